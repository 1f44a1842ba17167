"""Whether captures disagree with the model's own samples rather than with the bench.

Lost contrast is what coarse samples look like; a blur, bandwidth and an extended source then explain part of it. So the
held-out captures are predicted once more with finer samples, larger grids, camera pixels that integrate or don't. A
cause that these do better without isn't one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from functools import partial

from holoview.diagnose.bench import Bench
from holoview.diagnose.comparison import Comparison, Values
from holoview.diagnose.decide import HALF, Decision, Verdict, quiet, scatter
from holoview.diagnose.judge import ALARM, Judged, Selection, judged
from holoview.diagnose.split import spread
from holoview.diagnose.ways import Way

_OTHERS = tuple(Way(*way) for way in ((1, 2, 2), (2, 2, 1), (2, 2, 2), (1, 3, 1), (1, 4, 1), (2, 3, 2)))
_CAPTURES = 4
_MOST_SAMPLES = 1 << 26  # of a grid: half a gigabyte a field
_CACHE_MB = 64  # of each way: causes are left out one after the other

Others = Mapping[Way, Comparison]


def without_artefacts(bench: Bench, selection: Selection, decision: Decision) -> tuple[Decision, list[str]]:
    """The decision without causes that other samples do better without; with notes.

    What comes down to the noise isn't doubted.
    """
    best = decision.best
    if decision.verdict is Verdict.CONSISTENT or (best is not None and best.excess <= scatter(selection.pixels)):
        return decision, []
    comparison = _few(bench, decision)
    others = _sampled_otherwise(bench, comparison)
    dropped: list[str] = []
    while best is not None and (name := _dispensable(comparison, others, best)):
        dropped.append(name)
        fewer = best.trial.without(name)
        best = judged(fewer, selection.comparison, selection.forgiving) if fewer.causes else None
    notes = [f"{name} is not named: other samples of the same bench explain more than it does." for name in dropped]
    if dropped:
        decision = Decision(Verdict.PARTLY if best else Verdict.UNEXPLAINED, best)
    if decision.verdict not in (Verdict.PARTLY, Verdict.UNEXPLAINED):
        return decision, notes
    values = best.trial.values if best else {}
    found, left = resampled(others, values), comparison.chi2(values)
    if found is None or (left - found[1]) * comparison.count < ALARM or found[1] - 1.0 > HALF * (left - 1.0):
        return decision, notes
    notes.append(f"With {found[0].words} χ²/n is {found[1]:.4g}, not {left:.4g}; {found[0].options} diagnoses so.")
    if best is None and found[1] - 1.0 < quiet(comparison.count):
        decision = Decision(Verdict.CONSISTENT, None)
    return decision, notes


def resampled(others: Others, values: Values) -> tuple[Way, float] | None:
    """The best of other ways to sample with these causes, and its χ²/n; None where there is no other."""
    return min(((way, other.chi2(values)) for way, other in others.items()), key=lambda found: found[1], default=None)


def _sampled_otherwise(bench: Bench, comparison: Comparison) -> dict[Way, Comparison]:
    """The comparison in other ways, but for those whose grids would be too large."""
    rows, columns = bench.system.modulators[0].shape
    samples = bench.system.sampling.upsample**2 * rows * columns
    able = [way for way in _OTHERS if way != bench.way and samples * (way.finer * way.padding) ** 2 <= _MOST_SAMPLES]
    make = partial(bench.predict.make, cache_mb=_CACHE_MB)
    return {way: comparison.predicted_by(make(**asdict(way))) for way in able}


def _few(bench: Bench, decision: Decision) -> Comparison:
    few = spread(bench.measured.captures, bench.split.held_out, _CAPTURES)
    return bench.judged_by(few, decision.best.trial.values if decision.best else {})


def _dispensable(comparison: Comparison, others: Others, best: Judged) -> str | None:
    """A cause without which other samples leave less than the model with it, and to which they don't need it either."""
    left = comparison.chi2(best.trial.values)
    for name in reversed(best.causes):
        found = resampled(others, best.trial.without(name).values)
        if found is None or (left - found[1]) * comparison.count < ALARM:
            continue
        both = others[found[0]].chi2(best.trial.values)
        if found[1] - both < HALF * (found[1] - 1.0):
            return name
    return None
