"""ColorVideoVDP: how much worse than its target an image looks, in just-objectionable differences (JOD).

10 JOD are no visible difference. Of two images that are 1 JOD apart, 75 % of people prefer the better one; strong
errors may lead below 0. The metric filters light by the contrast sensitivity of the eye for luminance and colour, at
its visual angle and absolute luminance, and lets structure mask errors (R. K. Mantiuk, P. Hanji, M. Ashraf, Y. Asano
and A. Chapiro, "ColorVideoVDP: A visual difference predictor for image, video and display distortions", ACM Trans.
Graph. 43(4), 129 (2024)). It is computed by its authors' program, as for a still image.

The light itself is compared, as XYZ in cd/m², without a screen between: grains of speckle that are brighter than white
and colours outside sRGB count as they are. Two things are approximate: holoview's XYZ is the eye's XYZ_F of cone
fundamentals, which the metric takes for CIE 1931 XYZ; and the metric was fitted to judgements of pictures on screens,
with few images of lasers and speckle among them. Its pyramid needs images of 16 rows and columns, and its coarsest band
depends on the size: values of images of different sizes can't be compared.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike

from holoview.colour import SRGB_TO_XYZ
from holoview.metrics.plane_scores import PlaneScores, Stack, as_stacks
from holoview.util.errors import UserError
from holoview.util.optional_library import import_optional

WHITE_CD_M2 = 100.0
"""Luminance of the display's white, Y = 1, unless another one is given."""

MIN_SIDE = 16
"""Least number of rows and columns of an image."""

_BLACK_CD_M2 = 0.005  # the least light that the metric's own model of a display gives


def color_video_vdp(
    image: ArrayLike, target: ArrayLike, samples_per_degree: float, white_cd_m2: float = WHITE_CD_M2
) -> PlaneScores:
    """JOD of linear sRGB images (y, x, 3) or stacks (plane, y, x, 3), not clipped; 10 for equal ones.

    samples_per_degree: of visual angle. white_cd_m2: luminance of Y = 1, on which depends what can be seen.

    Raises UserError when the shapes differ or aren't those of images, for images with fewer than 16 rows or columns, an
    angle or a luminance that isn't positive, and without the library cvvdp.
    """
    library = import_optional("pycvvdp", "ColorVideoVDP")
    if not (samples_per_degree > 0 and white_cd_m2 > 0):
        found = f"{samples_per_degree:g} samples a degree, white of {white_cd_m2:g} cd/m²"
        raise UserError("ColorVideoVDP", found, expected="positive numbers")
    stacks = as_stacks(image, target)
    rows, columns = stacks[0].shape[1:3]
    if min(rows, columns) < MIN_SIDE:
        expected = f"at least {MIN_SIDE} rows and columns for ColorVideoVDP"
        raise UserError("image", f"{columns} x {rows} samples", expected=expected)
    metric = library.cvvdp(
        display_photometry=_light_itself(library),
        display_geometry=library.vvdp_display_geometry((columns, rows), ppd=samples_per_degree),
        quiet=True,
    )
    seen, wanted = (_absolute_xyz(stack, white_cd_m2) for stack in stacks)
    with torch.inference_mode():
        pairs = zip(seen, wanted, strict=True)
        planes = tuple(float(metric.predict(one, other, dim_order="CHW")[0]) for one, other in pairs)
    return PlaneScores(float(np.mean(planes)), planes)


def _absolute_xyz(light: Stack, white_cd_m2: float) -> torch.Tensor:
    """XYZ in cd/m² (plane, channel, y, x) of linear sRGB (plane, y, x, 3)."""
    xyz = np.maximum(white_cd_m2 * (light @ SRGB_TO_XYZ.T), _BLACK_CD_M2)
    return torch.from_numpy(np.ascontiguousarray(np.moveaxis(xyz, -1, 1), dtype=np.float32))


def _light_itself(library: Any) -> Any:
    """A model of a display for the metric that passes XYZ in cd/m² on as it is."""

    class LightItself(library.vvdp_display_photometry):  # type: ignore[misc]
        rgb2xyz_list = np.eye(3).tolist()

        def __init__(self) -> None:
            self.short_name = "light itself"

        def forward(self, xyz: torch.Tensor) -> torch.Tensor:
            return xyz

        def is_input_display_encoded(self) -> bool:
            return False

    return LightItself()
