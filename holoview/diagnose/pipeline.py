"""From captures to a diagnosis: prepare, search, decide, and tell how sure it is."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.captures.patterns import pattern_roughness
from holoview.captures.prepared_captures import prepare_captures
from holoview.diagnose.capture_split import split_captures
from holoview.diagnose.comparison import Values
from holoview.diagnose.confounders import best_separating_capture, lookalike_correlations
from holoview.diagnose.diagnosis import CandidateResult, Cause, Diagnosis, FitQuality
from holoview.diagnose.excess_breakdown import break_down_excess
from holoview.diagnose.extended_model import PredictorWithKnownEffects
from holoview.diagnose.field_count import VERY_MANY, incoherent_field_count
from holoview.diagnose.fit_statistics import explained_variance, fit_quality, held_out_groups, sample_captures
from holoview.diagnose.forward_selection import select_causes
from holoview.diagnose.free_maps import fit_free_maps, likely_locations
from holoview.diagnose.held_out_ranking import SearchResult, rank_on_held_out
from holoview.diagnose.nuisances import detect_nuisances, excuse_laser_drift
from holoview.diagnose.power_law import PowerLawFit, changes_only_power, fit_power_law, gain_spread
from holoview.diagnose.refine import refine_fit
from holoview.diagnose.sampling_check import drop_sampling_artefacts
from holoview.diagnose.sampling_config import PLAIN, SamplingConfig
from holoview.diagnose.search_context import PerThreadPredictor, SearchContext, equivalent_effects
from holoview.diagnose.uncertainty import confidence_intervals, local_jacobian
from holoview.diagnose.verdict import Decision, Verdict, decide
from holoview.diagnose.worker_pool import WorkerPool
from holoview.model.effects.effect import Effect
from holoview.model.effects.registry import listed_effects
from holoview.util.errors import UserError
from holoview.util.progress import ProgressCallback

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
    progress: ProgressCallback | None = None,
    free_maps: bool = True,
    thorough: bool = False,
    sampling: SamplingConfig = PLAIN,
) -> Diagnosis:
    """Names what the nominal model of these captures gets wrong.

    effects: the candidates (all of the registry when None). known: effects that the nominal model has; what is found
    adds to them. workers: processes or threads; results don't depend on their number. free_maps: ask where an
    unexplained error lives. thorough: without it a search begins nothing new after 16 000 fields, about a minute for
    128 × 96 modulator pixels. way: how light is sampled. report: (done, total, what). Raises UserError when there are
    too few captures to judge.
    """
    began = time.monotonic()
    progress = progress or (lambda done, total, note: None)
    _check_capture_count(captures)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        library = list(listed_effects().values() if effects is None else effects)
        bench, notes = _prepare(captures, library, known or {}, workers, sampling)
        bench = bench if thorough else dataclasses.replace(bench, field_budget=_MOST_FIELDS)
        return _run_pipeline(bench, notes, progress, free_maps, began)
    finally:
        torch.set_num_threads(threads)


def _check_capture_count(captures: Captures) -> None:
    if len(captures) < _LEAST_CAPTURES:
        raise UserError(
            "captures",
            "one only",
            expected="at least two: some to fit, some to judge by",
            remedy="from one capture nothing can be held out, so no cause could be told from chance",
        )


def _prepare(
    captures: Captures, effects: Sequence[Effect], known: Values, workers: int, sampling: SamplingConfig
) -> tuple[SearchContext, list[str]]:
    facts = captures.data_properties()
    missing = {e.id: e.needs.unmet_by(facts) for e in effects}
    seen = {e.id: e for e in effects if not missing[e.id]}
    notes = [f"{name} can't be seen in these captures: {why}." for name, why in missing.items() if why]
    if facts.wavelengths == 1:
        notes.append("With one wavelength, errors of the wavelength and of distances can't be told apart.")
    if facts.planes == 1 and not facts.is_fourier:
        notes.append("With one plane, a wrong wavelength looks much like a wrong distance.")
    bench = SearchContext(
        data=prepare_captures(captures),
        system=captures.nominal_system(),
        effects=seen,
        split=split_captures(captures, pattern_roughness(captures)),
        predictor=PerThreadPredictor(
            partial(PredictorWithKnownEffects, captures, known, **dataclasses.asdict(sampling))
        ),
        workers=WorkerPool(workers),
        sampling=sampling,
        equivalents=equivalent_effects(seen, facts),
    )
    return bench, notes


def _run_pipeline(
    context: SearchContext, notes: list[str], progress: ProgressCallback, free_maps: bool, began: float
) -> Diagnosis:
    context = detect_nuisances(context, {})
    context, selection = _search_causes(context, progress)
    decision, forgiven = excuse_laser_drift(context, selection, decide(selection, context.equivalents))
    decision, doubts = drop_sampling_artefacts(context, selection, decision)
    notes = [*notes, *forgiven, *doubts, *_budget_notes(context, decision)]
    gain = _gains(context, decision)
    law = _power_law(context, gain)
    progress(1, 1, "intervals, look-alikes")
    causes = _describe_causes(context, selection, decision)
    return _assemble_diagnosis(context, selection, decision, gain, law, causes, notes, progress, free_maps, began)


def _search_causes(context: SearchContext, progress: ProgressCallback) -> tuple[SearchContext, SearchResult]:
    """What a search finds; none is begun where a shaking camera alone explains the captures."""
    nothing = rank_on_held_out(context, [])
    if (
        context.has_camera_jitter
        and excuse_laser_drift(context, nothing, decide(nothing, context.equivalents))[0].verdict is Verdict.CONSISTENT
    ):
        return context, nothing
    selection = select_causes(context, [e for e in context.effects.values() if not changes_only_power(e)], progress)
    settled = detect_nuisances(context, selection.best.fit.values)
    if settled is context:
        return context, selection
    near = [c.fit for c in selection.candidates[:_REJUDGED] if c.excess < _NEAR * selection.best.excess + _NEAR_FLOOR]
    return settled, rank_on_held_out(
        settled, settled.run_parallel(partial(refine_fit, settled, trial) for trial in near)
    )


def _budget_notes(context: SearchContext, decision: Decision) -> list[str]:
    """A note where a search that hadn't come to its end was ended."""
    if not context.budget_exhausted or decision.verdict not in (Verdict.UNEXPLAINED, Verdict.PARTLY):
        return []
    return ["The search was ended with causes left to try; a thorough one (--thorough) takes minutes more."]


