"""Forward selection: the cause, or the causes together, that predict held-out captures best.

Coarse to fine. Every effect is screened on the smoothest captures; the best few are fitted on more of them, first with
weights that forgive what is still wrong, then with the noise alone; all are judged on captures that no fit has seen,
with weights that are frozen. While much stays unexplained, each of the best is taken as a base and everything is tried
on top of it; a cause that the others turn out to do without is dropped again. Once a bench has computed its share of
fields, nothing further is begun.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from holoview.diagnose.beams import MANY, VERY_MANY, affordable, beams, has_many, most_beams
from holoview.diagnose.bench import Bench, Progress
from holoview.diagnose.judge import ALARM, NEARLY, Judged, Selection, distinct, judge, judged
from holoview.diagnose.refine import Refined, refined, searched_along
from holoview.diagnose.screen import mismatch, screen
from holoview.diagnose.search import Trial, cost_of, local_fit
from holoview.effects.effect import Effect

_SHORT_LIST, _CLOSE_SECONDS, _CLOSE = 3, 2, 1.3
_BASES, _SECONDS, _MOST_CAUSES = 3, 3, 3
FLOOR = 1.05  # χ²/n at which nothing worth a further cause is left
_REFINED, _ALONG = 2, 2
_NEARBY, _HARDLY = 0.2, 0.02  # r.m.s. residual: of the nominal bench's; over mean light
_HELPS = 0.9  # of the nominal excess: what leaves more explains nothing
_AS_GOOD = 1.05  # cost that is as good as another on coarse captures
_SETTLED, _SETTLED_SHARE = 0.1, 0.05  # χ²/n − 1, and of the nominal one: so close, scans over ranges bring nothing
_NO_SCAN = 2.0  # χ²/n of two causes on coarse captures, likewise
_WORTHWHILE = 0.7  # of a base's cost: with less left, base and addition are fitted together at once
_EARLY = 1.02  # a single cause that reaches this on held-out captures ends the search


def select(bench: Bench, effects: Sequence[Effect], report: Progress) -> Selection:
    """Searches causes until the held-out captures are explained, nothing helps, or there are three."""
    selection = _with_fine(bench, _first_round(bench, effects, report))
    for number in range(2, _MOST_CAUSES + 1):
        if _is_done(bench, selection):
            break
        wider = _pruned(bench, _next_round(bench, selection, number, effects, report))
        if not _is_better(wider, selection):
            break
        selection = _with_fine(bench, wider)
    return selection


def _first_round(bench: Bench, effects: Sequence[Effect], report: Progress) -> Selection:
    """Single causes; ends early when one explains everything."""
    blind = bench.coarse_comparison(bench.split.coarse, 0.0)
    trials: list[Trial] = []
    found, selection = Refined(bench), judge(bench, [])
    for stage in screen(bench, {}, effects, report, "one cause"):
        for batch in stage:
            trials = distinct(sorted([*trials, *batch], key=lambda t: t.cost))
            if not batch or cost_of(blind, batch[0].values) > NEARLY * blind.count:
                continue
            if found.add([t for t in batch[:_SHORT_LIST] if t.cost < _AS_GOOD * batch[0].cost]):
                selection = judge(bench, found.trials)
            if selection.best.chi2 < _EARLY:
                return selection
        found.add(_short_list(affordable(bench, trials, blind)))
        selection = _closer(bench, judge(bench, found.trials))
        if selection.best.excess < min(_SETTLED, _SETTLED_SHARE * selection.nominal.excess):
            break
    return selection


def _next_round(
    bench: Bench, selection: Selection, number: int, effects: Sequence[Effect], report: Progress
) -> Selection:
    """The candidates, and such with one cause more than the best ones; ends early when one explains everything."""
    known = [c.trial for c in selection.candidates]
    for base in _bases(bench, selection, number - 1):
        if bench.is_spent:
            break
        rest = [e for e in effects if _may_join(bench, e, base.trial)]
        wider = _wider(bench, base.trial, rest, report, f"{number} causes")
        known += bench.side_by_side([partial(refined, bench, t) for t in wider])
        selection = _closer(bench, judge(bench, distinct(sorted(known, key=lambda t: -len(t.causes)))))
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
                if joint[0].cost < NEARLY * blind.count:
                    return joint
        best_first = distinct(sorted(screened, key=lambda t: t.cost))
        joint = _joint(bench, affordable(bench, best_first, blind)[:_SECONDS])[:_REFINED]
        if bench.is_spent or (joint and joint[0].cost < _NO_SCAN * blind.count):
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


def _with_fine(bench: Bench, selection: Selection) -> Selection:
    """The best candidate with its fine parameters freed, where it is near but not at the floor, and they help."""
    best = selection.best
    effects = [bench.effects[name] for name in best.causes]
    if best.chi2 < _EARLY or not any(p.fine for e in effects for p in e.parameters) or not _is_near(bench, best.trial):
        return selection
    freed = refined(bench, best.trial, fine=True)
    again = judged(freed, selection.comparison, selection.forgiving)
    if (best.chi2 - again.chi2) * selection.pixels < ALARM or again.excess > 0.9 * best.excess:
        return selection
    return judge(bench, [freed, *(c.trial for c in selection.candidates[1:])])


def _closer(bench: Bench, selection: Selection) -> Selection:
    """The best candidates looked for along their axes, twice, where they stopped short of the floor, but not far off.

    What is far off lacks a cause: the best values of what it has would be others with it.
    """
    for _ in range(2):
        if selection.best.chi2 < FLOOR:
            break
        some = [c.trial for c in selection.candidates[:_ALONG] if c.excess < _HELPS * selection.nominal.excess]
        leaders = [t for t in some if beams(bench, t.values) < VERY_MANY and _is_near(bench, t)]
        if not leaders:
            break
        closer = bench.side_by_side([partial(searched_along, bench, t) for t in leaders])
        better = [new for new, old in zip(closer, leaders, strict=True) if new.values != old.values]
        if not better:
            break
        selection = judge(bench, [*better, *(c.trial for c in selection.candidates)])
    return selection


def _is_near(bench: Bench, trial: Trial) -> bool:
    """Whether a trial leaves hardly anything, or a small part of what the nominal bench does."""
    return mismatch(bench, trial.values) < max(_HARDLY, _NEARBY * mismatch(bench, {}))


def _is_done(bench: Bench, selection: Selection) -> bool:
    return selection.best.chi2 < FLOOR or not selection.candidates or bench.is_spent


def _bases(bench: Bench, selection: Selection, causes: int) -> list[Judged]:
    """What to build on: the best candidates with so many causes.

    Far from the floor smooth captures tell them apart better: rough ones favour whatever loses contrast.
    """
    most = _BASES if causes == 1 else 1
    same = [c for c in selection.candidates if len(c.causes) == causes]
    if selection.best.chi2 > NEARLY:
        smooth = bench.coarse_comparison(bench.split.coarse, min(mismatch(bench, {}), 1.0))
        same.sort(key=lambda c: cost_of(smooth, c.trial.values))
    few = {id(t) for t in affordable(bench, [c.trial for c in same], selection.forgiving)}
    return [c for c in same if id(c.trial) in few][:most] or [selection.best]


def _is_better(new: Selection, old: Selection) -> bool:
    before = judged(old.best.trial, new.comparison, new.forgiving)
    return (before.chi2 - new.best.chi2) * new.pixels > ALARM and new.best.excess < 0.8 * before.excess


def _pruned(bench: Bench, selection: Selection) -> Selection:
    """Without causes that the best candidate's others do without: from its values a fit may find what it missed."""
    best = selection.best
    if len(best.causes) < 2:
        return selection
    refits = bench.side_by_side([partial(refined, bench, best.trial.without(name)) for name in best.causes])
    return judge(bench, [*(c.trial for c in selection.candidates), *refits])


def _may_join(bench: Bench, effect: Effect, base: Trial) -> bool:
    """Whether it is another cause than those that are in, and doesn't multiply many fields by many."""
    if any(name == effect.id or name in bench.equals.get(effect.id, ()) for name in base.causes):
        return False
    return not (has_many(bench, base) and most_beams(bench, effect) >= MANY)
