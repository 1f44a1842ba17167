"""Whether captures disagree with the model's own samples rather than with the bench.

Lost contrast is what coarse samples look like; a blur, bandwidth and an extended source then explain part of it. So the
held-out captures are predicted once more with finer samples, larger grids, camera pixels that integrate or don't. A
cause that these do better without isn't one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from functools import partial

from holoview.diagnose.capture_split import spread_over_wavelengths
from holoview.diagnose.comparison import Comparison, Values
from holoview.diagnose.held_out_ranking import ALARM, HeldOutScore, SearchResult, score_on_held_out
from holoview.diagnose.sampling_config import SamplingConfig
from holoview.diagnose.search_context import SearchContext
from holoview.diagnose.verdict import HALF, Decision, Verdict, chance_excess, jitter_excess

_OTHERS = tuple(SamplingConfig(*way) for way in ((1, 2, 2), (2, 2, 1), (2, 2, 2), (1, 3, 1), (1, 4, 1), (2, 3, 2)))
_CAPTURES = 4
_MOST_SAMPLES = 1 << 26  # of a grid: half a gigabyte a field
_CACHE_MB = 64  # of each way: causes are left out one after the other

AlternativeComparisons = Mapping[SamplingConfig, Comparison]


def drop_sampling_artefacts(
    context: SearchContext, selection: SearchResult, decision: Decision
) -> tuple[Decision, list[str]]:
    """The decision without causes that other samples do better without; with notes.

    What comes down to the noise isn't doubted.
    """
    best = decision.best
    if decision.verdict is Verdict.CONSISTENT or (
        best is not None and best.excess <= chance_excess(selection.pixel_count)
    ):
        return decision, []
    comparison = _check_comparison(context, decision)
    others = _alternative_comparisons(context, comparison)
    dropped: list[str] = []
    while best is not None and (name := _find_dispensable_cause(comparison, others, best)):
        dropped.append(name)
        fewer = best.fit.without(name)
        best = score_on_held_out(fewer, selection.comparison, selection.tolerant_comparison) if fewer.causes else None
    notes = [f"{name} is not named: other samples of the same bench explain more than it does." for name in dropped]
    if dropped:
        decision = Decision(Verdict.PARTLY if best else Verdict.UNEXPLAINED, best)
    if decision.verdict not in (Verdict.PARTLY, Verdict.UNEXPLAINED):
        return decision, notes
    values = best.fit.values if best else {}
    found, left = best_alternative_sampling(others, values), comparison.chi2_per_pixel(values)
    if found is None or (left - found[1]) * comparison.pixel_count < ALARM or found[1] - 1.0 > HALF * (left - 1.0):
        return decision, notes
    notes.append(
        f"With {found[0].description} χ²/n is {found[1]:.4g}, not {left:.4g}; {found[0].cli_options} diagnoses so."
    )
    if best is None and found[1] - 1.0 < jitter_excess(comparison.pixel_count):
        decision = Decision(Verdict.CONSISTENT, None)
    return decision, notes


def best_alternative_sampling(
    alternatives: AlternativeComparisons, values: Values
) -> tuple[SamplingConfig, float] | None:
    """The best of other ways to sample with these causes, and its χ²/n; None where there is no other."""
    return min(
        ((way, other.chi2_per_pixel(values)) for way, other in alternatives.items()),
        key=lambda found: found[1],
        default=None,
    )


def _alternative_comparisons(context: SearchContext, comparison: Comparison) -> dict[SamplingConfig, Comparison]:
    """The comparison in other ways, but for those whose grids would be too large."""
    rows, columns = context.system.modulators[0].shape
    samples = context.system.sampling.upsample**2 * rows * columns
    able = [
        way for way in _OTHERS if way != context.sampling and samples * (way.finer * way.padding) ** 2 <= _MOST_SAMPLES
    ]
    make = partial(context.predictor.create, cache_mb=_CACHE_MB)
    return {way: comparison.with_predictor(make(**asdict(way))) for way in able}


def _check_comparison(context: SearchContext, decision: Decision) -> Comparison:
    few = spread_over_wavelengths(context.data.captures, context.split.held_out, _CAPTURES)
    return context.model_weighted_comparison(few, decision.best.fit.values if decision.best else {})


def _find_dispensable_cause(comparison: Comparison, others: AlternativeComparisons, best: HeldOutScore) -> str | None:
    """A cause without which other samples leave less than the model with it, and to which they don't need it either."""
    left = comparison.chi2_per_pixel(best.fit.values)
    for name in reversed(best.causes):
        found = best_alternative_sampling(others, best.fit.without(name).values)
        if found is None or (left - found[1]) * comparison.pixel_count < ALARM:
            continue
        both = others[found[0]].chi2_per_pixel(best.fit.values)
        if found[1] - both < HALF * (found[1] - 1.0):
            return name
    return None
