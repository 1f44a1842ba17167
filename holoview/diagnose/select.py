"""Forward selection: the cause, or the causes together, that predict held-out captures best.

Coarse to fine. Every effect is screened on the smoothest captures; the best few are fitted on more of them, first with
weights that forgive what is still wrong, then with the noise alone; all are judged on captures that no fit has seen,
with weights that are frozen. While much stays unexplained, each of the best is taken as a base and everything is tried
on top of it; a cause that the others turn out to do without is dropped again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from holoview.diagnose.bench import Bench, Progress
from holoview.diagnose.comparison import Comparison
from holoview.diagnose.screen import mismatch, screen
from holoview.diagnose.search import Trial, cost_of, local_fit, polished, sharpened, simplified
from holoview.effects.effect import Effect

_SHORT_LIST, _CLOSE_SECONDS, _CLOSE = 3, 2, 1.3
_BASES, _SECONDS, _MOST_CAUSES = 3, 3, 3
FLOOR = 1.05  # χ²/n at which nothing worth a further cause is left
_NEARLY = 1.3  # χ²/n on coarse captures from which a cause is worth judging at once
_REFINED = 2
_AS_GOOD = 1.05  # cost that is as good as another on coarse captures
_BETTER = 0.95  # cost that is worth refining the same causes again
_SETTLED, _SETTLED_SHARE = 0.1, 0.05  # χ²/n − 1, and of the nominal one: so close, scans over ranges bring nothing
_NO_SCAN = 2.0  # χ²/n of two causes on coarse captures, likewise
_WORTHWHILE = 0.7  # of a base's cost: with less left, base and addition are fitted together at once
_FAR = 0.15  # r.m.s. residual over mean light; beyond, weights of the noise alone lead nowhere
_EARLY = 1.02  # a single cause that reaches this on held-out captures ends the search
_ALARM = 25.0  # Δχ² of held-out captures below which nothing has been found (5 σ)


@dataclass(frozen=True)
class Judged:
    """A trial and its χ²/n on held-out captures, in total and for each; rank: the same by weights that forgive."""

    trial: Trial
    chi2: float
    per_capture: tuple[float, ...]
    rank: float

    @property
    def causes(self) -> tuple[str, ...]:
        """The effects that are on."""
        return self.trial.causes

    @property
    def excess(self) -> float:
        """χ²/n beyond the noise floor."""
        return self.chi2 - 1.0


@dataclass(frozen=True)
class Selection:
    """What a search found: candidates, best first, all judged by the same frozen weights; the nominal bench's χ²."""

    nominal: Judged
    candidates: tuple[Judged, ...]
    comparison: Comparison
    forgiving: Comparison

    @property
    def best(self) -> Judged:
        """The best candidate; the nominal bench where there is none."""
        return self.candidates[0] if self.candidates else self.nominal

    @property
    def pixels(self) -> float:
        """How many held-out pixels judge."""
        return self.comparison.count


NOTHING = Trial((), {}, float("inf"))


def select(bench: Bench, effects: Sequence[Effect], report: Progress) -> Selection:
    """Searches causes until the held-out captures are explained, nothing helps, or there are three."""
    selection = _with_fine(bench, _first_round(bench, effects, report))
    for number in range(2, _MOST_CAUSES + 1):
        if _is_done(selection):
            break
        wider = _pruned(bench, _next_round(bench, selection, number, effects, report))
        if not _is_better(wider, selection):
            break
        selection = _with_fine(bench, wider)
    return selection


def judge(bench: Bench, trials: Sequence[Trial]) -> Selection:
    """All trials on the held-out captures, with weights frozen at the prediction of the best of them.

    Weights at a wrong prediction favour what is wrong alike. So as long as the best is far off, the order is by weights
    that forgive as much as that.
    """
    indices = bench.split.held_out
    rough = bench.coarse_comparison(indices, 1.0)
    first = min([NOTHING, *trials], key=lambda t: cost_of(rough, t.values))
    forgiving = bench.coarse_comparison(indices, min(mismatch(bench, first.values, indices), 1.0))
    first = min([NOTHING, *trials], key=lambda t: cost_of(forgiving, t.values))
    comparison = bench.judged_by(indices, first.values)
    judged = [_judged(t, comparison, forgiving) for t in trials]
    near = min((j.chi2 for j in judged), default=np.inf) < _NEARLY
    ordered = sorted(judged, key=lambda j: j.chi2 if near else j.rank)
    candidates = _distinct_judged(_simpler_first(ordered, comparison.count) if near else ordered)
    return Selection(_judged(NOTHING, comparison, forgiving), tuple(candidates), comparison, forgiving)


