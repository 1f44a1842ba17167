"""Puts a diagnosis together from the result of a search, and from the check of the records before it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.patterns import pattern_roughness
from holoview.bench.diagnose.correct.wrong_records import CheckedRecords
from holoview.bench.diagnose.detail_veto import veto_no_size
from holoview.bench.diagnose.fit_statistics import (
    break_down_excess,
    explained_variance,
    fit_quality,
    held_out_groups,
    sample_captures,
    speckle_change,
)
from holoview.bench.diagnose.intervals import Interval
from holoview.bench.diagnose.judge import RIVAL_FACTOR, Verdict, with_further_cause
from holoview.bench.diagnose.outlier_rejection import SearchOutcome
from holoview.bench.diagnose.power_law import PowerLawFit, changes_only_power, fit_power_law, gain_spread
from holoview.bench.diagnose.report.causes import (
    describe_causes,
    describe_power_law,
    describe_wrong_records,
    intervals_of,
)
from holoview.bench.diagnose.report.diagnosis import CandidateResult, Diagnosis
from holoview.bench.diagnose.report.error_places import (
    FreeMapFit,
    find_pixel_maps,
    fit_free_maps,
    flicker_notes,
    likely_fits,
    line_notes,
)
from holoview.bench.diagnose.rivals import wider_names
from holoview.bench.diagnose.search_context import SearchContext, SearchEnd
from holoview.util.progress import ProgressCallback

_FEWER_PROFILES = (
    "The time was over: intervals that weren't yet widened to where χ² rises follow from derivatives alone, and may be "
    "too narrow."
)
_SHORT_MAPS = "The time was short for the places where what is left lives: with more, they may explain more of it."
_MAPS_SHARE = 0.3
"""[1] Of the time of a search, which the fits of free maps may take behind it. Evidence: a reason: it is told as a
little longer."""


def assemble(
    outcome: SearchOutcome,
    notes: list[str],
    free_maps: bool,
    progress: ProgressCallback,
    end: SearchEnd,
    *,
    of_one_picture: bool,
) -> Diagnosis:
    """The diagnosis that follows from a search, but for the time that it took.

    notes: on what the captures can't show. free_maps: look for the place of an error that no effect explains. end: of
    the time; later, intervals follow from derivatives alone. of_one_picture: the captures are parts of one picture, of
    which nothing changes from capture to capture.
    """
    progress(1, 1, "intervals, look-alikes")
    outcome, intervals = _without_causes_of_no_size(outcome, end)
    result, decision = outcome.result, outcome.decision
    context, comparison, values = outcome.context, result.comparison, decision.values
    captures = context.data.captures
    gain = outcome.searched.data_weighted_comparison(context.kept, 0.0).fit_gains(values).gain
    law = _power_law(context, gain)
    causes = describe_causes(context, outcome.searched, result, decision, intervals)
    if causes and end.seconds_left < 0:
        notes = [*notes, _FEWER_PROFILES]
    nominal, best = comparison.fit_gains({}), comparison.fit_gains(values)
    after = fit_quality(comparison, best)
    left = max(after.chi2_per_pixel - 1.0, 0.0) / max(result.nominal.excess, 1e-9)
    roughness = pattern_roughness(captures)
    is_open = decision.verdict.is_open and after.chi2_per_pixel > context.config.verdict.explained_chi2
    pixels = find_pixel_maps(outcome.searched, values) if free_maps and is_open else ()
    maps = _free_maps(outcome, progress, end.time_s) if free_maps and is_open else ()
    short = [_SHORT_MAPS] if any(fit.was_ended for fit in maps) else []
    changing = [] if of_one_picture else flicker_notes(outcome.searched, values, pixels)
    return Diagnosis(
        verdict=decision.verdict if law is None else with_further_cause(decision.verdict),
        before=fit_quality(comparison, nominal),
        after=after,
        causes=tuple(causes if law is None else [*causes, describe_power_law(context, law)]),
        values=values if law is None else values | law.values,
        rivals=_rivals(outcome),
        unexplained=0.0 if decision.verdict is Verdict.CONSISTENT else float(min(left, 1.0)),
        free_maps=maps,
        pixel_maps=pixels,
        groups=held_out_groups(captures, comparison, nominal, best),
        candidates=tuple(CandidateResult(c.causes, c.chi2_per_pixel) for c in result.candidates),
        samples=sample_captures(captures, comparison, nominal, best),
        excess_before=break_down_excess(captures, comparison, nominal, roughness),
        excess_after=break_down_excess(captures, comparison, best, roughness),
        signal_explained=(explained_variance(comparison, nominal), explained_variance(comparison, best)),
        speckle=speckle_change(comparison, nominal, best),
        fixed_pattern=context.prnu,
        gain_spread=gain_spread(context.kept_captures, gain),
        captures=len(captures),
        bad_captures=outcome.bad_captures,
        notes=(*notes, *outcome.notes, *short, *line_notes(pixels), *changing),
        seconds=math.nan,
    )


def _without_causes_of_no_size(
    outcome: SearchOutcome, end: SearchEnd
) -> tuple[SearchOutcome, dict[tuple[str, str], Interval]]:
    """The outcome without causes that may be nominal, with notes, and the interval of each (effect, parameter)."""
    fitted = outcome.fitted or outcome.context
    intervals = intervals_of(fitted, outcome.decision, end)
    result, decision, vetoes = veto_no_size(outcome.context, outcome.result, outcome.decision, intervals, fitted)
    if vetoes and not decision.values.items() <= outcome.decision.values.items():  # the others were fitted again
        intervals = intervals_of(fitted, decision, end)
    return dataclasses.replace(outcome, result=result, decision=decision, notes=[*outcome.notes, *vetoes]), intervals


def _rivals(outcome: SearchOutcome) -> tuple[tuple[str, ...], ...]:
    """The sets of causes that can't be excluded; last the sets of the same physics in more numbers, and sets with
    effects that these captures can't show."""
    decision = outcome.decision
    unseen = [fit.causes for fit in outcome.result.unseen_rivals if decision.best is outcome.result.best]
    return (*(r.causes for r in decision.rivals), *unseen, *wider_names(outcome.context, decision))


