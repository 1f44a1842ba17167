"""A diagnosis that follows captures: when it begins, that it gives way, and what a real one shows."""

from __future__ import annotations

from collections.abc import Iterator
from threading import Event
from typing import Any, cast

import numpy as np
import pytest

from holoview.bench.captures.dataset import Captures
from holoview.bench.diagnose.report.diagnosis import Diagnosis
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.live_view import MOST, LiveDiagnosis
from tests.experiment.live.conftest import Rigged
from tests.experiment.live.fake_bench import PLAN, FakeBench, write_rig
from tests.patience import PATIENCE_S, wait_until


class _Slow:
    """Stands for `diagnose`: takes until `may_end` or until it is asked to end."""

    def __init__(self) -> None:
        self.counts, self.may_end = list[int](), Event()

    def __call__(self, captures: Captures, **options: Any) -> Diagnosis:
        self.counts.append(len(captures))
        options["so_far"](f"of {len(captures)}")
        options["forecast"](f"{len(captures)} fields")
        while not self.may_end.wait(0.002) and not options["is_asked_to_end"]():
            pass
        return cast(Diagnosis, f"of {len(captures)}")


@pytest.fixture
def captures(tmp_path_factory: pytest.TempPathFactory) -> list[Captures]:
    bench = FakeBench(write_rig(tmp_path_factory.mktemp("rig")))
    one = Captures(
        levels=np.zeros((1, 1, 24, 32), np.uint8),
        images=np.zeros((1, 48, 64), np.uint16),
        wavelength_m=np.array([638e-9]),
        distance_m=np.array([3e-3]),
        power=np.ones(1),
        exposure_s=np.ones(1),
        **bench.rig.bench.as_fields(),
    )
    return [one] * 20


@pytest.fixture
def slow() -> Iterator[_Slow]:
    made = _Slow()
    yield made
    made.may_end.set()


def test_it_begins_with_a_few_captures_and_gives_way_to_more(
    session: EditingSession, slow: _Slow, captures: list[Captures]
) -> None:
    live = LiveDiagnosis(session, slow)
    for count in range(1, 12):
        live.offer(captures[:count])
        session.poll()
    slow.may_end.set()
    assert session.wait_until_idle(PATIENCE_S)
    assert slow.counts[0] == 4 and slow.counts[-1] == MOST
    assert live.seen == 11 and str(live.diagnosis) == f"of {MOST}"
    live.start(captures)
    assert session.wait_until_idle(PATIENCE_S)
    assert str(live.diagnosis) == "of 20"


def test_one_that_was_cancelled_shows_nothing(session: EditingSession, slow: _Slow, captures: list[Captures]) -> None:
    live = LiveDiagnosis(session, slow)
    live.start(captures[:5])
    live.cancel()
    assert session.wait_until_idle(PATIENCE_S)
    assert live.diagnosis is None and live.job is None and live.so_far == live.forecast == ""


def test_a_running_one_says_how_long_it_takes(session: EditingSession, slow: _Slow, captures: list[Captures]) -> None:
    live = LiveDiagnosis(session, slow)
    live.start(captures[:5])
    wait_until(lambda: live.forecast == "5 fields", session.poll)
    slow.may_end.set()
    assert session.wait_until_idle(PATIENCE_S)
    assert live.forecast == ""


def test_it_doesnt_begin_by_itself_when_that_is_off(
    session: EditingSession, slow: _Slow, captures: list[Captures]
) -> None:
    live = LiveDiagnosis(session, slow)
    live.is_on = False
    live.offer(captures, is_all=True)
    assert live.job is None
    live.start(captures)
    assert live.job is not None


@pytest.mark.long
def test_the_captures_of_a_plan_are_diagnosed(rigged: Rigged) -> None:
    rigged.rig.diagnosis.time_s = 0.1
    rigged.open()
    plan = rigged.path.with_name("plan.toml")
    plan.write_text(PLAN.replace("each = 3", "each = 4"), encoding="utf-8")
    rigged.rig.run_plan(plan)
    rigged.wait(lambda: rigged.rig.diagnosis.diagnosis is not None)
    assert rigged.rig.diagnosis.seen == 4
    assert str(rigged.rig.diagnosis.diagnosis.verdict).startswith("consistent")  # type: ignore[union-attr]
