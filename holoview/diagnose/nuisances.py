"""What differs between every bench and its model and is no fault: PRNU, a camera that moves, laser drift, sampling.

PRNU (pixels of unequal sensitivity) and movements of the camera are looked for where a model is good enough to show
them: under the nominal one, and again under the best. No cause may explain what they explain.

Lasers may drift: each capture chooses its own wavelength among a few near the nominal one. Derivatives wouldn't do: a
small drift moves the edge of an iris over whole samples. Drift is no fault where it takes the residuals to the noise
and its mean isn't significant.

Coarse samples of the model look like lost contrast, which a blur, bandwidth and an extended source partly explain. So
the held-out captures are predicted once more with finer samples, larger grids, and camera pixels that integrate or
don't. A cause that isn't needed with such samples isn't named.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np

from holoview.captures.prepared_captures import estimate_prnu
from holoview.diagnose.capture_split import spread_over_wavelengths
from holoview.diagnose.config import LaserDriftConfig, SearchConfig
from holoview.diagnose.fit import FittedValues
from holoview.diagnose.judge import (
    Decision,
    HeldOutScore,
    SearchResult,
    Verdict,
    chance_excess,
    jitter_excess,
    score_on_held_out,
)
from holoview.diagnose.likelihood import Comparison, Values, mean_is_significant
from holoview.diagnose.sampling_config import SamplingConfig
from holoview.diagnose.search_context import SearchContext


def detect_nuisances(context: SearchContext, values: FittedValues) -> SearchContext:
    """The context with movements of the camera and PRNU, where a model with these values shows them."""
    return _detect_prnu(_detect_camera_jitter(context, values), values)


def excuse_laser_drift(context: SearchContext, result: SearchResult, decision: Decision) -> tuple[Decision, list[str]]:
    """Consistent after all where undirected drift of the lasers leaves no more than jitter does; with a note."""
    if decision.verdict is not Verdict.UNEXPLAINED or DRIFT_EFFECT not in context.effects:
        return decision, []
    drift = estimate_laser_drift(result.comparison, {}, context.config.laser_drift)
    max_excess = jitter_excess(result.pixel_count, context.config.verdict)
    if drift.is_systematic or drift.chi2_per_pixel - 1.0 > max_excess:
        return decision, []
    note = f"The wavelengths drift by {drift.rms_m * 1e9:.2g} nm (r.m.s.) between captures; that explains what is left."
    return Decision(Verdict.CONSISTENT, None), [note]


def _detect_camera_jitter(context: SearchContext, values: FittedValues) -> SearchContext:
    """The context with a camera that moves from capture to capture, where that explains most of the excess."""
    comparison = context.model_weighted_comparison(context.split.held_out, values)
    excess = comparison.chi2_per_pixel(values) - 1.0
    small = excess < jitter_excess(comparison.pixel_count, context.config.verdict)
    if context.has_camera_jitter or small or len(context.split.held_out) < 2:
        return context
    moving = replace(context, has_camera_jitter=True)
    left = moving.model_weighted_comparison(context.split.held_out, values).chi2_per_pixel(values) - 1.0
    return moving if left < context.config.nuisances.jitter_max_excess * excess else context


def _detect_prnu(context: SearchContext, values: FittedValues) -> SearchContext:
    """The context with PRNU, where the residuals of two disjoint sets of captures show the same pattern."""
    config = context.config.nuisances
    sets = [context.split.fine, context.split.held_out]
    comparisons = [context.model_weighted_comparison(indices, values) for indices in sets]
    if context.prnu or max(c.chi2_per_pixel(values) for c in comparisons) > config.prnu_max_chi2:
        return context
    fits = [c.fit_gains(values) for c in comparisons]
    expected = [fitted.expected for fitted in fits]
    residuals = [c.residual_counts(fitted) for c, fitted in zip(comparisons, fits, strict=True)]
    prnu = min(estimate_prnu(residuals, expected, [c.weight > 0 for c in comparisons]), config.max_prnu)
    added = [np.square(prnu * e * c.weight).sum() / c.pixel_count for e, c in zip(expected, comparisons, strict=True)]
    return replace(context, prnu=prnu) if max(added) > config.min_prnu_chi2 else context


DRIFT_EFFECT, _PARAMETER = "wavelength_offset", "offset"


@dataclass(frozen=True)
class LaserDrift:
    """R.m.s. drift (m) over the captures, χ²/n with a wavelength for each capture, and whether the mean stands out."""

    rms_m: float
    chi2_per_pixel: float
    is_systematic: bool


def estimate_laser_drift(comparison: Comparison, values: FittedValues, config: LaserDriftConfig) -> LaserDrift:
    """The wavelength that suits each capture best, and what is left with it."""
    known = values.get(DRIFT_EFFECT, {})
    offsets_m = config.step_m * np.arange(-config.steps, config.steps + 1)
    squares = [
        comparison.fit_gains(
            {**values, DRIFT_EFFECT: {**known, _PARAMETER: known.get(_PARAMETER, 0.0) + float(offset)}}
        ).squares
        for offset in offsets_m
    ]
    drifts = offsets_m[np.argmin(squares, axis=0)]
    return LaserDrift(
        rms_m=float(np.sqrt(np.mean(np.square(drifts)))),
        chi2_per_pixel=float(np.min(squares, axis=0).sum() / comparison.pixel_count),
        is_systematic=bool(mean_is_significant(drifts, config.p_value)),
    )


AlternativeComparisons = Mapping[SamplingConfig, Comparison]


def drop_sampling_artefacts(
    context: SearchContext, result: SearchResult, decision: Decision
) -> tuple[Decision, list[str]]:
    """The decision without causes that other samples make superfluous; with notes.

    A model that predicts the captures down to their noise isn't checked.
    """
    best, config = decision.best, context.config
    at_noise = best is not None and best.excess <= chance_excess(result.pixel_count, config.verdict)
    if decision.verdict is Verdict.CONSISTENT or at_noise:
        return decision, []
    comparison = _check_comparison(context, decision)
    alternatives = _alternative_comparisons(context, comparison)
    dropped: list[str] = []
    while best is not None and (name := _find_dispensable_cause(config, comparison, alternatives, best)):
        dropped.append(name)
        fewer = best.fit.without(name)
        best = score_on_held_out(fewer, result.comparison, result.tolerant_comparison) if fewer.causes else None
    notes = [f"{name} is not named: other samples of the same bench explain more than it does." for name in dropped]
    if dropped:
        decision = Decision(Verdict.PARTLY if best else Verdict.UNEXPLAINED, best)
    if decision.verdict not in (Verdict.PARTLY, Verdict.UNEXPLAINED):
        return decision, notes
    values = best.fit.values if best else {}
    decision, more = _credit_sampling(config, comparison, alternatives, decision, values)
    return decision, notes + more


def _credit_sampling(
    config: SearchConfig,
    comparison: Comparison,
    alternatives: AlternativeComparisons,
    decision: Decision,
    values: Values,
) -> tuple[Decision, list[str]]:
    """The decision with a note on samples that explain much of what is left; consistent if they explain it all."""
    alternative, left = _best_alternative(alternatives, values), comparison.chi2_per_pixel(values)
    if alternative is None:
        return decision, []
    sampling, chi2 = alternative
    gained = (left - chi2) * comparison.pixel_count
    max_excess = config.sampling_check.max_left_share * (left - 1.0)
    if gained < config.verdict.min_delta_chi2 or chi2 - 1.0 > max_excess:
        return decision, []
    note = f"With {sampling.description} χ²/n is {chi2:.4g}, not {left:.4g}; {sampling.cli_options} diagnoses so."
    if decision.best is None and chi2 - 1.0 < jitter_excess(comparison.pixel_count, config.verdict):
        decision = Decision(Verdict.CONSISTENT, None)
    return decision, [note]


def _best_alternative(alternatives: AlternativeComparisons, values: Values) -> tuple[SamplingConfig, float] | None:
    """The best other sampling with these causes, and its χ²/n; None where there is no other."""
    return min(
        ((sampling, other.chi2_per_pixel(values)) for sampling, other in alternatives.items()),
        key=lambda pair: pair[1],
        default=None,
    )


def _alternative_comparisons(context: SearchContext, comparison: Comparison) -> dict[SamplingConfig, Comparison]:
    """The comparison with each other sampling, except those whose grids would be too large."""
    config = context.config.sampling_check
    rows, columns = context.system.modulators[0].shape
    samples = context.system.sampling.upsample**2 * rows * columns
    affordable = [
        sampling
        for sampling in config.alternatives
        if sampling != context.sampling and samples * (sampling.finer * sampling.padding) ** 2 <= config.max_samples
    ]
    create = partial(context.predictor.create, cache_mb=config.cache_mb)
    return {sampling: comparison.with_predictor(create(**asdict(sampling))) for sampling in affordable}


def _check_comparison(context: SearchContext, decision: Decision) -> Comparison:
    """A few held-out captures, with the weights of the noise at the best model."""
    count = context.config.sampling_check.captures
    few = spread_over_wavelengths(context.data.captures, context.split.held_out, count)
    return context.model_weighted_comparison(few, decision.best.fit.values if decision.best else {})


def _find_dispensable_cause(
    config: SearchConfig, comparison: Comparison, alternatives: AlternativeComparisons, best: HeldOutScore
) -> str | None:
    """A cause without which other samples leave less than the model with it, and that they don't need either."""
    left = comparison.chi2_per_pixel(best.fit.values)
    for name in reversed(best.causes):
        alternative = _best_alternative(alternatives, best.fit.without(name).values)
        if alternative is None:
            continue
        sampling, chi2 = alternative
        if (left - chi2) * comparison.pixel_count < config.verdict.min_delta_chi2:
            continue
        gain = chi2 - alternatives[sampling].chi2_per_pixel(best.fit.values)
        needed_gain = config.sampling_check.max_left_share * (chi2 - 1.0)
        if gain < max(needed_gain, config.verdict.min_delta_chi2 / comparison.pixel_count):
            return name
    return None
