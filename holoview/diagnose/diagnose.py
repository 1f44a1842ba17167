"""From captures to a diagnosis: prepare, search, decide, and tell how sure it is."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.captures.session import Captures
from holoview.diagnose.beams import VERY_MANY, beams
from holoview.diagnose.bench import Bench, PerThread, Progress, same_physics
from holoview.diagnose.comparison import Values
from holoview.diagnose.confounds import correlations, separating
from holoview.diagnose.decide import Decision, Verdict, decide
from holoview.diagnose.diagnosis import Candidate, Cause, Diagnosis, Quality
from holoview.diagnose.excess import excess
from holoview.diagnose.extend import Known
from holoview.diagnose.figures import groups, quality, samples, signal_explained
from holoview.diagnose.freeform import lives_in, places
from holoview.diagnose.judge import Selection, judge
from holoview.diagnose.measured import measured
from holoview.diagnose.nuisances import forgiving, with_nuisances
from holoview.diagnose.power import PowerLaw, gain_spread, only_power, power_law
from holoview.diagnose.refine import refined
from holoview.diagnose.sampling import without_artefacts
from holoview.diagnose.select import select
from holoview.diagnose.split import roughness, split
from holoview.diagnose.team import Team
from holoview.diagnose.uncertainty import intervals, tangent
from holoview.diagnose.ways import PLAIN, Way
from holoview.effects.effect import Effect
from holoview.effects.registry import registry
from holoview.errors import UserError

_LEAST_CAPTURES = 2
_REJUDGED = 3  # candidates, once nuisances are known, of those that leave so little more than the best:
_NEAR, _NEAR_FLOOR = 4.0, 0.1  # times its χ²/n − 1; beyond it
_MOST_FIELDS = 16000
_UNEXPLAINED = 1.1  # χ²/n above which it is worth asking where the rest lives


def diagnose(
    captures: Captures,
    effects: Iterable[Effect] | None = None,
    *,
    known: Values | None = None,
    workers: int = 2,
    report: Progress | None = None,
    free_maps: bool = True,
    thorough: bool = False,
    way: Way = PLAIN,
) -> Diagnosis:
    """Names what the nominal model of these captures gets wrong.

    effects: the candidates (all of the registry when None). known: effects that the nominal model has; what is found
    adds to them. workers: processes or threads; results don't depend on their number. free_maps: ask where an
    unexplained error lives. thorough: without it a search begins nothing new after 16 000 fields, about a minute for
    128 × 96 modulator pixels. way: how light is sampled. report: (done, total, what). Raises UserError when there are
    too few captures to judge.
    """
    began = time.monotonic()
    report = report or (lambda done, total, note: None)
    _check(captures)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        library = list(registry().values() if effects is None else effects)
        bench, notes = _prepare(captures, library, known or {}, workers, way)
        bench = bench if thorough else dataclasses.replace(bench, most_fields=_MOST_FIELDS)
        return _diagnosed(bench, notes, report, free_maps, began)
    finally:
        torch.set_num_threads(threads)


def _check(captures: Captures) -> None:
    if len(captures) < _LEAST_CAPTURES:
        raise UserError(
            "captures",
            "one only",
            expected="at least two: some to fit, some to judge by",
            remedy="from one capture nothing can be held out, so no cause could be told from chance",
        )


def _prepare(
    captures: Captures, effects: Sequence[Effect], known: Values, workers: int, way: Way
) -> tuple[Bench, list[str]]:
    facts = captures.facts()
    missing = {e.id: e.needs.missing(facts) for e in effects}
    seen = {e.id: e for e in effects if not missing[e.id]}
    notes = [f"{name} can't be seen in these captures: {why}." for name, why in missing.items() if why]
    if facts.wavelengths == 1:
        notes.append("With one wavelength, errors of the wavelength and of distances can't be told apart.")
    if facts.planes == 1 and not facts.is_fourier:
        notes.append("With one plane, a wrong wavelength looks much like a wrong distance.")
    bench = Bench(
        measured=measured(captures),
        system=captures.system(),
        effects=seen,
        split=split(captures, roughness(captures)),
        predict=PerThread(partial(Known, captures, known, **dataclasses.asdict(way))),
        team=Team(workers),
        way=way,
        equals=same_physics(seen, facts),
    )
    return bench, notes


def _diagnosed(bench: Bench, notes: list[str], report: Progress, free_maps: bool, began: float) -> Diagnosis:
    bench = with_nuisances(bench, {})
    bench, selection = _searched(bench, report)
    decision, forgiven = forgiving(bench, selection, decide(selection, bench.equals))
    decision, doubts = without_artefacts(bench, selection, decision)
    notes = [*notes, *forgiven, *doubts, *_ended_early(bench, decision)]
    gain = _gains(bench, decision)
    law = _power_law(bench, gain)
    report(1, 1, "intervals, look-alikes")
    causes = _causes(bench, selection, decision)
    return _told(bench, selection, decision, gain, law, causes, notes, report, free_maps, began)


def _searched(bench: Bench, report: Progress) -> tuple[Bench, Selection]:
    """What a search finds; none is begun where a shaking camera alone explains the captures."""
    nothing = judge(bench, [])
    if bench.shaking and forgiving(bench, nothing, decide(nothing, bench.equals))[0].verdict is Verdict.CONSISTENT:
        return bench, nothing
    selection = select(bench, [e for e in bench.effects.values() if not only_power(e)], report)
    settled = with_nuisances(bench, selection.best.trial.values)
    if settled is bench:
        return bench, selection
    near = [c.trial for c in selection.candidates[:_REJUDGED] if c.excess < _NEAR * selection.best.excess + _NEAR_FLOOR]
    return settled, judge(settled, settled.side_by_side(partial(refined, settled, trial) for trial in near))


def _ended_early(bench: Bench, decision: Decision) -> list[str]:
    """A note where a search that hadn't come to its end was ended."""
    if not bench.is_spent or decision.verdict not in (Verdict.UNEXPLAINED, Verdict.PARTLY):
        return []
    return ["The search was ended with causes left to try; a thorough one (--thorough) takes minutes more."]


