"""What a named cause could be mistaken for, and the capture that would tell them apart."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from holoview.captures.dataset import Captures
from holoview.captures.predictor import Predictor
from holoview.diagnose.comparison import Comparison
from holoview.diagnose.effect_fit import CandidateFit, effect_jacobian
from holoview.diagnose.free_parameters import FittedValues
from holoview.diagnose.held_out_ranking import HeldOutScore
from holoview.diagnose.search_context import SearchContext
from holoview.diagnose.uncertainty import LocalJacobian, canonical_correlation
from holoview.model.effects.effect import Effect
from holoview.util.errors import UserError

_TELLING = 0.5  # correlation from which a confusion is worth a word
_TELLS_APART = 25.0  # Δχ² of one capture


def lookalike_correlations(
    context: SearchContext, fit: CandidateFit, jacobian: LocalJacobian, comparison: Comparison
) -> dict[str, dict[str, float]]:
    """For each cause of a trial, effects that change the captures alike: id → canonical correlation of their slopes.

    What the trial's other causes explain is taken out first. The same physics counts as 1.
    """
    residual = comparison.residual(fit.values)
    others = [e for e in context.effects.values() if e.id not in fit.causes]
    jobs = [partial(effect_jacobian, e, {**fit.values, e.id: _identity(e)}, comparison, residual) for e in others]
    slopes = context.run_parallel(jobs)
    owner = np.array([effect for effect, _ in jacobian.unknowns.entries])
    result: dict[str, dict[str, float]] = {}
    for cause in fit.causes:
        own, rest = jacobian.slopes[owner == cause], jacobian.slopes[owner != cause]
        found = {e.id: canonical_correlation(own, s, rest) for e, s in zip(others, slopes, strict=True) if len(s)}
        found |= dict.fromkeys(context.equivalents.get(cause, ()), 1.0)
        ordered = sorted(found.items(), key=lambda pair: -pair[1])
        result[cause] = {name: value for name, value in ordered if value >= _TELLING}
    return result


@dataclass(frozen=True)
class ProposedCapture:
    """A capture that could be taken: in words, and as a session of one (its images are never looked at)."""

    description: str
    captures: Captures


def best_separating_capture(context: SearchContext, first: HeldOutScore, second: HeldOutScore) -> str | None:
    """The capture that would tell two explanations apart best, in words; None where none of those tried would."""
    best, words = _TELLS_APART, None
    for experiment in proposed_captures(
        context.data.captures, int(context.split.coarse[0]), int(context.split.held_out[-1])
    ):
        difference = _delta_chi2(experiment.captures, first.fit.values, second.fit.values)
        if difference > best:
            best, words = difference, experiment.description
    return words


def proposed_captures(captures: Captures, smooth_index: int, rough_index: int) -> list[ProposedCapture]:
    """Captures that differ from those there are in one respect each."""
    one, other = captures.subset([smooth_index]), captures.subset([rough_index])
    middle = captures.levels.dtype.type(captures.slms[0].num_levels // 2)
    flat = np.full_like(one.levels, middle)
    tries = [
        ProposedCapture("a capture with a smoother pattern", one),
        ProposedCapture("a capture with a rougher pattern", other),
        ProposedCapture("a capture with all modulators flat", _with(one, levels=flat)),
        ProposedCapture("a capture with half the laser power", _with(other, power=other.power / 2)),
        ProposedCapture("a capture with a tenth of the exposure", _with(other, exposure_s=other.exposure_s / 10)),
    ]
    if len(captures.slms) > 1:
        for number in (0, 1):
            levels = other.levels.copy()
            levels[:, number] = middle
            words = f"a capture with modulator {number + 1} flat and a rough pattern on the other"
            tries.append(ProposedCapture(words, _with(other, levels=levels)))
    planes = np.unique(captures.distance_m)
    farther = planes.max() * 1.5 if planes.max() > 0 else planes.max() + 2e-3
    plane = f"a capture in another plane, at {farther * 1e3:.3g} mm"
    tries.append(ProposedCapture(plane, _with(other, distance_m=np.array([farther]))))
    longest = captures.wavelengths_m.max() * 1.1
    tries.append(
        ProposedCapture(f"a capture at {longest * 1e9:.0f} nm", _with(other, wavelength_m=np.array([longest])))
    )
    return tries


def _delta_chi2(captures: Captures, first: FittedValues, second: FittedValues) -> float:
    """Δχ² by which one capture would tell two predictions apart, after its gain was fitted; light as in the session."""
    predictor = Predictor(captures, cache_mb=1)
    try:
        a, b = (predictor([0], values) for values in (first, second))
    except UserError:
        return 0.0
    m, n = (np.asarray(p.signal, dtype=np.float64) for p in (a, b))
    camera = captures.camera
    scale = 0.1 * camera.saturation / max(float(m.mean()), 1e-30)
    m, n = m * scale, n * scale + (b.black_level - a.black_level)
    weight = 1.0 / camera.noise_variance(m)
    gain = float((weight * m * n).sum() / (weight * n * n).sum())
    return float((weight * (m - gain * n) ** 2).sum())


def _with(captures: Captures, **changes: Any) -> Captures:
    return dataclasses.replace(captures, **changes)


def _identity(effect: Effect) -> dict[str, float]:
    return {p.name: p.identity for p in effect.parameters}
