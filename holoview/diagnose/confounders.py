"""Effects that look like a cause that was named, and the capture that would tell them apart."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from holoview.captures.dataset import Captures
from holoview.captures.predictor import Predictor
from holoview.diagnose.fit import CandidateFit, FittedValues, effect_jacobian, identity_values, number_count
from holoview.diagnose.judge import HeldOutScore
from holoview.diagnose.likelihood import Comparison
from holoview.diagnose.search_context import SearchContext
from holoview.diagnose.uncertainty import LocalJacobian, canonical_correlation
from holoview.util.errors import UserError


def lookalike_correlations(
    context: SearchContext, fit: CandidateFit, at: LocalJacobian, comparison: Comparison
) -> dict[str, dict[str, float]]:
    """For each cause of a fit, effects that change the captures alike: id → canonical correlation of their slopes.

    What the fit's other causes explain is projected out first. The same physics in as many numbers or more counts as 1.
    """
    residual = comparison.residual(fit.values)
    others = [e for e in context.effects.values() if e.id not in fit.causes]
    jobs = [partial(effect_jacobian, e, {**fit.values, e.id: identity_values(e)}, comparison, residual) for e in others]
    slopes = context.run_parallel(jobs)
    owner = np.array([effect for effect, _ in at.parameters.entries])
    result: dict[str, dict[str, float]] = {}
    for cause in fit.causes:
        own, rest = at.slopes[owner == cause], at.slopes[owner != cause]
        correlations = {
            e.id: canonical_correlation(own, s, rest) for e, s in zip(others, slopes, strict=True) if len(s)
        }
        equal = context.equivalents.get(cause, frozenset())
        numbers = number_count(context.effects[cause])
        correlations |= {name: 1.0 for name in equal if number_count(context.effects[name]) >= numbers}
        ordered = sorted(correlations.items(), key=lambda pair: -pair[1])
        least = context.config.confounders.min_correlation
        result[cause] = {name: value for name, value in ordered if value >= least}
    return result


@dataclass(frozen=True)
class ProposedCapture:
    """A capture that could be taken: in words, and as a session of one, whose images are never used."""

    description: str
    captures: Captures


def best_separating_capture(context: SearchContext, first: HeldOutScore, second: HeldOutScore) -> str | None:
    """In words, the capture that would tell two explanations apart best; None where none of those tried would."""
    smooth, rough = int(context.split.coarse[0]), int(context.split.held_out[-1])
    best, description = context.config.verdict.min_delta_chi2, None
    mean_light = context.config.confounders.mean_light
    for proposed in proposed_captures(context.data.captures, smooth, rough):
        delta = _delta_chi2(proposed.captures, first.fit.values, second.fit.values, mean_light)
        if delta > best:
            best, description = delta, proposed.description
    return description


def proposed_captures(captures: Captures, smooth_index: int, rough_index: int) -> list[ProposedCapture]:
    """Captures that differ from one of those there are in one respect each."""
    smooth, rough = captures.subset([smooth_index]), captures.subset([rough_index])
    middle = captures.levels.dtype.type(captures.slms[0].num_levels // 2)
    flat = np.full_like(smooth.levels, middle)
    proposed = [
        ProposedCapture("a capture with a smoother pattern", smooth),
        ProposedCapture("a capture with a rougher pattern", rough),
        ProposedCapture("a capture with all modulators flat", replace(smooth, levels=flat)),
        ProposedCapture("a capture with half the laser power", replace(rough, power=rough.power / 2)),
        ProposedCapture("a capture with a tenth of the exposure", replace(rough, exposure_s=rough.exposure_s / 10)),
    ]
    if len(captures.slms) > 1:
        for number in (0, 1):
            levels = rough.levels.copy()
            levels[:, number] = middle
            words = f"a capture with modulator {number + 1} flat and a rough pattern on the other"
            proposed.append(ProposedCapture(words, replace(rough, levels=levels)))
    planes = np.unique(captures.distance_m)
    farther = planes.max() * 1.5 if planes.max() > 0 else planes.max() + 2e-3
    words = f"a capture in another plane, at {farther * 1e3:.3g} mm"
    proposed.append(ProposedCapture(words, replace(rough, distance_m=np.array([farther]))))
    longest = captures.wavelengths_m.max() * 1.1
    words = f"a capture at {longest * 1e9:.0f} nm"
    return [*proposed, ProposedCapture(words, replace(rough, wavelength_m=np.array([longest])))]


def _delta_chi2(captures: Captures, first: FittedValues, second: FittedValues, mean_light: float) -> float:
    """Δχ² by which one capture would tell two predictions apart, its gain fitted.

    mean_light: mean signal over saturation. 0 for values that the proposed bench can't have.
    """
    predictor = Predictor(captures, cache_mb=1)
    try:
        a, b = (predictor([0], values) for values in (first, second))
    except UserError:
        return 0.0
    m, n = (np.asarray(p.signal, dtype=np.float64) for p in (a, b))
    camera = captures.camera
    scale = mean_light * camera.saturation / max(float(m.mean()), 1e-30)
    dark, other_dark = (p.counts_without_lasers(camera.black_level) for p in (a, b))
    m, n = m * scale, n * scale + (other_dark - dark)
    weight = 1.0 / camera.noise_variance(m)
    gain = float((weight * m * n).sum() / (weight * n * n).sum())
    return float((weight * (m - gain * n) ** 2).sum())
