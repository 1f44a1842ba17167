"""Light that the camera's cover glass reflects twice interferes with what passes: fringes lie over the picture."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from holoview.effects.fringe_depths import depth_parameters, describe_fringes, fringe_depths, wedge_starts
from holoview.model.effects.effect import Effect, StartKind
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.model.effects.hook_contexts import CameraContext


class CameraFringes(Effect):
    """signal → signal·(1 + c_λ·cos φ − s_λ·sin φ), φ = 2π·(path_y·y + path_x·x)/(2λ), y and x from −1 to 1.

    The plate is a weak etalon of Airy's function to first order in its reflectance (Born & Wolf, Principles of Optics,
    7.6): φ is the phase of the round trip, whose length 2·n·thickness varies over the picture by `path`, as the plate
    is a wedge. So the number of fringes is path/λ, and one wedge describes all wavelengths. The phase in the centre
    can't be derived from it, nor can the depth (`fringe_depths` says why). Both are free at each wavelength, stated as
    cosine and sine of one oscillation, in which the picture is linear. φ and −φ are the same fringes, hence path_y ≥ 0.
    """

    id = "camera_fringes"
    cause = "The camera's cover glass reflects light twice, which interferes: fringes lie over the picture."
    finding = (
        "Fringes of depth {depth} lie over the picture; {fringes_y} (y) and {fringes_x} (x) of them fit into it at "
        "550 nm: the cover glass is a wedge."
    )
    parameters = (
        Parameter(
            "path_y",
            "By how much the round trip in the glass is longer at the picture's lower edge than at its upper edge.",
            "um",
            low=0.0,
            high=2e-3,
            prior=5e-6,
        ),
        Parameter(
            "path_x",
            "By how much the round trip in the glass is longer at the picture's right edge than at its left edge.",
            "um",
            low=-2e-3,
            high=2e-3,
            prior=5e-6,
        ),
        *depth_parameters("the picture's centre"),
    )
    start_kinds = (StartKind.CAMERA_FRINGES,)
    acts_on = ("camera",)
    imitates = ("vignetting",)
    order = 3

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """A few wedges; a diagnosis adds those of the fringes that it sees in the residuals."""
        return wedge_starts()

    def image(self, image: Tensor, context: CameraContext, v: Values) -> Tensor:
        y, x = context.positions(image)
        phase = (math.pi / context.wavelength_m) * (v["path_y"] * y + v["path_x"] * x)
        cos, sin = fringe_depths(self.id, context.laser, v)
        return image * (1 + cos * phase.cos() - sin * phase.sin())

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        return describe_fringes(v)
