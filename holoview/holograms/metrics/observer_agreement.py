"""How differently people see the light of lasers: CIEDE2000 between each of them and their average.

A person i sees XYZ_i = Σ_λ I_λ·w_i(λ), the average person Σ_λ I_λ·w̄(λ) with the mean w̄ of all people's weights. Colours
are those of patches, as people don't judge the colour of a grain of speckle. Two adaptations bracket what happens:

    daylight    to each person light of equal energy is white, as it is beside a window (`holoview.light.colour`)
    display     the white that the lasers make is white to each person: X, Y and Z are divided by those of it
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.metrics.fidelity import delta_e_map_xyz
from holoview.light.colour import D65_WHITE, observer_weights, white_amplitudes
from holoview.util.errors import UserError

Floats = NDArray[np.float64]

PATCH = 8
"""Samples each way of a patch."""


@dataclass(frozen=True)
class Disagreement:
    """CIEDE2000 from the average of all people, for each of them (person,).

    daylight, display: means over the patches of the picture, in either adaptation. white: of the lasers' white, in
    daylight.
    """

    daylight: Floats
    display: Floats
    white: Floats


def people_weights(people: Sequence[str], wavelengths_m: NDArray[np.floating]) -> Floats:
    """XYZ (person, wavelength, 3) of unit intensity."""
    return np.stack([observer_weights(person, wavelengths_m) for person in people])


def disagreement(
    intensity: NDArray[np.floating], wavelengths_m: NDArray[np.floating], people: Sequence[str], patch: int = PATCH
) -> Disagreement:
    """How differently people see an image. intensity: (wavelength, y, x).

    Raises UserError for fewer than two people, and for an image that is smaller than a patch.
    """
    if len(people) < 2:
        raise UserError("observers", str(len(people)), expected="2 or more")
    rows, columns = (size // patch for size in intensity.shape[1:])
    if not (rows and columns):
        found = f"{intensity.shape[2]} × {intensity.shape[1]} samples"
        raise UserError("image", found, expected=f"at least {patch} × {patch}, a patch")
    cut = np.asarray(intensity, dtype=np.float64)[:, : rows * patch, : columns * patch]
    light = cut.reshape(len(cut), rows, patch, columns, patch).mean(axis=(2, 4)).reshape(len(cut), -1)
    weights = people_weights(people, wavelengths_m)
    lasers_white = white_amplitudes(observer_weights("eye", wavelengths_m), np.ones((1, len(cut))))[0]
    seen, white = np.einsum("lp,olc->opc", light, weights), np.einsum("l,olc->oc", lasers_white, weights)
    own, mean_white = seen * (D65_WHITE / white)[:, None], white.mean(axis=0)
    average, own_average = seen.mean(axis=0), seen.mean(axis=0) * (D65_WHITE / mean_white)
    daylight = delta_e_map_xyz(seen, np.broadcast_to(average, seen.shape))
    display = delta_e_map_xyz(own, np.broadcast_to(own_average, own.shape))
    return Disagreement(
        daylight.mean(axis=1), display.mean(axis=1), delta_e_map_xyz(white, np.broadcast_to(mean_white, white.shape))
    )
