"""A search ends when its time is over or somebody asks, keeps what it had found, and tells what it has found so far."""

from __future__ import annotations

import math
import pickle
import re
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from holoview.bench.captures import Captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose import search_context
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.search_context import (
    NEVER,
    BestSoFar,
    Pace,
    SearchEnd,
    SearchEnded,
    describe_so_far,
    describe_work,
)
from holoview.bench.diagnose.worker_pool import WorkerPool
from holoview.light.model.effects.registry import listed_effects
from tests.diagnose.conftest import MakeContext, small_system
from tests.patience import PATIENCE_S

FAULTS = {"gap": {"gap_error": 2e-4}, "stroke": {"stroke_error": 0.2}}
SESSION = AcquisitionSettings(captures_per_condition=3, seed=1)
EFFECTS = [listed_effects()[name] for name in FAULTS]


@cache
def _faulty() -> Captures:
    return make_captures(small_system(), FAULTS, SESSION)


@cache
def _usual() -> dict[str, Any]:
    """What a search finds in them that nobody watches or hurries, as JSON."""
    return diagnose(_faulty(), EFFECTS, free_maps=False).as_json()


def _without_times(found: dict[str, Any]) -> dict[str, Any]:
    return found | {"seconds": 0, "records": None}


@dataclass
class _Score:
    causes: tuple[str, ...]
    chi2_per_pixel: float

    @property
    def excess(self) -> float:
        return self.chi2_per_pixel - 1


@dataclass
class _Result:
    nominal: _Score
    candidates: tuple[_Score, ...]

    @property
    def best(self) -> _Score:
        return self.candidates[0] if self.candidates else self.nominal


def _result(*causes: str, chi2: float = 5.0) -> _Result:
    return _Result(_Score((), 9.0), (_Score(causes, chi2),) if causes else ())


def test_time_over_raises_and_never_does_not() -> None:
    NEVER.check()
    assert not NEVER.is_near
    with pytest.raises(SearchEnded):
        SearchEnd(-1.0).check()
    near = SearchEnd(3600.0, last_begin=0.0)
    near.check()
    assert near.is_near and not SearchEnd(3600.0, last_begin=1.0).is_near


def test_the_pace_tells_how_long_the_rest_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hundred fields a second, after a first measurement of 33. Counts that don't change, while processes work, don't
    count as slow."""
    assert Pace().seconds_for(1000, 0) is None
    now, pace = [50.0], Pace()
    pace.first = 0.03
    monkeypatch.setattr(search_context, "time", SimpleNamespace(monotonic=lambda: now[0]))
    assert pace.seconds_for(1000, 0) == pytest.approx(30.0)
    now[0] += 1.0
    assert pace.seconds_for(1000, 99) == pytest.approx(30.0)
    now[0] += 1.0
    assert pace.seconds_for(1000, 200) == pytest.approx(10.0)
    now[0] += 60.0
    assert pace.seconds_for(1000, 200) == pytest.approx(10.0)


def test_progress_says_how_long_a_search_takes_at_most(make_context: MakeContext) -> None:
    context, notes = replace(make_context(), field_budget=1e6), list[str]()
    tell = context.telling_time_left(lambda done, total, note: notes.append(note))
    tell(0, 1, "one cause")
    for _ in range(10):
        context.predictor(np.arange(12), {})
    tell(0, 1, "one cause")
    timed = replace(context, field_budget=math.inf, end=SearchEnd(7 * 3600.0))
    timed.telling_time_left(lambda done, total, note: notes.append(note))(1, 1, "two")
    assert notes[0] == "one cause" and re.fullmatch(r"one cause \(at most \S+ (s|min|h) more\)", notes[1])
    assert re.fullmatch(r"two \(at most (7|6\.9) h more\)", notes[2])


@pytest.mark.parametrize(
    ("fields", "end", "expected"),
    [
        ([32_000.0], NEVER, "begins nothing new after 32 000 fields, about 2.7 min on this machine. Most"),
        ([800.0, 600.0], NEVER, "begins nothing new after 1 400 fields, about 7 s on this machine. Most"),
        ([800.0], SearchEnd(100.0, last_begin=0.7), "after 800 fields, about 4 s on this machine, or after 70 s. Most"),
        ([math.inf], SearchEnd(100.0, last_begin=0.7), "begins nothing new after 70 s. Most"),
        ([math.inf], NEVER, "takes as long as it needs; 1000 fields take about 5 s on this machine."),
    ],
    ids=["default", "middle and whole", "--time beside a budget", "--time", "--thorough"],
)
def test_the_work_of_searches_in_words(
    make_context: MakeContext, fields: list[float], end: SearchEnd, expected: str
) -> None:
    contexts = [replace(make_context(), field_budget=count, end=end, pace=Pace()) for count in fields]
    for context in contexts:
        context.pace.first = 0.005
    assert expected in describe_work(contexts)


def test_first_predictions_set_the_pace(make_context: MakeContext, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four fields of a quarter of a second, in one of two processes that will share the work."""
    context, now = replace(make_context(), workers=WorkerPool(2)), [7.0]
    monkeypatch.setattr(search_context, "process_cpu_count", lambda: 2)
    monkeypatch.setattr(search_context, "time", SimpleNamespace(monotonic=lambda: now[0]))
    with context.measuring_pace():
        context.predictor(np.arange(4), {})
        now[0] += 1.0
    assert context.pace.first == pytest.approx(0.125)


