"""The tuner starts with "passes" at once, finds the fastest strategy in the background, and survives any cache file."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from holoview.light.gpu import tune, tune_worker
from holoview.light.gpu.adapter import AdapterInfo
from holoview.light.gpu.device import Device
from holoview.light.gpu.fft import FftPlan
from holoview.light.gpu.line_fft import Strategy, TransformShader, supported_strategies
from holoview.light.gpu.recorder import CommandRecorder
from holoview.light.gpu.shader import ShaderError
from holoview.light.gpu.tune import FftTuner, TuningProcess, TuningResult, TuningStore, remembered_strategy
from holoview.util.errors import UserError

SHAPE = (64, 64)
INFO = AdapterInfo("adapter", "CPU", "Vulkan", "driver 1")
KNOWN = TuningResult({"passes": 3.0, "workgroup": 2.0, "subgroup": 1.0}, {"passes": 0.1, "subgroup": 9.0}, {})


class _Script:
    """A helper that answers from a list, an answer a poll, and then stays silent or ends."""

    answers: list[dict[str, Any]]
    asked: list[dict[str, Any]]
    ends = False
    hit_time_limit = False

    def __init__(self, adapter: str, budget_s: float) -> None:
        type(self).started += 1  # type: ignore[attr-defined]

    def send(self, request: dict[str, Any]) -> None:
        self.asked.append(request)

    def next_answer(self) -> dict[str, Any] | None:
        return self.answers.pop(0) if self.answers else None

    @property
    def has_ended(self) -> bool:
        return self.ends and not self.answers

    def close(self) -> None:
        type(self).closed += 1  # type: ignore[attr-defined]


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> type[_Script]:
    """The class of all helpers of a test; each of them has to be closed by the end of it."""
    made = type("Script", (_Script,), {"answers": [], "asked": [], "started": 0, "closed": 0})
    monkeypatch.setattr(tune, "TuningProcess", made)
    return made


@pytest.fixture
def store(tmp_path: Path) -> TuningStore:
    return TuningStore(tmp_path / "cache")


@pytest.fixture
def offers_all(device: Device, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """All strategies on offer, whatever the adapter has: these tests run none of them."""
    monkeypatch.setattr(tune, "supported_strategies", lambda device, shape: ("passes", "workgroup", "subgroup"))
    yield


def _timed(**seconds: float) -> list[dict[str, Any]]:
    compiled = [{"strategy": name, "compile_seconds": 1.0} for name in seconds]
    return [*compiled, *({"strategy": name, "seconds": value} for name, value in seconds.items())]


# --- store ----------------------------------------------------------------------------------------------------------


def test_a_tuning_is_remembered_by_adapter_driver_and_size(store: TuningStore) -> None:
    store.save(INFO, SHAPE, KNOWN)
    store.save(INFO, (32, 32), KNOWN.without("subgroup", "wrong"))
    assert store.load(INFO, SHAPE) == KNOWN
    assert KNOWN.best == "subgroup"
    other = store.load(INFO, (32, 32))
    assert other is not None and other.best == "workgroup" and other.refused == {"subgroup": "wrong"}
    assert store.load(replace(INFO, driver="driver 2"), SHAPE) is None
    assert store.load(replace(INFO, name="another"), SHAPE) is None
    assert store.load(INFO, (64, 32)) is None


@pytest.mark.parametrize("text", ["", "{", "[]", "null", "\udcff", "[" * 100_000, "nan"])
def test_a_file_that_makes_no_sense_counts_as_not_there(store: TuningStore, text: str) -> None:
    store.path.parent.mkdir(parents=True)
    store.path.write_bytes(text.encode("utf-8", "surrogateescape"))
    assert store.load(INFO, SHAPE) is None
    store.save(INFO, SHAPE, KNOWN)
    assert store.load(INFO, SHAPE) == KNOWN


@pytest.mark.parametrize(
    "entry",
    [
        None,
        [],
        {},
        {"seconds": {"passes": "fast"}, "compile_seconds": {}, "refused": {}},
        {"seconds": {"passes": -1.0}, "compile_seconds": {}, "refused": {}},
        {"seconds": {"passes": float("nan")}, "compile_seconds": {}, "refused": {}},
        {"seconds": {"magic": 1.0}, "compile_seconds": {}, "refused": {}},
        {"seconds": {}, "compile_seconds": {}, "refused": {"subgroup": 3}},
        {"seconds": {}, "compile_seconds": {}, "refused": ["subgroup"]},
    ],
)
def test_an_entry_that_is_not_as_expected_counts_as_not_there(store: TuningStore, entry: object) -> None:
    store.save(INFO, SHAPE, KNOWN)
    (key,) = json.loads(store.path.read_text())
    store.path.write_text(json.dumps({key: entry}))
    assert store.load(INFO, SHAPE) is None


def test_a_folder_that_can_not_be_made_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    store = TuningStore(tmp_path / "file" / "cache")
    store.save(INFO, SHAPE, KNOWN)
    assert store.load(INFO, SHAPE) is None
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


# --- tuner ---------------------------------------------------------------------------------------------------------


@pytest.mark.gpu
@pytest.mark.usefixtures("offers_all")
def test_it_starts_on_passes_and_switches_once_all_is_compiled(
    device: Device, store: TuningStore, script: type[_Script]
) -> None:
    asked: list[Strategy] = []

    def shaders(strategy: Strategy) -> list[TransformShader]:
        asked.append(strategy)
        return FftPlan(device, SHAPE).shaders

    tuner = FftTuner(device, SHAPE, shaders, store=store)
    assert tuner.current == "passes" and not tuner.is_settled and not tuner.poll()
    script.answers += _timed(passes=3.0, workgroup=1.0, subgroup=2.0)
    assert not tuner.poll()
    assert asked == ["workgroup"]
    assert [request["do"] for request in script.asked] == ["time", "compile"]
    assert len(script.asked[1]["shaders"]) == len(FftPlan(device, SHAPE).shaders)
    script.answers.append({"compile_seconds": 5.0})
    assert tuner.current == "passes"
    assert tuner.wait() == "workgroup" and tuner.is_settled and not tuner.poll()
    found = store.load(device.info, SHAPE)
    assert found is not None and found.seconds == {"passes": 3.0, "workgroup": 1.0, "subgroup": 2.0}
    assert (script.started, script.closed) == (1, 1)  # type: ignore[attr-defined]


@pytest.mark.gpu
@pytest.mark.usefixtures("offers_all")
def test_what_is_remembered_is_not_timed_again_unless_asked(
    device: Device, store: TuningStore, script: type[_Script]
) -> None:
    store.save(device.info, SHAPE, KNOWN)
    with FftTuner(device, SHAPE, store=store) as tuner:
        assert [request["do"] for request in script.asked] == ["compile"]
        assert tuner.current == "passes"
    with FftTuner(device, SHAPE, store=store, remeasure=True):
        assert script.asked[-1]["do"] == "time"
    store.save(device.info, SHAPE, TuningResult({"passes": 1.0, "workgroup": 2.0, "subgroup": 2.0}, {}, {}))
    assert FftTuner(device, SHAPE, store=store).is_settled


@pytest.mark.gpu
@pytest.mark.usefixtures("offers_all")
def test_a_gpu_that_compiles_at_once_starts_on_the_fastest(
    device: Device, store: TuningStore, script: type[_Script]
) -> None:
    gpu = Device(device.raw, replace(device.info, kind="DiscreteGPU"), device.limits)
    store.save(gpu.info, SHAPE, replace(KNOWN, compile_seconds={"subgroup": 0.1}))
    tuner = FftTuner(gpu, SHAPE, store=store)
    assert tuner.current == "subgroup" and tuner.is_settled
    assert script.started == 0  # type: ignore[attr-defined]


@pytest.mark.gpu
@pytest.mark.usefixtures("offers_all")
def test_without_waiting_only_what_compiles_at_once_is_taken(device: Device, store: TuningStore) -> None:
    gpu = Device(device.raw, replace(device.info, kind="DiscreteGPU"), device.limits)
    assert remembered_strategy(gpu, SHAPE, store) == "passes"
    store.save(gpu.info, SHAPE, replace(KNOWN, compile_seconds={"subgroup": 9.0}))
    assert remembered_strategy(gpu, SHAPE, store) == "passes"
    store.save(gpu.info, SHAPE, replace(KNOWN, compile_seconds={"subgroup": 0.1}))
    assert remembered_strategy(gpu, SHAPE, store) == "subgroup"
    processor = Device(device.raw, replace(device.info, kind="CPU"), device.limits)
    store.save(processor.info, SHAPE, replace(KNOWN, compile_seconds={"subgroup": 0.1}))
    assert remembered_strategy(processor, SHAPE, store) == "passes"
    store.save(gpu.info, SHAPE, replace(KNOWN.without("subgroup", "wrong"), compile_seconds={"workgroup": 0.1}))
    assert remembered_strategy(gpu, SHAPE, store) == "workgroup"


@pytest.mark.gpu
@pytest.mark.usefixtures("offers_all")
def test_a_strategy_that_is_late_is_refused_now_and_later(
    device: Device, store: TuningStore, script: type[_Script]
) -> None:
    script.answers += _timed(passes=3.0, workgroup=2.0)[:2]
    tuner = FftTuner(device, SHAPE, store=store, budget_s=0.0)
    assert tuner.wait() == "passes"
    assert tuner.tuning.refused == {"subgroup": "too slow to compile"}
    FftTuner(device, SHAPE, store=store).close()
    assert script.asked[-1]["strategies"] == ["passes", "workgroup"]


@pytest.mark.gpu
@pytest.mark.usefixtures("offers_all")
@pytest.mark.parametrize(("was_late", "reason"), [(False, "the driver failed"), (True, "too slow to compile")])
def test_shaders_that_end_the_helper_are_refused(
    device: Device, store: TuningStore, script: type[_Script], was_late: bool, reason: str
) -> None:
    store.save(device.info, SHAPE, KNOWN)
    script.ends, script.hit_time_limit = True, was_late
    assert FftTuner(device, SHAPE, store=store).wait() == "passes"
    found = store.load(device.info, SHAPE)
    assert found is not None and found.refused == {"subgroup": reason} and found.best == "workgroup"


@pytest.mark.gpu
@pytest.mark.usefixtures("offers_all")
def test_a_helper_that_does_not_even_start_is_tried_again(
    device: Device, store: TuningStore, script: type[_Script]
) -> None:
    script.ends = True
    assert FftTuner(device, SHAPE, store=store).wait() == "passes"
    assert store.load(device.info, SHAPE) is None


@pytest.mark.gpu
@pytest.mark.usefixtures("offers_all")
def test_pipelines_that_fail_here_leave_what_works(
    device: Device, store: TuningStore, script: type[_Script], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(self: Device, source: object, constants: object) -> None:
        raise ShaderError("no", "file", 1)

    store.save(device.info, SHAPE, KNOWN)
    monkeypatch.setattr(Device, "pipeline", fails)
    script.answers.append({"compile_seconds": 5.0})
    tuner = FftTuner(device, SHAPE, lambda strategy: FftPlan(device, SHAPE).shaders, store=store)
    assert tuner.wait() == "passes"
    assert tuner.tuning.refused == {"subgroup": "the driver failed"}


@pytest.mark.gpu
def test_nothing_is_started_where_there_is_no_choice(device: Device, store: TuningStore, script: type[_Script]) -> None:
    lengths = (8192, 3125)
    if supported_strategies(device, lengths) == ("passes",):
        tuner = FftTuner(device, lengths, store=store)
        assert tuner.is_settled and tuner.current == "passes"
        assert script.started == 0  # type: ignore[attr-defined]
    with pytest.raises(UserError, match="next good size"):
        FftTuner(device, (7, 64), store=store)


@pytest.mark.gpu
def test_a_helper_times_and_compiles_what_then_runs_here(device: Device, store: TuningStore) -> None:
    """The whole way, with a process: whatever it chooses is ready, and its timing is that of all on offer."""
    plans = {strategy: FftPlan(device, SHAPE, strategy=strategy) for strategy in supported_strategies(device, SHAPE)}
    with FftTuner(device, SHAPE, lambda strategy: plans[strategy].shaders, store=store) as tuner:
        chosen = tuner.wait()
    known = store.load(device.info, SHAPE)
    assert known is not None and not known.refused
    assert set(known.seconds) == set(known.compile_seconds) == set(plans)
    assert chosen == known.best
    recorder = CommandRecorder(device)
    plans[chosen].forward(recorder, device.buffer(plans[chosen].buffer_bytes, "fields"))
    recorder.submit(wait=True)


@pytest.mark.gpu
def test_a_helper_that_is_not_needed_any_more_ends(
    device: Device, store: TuningStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    helpers: list[TuningProcess] = []

    class Recorded(TuningProcess):
        def __init__(self, adapter: str, budget_s: float) -> None:
            super().__init__(adapter, budget_s)
            helpers.append(self)

    monkeypatch.setattr(tune, "TuningProcess", Recorded)
    tuner = FftTuner(device, SHAPE, store=store)
    if tuner.is_settled:
        pytest.skip("an adapter without a tuner")
    (helper,) = helpers
    assert not helper.has_ended
    tuner.close()
    while helper.next_answer() is not None:
        pass
    assert helper.has_ended and tuner.is_settled


@pytest.mark.gpu
def test_a_strategy_that_a_driver_makes_wrong_is_refused(
    device: Device, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Wrong(FftPlan):
        def natural_order(self, spectrum: NDArray[np.complexfloating]) -> NDArray[np.complexfloating]:
            sorted_spectrum = super().natural_order(spectrum).copy()
            if self.strategy == "workgroup":
                sorted_spectrum[..., 0, 0] *= 1 + 1e-4
            return sorted_spectrum

    monkeypatch.setattr(tune_worker, "FftPlan", Wrong)
    tune_worker.time_strategies(device, ("passes", "workgroup"), (1, 64))
    answers = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    tuning = TuningResult({}, {}, {})
    for answer in answers:
        tuning = tuning.with_answer(answer)
    assert set(tuning.seconds) == {"passes"} and set(tuning.compile_seconds) == {"passes", "workgroup"}
    assert tuning.refused["workgroup"].startswith("wrong by")


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="the system limits no processor time")
def test_the_system_ends_a_helper_whose_time_is_up() -> None:
    program = "from holoview.light.gpu.tune_worker import limit_cpu_time\nlimit_cpu_time(1)\nwhile True: pass"
    helper = TuningProcess("any", budget_s=1.0, arguments=("-c", program))
    while not helper.has_ended:
        time.sleep(0.02)
    assert helper.hit_time_limit and helper.next_answer() is None
    helper.send({"do": "nothing"})
    helper.close()
