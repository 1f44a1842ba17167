"""A search ends at its budget of fields, whoever computes them; many fields are begun only where they pay."""

from __future__ import annotations

import dataclasses
import json
import math
import multiprocessing
from typing import Any

import numpy as np
import pytest

from holoview.bench.captures import Captures
from holoview.bench.captures.predictor import PLAIN, SamplingConfig
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose import screening
from holoview.bench.diagnose.config import MIN_FIELDS, BudgetConfig, SearchConfig
from holoview.bench.diagnose.fit import CandidateFit
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.screening import (
    COSTLY_FIELDS,
    field_count,
    largest_field_count,
    screen_effects,
    without_costly_fits,
)
from holoview.bench.diagnose.search_context import SearchContext, field_samples
from holoview.bench.diagnose.worker_pool import WorkerPool
from holoview.light.model.effects.registry import listed_effects
from tests.diagnose.conftest import MakeContext, small_system

TWO = {"gap": {"gap_error": 2e-4}, "stroke": {"stroke_error": 0.2}}
FEW = ["gap", "stroke", "tilt"]


def _fit(**values: dict[str, float]) -> CandidateFit:
    return CandidateFit(tuple(values), values, 0.0)


def test_fields_are_counted_for_captures_wavelengths_directions_and_moments(make_context: MakeContext) -> None:
    context = make_context()
    assert context.predictor.fields_requested == 0
    context.predictor(np.array([0, 1]), {})
    context.predictor(np.array([0]), {})  # kept, and counted all the same
    assert context.predictor.fields_requested == 3
    flicker = {"flicker": {"depth": 0.1}}
    assert field_count(context, flicker) == 7  # an odd number, so that one shows the nominal phase
    assert largest_field_count(context, listed_effects()["flicker"]) == 11  # at the end of its scan, a depth of 0.3
    before = context.predictor.fields_requested
    context.predictor(np.array([0]), flicker)
    assert context.predictor.fields_requested == before + 7


def test_the_budget_is_spent_beyond_its_fields(make_context: MakeContext) -> None:
    context = dataclasses.replace(make_context(), field_budget=2)
    context.predictor(np.array([0, 1]), {})
    assert not context.budget_exhausted
    context.predictor(np.array([0]), {})
    assert context.budget_exhausted