def with_wrong_records(diagnosis: Diagnosis, records: CheckedRecords) -> Diagnosis:
    """The diagnosis of corrected captures with the wrong records as its first causes, and the file's numbering."""
    findings = records.findings
    found = dataclasses.replace(diagnosis, records=findings, notes=(*findings.notes, *diagnosis.notes))
    if not records.gains:
        return found
    return dataclasses.replace(
        found,
        bad_captures=tuple(dataclasses.replace(one, index=records.kept[one.index]) for one in found.bad_captures),
        samples=tuple(dataclasses.replace(one, capture=records.kept[one.capture]) for one in found.samples),
        verdict=with_further_cause(found.verdict),
        causes=(*describe_wrong_records(records.gains), *found.causes),
    )


def better_explained(records: CheckedRecords, corrected: Diagnosis, as_recorded: Diagnosis) -> Diagnosis:
    """The diagnosis with corrections; or without, and with a note, if it excludes the diagnosis with corrections."""
    before, after = (d.after.chi2_per_pixel - 1.0 for d in (corrected, as_recorded))
    if before < RIVAL_FACTOR * after:
        return corrected
    names = " and ".join(correction.effect for correction in records.findings.corrections)
    note = f"The records look as if they were wrong ({names}), but the captures are explained better as recorded."
    return dataclasses.replace(as_recorded, notes=(note, *as_recorded.notes))


def _power_law(context: SearchContext, gain: NDArray[np.float64]) -> PowerLawFit | None:
    """The law of the lasers' power that leaves the smallest spread of the gains, if a law is significant."""
    captures, laws = context.kept_captures, [e for e in context.effects.values() if changes_only_power(e)]
    fits = [fit_power_law(effect, captures, gain) for effect in laws]
    return min((fit for fit in fits if fit is not None), key=lambda fit: fit.spread_after, default=None)


def _free_maps(outcome: SearchOutcome, progress: ProgressCallback, most_s: float) -> tuple[FreeMapFit, ...]:
    """The places of an error that no effect explains, with maps that are free there. most_s: time of the search."""
    context, values = outcome.searched, outcome.decision.values
    progress(0, 1, "free maps at every place")
    held_out = outcome.result.comparison
    if context is not outcome.context:
        held_out = context.model_weighted_comparison(context.split.held_out, values)
    base = {name: dict(own) for name, own in values.items()}
    return likely_fits(fit_free_maps(context, base, held_out, _MAPS_SHARE * most_s))