def _gains(bench: Bench, decision: Decision) -> NDArray[np.float64]:
    """The gain of every capture under the best model."""
    values = decision.best.trial.values if decision.best else {}
    return bench.coarse_comparison(np.arange(len(bench.measured.captures)), 0.0).fit(values).gain


def _power_law(bench: Bench, gain: NDArray[np.float64]) -> PowerLaw | None:
    """What the gains of all captures tell of the lasers' power."""
    found = [power_law(e, bench.measured.captures, gain) for e in bench.effects.values() if only_power(e)]
    return min((law for law in found if law is not None), key=lambda law: law.after, default=None)


def _causes(bench: Bench, selection: Selection, decision: Decision) -> list[Cause]:
    if decision.best is None:
        return []
    trial, judged_by = decision.best.trial, selection.comparison
    after = quality(judged_by, judged_by.fit(trial.values))
    effects = [bench.effects[name] for name in trial.causes]
    fitted = bench.judged_by(bench.split.fine, trial.values)
    at = tangent(trial, effects, fitted)
    found = intervals(trial, at, fitted)
    one_or_two = [0] if beams(bench, trial.values) >= VERY_MANY else [0, -1]
    few = bench.judged_by(bench.split.coarse[one_or_two], trial.values)
    alike = correlations(bench, trial, tangent(trial, effects, few), few)
    separate = separating(bench, decision.best, decision.rivals[0]) if decision.rivals else None
    rivals = {name: 1.0 for rival in decision.rivals for name in rival.causes if name not in trial.causes}
    causes = []
    for effect in effects:
        before = quality(judged_by, judged_by.fit(trial.without(effect.id).values))
        share = (before.chi2 - after.chi2) / max(before.chi2 - 1.0, 1e-9)
        shown = {name: interval for (e, name), interval in found.items() if e == effect.id}
        causes.append(
            Cause(
                effect=effect.id,
                sentence=effect.sentence(bench.system, trial.values[effect.id]),
                intervals=shown,
                units={p.name: p.unit for p in effect.parameters},
                excess_explained=float(np.clip(share, 0.0, 1.0)),
                gain_db=after.psnr_db - before.psnr_db,
                before=before,
                after=after,
                confounded_with=rivals | alike[effect.id],
                separate_by=separate,
            )
        )
    return sorted(causes, key=lambda c: -c.gain_db)


def _told(
    bench: Bench,
    selection: Selection,
    decision: Decision,
    gain: NDArray[np.float64],
    law: PowerLaw | None,
    causes: list[Cause],
    notes: list[str],
    report: Progress,
    free_maps: bool,
    began: float,
) -> Diagnosis:
    captures, comparison = bench.measured.captures, selection.comparison
    values = decision.best.trial.values if decision.best else {}
    verdict = decision.verdict
    nominal, best = comparison.fit({}), comparison.fit(values)
    after = quality(comparison, best)
    left = max(after.chi2 - 1.0, 0.0) / max(selection.nominal.excess, 1e-9)
    freed = []
    if free_maps and verdict in (Verdict.UNEXPLAINED, Verdict.PARTLY) and after.chi2 > _UNEXPLAINED:
        report(0, 1, "free maps at every place")
        freed = places(bench, values, comparison)
    if law is not None:
        values = values | law.values
        causes = [*causes, _power_cause(bench, law)]
        verdict = Verdict.EXPLAINED if verdict is Verdict.CONSISTENT else verdict
        verdict = Verdict.PARTLY if verdict is Verdict.UNEXPLAINED else verdict
    rough = roughness(captures)
    return Diagnosis(
        verdict=verdict,
        before=quality(comparison, nominal),
        after=after,
        causes=tuple(causes),
        values=values,
        rivals=tuple(r.causes for r in decision.rivals),
        unexplained=0.0 if decision.verdict is Verdict.CONSISTENT else float(min(left, 1.0)),
        lives_in=lives_in(freed),
        groups=groups(captures, comparison, nominal, best),
        candidates=tuple(Candidate(c.causes, c.chi2) for c in selection.candidates),
        samples=samples(captures, comparison, nominal, best),
        where_before=excess(captures, comparison, nominal, rough),
        where_after=excess(captures, comparison, best, rough),
        signal_explained=(signal_explained(comparison, nominal), signal_explained(comparison, best)),
        fixed_pattern=bench.fixed_pattern,
        gain_spread=gain_spread(captures, gain),
        notes=tuple(notes),
        seconds=time.monotonic() - began,
    )


def _power_cause(bench: Bench, law: PowerLaw) -> Cause:
    """The laser's law as a cause; its before and after are the spread of the gains, as errors of the pictures."""
    effect = bench.effects[law.effect]
    gain_db = 20 * float(np.log10(law.before / max(law.after, 1e-9)))
    nothing = Quality(float("nan"), float("nan"))
    return Cause(
        effect=effect.id,
        sentence=effect.sentence(bench.system, law.values[effect.id]),
        intervals={name: interval for (_, name), interval in law.intervals.items()},
        units={p.name: p.unit for p in effect.parameters},
        excess_explained=1.0 - (law.after / law.before) ** 2,
        gain_db=gain_db,
        before=nothing,
        after=nothing,
    )
