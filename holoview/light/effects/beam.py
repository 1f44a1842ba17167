"""The light falls on a part of the first modulator: a disc, a Gaussian beam or an ellipse, with a wavefront over it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from holoview.light.model.effects.effect import Effect, Parameter, Values
from holoview.light.model.system import System
from holoview.util.units import format_rounded

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import ModulatorContext

WAVEFRONT_TERMS = range(4, 12)  # Noll: defocus, astigmatism, coma, trefoil, spherical
_NAMES = {4: "defocus", 5: "astigmatism", 7: "coma", 9: "trefoil", 11: "spherical aberration"}
_DISC_EDGE = 2.0  # exponents above it are a disc in words
_MOST_WITHIN_PIXELS = 0.05
"""[rad] By which the light's phase may differ within pixels from that of their middles, r.m.s. over the light, and
count as even over them. Evidence: measured: at 0.09 to 0.14 images of small benches differ by 0.8 to 1.9 %, at 0.21 by
5.6 %."""
_SLOPE_POINTS = 32  # along each axis, at which the slope of the wavefront is looked at
_MOST_EXPONENT = 40.0  # of light that counts: 4e-18 of the amplitude; smaller numbers slow processors down a lot


def _term(noll: int) -> Parameter:
    return Parameter(
        f"z{noll}",
        f"Zernike term {noll} (Noll) of the light's wavefront, r.m.s. over the beam's circle.",
        "nm",
        low=-10e-6,
        high=10e-6,
        prior=100e-9,
        secondary=True,
    )


def _centre(name: str) -> Parameter:
    moved = ("size", *(f"z{noll}" for noll in WAVEFRONT_TERMS))
    doc = "Place of its centre, in half the modulator's longer side."
    return Parameter(name, doc, low=-2.0, high=2.0, prior=0.1, modifies=moved)


class BeamProfile(Effect):
    """amplitude = exp(−(size²·|E(r − centre)|²)^edge) · exp(2πi·W(r)/λ), r in half sides of the modulator, the longer.

    size is the half side over the radius at which the amplitude has fallen to 1/e; 0 is even light. edge 1 is a
    Gaussian beam, larger ones have a steeper edge, up to a disc. E stretches y by e^ellipse and x by its inverse. The
    wavefront W is a sum of Zernike terms over the beam's circle, or over that around the modulator if it is smaller,
    and goes on beyond it. Terms over the beam keep coma apart from the tilt that coma over a wider circle is there.
    Where it is steep, the light is sampled within pixels.
    """

    id = "beam"
    cause = "The light fills only a part of the first modulator, or has a wavefront of its own."
    finding = "The light on the modulator is {shape}{wavefront}."
    parameters = (
        Parameter(
            "size",
            "Half the modulator's longer side over the beam's radius (1/e of amplitude); 0: even light.",
            low=0.0,
            high=20.0,
            prior=0.5,
        ),
        Parameter(
            "edge",
            "Exponent of the edge: 1 Gaussian, 8 nearly a disc.",
            low=0.7,
            high=30.0,
            prior=1.0,
            identity=1.0,
            modifies=("size",),
        ),
        _centre("centre_y"),
        _centre("centre_x"),
        Parameter(
            "ellipse",
            "Half the logarithm of width over height.",
            low=-1.0,
            high=1.0,
            prior=0.2,
            secondary=True,
            modifies=("size",),
        ),
        *map(_term, WAVEFRONT_TERMS),
    )
    acts_on = ("source",)
    degenerate_with = ("source_profile",)  # which is a Gaussian beam, in fewer numbers
    varies_over_field = True
    order = 3  # it lights what the modulator leaves unmodulated too

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        return [{"size": size, "edge": edge} for size in (0.8, 1.2, 1.8, 2.6, 4.0) for edge in (1.0, 4.0)]

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        """`v` may hold tensors; the light is differentiable with respect to them. Each pixel has the light of its
        middle, unless the wavefront turns the phase within pixels by more than `_MOST_WITHIN_PIXELS`."""
        half_m = context.half_width()
        terms = {noll: v[f"z{noll}"] for noll in WAVEFRONT_TERMS if _is_varied(v[f"z{noll}"])}
        if not terms:
            return transmission * _amplitude(context.positions(transmission), v, half_m)
        centre_m = (v["centre_y"] * half_m, v["centre_x"] * half_m)
        radius_m = 1 / max(v["size"] / half_m, 1 / context.circle_radius())
        numbers = tuple((name, _number(value)) for name, value in v.items())
        pixels = replace(context, wavelength_m=0.0, stroke_m=0.0, laser=0, first_shown=None, shown=None)
        path_m = _path_within_pixels(pixels, numbers, tuple(terms), _number(radius_m))
        if path_m > _MOST_WITHIN_PIXELS / (2 * math.pi) * context.wavelength_m:
            transmission = context.sampled(transmission)
        light = transmission * _amplitude(context.positions(transmission), v, half_m)
        waves = context.zernike(transmission, terms, centre_m, radius_m) / context.wavelength_m
        return light * (2j * math.pi * waves.remainder(1.0)).exp()

    def radius_m(self, half_width_m: float, v: Values) -> float:
        """Radius of the beam, m; infinite for even light."""
        return half_width_m / v["size"] if v["size"] else math.inf

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        half_m = max(system.field_m) / 2
        shape = "even"
        if v["size"]:
            kind = "a disc" if v["edge"] > _DISC_EDGE else "a Gaussian beam"
            shape = f"{kind} of radius {format_rounded(self.radius_m(half_m, v), 'mm', 3)} (1/e of amplitude)"
            if v["centre_y"] or v["centre_x"]:
                y, x = (format_rounded(v[f"centre_{axis}"] * half_m, "mm", 3) for axis in "yx")
                shape += f", centred at y = {y}, x = {x}"
        sizes: dict[str, float] = {}
        for noll in WAVEFRONT_TERMS:
            name = _NAMES.get(noll) or _NAMES[noll - 1]
            sizes[name] = math.hypot(sizes.get(name, 0.0), v[f"z{noll}"])
        told = [f"{format_rounded(size, 'nm', 3)} of {name}" for name, size in sizes.items() if size > 1e-9]
        return {"shape": shape, "wavefront": f", with {', '.join(told)}" if told else ""}


@lru_cache(maxsize=64)
def _path_within_pixels(
    pixels: ModulatorContext, numbers: tuple[tuple[str, float], ...], terms: tuple[int, ...], radius_m: float
) -> float:
    """Deviation of the wavefront from that of the pixels' middles, m, r.m.s. over the light: its slope's over √12.

    numbers: of the beam. terms: of its wavefront. radius_m: of their circle.
    """
    v, half_m = dict(numbers), pixels.half_width()
    every = max(1, max(pixels.shape) // _SLOPE_POINTS)
    rows, columns = (max(2, count // every) for count in pixels.shape)
    few = replace(pixels, shape=(rows, columns), pitch_m=every * pixels.pitch_m, frame=None, upsample=1)
    light = _amplitude(few.positions(few.even()), v, half_m).square()[1:, 1:]
    centre_m = (v["centre_y"] * half_m, v["centre_x"] * half_m)
    path_m = few.zernike(few.even(), {noll: v[f"z{noll}"] for noll in terms}, centre_m, radius_m) / every
    slopes = path_m.diff(dim=0)[:, 1:].square() + path_m.diff(dim=1)[1:].square()
    return float(((light * slopes).sum() / light.sum().clamp(min=1e-300) / 12) ** 0.5)


def _amplitude(places: tuple[Tensor, Tensor], v: Mapping[str, Any], half_m: float) -> Tensor:
    """Of the light at places y (rows, 1) and x (1, columns), m."""
    y, x = (place - v[f"centre_{axis}"] * half_m for place, axis in zip(places, "yx", strict=True))
    stretch = (0.0 * y + v["ellipse"]).exp()
    square = ((y * stretch).square() + (x / stretch).square()) * (v["size"] / half_m) ** 2
    return (-((square + 1e-12) ** v["edge"]).clamp(max=_MOST_EXPONENT)).exp()


def _number(value: Any) -> float:
    """A number that may be a tensor, without its derivative."""
    return float(value if isinstance(value, float | int) else value.detach())


def _is_varied(value: Any) -> bool:
    """Whether a term may be other than 0: a tensor is a number that a fit varies."""
    return not isinstance(value, float | int) or value != 0
