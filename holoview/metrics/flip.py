"""FLIP: the error that a person notices who flips between what a screen shows and what it should.

Colours are filtered by the contrast sensitivity of the eye at the given visual angle and compared in a space of equal
differences; edges and points that appear or vanish count more. 0 is no difference, 1 the largest: green beside blue.
The mean over all samples is the score that the authors recommend (P. Andersson, J. Nilsson, T. Akenine-Möller,
M. Oskarsson, K. Åström and M. D. Fairchild, "FLIP: A Difference Evaluator for Alternating Images", Proc. ACM Comput.
Graph. Interact. Tech. 3(2), 15 (2020)), computed by their own program.

This is FLIP for a low dynamic range: of encoded sRGB, clipped to 0…1 as a screen does it. Light beyond white, such as
bright grains of speckle, counts as white. Nothing is fitted: brightness counts as it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holoview.colour import gamut_map, srgb_encode
from holoview.metrics.plane_scores import PlaneScores, Stack, as_stacks
from holoview.util.errors import UserError
from holoview.util.optional_library import import_optional


def flip(image: ArrayLike, target: ArrayLike, samples_per_degree: float) -> PlaneScores:
    """Mean FLIP of linear sRGB images (y, x, 3) or stacks (plane, y, x, 3); 0 for equal ones.

    samples_per_degree: of visual angle, the more the finer detail must be to go unnoticed.

    Raises UserError when the shapes differ or aren't those of images, for an angle that isn't positive, and without the
    library flip-evaluator.
    """
    library = import_optional("flip_evaluator", "FLIP")
    if not samples_per_degree > 0:
        raise UserError("FLIP", f"{samples_per_degree:g} samples a degree", expected="a positive number")
    planes = tuple(
        float(library.evaluate(wanted, seen, "LDR", True, False, True, {"ppd": samples_per_degree})[1])
        for seen, wanted in zip(*(_signals(stack) for stack in as_stacks(image, target)), strict=True)
    )
    return PlaneScores(float(np.mean(planes)), planes)


def _signals(light: Stack) -> NDArray[np.float32]:
    """The display signals (plane, y, x, channel), 0…1, of light (plane, y, x, 3)."""
    return np.ascontiguousarray(srgb_encode(gamut_map(light)), dtype=np.float32)
