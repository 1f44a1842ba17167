"""A closed loop on virtual benches: what it finds, why it took each capture, and how it ends."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.rig_adaptive import FixedPlanner, RandomPlanner
from holoview.bench.captures.dataset import join_captures
from holoview.bench.diagnose.config import SearchConfig
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.search_context import NEVER
from holoview.bench.experiment.capture_choice import (
    START_COUNT,
    BenchTime,
    CaptureChooser,
    ProposalPrediction,
    draw_proposals,
    expected_delta_chi2,
    improve_pattern,
)
from holoview.bench.experiment.closed_loop import (
    ClosedLoop,
    InformedPlanner,
    LoopResult,
    LoopSettings,
    PlannerState,
)
from holoview.bench.experiment.hypotheses import Belief, HypothesisFits, loop_context
from holoview.light.model.effects.registry import get_effect
from tests.experiment.next_capture.benches import BenchInProcess, make_bench

GAP_ERROR_M = 6e-5
CANDIDATES = ("gap", "distance", "ambient")


def _loop(bench: BenchInProcess, candidates: tuple[str, ...] = CANDIDATES, **options: Any) -> ClosedLoop:
    settings = options.pop("settings", LoopSettings(max_captures=8))
    effects = [get_effect(name) for name in candidates]
    planner = options.pop("planner", InformedPlanner(bench.rig))
    return ClosedLoop(bench.rig, bench.devices(), effects, planner, settings, free_maps=False, **options)


@pytest.fixture(scope="module")
def gap_bench(tmp_path_factory: pytest.TempPathFactory) -> BenchInProcess:
    return make_bench(tmp_path_factory.mktemp("gap"), {"gap": {"gap_error": GAP_ERROR_M}})


@pytest.fixture(scope="module")
def found(gap_bench: BenchInProcess) -> tuple[LoopResult, list[str]]:
    told: list[str] = []
    return _loop(gap_bench, tell=told.append).run(), told


def test_a_single_fault_is_found_with_few_captures(found: tuple[LoopResult, list[str]]) -> None:
    result, _ = found
    assert result.is_certain and result.diagnosis.verdict is Verdict.EXPLAINED
    assert list(result.diagnosis.values) == ["gap"] and len(result.parts) <= 6
    # far beyond the interval of such a small session, far below the next rival's value
    assert result.diagnosis.values["gap"]["gap_error"] == pytest.approx(GAP_ERROR_M, rel=0.1)
    assert result.ended == "gap is certain"


def test_every_capture_has_a_reason(found: tuple[LoopResult, list[str]]) -> None:
    result, told = found
    assert told == [step.sentence for step in result.steps]
    for number, step in enumerate(result.steps, start=1):
        assert step.sentence.startswith(f"capture {number}: {step.choice.proposal.place}: ")
        assert step.choice.reason and step.seconds > 0
    assert all(step.choice.reason == f"one of {START_COUNT} to begin with" for step in result.steps[:START_COUNT])
    assert result.steps[-1].as_json()["believed"] == "gap"


def test_lasers_are_off_while_it_thinks(found: tuple[LoopResult, list[str]], gap_bench: BenchInProcess) -> None:
    switched = gap_bench.switched
    assert switched[1::2] == [None] * (len(switched) // 2) and None not in switched[::2]


def test_lasers_are_off_after_a_camera_that_fails(tmp_path: Path) -> None:
    bench = make_bench(tmp_path, {})
    kept: list[int] = []
    never_certain = LoopSettings(certainty=1.1)
    loop = _loop(bench, settings=never_certain, keep=lambda number, capture: kept.append(number))
    take, pictures = bench.take, iter(range(100))

    def failing() -> Any:
        if len(kept) == 2:
            raise TimeoutError(f"no picture {next(pictures)}")
        return take()

    bench.take = failing  # type: ignore[method-assign]
    with pytest.raises(TimeoutError):
        loop.run()
    assert kept == [0, 1] and bench.bench.laser is None


@pytest.mark.long
def test_a_budget_of_captures_is_kept(tmp_path: Path) -> None:
    bench = make_bench(tmp_path, {"gap": {"gap_error": GAP_ERROR_M}})
    told: list[str] = []
    result = _loop(bench, ("gap",), settings=LoopSettings(certainty=1.1, max_captures=3), tell=told.append).run()
    assert len(result.parts) == 3 and not result.is_certain
    assert result.ended == "3 captures are taken, as many as allowed"
    assert told[-1].startswith("The search begins nothing new after")  # the diagnosis at the end says how long it takes


def test_a_budget_of_bench_time_is_kept(tmp_path: Path) -> None:
    bench = make_bench(tmp_path, {"gap": {"gap_error": GAP_ERROR_M}})
    result = _loop(bench, ("gap",), settings=LoopSettings(bench_time_s=0.5)).run()
    *before, last = (step.seconds for step in result.steps)
    assert sum(before) < 0.5 <= sum(before) + last
    assert result.ended == "the time on the bench is spent"


@pytest.mark.long
def test_an_interruption_gives_the_best_so_far(tmp_path: Path) -> None:
    bench = make_bench(tmp_path, {"gap": {"gap_error": GAP_ERROR_M}})
    kept: list[int] = []
    settings = LoopSettings(certainty=1.1)  # never certain
    loop = _loop(
        bench,
        ("gap", "ambient"),
        settings=settings,
        keep=lambda number, capture: kept.append(number),
        is_asked_to_end=lambda: len(kept) >= START_COUNT + 1,
    )
    result = loop.run()
    assert kept == list(range(START_COUNT + 1)) and len(result.parts) == START_COUNT + 1
    assert result.ended == "it was interrupted" and not result.is_certain
    assert list(result.diagnosis.values) == ["gap"]
    assert "The loop was interrupted; only the causes that were left were searched." in result.diagnosis.notes
    assert bench.bench.laser is None


def test_it_goes_on_with_captures_that_were_kept(
    found: tuple[LoopResult, list[str]], gap_bench: BenchInProcess
) -> None:
    before = found[0].parts[:1]
    result = _loop(gap_bench).run(before)
    assert result.parts[:1] == before and result.steps[0].number == 2
    assert list(result.diagnosis.values) == ["gap"]


@pytest.fixture(scope="module")
def belief(found: tuple[LoopResult, list[str]]) -> Belief:
    """What the captures of the gap say, with the distance as a rival that is kept."""
    captures = join_captures(found[0].parts[:START_COUNT])
    context = loop_context(captures, [get_effect(name) for name in CANDIDATES], SearchConfig(), NEVER, {})
    fits = HypothesisFits()
    fits.include(context, [("distance",)])
    return fits.update(context)


def test_probabilities_name_the_gap(belief: Belief) -> None:
    assert belief.leader.causes == ("gap",) and belief.explains
    assert belief.certainty > 0.9 and belief.probabilities.sum() == pytest.approx(1.0)
    assert {("distance",), ()} <= {h.causes for h in belief.hypotheses}


def test_patterns_are_improved_by_gradient(
    belief: Belief, found: tuple[LoopResult, list[str]], gap_bench: BenchInProcess
) -> None:
    taken, limits = join_captures(found[0].parts[:START_COUNT]), gap_bench.rig.limits
    rival = next(h for h in belief.hypotheses if h.causes == ("distance",))
    (proposal,) = draw_proposals(gap_bench.rig, np.random.default_rng(0), 1)

    def separation(one: Any) -> float:
        (responses,) = ProposalPrediction(belief, taken, [one], limits).responses([belief.leader, rival])
        return expected_delta_chi2(*responses)

    levels = improve_pattern(belief, taken, proposal, rival, limits)
    assert levels.dtype == proposal.levels.dtype and levels.shape == proposal.levels.shape
    improved = type(proposal)(**{**vars(proposal), "levels": levels})
    assert separation(improved) > 1.05 * separation(proposal)


def test_of_equal_information_the_quicker_capture_is_taken(
    belief: Belief, found: tuple[LoopResult, list[str]], gap_bench: BenchInProcess
) -> None:
    """Where the stage is, and a stage that is slow, decide between two planes that tell as much."""
    taken = join_captures(found[0].parts[:START_COUNT])
    drawn = draw_proposals(gap_bench.rig, np.random.default_rng(1), 8)
    near, far = 1e-3, 9e-3
    at = {}
    for here in (near, far):
        slow = BenchTime(0.1, moved_m=1e-3, moving_s=1e3)
        at[here] = CaptureChooser(belief, taken, gap_bench.rig.limits, slow, here).choose(drawn).proposal.distance_m
    assert at == {near: pytest.approx(near), far: pytest.approx(far)}


def test_other_planners_take_what_they_say(gap_bench: BenchInProcess) -> None:
    rig = gap_bench.rig
    state = PlannerState(None, 0, None, 0.0, BenchTime(0.1))
    plan = FixedPlanner(rig)
    first = plan.next(state)
    assert first is not None and first.proposal.wavelength_m == rig.wavelengths_m[0]
    count = 8 * len(rig.wavelengths_m) * 3
    assert plan.next(PlannerState(None, count, None, 0.0, BenchTime(0.1))) is None
    drawn = [RandomPlanner(rig, seed=s).next(state) for s in range(8)]
    assert {one.proposal.wavelength_m for one in drawn if one} == set(rig.wavelengths_m)
