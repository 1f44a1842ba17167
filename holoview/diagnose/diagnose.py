"""From captures to a diagnosis: prepare, search, decide, and tell how sure it is."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.captures.session import Captures
from holoview.diagnose.bench import Bench, Progress, same_physics
from holoview.diagnose.comparison import Comparison, Fitted, Values
from holoview.diagnose.confounds import correlations, separating
from holoview.diagnose.decide import QUIET, Decision, Verdict, decide
from holoview.diagnose.diagnosis import Candidate, Cause, Diagnosis, Group, Quality, Sample
from holoview.diagnose.drift import DRIFTING, drift
from holoview.diagnose.excess import excess
from holoview.diagnose.extend import Known
from holoview.diagnose.freeform import lives_in, places
from holoview.diagnose.measured import Images, measured
from holoview.diagnose.noise import fixed_pattern
from holoview.diagnose.power import PowerLaw, gain_spread, only_power, power_law
from holoview.diagnose.select import Selection, judge, select
from holoview.diagnose.split import roughness, split
from holoview.diagnose.uncertainty import intervals, tangent
from holoview.diagnose.unknowns import Found
from holoview.effects.effect import Effect
from holoview.effects.registry import registry
from holoview.errors import UserError

_LEAST_CAPTURES = 2
_PATTERN_BELOW = 3.0  # χ²/n up to which residuals tell the pixels' own sensitivity from errors of the model
_MOST_PATTERN = 0.1
_SAMPLES = 4
_NUISANCE_LEFT, _MOST_NUISANCE = 0.02, 0.06  # χ²/n that movements of the camera leave, of what they caused; at most
_UNEXPLAINED = 1.1  # χ²/n above which it is worth asking where the rest lives


def diagnose(
    captures: Captures,
    effects: Iterable[Effect] | None = None,
    *,
    known: Values | None = None,
    workers: int = 2,
    report: Progress | None = None,
    free_maps: bool = True,
) -> Diagnosis:
    """Names what the nominal model of these captures gets wrong.

    effects: the candidates (all of the registry when None). known: effects that the nominal model has; what is found
    adds to them. workers: threads, each with its own predictor; results don't depend on their number. free_maps: ask
    where an unexplained error lives. report: (done, total, what). Raises UserError when there are too few captures to
    judge.
    """
    began = time.monotonic()
    report = report or (lambda done, total, note: None)
    _check(captures)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with ThreadPoolExecutor(max(1, workers)) as pool:
            library = list(registry().values() if effects is None else effects)
            bench, notes = _prepare(captures, library, known or {}, pool, workers)
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
    captures: Captures, effects: Sequence[Effect], known: Values, pool: ThreadPoolExecutor, workers: int
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
        make_predictor=partial(Known, captures, known),
        pool=pool,
        workers=workers,
        equals=same_physics(seen, facts),
    )
    return bench, notes


def _diagnosed(bench: Bench, notes: list[str], report: Progress, free_maps: bool, began: float) -> Diagnosis:
    bench = _with_pattern(bench, {})
    searched = [e for e in bench.effects.values() if not only_power(e)]
    selection = select(bench, searched, report)
    if bench.fixed_pattern == 0.0:
        bench = _with_pattern(bench, selection.best.trial.values)
        if bench.fixed_pattern:
            selection = judge(bench, [c.trial for c in selection.candidates])
    decision = decide(selection, bench.equals)
    decision, notes = _forgiving_nuisances(bench, selection, decision, notes)
    law = _power_law(bench, decision)
    report(1, 1, "intervals, look-alikes")
    causes = _causes(bench, selection, decision)
    return _told(bench, selection, decision, law, causes, notes, report, free_maps, began)


def _with_pattern(bench: Bench, values: Found) -> Bench:
    """The bench with the camera's fixed pattern, where the residuals of two disjoint sets of captures show one."""
    sets = [bench.split.fine, bench.split.held_out]
    comparisons = [bench.judged_by(indices, values) for indices in sets]
    if max(c.chi2(values) for c in comparisons) > _PATTERN_BELOW:
        return bench
    residuals, expected, usable = [], [], []
    for comparison in comparisons:
        fitted = comparison.fit(values)
        seen = comparison.weight > 0
        residuals.append(np.where(seen, fitted.residual / np.where(seen, comparison.weight, 1.0), 0.0))
        expected.append(fitted.expected)
        usable.append(seen)
    return replace(bench, fixed_pattern=min(fixed_pattern(residuals, expected, usable), _MOST_PATTERN))