def _gains(context: SearchContext, decision: Decision) -> NDArray[np.float64]:
    """The gain of every capture under the best model."""
    values = decision.best.fit.values if decision.best else {}
    return context.data_weighted_comparison(np.arange(len(context.data.captures)), 0.0).fit_gains(values).gain


def _power_law(context: SearchContext, gain: NDArray[np.float64]) -> PowerLawFit | None:
    """What the gains of all captures tell of the lasers' power."""
    found = [fit_power_law(e, context.data.captures, gain) for e in context.effects.values() if changes_only_power(e)]
    return min((law for law in found if law is not None), key=lambda law: law.spread_after, default=None)


def _describe_causes(context: SearchContext, selection: SearchResult, decision: Decision) -> list[Cause]:
    if decision.best is None:
        return []
    trial, judged_by = decision.best.fit, selection.comparison
    after = fit_quality(judged_by, judged_by.fit_gains(trial.values))
    effects = [context.effects[name] for name in trial.causes]
    fitted = context.model_weighted_comparison(context.split.fine, trial.values)
    at = local_jacobian(trial, effects, fitted)
    found = confidence_intervals(trial, at, fitted)
    one_or_two = [0] if incoherent_field_count(context, trial.values) >= VERY_MANY else [0, -1]
    few = context.model_weighted_comparison(context.split.coarse[one_or_two], trial.values)
    alike = lookalike_correlations(context, trial, local_jacobian(trial, effects, few), few)
    separate = best_separating_capture(context, decision.best, decision.rivals[0]) if decision.rivals else None
    rivals = {name: 1.0 for rival in decision.rivals for name in rival.causes if name not in trial.causes}
    causes = []
    for effect in effects:
        before = fit_quality(judged_by, judged_by.fit_gains(trial.without(effect.id).values))
        share = (before.chi2_per_pixel - after.chi2_per_pixel) / max(before.chi2_per_pixel - 1.0, 1e-9)
        shown = {name: interval for (e, name), interval in found.items() if e == effect.id}
        causes.append(
            Cause(
                effect=effect.id,
                sentence=effect.format_finding(context.system, trial.values[effect.id]),
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


def _assemble_diagnosis(
    context: SearchContext,
    selection: SearchResult,
    decision: Decision,
    gain: NDArray[np.float64],
    law: PowerLawFit | None,
    causes: list[Cause],
    notes: list[str],
    progress: ProgressCallback,
    free_maps: bool,
    began: float,
) -> Diagnosis:
    captures, comparison = context.data.captures, selection.comparison
    values = decision.best.fit.values if decision.best else {}
    verdict = decision.verdict
    nominal, best = comparison.fit_gains({}), comparison.fit_gains(values)
    after = fit_quality(comparison, best)
    left = max(after.chi2_per_pixel - 1.0, 0.0) / max(selection.nominal.excess, 1e-9)
    freed = []
    if free_maps and verdict in (Verdict.UNEXPLAINED, Verdict.PARTLY) and after.chi2_per_pixel > _UNEXPLAINED:
        progress(0, 1, "free maps at every place")
        freed = fit_free_maps(context, values, comparison)
    if law is not None:
        values = values | law.values
        causes = [*causes, _power_cause(context, law)]
        verdict = Verdict.EXPLAINED if verdict is Verdict.CONSISTENT else verdict
        verdict = Verdict.PARTLY if verdict is Verdict.UNEXPLAINED else verdict
    rough = pattern_roughness(captures)
    return Diagnosis(
        verdict=verdict,
        before=fit_quality(comparison, nominal),
        after=after,
        causes=tuple(causes),
        values=values,
        rivals=tuple(r.causes for r in decision.rivals),
        unexplained=0.0 if decision.verdict is Verdict.CONSISTENT else float(min(left, 1.0)),
        lives_in=likely_locations(freed),
        groups=held_out_groups(captures, comparison, nominal, best),
        candidates=tuple(CandidateResult(c.causes, c.chi2_per_pixel) for c in selection.candidates),
        samples=sample_captures(captures, comparison, nominal, best),
        excess_before=break_down_excess(captures, comparison, nominal, rough),
        excess_after=break_down_excess(captures, comparison, best, rough),
        signal_explained=(explained_variance(comparison, nominal), explained_variance(comparison, best)),
        fixed_pattern=context.prnu,
        gain_spread=gain_spread(captures, gain),
        notes=tuple(notes),
        seconds=time.monotonic() - began,
    )


def _power_cause(context: SearchContext, law: PowerLawFit) -> Cause:
    """The laser's law as a cause; its before and after are the spread of the gains, as errors of the pictures."""
    effect = context.effects[law.effect]
    gain_db = 20 * float(np.log10(law.spread_before / max(law.spread_after, 1e-9)))
    nothing = FitQuality(float("nan"), float("nan"))
    return Cause(
        effect=effect.id,
        sentence=effect.format_finding(context.system, law.values[effect.id]),
        intervals={name: interval for (_, name), interval in law.intervals.items()},
        units={p.name: p.unit for p in effect.parameters},
        excess_explained=1.0 - (law.spread_after / law.spread_before) ** 2,
        gain_db=gain_db,
        before=nothing,
        after=nothing,
    )
