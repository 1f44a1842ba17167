"""Light that the camera's cover glass reflects twice interferes with what passes: fringes lie over the picture."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from holoview.effects.starting_grids import half_circle
from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System
from holoview.util.errors import UserError

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.model.effects.hook_contexts import CameraContext

_LASERS = 8


def _quadratures() -> tuple[Parameter, ...]:
    ordinals = ("shortest", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth")
    return tuple(
        Parameter(
            f"{part}{number}",
            f"Depth of the fringes times the {name} of their phase in the picture's centre, at the {word} wavelength.",
            low=-0.5,
            high=0.5,
            prior=0.02,
        )
        for number, word in enumerate(ordinals, start=1)
        for part, name in (("cos", "cosine"), ("sin", "sine"))
    )


class CameraFringes(Effect):
    """signal → signal·(1 + c_λ·cos φ − s_λ·sin φ), φ = 2π·(path_y·y + path_x·x)/(2λ), y and x from −1 to 1.

    The plate is a weak etalon of Airy's function to first order in its reflectance (Born & Wolf, Principles of Optics,
    7.6): φ is the phase of the round trip, whose length 2·n·thickness varies over the picture by `path`, as the plate
    is a wedge. So the number of fringes is path/λ, and one wedge describes all wavelengths. The phase in the centre
    can't be derived from it: it would take the thickness to a hundredth of a wave and the dispersion of the glass; nor
    can the depth, which coatings and the width of the laser's line decide. Both are free at each wavelength, stated as
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
        *_quadratures(),
    )
    acts_on = ("camera",)
    order = 3

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """A few wedges; a diagnosis adds those of the fringes that it sees in the residuals."""
        depths = {f"cos{number}": 0.02 for number in range(1, _LASERS + 1)}
        return [{**wedge, **depths} for wedge in half_circle("path_y", "path_x", 5e-6, 8)]

    def image(self, image: Tensor, context: CameraContext, v: Values) -> Tensor:
        if context.laser >= _LASERS:
            raise UserError(
                f"effects.{self.id}",
                f"there are more than {_LASERS} wavelengths",
                expected=f"at most {_LASERS} in a session",
            )
        y, x = context.positions(image)
        phase = (math.pi / context.wavelength_m) * (v["path_y"] * y + v["path_x"] * x)
        cos, sin = (v[f"{part}{context.laser + 1}"] for part in ("cos", "sin"))
        return image * (1 + cos * phase.cos() - sin * phase.sin())

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        depths = [math.hypot(v[f"cos{n}"], v[f"sin{n}"]) for n in range(1, _LASERS + 1)]
        present = [depth for depth in depths if depth] or [0.0]
        low, high = (f"{depth:.2g}" for depth in (min(present), max(present)))
        fringes = {f"fringes_{axis}": f"{abs(v[f'path_{axis}']) / 550e-9:.3g}" for axis in ("y", "x")}
        return {"depth": low if low == high else f"{low} … {high}", **fringes}
