"""Faults and drift of a virtual bench: as often and as large as its settings say."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from holoview.rig import RigDescription
from holoview.rig.devices import DeviceError, DeviceGone
from holoview.rig.virtual.server import FaultInjector
from holoview.rig.virtual.virtual_bench import Drift, DriftSettings, FaultSettings, read_virtual_settings
from holoview.rig.virtual.wire import Disconnected, Message
from holoview.util.errors import UserError
from tests.rig.conftest import LASERS_M, DirectBench

MakeRig = Callable[..., RigDescription]
COUNT = 2000


def _answers(shares: dict[str, float], seed: int = 0) -> tuple[Counter[str], list[str]]:
    """What became of pictures that are all different: each holds its number in every row."""
    number, offs = 0, list[str]()

    def answer(message: Message) -> Message:
        nonlocal number
        if message.table["do"] == "wait":
            return Message({})
        number += 1
        return Message({}, np.full((16, 4), number, np.uint16))

    injector = FaultInjector(FaultSettings(seed, shares), lambda: offs.append("off"))
    seen: Counter[str] = Counter()
    last = 0
    for _ in range(COUNT):
        try:
            found = injector.answer(Message({"do": "take"}), answer)
        except Disconnected:
            seen["disconnect"] += 1
            continue
        if found.array is None:
            seen["timeout"] += 1
        elif len(found.array) < 16:
            seen["short"] += 1
        elif int(found.array[0, 0]) == last:
            seen["repeated"] += 1
        else:
            seen["torn" if int(found.array[-1, 0]) != number else "right"] += 1
        last = last if found.array is None else int(found.array[0, 0])
    return seen, offs


@pytest.mark.parametrize("fault", ["timeout", "short", "torn", "repeated", "disconnect"])
def test_a_fault_happens_as_often_as_its_share(fault: str) -> None:
    seen, offs = _answers({fault: 0.1})
    assert set(seen) == {fault, "right"} and offs == []
    assert seen[fault] == pytest.approx(0.1 * COUNT, abs=5 * (0.09 * COUNT) ** 0.5)


def test_the_power_goes_as_often_as_its_share() -> None:
    _, offs = _answers({"power_off": 0.1})
    assert len(offs) == pytest.approx(0.1 * COUNT, abs=5 * (0.09 * COUNT) ** 0.5)


def test_without_shares_nothing_happens_and_equal_seeds_fail_alike() -> None:
    assert _answers({})[0] == {"right": COUNT}
    some = {"torn": 0.05, "timeout": 0.05}
    assert _answers(some, 3) == _answers(some, 3) != _answers(some, 4)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"timeot": 0.1}, r"faults\.timeot: unknown key; did you mean timeout"),
        ({"timeout": 2.0}, r"faults\.timeout: 2 is out of range"),
        ({"seed": 0.5}, r"faults\.seed"),
        ("many", "a table"),
    ],
)
def test_wrong_faults_are_named(make_rig: MakeRig, table: Any, words: str) -> None:
    with pytest.raises(UserError, match=words):
        read_virtual_settings(make_rig({"virtual.faults": table}))


def test_a_bench_with_faults_is_a_device_that_fails(make_rig: MakeRig) -> None:
    with pytest.raises(DeviceError, match="no picture within 1 s"):
        DirectBench(make_rig({"virtual.faults": {"timeout": 1.0}})).ask({"do": "take"})
    with pytest.raises(DeviceGone):
        DirectBench(make_rig({"virtual.faults": {"disconnect": 1.0}})).ask({"do": "time"})


def test_random_walks_spread_with_the_square_root_of_time() -> None:
    settings = DriftSettings(camera_m=1e-6, power=0.02)
    for hours, step_s in ((1.0, 3600.0), (4.0, 600.0)):
        ends = []
        for seed in range(400):
            drift = Drift(settings, np.random.default_rng(seed))
            for time_s in np.arange(step_s, hours * 3600 + 1, step_s):
                drift.advance(float(time_s))
            ends.append((*drift.camera_m, 5e-5 * np.log(drift.power)))
        deviations = np.std(ends, axis=0)
        assert deviations == pytest.approx(np.full(3, 1e-6 * hours**0.5), rel=5 / (2 * 400) ** 0.5)


def test_time_that_doesnt_pass_moves_nothing() -> None:
    drift = Drift(DriftSettings(1e-6, 0.1), np.random.default_rng(0))
    drift.advance(0.0)
    assert drift.camera_m == (0.0, 0.0) and drift.power == 1.0
    still = Drift(DriftSettings(), np.random.default_rng(0))
    still.advance(1e6)
    assert still.camera_m == (0.0, 0.0) and still.power == 1.0


def test_the_lasers_of_a_bench_drift_while_its_time_passes(make_rig: MakeRig) -> None:
    light = []
    for seed in range(12):
        bench = DirectBench(make_rig({"virtual": {"power_drift": 0.2, "seed": seed}})).light
        bench.switch_on(LASERS_M[0], 1.0)
        bench.expose(5e-3)
        first = bench.take().astype(float) - 64
        bench.wait(3600.0)
        light.append(np.log(((bench.take() - 64.0).sum()) / first.sum()))
    assert 0.2 * 0.4 < np.std(light) < 0.2 * 1.8  # 12 samples: χ² at 1e-4 and beyond


def test_exposures_begin_late_by_the_trigger_s_jitter(make_rig: MakeRig) -> None:
    bench = DirectBench(make_rig({"virtual": {"trigger_jitter": 0.01, "readout": 0.0}})).light
    bench.expose(1e-3)
    late = []
    for _ in range(200):
        before = bench.time_s
        bench.take()
        late.append(bench.time_s - before - 1e-3)
    assert min(late) >= -1e-12
    assert np.sqrt(np.mean(np.square(late))) == pytest.approx(0.01, rel=5 / (2 * 200) ** 0.5)