def _forgiving_nuisances(
    bench: Bench, selection: Selection, decision: Decision, notes: list[str]
) -> tuple[Decision, list[str]]:
    """Consistent after all, where what drifts and shakes without direction accounts for what is left; with a note."""
    if decision.verdict is not Verdict.UNEXPLAINED:
        return decision, notes
    comparison = selection.comparison
    still = bench.coarse_comparison(comparison.indices, 0.0).fit({}).squares.sum() / comparison.count
    allowed = QUIET + min(_NUISANCE_LEFT * max(still - selection.nominal.chi2, 0.0), _MOST_NUISANCE)
    if selection.nominal.excess <= allowed:
        return Decision(Verdict.CONSISTENT, None), [
            *notes,
            "The camera moves between captures; that explains the rest.",
        ]
    if DRIFTING not in bench.effects:
        return decision, notes
    found = drift(comparison, {})
    if found.has_direction or found.chi2 - 1.0 > allowed:
        return decision, notes
    note = f"The wavelengths drift by {found.rms_m * 1e9:.2g} nm (r.m.s.) between captures; that explains what is left."
    return Decision(Verdict.CONSISTENT, None), [*notes, note]


def _power_law(bench: Bench, decision: Decision) -> PowerLaw | None:
    """What the gains of all captures tell of the lasers' power, under the best model."""
    values = decision.best.trial.values if decision.best else {}
    everything = np.arange(len(bench.measured.captures))
    gain = bench.coarse_comparison(everything, 0.0).fit(values).gain
    found = [power_law(e, bench.measured.captures, gain) for e in bench.effects.values() if only_power(e)]
    return min((law for law in found if law is not None), key=lambda law: law.after, default=None)


