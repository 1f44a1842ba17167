"""An eye whose pupil lies beside the eyebox, or beyond the directions that the samples hold."""

from __future__ import annotations

import numpy as np

from holoview.model.eye import Eye
from holoview.model.plan import Plan
from holoview.model.validity.limit import Limit, Measured
from holoview.model.validity.sampling_limits import lit_wavelengths
from holoview.util import units

_LEAST_SHARE = 0.01
_CHORDS = 200  # across the pupil: the area of their part in the square is right to 1e-3 of the pupil's


def pupil_share(eye: Eye, pupil_na: float, half_side: float) -> float:
    """Share of a pupil's area that lies in the square |s_y|, |s_x| ≤ half_side of direction sines."""
    y, x = eye.pupil_centre_na
    heights = pupil_na * ((np.arange(_CHORDS) + 0.5) / _CHORDS * 2 - 1)
    half_chords = np.sqrt(pupil_na**2 - heights**2)
    left, right = np.maximum(x - half_chords, -half_side), np.minimum(x + half_chords, half_side)
    inside = np.where(np.abs(y + heights) <= half_side, np.maximum(right - left, 0.0), 0.0)
    return float(inside.sum() / (2 * half_chords).sum())


def _worst_share(plan: Plan, orders: float) -> tuple[float, float] | None:
    """The smallest share of the pupil in a square of so many first orders, and its wavelength; None without an eye."""
    if not plan.eyes:
        return None
    pitch_m, field_m = plan.system.modulators[0].pitch_m, plan.nominal.field_m
    return min(
        (pupil_share(eye, eye.pupil_na(field_m), orders * λ / (2 * pitch_m)), λ)
        for eye in dict.fromkeys(plan.eyes)
        for λ in lit_wavelengths(plan).tolist()
    )


def _in_eyebox(plan: Plan) -> Measured | None:
    worst = _worst_share(plan, 1.0)
    if worst is None:
        return None
    share, λ = worst
    return Measured(
        share,
        f"{share:.1%} of the pupil lie in the eyebox of {units.format_rounded(λ, 'nm')}: the eye sees this light by "
        "higher orders only, and dimly",
        "eye.pupil_y, eye.pupil_x",
        "move the pupil towards the middle of the eyebox",
    )


EYEBOX = Limit(
    name="pupil beside the eyebox",
    quantity="share of the pupil in the eyebox of the first order, at the worst wavelength",
    reason="outside, only higher orders arrive, whose strength depends on the real pixels' shape",
    measure=_in_eyebox,
    at_least=_LEAST_SHARE,
)


def _in_samples(plan: Plan) -> Measured | None:
    worst = _worst_share(plan, float(plan.grid.upsample))
    if worst is None:
        return None
    share, λ = worst
    return Measured(
        share,
        f"the samples hold the light of {share:.0%} of the pupil at {units.format_rounded(λ, 'nm')}; that of the rest "
        "isn't computed",
        "eye",
        "raise upsample, narrow the pupil or move it to the middle",
    )


PUPIL_SAMPLES = Limit(
    name="pupil beyond the samples",
    quantity="share of the pupil in the directions that the samples hold, λ/(2·dx), at the worst wavelength",
    reason="light beyond would enter the eye and isn't computed (Nyquist)",
    measure=_in_samples,
    at_least=1.0,
)
