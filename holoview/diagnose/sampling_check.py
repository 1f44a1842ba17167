"""Whether captures disagree with the model's sampling rather than with the bench.

Coarse samples look like lost contrast, which a blur, bandwidth and an extended source partly explain. So the held-out
captures are predicted once more with finer samples, larger grids, and camera pixels that integrate or don't. A cause
that isn't needed with such samples isn't named.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from functools import partial

from holoview.diagnose.capture_split import spread_over_wavelengths
from holoview.diagnose.comparison import Comparison, Values
from holoview.diagnose.config import SearchConfig
from holoview.diagnose.held_out_ranking import HeldOutScore, SearchResult, score_on_held_out
from holoview.diagnose.sampling_config import SamplingConfig
from holoview.diagnose.search_context import SearchContext
from holoview.diagnose.verdict import Decision, Verdict, chance_excess, jitter_excess

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
