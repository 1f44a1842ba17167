"""Large modulators: the middle of the pictures is searched; whole pictures polish and judge what was found there.

A field of 1024 × 768 modulator pixels takes a hundred times as long as one of 128 × 96, and a search needs thousands.
But most effects act everywhere alike. So the session is cut to its middle, with as much margin as light walks off
sideways, and searched. Hard edges of stops spread a little light further; what of it reaches the middle from beyond is
measured with the nominal bench and counts as noise. What was found is fitted once more to whole pictures, which then
rank and judge it. Only effects that show more towards the edges (`Effect.varies_over_field`) are searched in whole
pictures.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.captures.patterns import pattern_roughness
from holoview.captures.prepared_captures import prepare_captures
from holoview.captures.records.central_region import central_region, central_slices
from holoview.diagnose.bad_captures import BadCapture
from holoview.diagnose.capture_split import split_captures
from holoview.diagnose.judged_search import SearchOutcome, search_good_captures
from holoview.diagnose.search_context import Leads, NeighbourVariances, PerThreadPredictor, SearchContext, field_samples
from holoview.diagnose.verdict import Verdict
from holoview.util.progress import ProgressCallback

_EXPLAINED = (Verdict.CONSISTENT, Verdict.EXPLAINED, Verdict.AMBIGUOUS)


def with_region(context: SearchContext) -> SearchContext:
    """The context with its region; unchanged where the region would save little, or where there is none."""
    captures, config = context.data.captures, context.config.region
    cut = central_region(captures, config.side_px, config.further_px)
    if captures.levels[0].size < config.min_saving * cut.levels[0].size:
        return context
    data, system = prepare_captures(cut), cut.nominal_system()
    is_limited = math.isfinite(context.field_budget)
    region = replace(
        context,
        data=data,
        system=system,
        field_budget=context.config.budget.fields_for(field_samples(system)) if is_limited else math.inf,
        split=split_captures(cut, pattern_roughness(cut), context.config.split, context.left_out),
        predictor=PerThreadPredictor(partial(context.predictor.create, captures=cut)),
        variances=NeighbourVariances(data),
    )
    return replace(context, region=region)


def _cut_error(context: SearchContext, region: SearchContext) -> NDArray[np.float64]:
    """The region's r.m.s. error over mean light, (capture,), measured with the nominal bench.

    Captures that a search looks at are predicted whole and cut; the others take the error of the next rougher one.
    """
    known = np.array(sorted(region.split.used))
    jobs = [partial(_error_of, context, region, np.array([k])) for k in known]
    errors, roughness = np.array(context.run_parallel(jobs)), pattern_roughness(context.data.captures)
    order = np.argsort(roughness[known], kind="stable")
    place = np.minimum(np.searchsorted(roughness[known][order], roughness), len(known) - 1)
    found = np.asarray(errors[order][place], dtype=np.float64)
    found[known] = errors
    return found


def _error_of(context: SearchContext, region: SearchContext, index: NDArray[np.intp]) -> float:
    whole, cut = (np.asarray(c.predictor(index, {}).signal)[0] for c in (context, region))
    seen = whole[central_slices(whole.shape, (cut.shape[0], cut.shape[1]))]
    scaled = cut * (np.vdot(cut, seen) / np.vdot(cut, cut))
    return float(np.sqrt(np.square(seen - scaled).mean()) / seen.mean())


def search_region_first(
    context: SearchContext, useless: Sequence[BadCapture], count: int, progress: ProgressCallback
) -> SearchOutcome:
    """The causes and the bad ones of `count` captures, as `search_good_captures` finds them, by the region if any."""
    if context.region is None:
        return search_good_captures(context, useless, count, progress)
    progress(0, 1, "light from beyond the middle")
    region = replace(context.region, cut_error=_cut_error(context, context.region))
    inner = search_good_captures(region, useless, count, progress)
    decision = inner.decision
    fits = tuple(score.fit for score in (decision.best, *decision.rivals) if score is not None)
    leads = Leads(fits, decision.verdict in _EXPLAINED, inner.context.left_out)
    torch.set_num_threads(context.workers.workers)  # most of what follows runs here, a few large fields at a time
    whole = replace(context, region=inner.context, leads=leads, workers=inner.context.workers)
    outcome = search_good_captures(whole, useless, count, progress)
    rows, columns = inner.context.data.captures.levels.shape[2:]
    note = (
        f"Causes were searched in the middle of the pictures, {columns} × {rows} modulator pixels; whole pictures "
        "fitted and judged them."
    )
    return replace(outcome, notes=list(dict.fromkeys([*inner.notes, *outcome.notes, note])))