def test_large_fields_are_fewer() -> None:
    budget, usual = BudgetConfig(), 256 * 192
    assert budget.fields_for(usual // 4) == budget.fields_for(usual) == budget.max_fields
    assert budget.fields_for(4 * usual) == budget.max_fields / 4
    assert budget.fields_for(1000 * usual) == MIN_FIELDS
    assert BudgetConfig(max_fields=200).fields_for(1000 * usual) == 200


def test_the_middle_of_larger_pictures_gets_more() -> None:
    budget, usual = BudgetConfig(), 256 * 192
    assert budget.fields_for_middle(usual, usual // 9) == budget.fields_for_middle(usual, usual) == budget.max_fields
    assert budget.fields_for_middle(2 * usual, 4 * usual) == 2 * budget.max_fields
    assert budget.fields_for_middle(usual, 1000 * usual) == 5 * budget.max_fields


def test_finer_samples_count(nominal: Captures) -> None:
    """Twice as fine, in a grid of thrice the modulators' size in place of twice."""
    assert field_samples(nominal, SamplingConfig(2, 3)) == (2 * 3 / 2) ** 2 * 4 * 32 * 40


def test_a_field_of_a_fourier_bench_counts_by_the_points_of_its_transforms(nominal: Captures) -> None:
    """Pictures of 64 × 80 pixels, modulators of 32 × 40 with two samples a pixel each way."""
    assert field_samples(nominal, PLAIN) == 4 * 32 * 40
    far = dataclasses.replace(nominal, focal_length_m=0.1)
    assert field_samples(far, PLAIN) == (40 * (32 + 64) + 64 * (40 + 80)) // 2


@pytest.mark.parametrize(
    ("truth", "low", "high"),
    [
        ({"gap": {"gap_error": 2e-5}}, 0.0, screening.TANGENT_MAX_ERROR),
        ({"gap": {"gap_error": 2e-4}}, screening.TANGENT_MAX_ERROR, screening.LOCAL_MAX_ERROR),
        ({"aberration1": {"z4": -5e-7, "z7": 4e-7, "z10": 2e-7}}, screening.LOCAL_MAX_ERROR, math.inf),
    ],
    ids=["small error", "medium", "large"],
)
def test_effects_are_tried_before_stuck_pixels(
    make_context: MakeContext,
    monkeypatch: pytest.MonkeyPatch,
    truth: dict[str, dict[str, float]],
    low: float,
    high: float,
) -> None:
    """Decorrelated speckle seems to be of stuck lines; to find out that it isn't costs more than all other effects."""
    context, tried = make_context(truth), list[tuple[str, ...]]()
    assert low < context.relative_model_error({}) < high

    def look(*_: Any) -> Any:
        assert tried, "nothing else was tried"
        return lambda effect: []

    monkeypatch.setattr("holoview.bench.diagnose.screening.StuckStarts", look)
    effects = [context.effects[name] for name in ("slm1_stuck", "gap", "stroke", "aberration1")]
    for batch in screen_effects(context, {}, effects, lambda *_: None, ""):
        tried += [fit.causes for fit in batch.fits]
    assert tuple(truth) in tried


@pytest.mark.parametrize(("share", "computed"), [(0.05, [2]), (1.0, [2, 1])], ids=["decisive", "never decisive"])
def test_derivatives_of_very_many_fields_are_left_out_where_another_effect_explains_most(
    make_context: MakeContext, monkeypatch: pytest.MonkeyPatch, share: float, computed: list[int]
) -> None:
    context, totals = make_context({"undiffracted": {"share": 0.01}}), list[int]()
    monkeypatch.setattr("holoview.bench.diagnose.screening._DECISIVE_TANGENT_GAIN", share)

    def note(done: int, total: int, what: str) -> None:
        if what.endswith("tangents") and done == total:
            totals.append(total)

    effects = [context.effects[name] for name in ("source_extent", "stroke", "undiffracted")]
    first = next(batch.fits[0] for batch in screen_effects(context, {}, effects, note, "") if batch.fits)
    assert first.causes == ("undiffracted",) and totals == computed


@pytest.mark.parametrize(("budget", "batches"), [(1.0, 1), (1e9, 2)])
def test_no_further_effect_is_tried_alone_far_beyond_the_budget(
    make_context: MakeContext, budget: float, batches: int
) -> None:
    """Two effects, each a batch of its own, which are scanned over their ranges at once: the error is large."""
    config = SearchConfig(budget=BudgetConfig(effects_per_batch=1))
    faulty = make_context({"stroke": {"stroke_error": 0.7}})
    assert faulty.relative_model_error({}) > screening.LOCAL_MAX_ERROR
    context = dataclasses.replace(faulty, field_budget=budget, config=config)
    effects = [listed_effects()[name] for name in ("camera_black", "camera_gamma")]
    queue = list(screen_effects(context, {}, effects, lambda *_: None, ""))
    assert sum(not batch.ends_round for batch in queue) == batches and queue[-1].ends_round


def test_many_fields_pay_only_where_nothing_simpler_does_as_well(make_context: MakeContext) -> None:
    many, simple = _fit(bandwidth={"sigma": 3e-9}), _fit(gap={"gap_error": 1e-6})
    for fault, kept in (
        ({"bandwidth": {"sigma": 3e-9}}, [many, simple]),
        ({"stroke": {"stroke_error": 0.2}}, [simple]),
    ):
        context: SearchContext = make_context(fault)
        assert field_count(context, many.values) >= COSTLY_FIELDS > field_count(context, simple.values)
        assert (
            without_costly_fits(context, [many, simple], context.data_weighted_comparison(context.split.fine, 0.0))
            == kept
        )


def _budget(fields: int) -> SearchConfig:
    return SearchConfig(budget=BudgetConfig(max_fields=fields))


@pytest.mark.long
def test_a_search_that_was_ended_says_so() -> None:
    captures = make_captures(small_system(), TWO, AcquisitionSettings(captures_per_condition=4, seed=1))
    effects = [listed_effects()[name] for name in TWO]
    short = diagnose(captures, effects, free_maps=False, config=_budget(200))
    assert short.verdict in (Verdict.UNEXPLAINED, Verdict.PARTLY)
    assert any("--thorough" in note for note in short.notes)
    thorough = diagnose(captures, effects, free_maps=False, thorough=True, config=_budget(200))
    assert thorough.verdict is Verdict.EXPLAINED and {c.effect for c in thorough.causes} == set(TWO)
    assert not any("--thorough" in note for note in thorough.notes)


def _without_seconds(value: Any) -> Any:
    """JSON without the time that anything took, at any depth."""
    if isinstance(value, dict):
        return {key: _without_seconds(part) for key, part in value.items() if key != "seconds"}
    return [_without_seconds(part) for part in value] if isinstance(value, list | tuple) else value


@pytest.mark.long
def test_the_end_does_not_depend_on_workers() -> None:
    captures = make_captures(small_system(), TWO, AcquisitionSettings(captures_per_condition=4, seed=2))
    effects = [listed_effects()[name] for name in FEW]
    processes, before = [0], {*multiprocessing.active_children()}

    def count_processes(done: int, total: int, what: str) -> None:
        processes.append(len({*multiprocessing.active_children()} - before))

    with WorkerPool(2) as pool:
        pool.start()  # the fork server has imported then, and answers at once
    config = SearchConfig(budget=BudgetConfig(max_fields=500, worker_start_s=0.0))
    alone = diagnose(captures, effects, workers=1, free_maps=False, config=config).as_json()
    shared = diagnose(captures, effects, workers=3, free_maps=False, config=config, progress=count_processes).as_json()
    assert json.dumps(_without_seconds(alone)) == json.dumps(_without_seconds(shared))
    assert max(processes) > 1  # as many as there are jobs at a time, of at most three
