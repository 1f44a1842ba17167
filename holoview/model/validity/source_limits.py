"""Light that the observer hardly sees, and lines and sources that their samples don't resolve."""

from __future__ import annotations

import math

import numpy as np

from holoview.colour import observer_weights
from holoview.model.effects.active_effects import ActiveEffects
from holoview.model.plan import Plan
from holoview.model.validity.limit import Limit, Measured
from holoview.model.validity.sampling_limits import lit_wavelengths
from holoview.util import units

_LEAST_RESPONSE = 0.5 / 255 / 12.92  # half a level of 8 bits on the linear part of sRGB's curve
_VISIBLE_M = np.arange(390e-9, 831e-9, 5e-9)


def _response(plan: Plan) -> Measured | None:
    observer = plan.system.observer
    if observer == "mono":
        return None
    λ = lit_wavelengths(plan)
    strongest = np.abs(observer_weights(observer, _VISIBLE_M)).max(axis=0)
    responses = (np.abs(observer_weights(observer, λ)) / strongest).max(axis=1)
    dimmest = int(np.argmin(responses))
    return Measured(
        float(responses[dimmest]),
        f"{units.format_rounded(float(λ[dimmest]), 'nm')} excites the observer with {responses[dimmest]:.1e} of the "
        "strongest response: it adds nothing to the picture that is seen",
        "wavelengths",
        'choose another wavelength, or observer = "mono"',
    )


OBSERVER = Limit(
    name="observer's response",
    quantity="the largest of X, Y, Z at the wavelength that is seen worst, in that of the wavelength seen best",
    reason="half a level of 8-bit sRGB next to black, 1/(2·255·12.92): less changes no pixel even of a dark picture",
    measure=_response,
    at_least=_LEAST_RESPONSE,
)


def _sample_phase(plan: Plan) -> Measured | None:
    active = ActiveEffects(plan.nominal.effect_values)
    steps = [(effect.sample_phase(plan.nominal, values), effect.id) for effect, values in active.pairs]
    if not steps or max(steps)[0] == 0.0:
        return None
    phase, name = max(steps)
    return Measured(
        phase,
        f"neighbouring samples of {name} differ by {phase:.3g} rad at the edge of the first order: they make separate "
        "speckle patterns where a continuum blurs them",
        f"effects.{name}",
        "narrow the line or the source, or shorten the distances",
    )


CONTINUUM = Limit(
    name="samples of lines and sources",
    quantity="phase between neighbouring samples of a broad line or an extended source, rad",
    reason="half a fringe: a sum of samples holds a continuum's interference up to π between them (Nyquist)",
    measure=_sample_phase,
    at_most=math.pi,
)