def refined(bench: Bench, trial: Trial, *, fine: bool = False) -> Trial:
    """A joint fit of all causes of a trial on the fine captures: forgiving weights first, then the noise alone."""
    effects = [bench.effects[name] for name in trial.causes]
    indices = bench.split.fine
    off_by = mismatch(bench, trial.values)
    values = trial.values
    if off_by > 0.02:
        forgiving = bench.coarse_comparison(indices, min(0.5, 0.5 * off_by))
        found = local_fit(effects, values, forgiving, fine=fine)
        values = found.values
        if mismatch(bench, values) > _FAR:
            return found
    comparison = bench.judged_by(indices, values)
    found = local_fit(effects, values, comparison, iterations=5, tolerance=1e-4, fine=fine)
    for improved in (polished, sharpened, simplified):
        found = improved(effects, found, comparison)
    return found


class _Refined:
    """What was refined so far. Nothing is refined twice unless a later stage of the screen found better values."""

    def __init__(self, bench: Bench) -> None:
        self.trials: list[Trial] = []
        self._bench, self._begun = bench, dict[tuple[str, ...], float]()

    def add(self, trials: Sequence[Trial]) -> bool:
        """Refines what is new of these; whether there was something."""
        fresh = [t for t in trials if t.cost < _BETTER * self._begun.get(t.causes, np.inf)]
        self._begun |= {t.causes: t.cost for t in fresh}
        self.trials += self._bench.side_by_side([partial(refined, self._bench, t) for t in fresh])
        return bool(fresh)


def _first_round(bench: Bench, effects: Sequence[Effect], report: Progress) -> Selection:
    """Single causes; ends early when one explains everything."""
    blind = bench.coarse_comparison(bench.split.coarse, 0.0)
    trials: list[Trial] = []
    found, selection = _Refined(bench), judge(bench, [])
    for stage in screen(bench, {}, effects, report, "one cause"):
        for batch in stage:
            trials = _distinct(sorted([*trials, *batch], key=lambda t: t.cost))
            if not batch or cost_of(blind, batch[0].values) > _NEARLY * blind.count:
                continue
            if found.add([t for t in batch[:_SHORT_LIST] if t.cost < _AS_GOOD * batch[0].cost]):
                selection = judge(bench, found.trials)
            if selection.best.chi2 < _EARLY:
                return selection
        found.add(_short_list(trials))
        selection = judge(bench, found.trials)
        if selection.best.excess < min(_SETTLED, _SETTLED_SHARE * selection.nominal.excess):
            break
    return selection


def _next_round(
    bench: Bench, selection: Selection, number: int, effects: Sequence[Effect], report: Progress
) -> Selection:
    """The candidates, and such with one cause more than the best ones; ends early when one explains everything."""
    known = [c.trial for c in selection.candidates]
    for base in _bases(selection, number - 1):
        rest = [e for e in effects if e.id not in base.causes and not _equals_one(e, base.causes, bench)]
        wider = _wider(bench, base.trial, rest, report, f"{number} causes")
        known += bench.side_by_side([partial(refined, bench, t) for t in wider])
        selection = judge(bench, _distinct(sorted(known, key=lambda t: -len(t.causes))))
        if selection.best.chi2 < _EARLY:
            break
    return selection


def _wider(bench: Bench, base: Trial, effects: Sequence[Effect], report: Progress, note: str) -> list[Trial]:
    """The best with one cause more than a base, fitted together; the first that nearly explains all ends the search."""
    blind = bench.coarse_comparison(bench.split.coarse, 0.0)
    best, screened, joint = _WORTHWHILE * cost_of(blind, base.values), list[Trial](), list[Trial]()
    for stage in screen(bench, base.values, effects, report, note):
        for batch in stage:
            screened += batch
            if batch and (cost := cost_of(blind, batch[0].values)) < best:
                best = cost
                joint = _joint(bench, batch[:1])
                if joint[0].cost < _NEARLY * blind.count:
                    return joint
        joint = _joint(bench, _distinct(sorted(screened, key=lambda t: t.cost))[:_SECONDS])[:_REFINED]
        if joint and joint[0].cost < _NO_SCAN * blind.count:
            break
    return joint


