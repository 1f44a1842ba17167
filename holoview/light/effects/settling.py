"""Modulators in time: a part of the pattern before that remains, and a phase that ripples within an exposure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from holoview.light.model.effects.effect import Effect, ExposureSample, Parameter, Values
from holoview.light.model.elements import PhaseModulator
from holoview.light.model.system import System

if TYPE_CHECKING:
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import ModulatorContext


_SHARES = (-0.1, 0.05, 0.1, 0.2, 0.3, 0.5)


class Settling(Effect):
    """Fraction of the stroke = (1 − share)·now + share·before: exponential relaxation, share = exp(−time/constant).

    Before is the frame before, of several that repeat, or the capture before in the order of the file, whose first
    capture has none. To first order in the step, a nematic cell relaxes like this, with the time constant of its
    viscosity (Yang & Wu, Fundamentals of Liquid Crystal Devices, 2nd ed., 5.4). A negative share is that of overdrive,
    which goes beyond the target.
    """

    id = "settling"
    cause = "The modulators are seen before they have settled: a part of the pattern before remains."
    finding = "Of the pattern before, {remaining} remains on the modulators."
    parameters = tuple(
        Parameter(
            f"share{number}",
            f"Share of the pattern before on modulator {number}.",
            low=-0.5,
            high=0.95,
            prior=0.05,
            acts_on=f"modulator {number}",
        )
        for number in (1, 2)
    )
    acts_on = ("modulator 1", "modulator 2")
    element_kinds = ("phase", "amplitude")

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """Both modulators alike, and each alone."""
        alike = [{"share1": share, "share2": share} for share in _SHARES]
        alone = [{name: share} for name in ("share1", "share2") for share in _SHARES]
        return alike + alone if len(system.modulators) == 2 else alone[: len(_SHARES)]

    def element_starts(self, parameters: tuple[Parameter, ...]) -> list[dict[str, float]]:
        return [{"share": share} for share in _SHARES]

    def settled_share(self, share: Tensor, before: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        remaining = v[f"share{context.number + 1}"]
        return share + remaining * (before - share) if remaining else share

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        shares = [f"{v[f'share{number}']:.3g}" for number in range(1, len(system.modulators) + 1)]
        return {"remaining": " and ".join(dict.fromkeys(shares))}


_LEAST_SAMPLES = 7
_COUNTED_WAVES = 4  # full drive of both modulators together, in wavelengths, up to which the samples suffice


class Flicker(Effect):
    """phase → phase · (1 + √2·depth·cos φ), averaged in intensity over a cycle of φ.

    Light of two pixels whose phases differ by a·cos φ interferes in the mean as J₀(a) says. The mean of N equal steps
    of half a cycle errs by 2·J_2N(a), below 10⁻⁴ where N ≥ a/2 + 1.7·a^(1/3) + 1 (Abramowitz & Stegun, 9.1.44, 9.3.1).
    N is chosen for the largest a of modulators with a full drive of 4 wavelengths together, √2·depth·2π·4.
    """

    id = "flicker"
    cause = "The modulators' phase ripples within an exposure (flicker of digital drive)."
    finding = "The modulators' phase ripples by {depth} of itself (r.m.s.) within an exposure."
    parameters = (
        Parameter(
            "depth",
            "Relative r.m.s. ripple of the phase.",
            low=0.0,
            high=0.5,
            prior=0.05,
            scan=(0.03, 0.3, 0.03),
            even_symmetric=True,
        ),
    )
    acts_on = ("modulator 1", "modulator 2")
    on_chain = ("phase",)

    def exposure_samples(self, v: Values) -> Sequence[ExposureSample]:
        count = _sample_count(v["depth"])
        angles = [math.pi * (k + 0.5) / count for k in range(count)]
        return [(1 / count, 1 + math.sqrt(2) * v["depth"] * math.cos(angle)) for angle in angles]

    def sample_phase(self, system: System, v: Values) -> float:
        """Of a pixel at either end of the stroke relative to one in its middle, in the fastest part of the cycle."""
        waves = sum(e.stroke_m for e in system.elements if isinstance(e, PhaseModulator)) / float(
            system.wavelengths_m.min()
        )
        return math.pi / _sample_count(v["depth"]) * _amplitude(v["depth"], waves) / 2


def _amplitude(depth: float, waves: float) -> float:
    """How far the phase between no drive and full drive, which adds so many wavelengths, goes from its mean, rad."""
    return math.sqrt(2) * depth * 2 * math.pi * waves


def _sample_count(depth: float) -> int:
    """The samples of half a cycle; the other half has the same. Odd: the one in the middle has the nominal phase."""
    amplitude = _amplitude(depth, _COUNTED_WAVES)
    return max(_LEAST_SAMPLES, math.ceil(amplitude / 2 + 1.7 * amplitude ** (1 / 3) + 1)) | 1