@pytest.mark.long
def test_the_work_is_told_before_the_search_and_changes_nothing() -> None:
    told = list[str]()

    def progress(done: int, total: int, note: str) -> None:
        assert told or not note.startswith("one cause")
        assert "one cause" not in note or re.search(r"at most [\d.]+ (s|min|h) more", note)

    watched = diagnose(_faulty(), EFFECTS, free_maps=False, progress=progress, forecast=told.append).as_json()
    assert re.fullmatch(r"The search .* 32 000 fields, about [\d.]+ (s|min|h) on this machine\. .*", *told)
    assert _without_times(watched) == _without_times(_usual())


def test_somebody_asks_in_this_process_only() -> None:
    asked = SearchEnd(is_asked=lambda: True)
    with pytest.raises(SearchEnded):
        asked.check()
    pickle.loads(pickle.dumps(asked)).check()


def test_what_is_better_is_told_once() -> None:
    told: list[str] = []
    best: BestSoFar[_Result] = BestSoFar(lambda result: told.append(describe_so_far(result)))
    for result in (_result(), _result("gap"), _result("gap", chi2=4.9), _result("gap", chi2=2.0), _result()):
        best.note(result)
    assert best.result == _result("gap", chi2=2.0), "nothing found later isn't better"
    assert [text.split(" (")[0] for text in told] == ["no cause yet", "gap", "gap"]
    assert told[1] == "gap (held-out captures: χ²/n 9 → 5, noise: 1)"
    assert pickle.loads(pickle.dumps(best)).result is None


def test_a_search_that_begins_anew_does_not_take_back_what_was_told() -> None:
    told: list[_Result] = []
    best: BestSoFar[_Result] = BestSoFar(told.append)
    first, again = _result("gap"), _result("gap", chi2=1.2)
    best.note(first)
    best.clear()
    best.note(_result())
    assert best.result == _result() and told == [first]
    best.note(again)
    assert told == [first, again]


def test_predictions_of_jobs_end_with_the_search(make_context: MakeContext) -> None:
    context = make_context()
    ended = replace(context, end=SearchEnd(-1.0))
    job = partial(context.predictor, np.array([0]), {})
    with pytest.raises(SearchEnded):
        ended.run_parallel([job])
    assert len(context.run_parallel([job])) == 1 and len(context.workers.run([job])) == 1


@pytest.mark.long
def test_processes_go_on_after_a_search_that_ended(make_context: MakeContext) -> None:
    """Free maps are fitted by the processes that searched, after its time."""
    with WorkerPool(2) as pool:
        context = replace(make_context(), workers=pool)
        pool.share(context.shared_objects())
        pool.start()
        job = partial(context.predictor, np.array([0]), {})
        assert len(context.run_parallel([job] * 4)) == 4  # the processes have imported then, and answer at once
        for seconds in (0.5, 5.0, PATIENCE_S):  # on a busy machine four predictions may take longer
            soon = replace(context, end=SearchEnd(seconds))
            with suppress(SearchEnded):
                assert len(soon.run_parallel([job] * 4)) == 4
                break
        while soon.end.seconds_left >= 0.0:
            time.sleep(0.02)
        assert len(context.run_parallel([job] * 4)) == 4


def test_processes_are_not_waited_for() -> None:
    with WorkerPool(2) as pool:
        pool.start()
        began = time.monotonic()
        with pytest.raises(SearchEnded):
            pool.run([partial(time.sleep, PATIENCE_S)] * 2, check=SearchEnd(-1.0).check)
        pool.close(kill=True)
    assert time.monotonic() - began < PATIENCE_S


@pytest.mark.long
def test_a_search_without_time_says_so_and_judges_all_the_same() -> None:
    found = diagnose(_faulty(), EFFECTS, free_maps=False, time_s=1e-3, thorough=True)
    assert found.verdict is Verdict.UNEXPLAINED and found.before.chi2_per_pixel > 2
    assert any("--time 10min" in note for note in found.notes)


@pytest.mark.long
def test_the_best_so_far_is_the_result() -> None:
    """Asked for once a cause was told."""
    told = list[str]()
    found = diagnose(
        _faulty(), EFFECTS, thorough=True, so_far=told.append, is_asked_to_end=lambda: any("gap" in t for t in told)
    )
    assert {cause.effect for cause in found.causes} <= {"gap", "stroke"} and found.lives_in == {}
    assert found.notes[-1] == "The search was interrupted; this is the best that it had found."
    names = found.causes[0].effect if found.causes else "no cause yet"
    assert names in told[-1]


@pytest.mark.long
def test_a_finished_search_is_no_interrupted_one() -> None:
    captures = make_captures(small_system(), {}, SESSION)
    found = diagnose(captures, EFFECTS, time_s=3600.0)
    assert found.verdict is Verdict.CONSISTENT and not any("ended" in note for note in found.notes)


@pytest.mark.long
def test_without_a_time_the_clock_ends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine on which every second is an hour finds the same."""
    usual, clock = _usual(), time.monotonic
    monkeypatch.setattr(search_context, "time", SimpleNamespace(monotonic=lambda: 3600.0 * clock()))
    slow = diagnose(_faulty(), EFFECTS, free_maps=False)
    assert _without_times(slow.as_json()) == _without_times(usual) and slow.verdict is Verdict.EXPLAINED