def _joint(bench: Bench, trials: Sequence[Trial]) -> list[Trial]:
    """Joint fits of base and addition on the coarse captures."""
    jobs = []
    for trial in trials:
        comparison = bench.coarse_comparison(bench.split.coarse, min(mismatch(bench, trial.values), 1.0))
        effects = [bench.effects[name] for name in trial.causes]
        jobs.append(partial(local_fit, effects, trial.values, comparison))
    blind = bench.coarse_comparison(bench.split.coarse, 0.0)
    fits = bench.side_by_side(jobs)
    return sorted((replace(t, cost=cost_of(blind, t.values)) for t in fits), key=lambda t: t.cost)


def _short_list(trials: list[Trial]) -> list[Trial]:
    if not trials:
        return []
    close = [t for t in trials[_SHORT_LIST:] if t.cost < _CLOSE * trials[0].cost]
    return trials[:_SHORT_LIST] + close[:_CLOSE_SECONDS]


def _distinct(trials: Sequence[Trial]) -> list[Trial]:
    """The first trial of each set of causes."""
    seen: dict[frozenset[str], Trial] = {}
    for trial in trials:
        seen.setdefault(frozenset(trial.causes), trial)
    return list(seen.values())


def _judged(trial: Trial, comparison: Comparison, forgiving: Comparison) -> Judged:
    squares = comparison.fit(trial.values).squares
    per_capture = squares / np.maximum(comparison.pixels, 1.0)
    rank = cost_of(forgiving, trial.values) / forgiving.count
    return Judged(trial, float(squares.sum() / comparison.count), tuple(float(c) for c in per_capture), rank)


def _distinct_judged(judged: Sequence[Judged]) -> list[Judged]:
    """The first of each set of causes."""
    seen: dict[frozenset[str], Judged] = {}
    for one in judged:
        seen.setdefault(frozenset(one.causes), one)
    return list(seen.values())


def _simpler_first(judged: Sequence[Judged], pixels: float) -> list[Judged]:
    """Sorted by χ²; of the leaders, those within 0.02 + 0.02·excess and noise of the best, fewer numbers come first."""
    if not judged:
        return []
    best = judged[0]
    excess = max(best.excess, 0.0)
    limit = best.chi2 + 0.02 * excess + min(0.02, 0.1 * excess) + _ALARM / pixels
    leaders = [j for j in judged if j.chi2 <= limit]
    rest = [j for j in judged if j.chi2 > limit]
    return sorted(leaders, key=lambda j: (len(j.causes), j.trial.free, j.chi2)) + rest


def _with_fine(bench: Bench, selection: Selection) -> Selection:
    """The best candidate with its fine parameters freed, where it isn't at the floor yet and they help."""
    best = selection.best
    effects = [bench.effects[name] for name in best.causes]
    if best.chi2 < _EARLY or not any(p.fine for e in effects for p in e.parameters):
        return selection
    freed = refined(bench, best.trial, fine=True)
    judged = _judged(freed, selection.comparison, selection.forgiving)
    if (best.chi2 - judged.chi2) * selection.pixels < _ALARM or judged.excess > 0.9 * best.excess:
        return selection
    return judge(bench, [freed, *(c.trial for c in selection.candidates[1:])])


def _is_done(selection: Selection) -> bool:
    return selection.best.chi2 < FLOOR or not selection.candidates


def _bases(selection: Selection, causes: int) -> list[Judged]:
    """What to build on: the best candidates with so many causes."""
    most = _BASES if causes == 1 else 1
    return [c for c in selection.candidates if len(c.causes) == causes][:most] or [selection.best]


def _is_better(new: Selection, old: Selection) -> bool:
    if len(new.best.causes) <= len(old.best.causes):
        return False
    before = _judged(old.best.trial, new.comparison, new.forgiving)
    return (before.chi2 - new.best.chi2) * new.pixels > _ALARM and new.best.excess < 0.8 * before.excess


def _pruned(bench: Bench, selection: Selection) -> Selection:
    """Without causes that the best candidate's others do without."""
    best = selection.best
    if len(best.causes) < 2:
        return selection
    fewer = [
        Trial(tuple(c for c in best.causes if c != out), {k: v for k, v in best.trial.values.items() if k != out}, 0.0)
        for out in best.causes
    ]
    refits = bench.side_by_side([partial(refined, bench, t) for t in fewer])
    return judge(bench, [*(c.trial for c in selection.candidates), *refits])


def _equals_one(effect: Effect, causes: Sequence[str], bench: Bench) -> bool:
    """Whether it is the same physics as a cause that is already in."""
    return any(name in bench.equals.get(effect.id, ()) for name in causes)