def _causes(bench: Bench, selection: Selection, decision: Decision) -> list[Cause]:
    if decision.best is None:
        return []
    trial = decision.best.trial
    effects = [bench.effects[name] for name in trial.causes]
    fitted = bench.judged_by(bench.split.fine, trial.values)
    at = tangent(trial, effects, fitted)
    found = intervals(trial, at, fitted)
    alike = correlations(
        bench,
        trial,
        tangent(trial, effects, bench.judged_by(bench.split.coarse, trial.values)),
        bench.judged_by(bench.split.coarse, trial.values),
    )
    separate = separating(bench, decision.best, decision.rivals[0]) if decision.rivals else None
    rivals = {name: 1.0 for rival in decision.rivals for name in rival.causes if name not in trial.causes}
    causes = []
    for effect in effects:
        without = {name: values for name, values in trial.values.items() if name != effect.id}
        before, after = (_quality(selection.comparison, values) for values in (without, trial.values))
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
    after = _quality(comparison, values)
    left = max(after.chi2 - 1.0, 0.0) / max(selection.nominal.excess, 1e-9)
    freed = []
    if free_maps and verdict in (Verdict.UNEXPLAINED, Verdict.PARTLY) and after.chi2 > _UNEXPLAINED:
        report(0, 1, "free maps at every place")
        freed = places(bench, values, comparison)
    everything = bench.judged_by(np.arange(len(captures)), values)
    spread = gain_spread(captures, everything.fit(values).gain)
    if law is not None:
        values = values | law.values
        causes = [*causes, _power_cause(bench, law)]
        verdict = Verdict.EXPLAINED if verdict is Verdict.CONSISTENT else verdict
        verdict = Verdict.PARTLY if verdict is Verdict.UNEXPLAINED else verdict
    rough = roughness(captures)
    fitted = [comparison.fit(v) for v in ({}, values)]
    return Diagnosis(
        verdict=verdict,
        before=_quality(comparison, {}),
        after=after,
        causes=tuple(causes),
        values=values,
        rivals=tuple(r.causes for r in decision.rivals),
        unexplained=float(min(left, 1.0)) if selection.nominal.excess > 0.02 else 0.0,
        lives_in=lives_in(freed),
        groups=_groups(captures, comparison, values),
        candidates=tuple(Candidate(c.causes, c.chi2) for c in selection.candidates),
        samples=_samples(captures, comparison, fitted[0], fitted[1]),
        where_before=excess(captures, comparison, fitted[0], rough),
        where_after=excess(captures, comparison, fitted[1], rough),
        signal_explained=(_explained(comparison, {}), _explained(comparison, values)),
        fixed_pattern=bench.fixed_pattern,
        gain_spread=spread,
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


def _quality(comparison: Comparison, values: Found, only: NDArray[np.bool_] | None = None) -> Quality:
    """χ²/n and mean PSNR of captures (all, or those of a mask)."""
    fitted = comparison.fit(values)
    chosen = np.ones(len(comparison.indices), dtype=bool) if only is None else only
    chi2 = fitted.squares[chosen].sum() / max(comparison.pixels[chosen].sum(), 1.0)
    return Quality(float(chi2), float(_psnr(comparison, fitted.residual)[chosen].mean()))


def _psnr(comparison: Comparison, residual: Images) -> NDArray[np.float64]:
    """PSNR of each capture against its brightest 0.1 %."""
    usable = comparison.weight > 0
    errors = np.where(usable, residual / np.where(usable, comparison.weight, 1.0), 0.0)
    mean_square = np.square(errors, dtype=np.float64).sum((1, 2)) / np.maximum(comparison.pixels, 1.0)
    peak = np.array([np.quantile(light[seen], 0.999) for light, seen in zip(comparison.light, usable, strict=True)])
    return 10 * np.log10(np.maximum(peak, 1e-9) ** 2 / np.maximum(mean_square, 1e-12))


def _explained(comparison: Comparison, values: Found) -> float:
    """Share of the pictures' variance that a model explains."""
    fitted = comparison.fit(values)
    usable = comparison.weight > 0
    errors = np.where(usable, fitted.residual / np.where(usable, comparison.weight, 1.0), 0.0)
    spread = [float(light[seen].var() * seen.sum()) for light, seen in zip(comparison.light, usable, strict=True)]
    return 1.0 - float(np.square(errors, dtype=np.float64).sum() / max(sum(spread), 1e-9))


def _groups(captures: Captures, comparison: Comparison, values: Found) -> tuple[Group, ...]:
    indices = comparison.indices
    wavelengths, planes = captures.wavelength_m[indices], captures.distance_m[indices]
    groups = []
    for wavelength, plane in sorted(set(zip(wavelengths, planes, strict=True))):
        same = (wavelengths == wavelength) & (planes == plane)
        before, after = (_quality(comparison, v, same) for v in ({}, values))
        groups.append(Group(float(wavelength), float(plane), before, after))
    return tuple(groups)


def _samples(captures: Captures, comparison: Comparison, before: Fitted, after: Fitted) -> tuple[Sample, ...]:
    """Held-out captures of different wavelengths, as far as there are."""
    wavelengths = captures.wavelength_m[comparison.indices]
    first_of_each = [int(np.flatnonzero(wavelengths == w)[0]) for w in np.unique(wavelengths)]
    chosen = first_of_each if len(first_of_each) > 1 else list(range(len(wavelengths)))
    samples = []
    for k in chosen[:_SAMPLES]:
        index = int(comparison.indices[k])
        samples.append(
            Sample(
                capture=index,
                wavelength_m=float(captures.wavelength_m[index]),
                distance_m=float(captures.distance_m[index]),
                light=comparison.light[k],
                predicted=(before.expected[k], after.expected[k]),
                residual=(before.residual[k], after.residual[k]),
            )
        )
    return tuple(samples)
