"""Light that a cover glass reflects twice interferes with passing light: fringes lie over a modulator or the picture.
Over the picture, fringes may also be a moiré of the sensor.

The glass is a weak etalon (Born & Wolf, Principles of Optics, 7.6). Its round trip 2·n·thickness varies over the area
by `path`, as the glass is a wedge; the number of fringes is path/λ, so that one wedge describes all wavelengths.

The phase of the fringes at one wavelength doesn't follow from that at another one: for that the thickness of the glass
would have to be known to a hundredth of a wave, and its dispersion. Their depth depends on coatings and on the width of
the laser's line. So both are free at each wavelength, stated as the cosine and the sine of one oscillation.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, ClassVar

from holoview.light.model.effects.effect import Effect, Needs, Parameter, StartKind, Values, half_circle
from holoview.light.model.system import System
from holoview.util.errors import UserError

if TYPE_CHECKING:
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import CameraContext, ModulatorContext


_ORDINALS = ("shortest", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth")
LASERS = len(_ORDINALS)
"""The largest number of wavelengths in captures or on a bench."""


_DEPTHS = tuple(f"{part}{number}" for number in range(1, LASERS + 1) for part in ("cos", "sin"))


def depth_parameters(centre: str) -> tuple[Parameter, ...]:
    """The parameters cos1, sin1 … cos8, sin8 of fringes whose phase is stated at a place, such as "the centre"."""
    return tuple(
        Parameter(
            f"{part}{number}",
            f"Depth of the fringes times the {name} of their phase in {centre}, at the {word} wavelength.",
            low=-0.5,
            high=0.5,
            prior=0.02,
            laser=number,
        )
        for number, word in enumerate(_ORDINALS, start=1)
        for part, name in (("cos", "cosine"), ("sin", "sine"))
    )


def fringe_depths(laser: int, v: Values) -> tuple[float, float]:
    """Cosine and sine at a laser, 0 for the shortest wavelength. Raises UserError beyond 8."""
    if laser >= LASERS:
        raise UserError("wavelengths", f"more than {LASERS}", expected=f"at most {LASERS}")
    return v[f"cos{laser + 1}"], v[f"sin{laser + 1}"]


def _wedge(of: str, least_y: float = -2e-3) -> tuple[Parameter, ...]:
    """The parameters path_y and path_x. of: the part over which the fringes lie. least_y: lower bound of path_y, m."""
    return tuple(
        Parameter(
            f"path_{axis}",
            f"By how much the round trip in the glass is longer at the {of}'s {last} edge than at its {first} edge.",
            "um",
            low=low,
            high=2e-3,
            prior=5e-6,
            modifies=_DEPTHS,
        )
        for axis, last, first, low in (("y", "lower", "upper", least_y), ("x", "right", "left", -2e-3))
    )


def wedge_starts(system: System) -> list[dict[str, float]]:
    """Points {parameter: value} of a few wedges, path_y and path_x, with weak fringes at every wavelength."""
    depths = {f"cos{number}": 0.02 for number in range(1, min(len(system.wavelengths_m), LASERS) + 1)}
    return [{**wedge, **depths} for wedge in half_circle("path_y", "path_x", 5e-6, 8)]


REFERENCE_M = 550e-9
"""The wavelength at which numbers of fringes are told."""


def describe_fringes(v: Values) -> dict[str, str]:
    """The fields depth, fringes_y and fringes_x of a finding; the numbers of fringes are those at 550 nm."""
    fringes = {f"fringes_{axis}": f"{abs(v[f'path_{axis}']) / REFERENCE_M:.3g}" for axis in ("y", "x")}
    return {"depth": _format_depths(v), **fringes}


def _format_depths(v: Values) -> str:
    """The smallest and the largest depth as text, of the wavelengths that have fringes."""
    depths = [math.hypot(v[f"cos{n}"], v[f"sin{n}"]) for n in range(1, LASERS + 1)]
    present = [depth for depth in depths if depth] or [0.0]
    low, high = (f"{depth:.2g}" for depth in (min(present), max(present)))
    return low if low == high else f"{low} … {high}"


class SlmFringes(Effect):
    """transmission t → t·(1 + ½·(c_λ + i·s_λ)·exp(iφ)), φ = 2π·(path_y·y + path_x·x)/(2λ), y and x from −1 to 1.

    The second of two beams passes the glass of a modulator once more to and fro. The light has fringes of depth c and
    phase, and so has its wavefront.

    modulator: 0 for the first.
    """

    modulator: ClassVar[int]
    finding = element_finding = (
        "Fringes of depth {depth} lie over {modulator}; {fringes_y} (y) and {fringes_x} (x) of them fit onto it at "
        "550 nm: the cover glass is a wedge."
    )
    parameters = (*_wedge("modulator"), *depth_parameters("the modulator's centre"))
    element_kinds = ("phase", "amplitude", "complex", "mask")
    element_id = "slm_fringes"
    start_kinds = (StartKind.MODULATOR_FRINGES,)

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """A few wedges; a diagnosis adds those of the fringes that it sees in the residuals."""
        return wedge_starts(system)

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        cos, sin = fringe_depths(context.laser, v)
        if not cos and not sin:
            return transmission
        y, x = context.positions(transmission)
        half_y, half_x = (n * context.pitch_m / 2 for n in context.whole_shape)
        phase = (math.pi / context.wavelength_m) * (v["path_y"] / half_y * y + v["path_x"] / half_x * x)
        real = (cos * phase.cos() - sin * phase.sin()) / 2
        imaginary = (cos * phase.sin() + sin * phase.cos()) / 2
        return transmission * (1 + real + 1j * imaginary)

    def cache_values(self, v: Values, laser: int) -> tuple[float, ...]:
        """The wedge, and the depth at this laser alone."""
        depths = fringe_depths(laser, v)
        return (v["path_y"], v["path_x"], *depths) if any(depths) else ()

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        return {**describe_fringes(v), "modulator": f"modulator {self.modulator + 1}"}


class Slm1Fringes(SlmFringes):
    """Fringes of the cover glass of modulator 1."""

    id = "slm1_fringes"
    cause = "The cover glass of modulator 1 reflects light twice, which interferes: fringes lie over the modulator."
    acts_on = ("modulator 1",)
    modulator = 0


class Slm2Fringes(SlmFringes):
    """Fringes of the cover glass of modulator 2."""

    id = "slm2_fringes"
    cause = "The cover glass of modulator 2 reflects light twice, which interferes: fringes lie over the modulator."
    acts_on = ("modulator 2",)
    needs = Needs(modulators=2, fourier=False)
    modulator = 1


class CameraFringes(Effect):
    """signal → signal·(1 + c_λ·cos φ − s_λ·sin φ), φ = 2π·(path_y·y + path_x·x)/(2λ), y and x from −1 to 1.

    Airy's function to first order in the reflectance, where φ is the phase of the round trip. The picture is linear in
    (c, s). φ and −φ are the same fringes, hence path_y ≥ 0. `achromatic` a replaces 1/λ by (1 − a)/λ + a/550 nm: a
    moiré of the sensor's pixels with a grid before them, such as its microlenses, has the same period at every
    wavelength.
    """

    id = "camera_fringes"
    cause = (
        "Fringes lie over the picture: the camera's cover glass reflects light twice, which interferes, or a grid "
        "before its pixels makes a moiré."
    )
    finding = (
        "Fringes of depth {depth} lie over the picture; {fringes_y} (y) and {fringes_x} (x) of them fit into it at "
        "{origin}."
    )
    parameters = (
        *_wedge("picture", least_y=0.0),
        *depth_parameters("the picture's centre"),
        Parameter(
            "achromatic",
            "From a wedge's fringes, whose number is path/λ, 0, to as many at every wavelength as at 550 nm, 1.",
            low=0.0,
            high=1.0,
            prior=0.1,
            secondary=True,
            modifies=_DEPTHS,
        ),
    )
    acts_on = ("camera",)
    start_kinds = (StartKind.CAMERA_FRINGES,)
    degenerate_limit = ("vignetting",)
    order = 3

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """A few wedges; a diagnosis adds those of the fringes that it sees in the residuals."""
        return wedge_starts(system)

    def image(self, image: Tensor, context: CameraContext, v: Values) -> Tensor:
        y, x = context.positions(image)
        waves_per_m = (1 - v["achromatic"]) / context.wavelength_m + v["achromatic"] / REFERENCE_M
        phase = math.pi * waves_per_m * (v["path_y"] * y + v["path_x"] * x)
        cos, sin = fringe_depths(context.laser, v)
        return image * (1 + cos * phase.cos() - sin * phase.sin())

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        wedge, moire = "550 nm: the cover glass is a wedge", "every wavelength: a moiré of the sensor with a grid"
        return {**describe_fringes(v), "origin": moire if v["achromatic"] > 0.5 else wedge}
