"""The captures so far as fits need them: all of them fitted, large modulators cut to their middle."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from holoview.captures.dataset import Captures
from holoview.diagnose.capture_split import CaptureSplit
from holoview.diagnose.config import PLAIN, SearchConfig
from holoview.diagnose.correct.bad_captures import find_useless_captures
from holoview.diagnose.correct.wrong_records import check_records
from holoview.diagnose.crop import middle_of, saving
from holoview.diagnose.likelihood import Values
from holoview.diagnose.pipeline import prepare_search
from holoview.diagnose.search_context import SearchContext, SearchEnd, field_samples
from holoview.diagnose.worker_pool import WorkerPool
from holoview.model.effects.effect import Effect

_SEARCH_SHARE = 0.25  # of the fields of a diagnosis; the loop searches several times


def loop_context(
    captures: Captures, effects: Sequence[Effect], config: SearchConfig, end: SearchEnd, known: Values
) -> SearchContext:
    """What fits to all captures work with, wrong records put right. Raises UserError when no capture shows anything.

    end: when fits have to end. known: effects that the nominal model has.
    """
    cut = searched_part(check_records(captures, known).captures, config)
    useless = find_useless_captures(cut)
    context, _ = prepare_search(cut, useless, effects, known, PLAIN, config, WorkerPool(1))
    everything = context.kept
    budget = _SEARCH_SHARE * config.budget.fields_for(field_samples(cut))
    split = CaptureSplit(context.split.coarse, everything, everything, everything)
    context.predictor.end = end
    return dataclasses.replace(context, split=split, field_budget=budget, end=end)


def searched_part(captures: Captures, config: SearchConfig) -> Captures:
    """The captures, or their middle where that saves much."""
    cut = middle_of(captures, config.region)
    return captures if saving(captures, cut) < config.region.min_saving else cut
