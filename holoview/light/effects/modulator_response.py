"""The modulators' response: the optical path of full drive, of each level, and at each wavelength."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, ClassVar

from holoview.light.model.effects.effect import Effect, Needs, Parameter, Values
from holoview.light.model.system import System
from holoview.light.numerics.sampling import knot_interval, power_law
from holoview.util.units import format_rounded

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import ModulatorContext


# --- full drive: its size, and how it varies over the modulators ------------------------------------------------------


class Stroke(Effect):
    """stroke → stroke·(1 + stroke_error ± difference), + for the first modulator and − for the second.

    The same everywhere on a modulator: the mean of a `stroke_map`.
    """

    id = "stroke"
    cause = "The modulators' stroke (the optical path of full drive) isn't its nominal value."
    finding = "The stroke is {strokes}, not {nominal}."
    parameters = (
        Parameter(
            "stroke_error", "Relative error of the stroke.", low=-0.9, high=2.0, prior=0.1, scan=(-0.5, 0.5, 0.05)
        ),
        Parameter(
            "difference",
            "Half the relative difference of the two strokes.",
            low=-0.5,
            high=0.5,
            prior=0.05,
            secondary=True,
            acts_on="modulator 2",
        ),
    )
    acts_on = ("modulator 1", "modulator 2")
    element_kinds = ("phase",)
    degenerate_with: ClassVar = ("stroke_map",)

    def actual_system(self, system: System, v: Values) -> System:
        modulators = tuple(
            dataclasses.replace(m, stroke_m=m.stroke_m * (1 + v["stroke_error"] + sign * v["difference"]))
            for m, sign in zip(system.modulators, (1, -1), strict=False)
        )
        return dataclasses.replace(system, modulators=modulators)

    def actual_element(self, system: System, element: str, v: Values) -> System:
        index = system.part(element)
        stroke_m = system.elements[index].stroke_m  # type: ignore[attr-defined]  # of a phase modulator
        return system.edit({f"elements.{index}.stroke": stroke_m * (1 + v["stroke_error"])})

    def finding_fields(self, system: System, v: Values) -> Mapping[str, str]:
        strokes = [format_rounded(m.stroke_m, "nm") for m in self.actual_system(system, v).modulators]
        return {
            "strokes": " and ".join(dict.fromkeys(strokes)),
            "nominal": format_rounded(system.modulators[0].stroke_m, "nm"),
        }


_TERMS = range(1, 7)  # Noll: mean, slope along x, slope along y, bow, two saddles
_COMMON = (1, 2, 3, 4)


def _terms(modulator: int) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(
            f"z{noll}_{modulator}",
            f"Zernike term {noll} (Noll) of modulator {modulator}'s relative stroke, r.m.s. over the circle around it.",
            low=-0.5,
            high=0.5,
            prior=0.03,
            scan=(-0.15, 0.15, 0.05) if noll in _COMMON else None,
            secondary=noll not in _COMMON,
            acts_on=f"modulator {modulator}",
        )
        for noll in _TERMS
    )


class StrokeMap(Effect):
    """opd → opd · (1 + Σ_j c_j·Z_j) over the circle around the modulator.

    The phase of a level is proportional to the thickness of the liquid crystal, which is that of the cell, and to its
    birefringence, which falls with the temperature (Xun & Cohn, Appl. Opt. 43, 6400 (2004), for measured maps). A bow
    changes the mean too, which alone is `stroke`; a wavefront that doesn't depend on the level is `slm_flatness`.
    """

    id = "stroke_map"
    cause = "A modulator's stroke varies over its area (thickness or temperature of the liquid crystal)."
    finding = "The stroke varies over the modulators: {rms} r.m.s. of itself."
    parameters = (*_terms(1), *_terms(2))
    acts_on = ("modulator 1", "modulator 2")
    element_kinds = ("phase",)
    varies_over_field = True
    degenerate_with: ClassVar = ("stroke",)

    def optical_path(self, path_m: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        terms = {noll: value for noll in _TERMS if (value := v[f"z{noll}_{context.number + 1}"])}
        return path_m * (1 + context.zernike(path_m, terms)) if terms else path_m

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        squares = [sum(v[f"z{noll}_{m + 1}"] ** 2 for noll in _TERMS[1:]) for m in range(len(system.modulators))]
        parts = [f"{100 * square**0.5:.2g} % (modulator {m})" for m, square in enumerate(squares, start=1) if square]
        return {"rms": " and ".join(parts) or "0 %"}


# --- the table of levels ----------------------------------------------------------------------------------------------


_STEPS = 15  # intervals between knots at 0, 1/15, …, 1 of the drive, the levels of a modulator with 16
_GAMMAS = (0.45, 0.55, 0.67, 0.82, 1.22, 1.49, 1.82, 2.23)  # e^±0.2 … e^±0.8


def _knots(modulator: int) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(
            f"level{modulator}_{k:02d}",
            f"Added by modulator {modulator} at {k}/{_STEPS} of the drive, as a share of the stroke.",
            low=-0.6,
            high=0.6,
            prior=0.05,
            secondary=True,
            acts_on=f"modulator {modulator}",
        )
        for k in range(1, _STEPS + 1)
    )


def _gamma(modulator: int) -> Parameter:
    doc, part = f"Exponent of modulator {modulator}'s response.", f"modulator {modulator}"
    return Parameter(f"gamma{modulator}", doc, low=0.2, high=5.0, prior=0.2, identity=1.0, acts_on=part)


class Lut(Effect):
    """Fraction of the stroke = drive^gamma + a correction that is linear between free knots.

    Where the correction would make the response fall at a knot, it stays constant instead. Each modulator has its own
    gamma and knots; the nominal response is the straight line.
    """

    id = "lut"
    cause = "The modulators' levels aren't equal steps of optical path: their look-up table is wrong."
    finding = "Half drive gives {half} of the stroke, not 0.5."
    parameters = (
        _gamma(1),
        _gamma(2),
        *_knots(1),
        *_knots(2),
    )
    acts_on = ("modulator 1", "modulator 2")
    element_kinds = ("phase",)

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """Both modulators with the same gamma, and each alone."""
        alike = [{"gamma1": g, "gamma2": g} for g in _GAMMAS]
        alone = [{name: g} for name in ("gamma1", "gamma2") for g in _GAMMAS]
        return alike + alone if len(system.modulators) == 2 else alone[: len(_GAMMAS)]

    def element_starts(self, parameters: tuple[Parameter, ...]) -> list[dict[str, float]]:
        return [{"gamma": gamma} for gamma in _GAMMAS]

    def stroke_response(self, share: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        number = context.number + 1
        gamma = v[f"gamma{number}"]
        curved = power_law(share, gamma)
        added = [0.0, *(v[f"level{number}_{k:02d}"] for k in range(1, _STEPS + 1))]
        if not any(added):
            return curved
        knots = share.new_tensor([(k / _STEPS) ** gamma for k in range(_STEPS + 1)])
        rising = (knots + share.new_tensor(added)).cummax(dim=0).values
        correction = rising - knots
        index, fraction = knot_interval(share, _STEPS)
        return curved + correction[index] * (1 - fraction) + correction[index + 1] * fraction

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        halves = []
        for number in range(1, len(system.modulators) + 1):
            low, high = (v[f"level{number}_{k:02d}"] for k in (7, 8))
            halves.append(f"{0.5 ** v[f'gamma{number}'] + (low + high) / 2:.2f}")
        return {"half": " and ".join(dict.fromkeys(halves))}


# --- the wavelength: the size of the path, and the shape of the table -------------------------------------------------


_REFERENCE_M = 550e-9  # wavelength at which slopes and curvature don't count
_SLOPE_UNIT_M = 100e-9  # change of wavelength for which they are given


class Dispersion(Effect):
    """opd(λ) = opd · (1 + offset + slope·x + curvature·x²), x = (550 nm − λ)/100 nm.

    The birefringence of liquid crystals is larger at short wavelengths, so that slope > 0 (Cauchy's formula; Li et al.,
    J. Disp. Technol. 1, 51 (2005)).
    """

    id = "dispersion"
    cause = "The modulators' optical path depends on the wavelength (dispersion of the liquid crystal)."
    finding = "The modulators' optical path changes with the wavelength: {blue} at 450 nm against 550 nm."
    parameters = (
        Parameter(
            "slope", "Relative rise of the path for each 100 nm.", low=-0.8, high=0.8, prior=0.1, scan=(-0.3, 0.3, 0.05)
        ),
        Parameter("curvature", "Its quadratic part.", low=-0.5, high=0.5, prior=0.03, secondary=True),
        Parameter("offset", "Relative error of the path at 550 nm.", low=-0.5, high=0.5, prior=0.05, secondary=True),
    )
    acts_on = ("modulator 1", "modulator 2")
    element_kinds = ("phase", "mask")
    needs = Needs(wavelengths=2)

    def optical_path(self, path_m: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        return path_m * self.path_factor(context.wavelength_m, v)

    def path_factor(self, wavelength_m: float, v: Values) -> float:
        """The factor of the nominal optical path."""
        x = (_REFERENCE_M - wavelength_m) / _SLOPE_UNIT_M
        return 1 + v["offset"] + v["slope"] * x + v["curvature"] * x * x

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        return {"blue": f"{(self.path_factor(450e-9, v) / self.path_factor(_REFERENCE_M, v) - 1) * 100:+.1f} %"}


_LOWEST = 0.05  # of the exponent
_SEARCHED = (-0.3, -0.2, -0.1, 0.1, 0.2, 0.3)


def _of_modulator(number: int) -> tuple[Parameter, Parameter]:
    return (
        Parameter(
            f"slope{number}",
            f"Rise of the exponent of modulator {number} for each 100 nm.",
            low=-0.6,
            high=0.6,
            prior=0.1,
            acts_on=f"modulator {number}",
        ),
        Parameter(
            f"offset{number}",
            f"Exponent of modulator {number} at 550 nm, minus 1.",
            low=-0.7,
            high=2.0,
            prior=0.1,
            secondary=True,
            acts_on=f"modulator {number}",
        ),
    )


class LutDispersion(Effect):
    """Fraction of the stroke → fraction^γ(λ), γ = 1 + offset + slope·x ≥ 0.05, x = (550 nm − λ)/100 nm.

    A table is made at one wavelength. The path of a level follows from the liquid crystal's tilt at its voltage; tilted
    and untilted layers disperse differently, so that a table that is linear at one wavelength is curved at others (Li
    et al., J. Disp. Technol. 1, 51 (2005), for the dispersion). `dispersion` changes the path of full drive, `lut` the
    shape at all wavelengths alike; this is the shape that differs between wavelengths.
    """

    id = "lut_dispersion"
    cause = "The shape of the modulators' look-up table depends on the wavelength."
    finding = "Half drive gives {blue} of the stroke at 450 nm and {red} at 650 nm, not 0.5."
    parameters = (*_of_modulator(1), *_of_modulator(2))
    acts_on = ("modulator 1", "modulator 2")
    element_kinds = ("phase",)
    needs = Needs(wavelengths=2)

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """Both modulators alike, and each alone."""
        alone = [{f"slope{n + 1}": slope} for n in range(len(system.modulators)) for slope in _SEARCHED]
        alike = [{"slope1": slope, "slope2": slope} for slope in _SEARCHED]
        return alike + alone if len(system.modulators) == 2 else alone

    def element_starts(self, parameters: tuple[Parameter, ...]) -> list[dict[str, float]]:
        return [{"slope": slope} for slope in _SEARCHED]

    def stroke_response(self, share: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        return power_law(share, self.exponent(context.number, context.wavelength_m, v))

    def exponent(self, modulator: int, wavelength_m: float, v: Values) -> float:
        """γ of modulator 0 or 1 at a wavelength."""
        x = (_REFERENCE_M - wavelength_m) / _SLOPE_UNIT_M
        return max(1 + v[f"offset{modulator + 1}"] + v[f"slope{modulator + 1}"] * x, _LOWEST)

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        def halves(wavelength_m: float) -> str:
            texts = [f"{0.5 ** self.exponent(n, wavelength_m, v):.2f}" for n in range(len(system.modulators))]
            return " and ".join(dict.fromkeys(texts))

        return {"blue": halves(450e-9), "red": halves(650e-9)}
