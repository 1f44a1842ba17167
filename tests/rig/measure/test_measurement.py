"""A session on a virtual bench in this process: what it measures, what it tells, and how it goes on."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from holoview.bench.captures.predictor import Predictor
from holoview.bench.rig import RigDescription, camera_pictures
from holoview.bench.rig.capture_folder import CaptureStore, read_bench_record
from holoview.bench.rig.capture_plan import CapturePlan, default_plan, forecast_lines, make_forecast
from holoview.bench.rig.devices import DeviceError, Devices, Levels
from holoview.bench.rig.measurement import Measurement, is_complete
from holoview.util.errors import UserError
from tests.rig.conftest import MakeRig, direct_devices


def _plan(rig: RigDescription, exposure_s: float | None = None, count: int = 5) -> CapturePlan:
    requests = default_plan(rig).requests[:: 48 // count][:count]
    return CapturePlan(tuple(dataclasses.replace(request, exposure_s=exposure_s) for request in requests))


def _store(plan: CapturePlan, tmp_path: Path) -> CaptureStore:
    store = CaptureStore(tmp_path / "X.h5", plan, "")
    store.open()
    return store


def _ignore(*_: Any) -> None:
    pass


def test_captures_are_the_model_s_whatever_the_camera_did(
    make_rig: MakeRig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every picture has the χ² of its noise: none is torn, repeated, unsettled, or of another pattern.

    Three of four pictures fail: of so many attempts all fail once in 10⁷. 6 σ: one of 500 million pictures.
    """
    monkeypatch.setattr(camera_pictures, "ATTEMPTS", 60)
    faults = {"seed": 1, "timeout": 0.15, "short": 0.15, "torn": 0.2, "repeated": 0.25}
    changes = {"virtual": {"settle": 0.02, "faults": faults}, "slm1.settle": 0.3, "slm2.settle": 0.3}
    rig = make_rig(changes | {"limits.exposure": [1e-5, 20.0]})  # the finest pattern's light may need more than 0.5 s
    plan, said = _plan(rig), list[str]()
    store = _store(plan, tmp_path)
    with direct_devices(rig) as devices:
        session = Measurement(rig, devices, said.append)
        assert session.run(plan, store, _ignore)
    captures = store.finish()
    signal = Predictor(captures)(range(len(captures))).signal.double().numpy()
    for image, expected in zip(captures.images, signal, strict=True):
        valid = image < captures.camera.saturation
        seen, light = image[valid] - 64.0, expected[valid]
        light = light * (light @ seen) / (light @ light)
        χ2 = np.mean((seen - light) ** 2 / captures.camera.noise_variance(light))
        assert χ2 == pytest.approx(1.0, abs=6 * (2 / seen.size) ** 0.5)
    assert {text.partition("; ")[2] for text in said} == {"taken again"} and len(said) >= 3
    assert read_bench_record(tmp_path / "X.h5").notes == tuple(session.notes) == tuple(said)


def test_dark_frames_are_taken_with_the_lasers_off_at_the_exposures_used(make_rig: MakeRig, tmp_path: Path) -> None:
    rig = make_rig({"virtual": {"effects": {"camera_black": {"black": 7.0}}}})
    plan, said = _plan(rig, 0.004), list[str]()
    store = _store(plan, tmp_path)
    with direct_devices(rig) as devices:
        assert not is_complete(store)
        Measurement(rig, devices, said.append).run(plan, store, _ignore)
    assert is_complete(store)
    store.finish()
    frames = read_bench_record(tmp_path / "X.h5").dark
    assert [(frame.exposure_s, frame.pictures) for frame in frames] == [(0.01, 4), (0.004, 16)]
    assert all(frame.level == pytest.approx(71, abs=0.1) for frame in frames)
    assert len(said) == 1 and "rig.toml states black_level = 64" in said[0]


def test_settling_is_measured_where_the_rig_says_auto_and_used_and_stated(make_rig: MakeRig, tmp_path: Path) -> None:
    rig = make_rig({"slm1.settle": "auto", "virtual.settle": 0.03})
    assert rig.devices["slm1"].options["settle"] == 0.5 and not rig.devices["slm2"].measures_settling
    plan, said = _plan(rig, 0.01, 2), list[str]()
    store = _store(plan, tmp_path)
    with direct_devices(rig) as devices:
        Measurement(rig, devices, said.append).run(plan, store, _ignore)
        begin = devices.clock.now()
        again = Measurement(rig, devices)
        again.run(CapturePlan(plan.requests[:1]), _Fresh(store), _ignore)
        waited = devices.clock.now() - begin
    assert said[0].startswith("slm1: settles with a time constant of")
    store.finish()
    record = read_bench_record(tmp_path / "X.h5")
    assert set(record.settling) == {"slm1"}
    found = record.settling["slm1"]
    assert found.constant_s == pytest.approx(0.03, rel=0.02, abs=5 * found.deviation_s)
    assert found.wait_s <= waited < found.wait_s + 2.1  # moves of 10 mm, a picture; it isn't measured once more


class _Fresh:
    """A store in which the first capture is missing, with the record of another one."""

    def __init__(self, store: CaptureStore) -> None:
        self.record, self.missing, self.exposures_s = store.record, [0], list[float]()

    def add(self, number: int, capture: Any) -> None:
        self.missing = []

    def keep(self, record: Any) -> None:
        self.record = record


class _Asked:
    """Asked to end before a capture; or raises there."""

    def __init__(self, after: int, error: BaseException | None = None) -> None:
        self.left, self.error = after, error

    def __call__(self) -> bool:
        self.left -= 1
        if self.left < 0 and self.error is not None:
            raise self.error
        return self.left < 0


@pytest.mark.long
@pytest.mark.parametrize("error", [None, KeyboardInterrupt(), DeviceError("stage", "is stuck")])
def test_an_interruption_leaves_what_is_there_and_the_lasers_off(
    make_rig: MakeRig, tmp_path: Path, error: BaseException | None
) -> None:
    rig = make_rig()
    plan = _plan(rig, 0.01)
    try:
        with direct_devices(rig) as devices:
            done = Measurement(rig, devices).run(plan, _store(plan, tmp_path), _ignore, _Asked(2, error))
            assert not done and error is None
    except (KeyboardInterrupt, DeviceError) as raised:
        assert raised is error
    assert _laser_log(devices)[-1] == "off"
    store = _store(plan, tmp_path)
    assert store.missing == [2, 3, 4]
    before = (store.folder / "00000.h5").read_bytes()
    with direct_devices(rig) as devices:
        assert Measurement(rig, devices).run(plan, store, _ignore)
    assert (store.folder / "00000.h5").read_bytes() == before
    captures = store.finish()
    assert captures.power.tolist() == [request.power for request in plan.requests]
    assert np.array_equal(captures.levels, np.stack([request.levels(rig) for request in plan.requests]))


def _laser_log(devices: Devices) -> list[str]:
    lasers: Any = devices.lasers
    return lasers.device.log  # type: ignore[no-any-return]


def test_pictures_at_the_end_of_the_exposures_are_told_once_for_each_laser(make_rig: MakeRig, tmp_path: Path) -> None:
    rig = make_rig({"limits.exposure": [1e-5, 2e-4]})
    plan, said = _plan(rig), list[str]()
    with direct_devices(rig) as devices:
        Measurement(rig, devices, said.append).run(plan, _store(plan, tmp_path), _ignore)
    assert sorted(said) == [f"{nm} nm: too dark at 0.0002 s, where exposures end" for nm in (450, 638)]


def test_progress_tells_the_bench_s_time_that_is_left(make_rig: MakeRig, tmp_path: Path) -> None:
    rig = make_rig({"slm1.settle": 10.0, "slm2.settle": 10.0})
    plan, notes = _plan(rig, 0.01), list[str]()
    with direct_devices(rig) as devices:
        Measurement(rig, devices).run(plan, _store(plan, tmp_path), lambda _, __, note: notes.append(note))
    assert notes[0] == "450 nm, 1 mm" and notes[1].endswith(" left") and notes[-1] == ""
    left = [float(note.split(", ")[2].removesuffix(" s left")) for note in notes[1:-1]]
    assert left == pytest.approx([40, 30, 20, 10], rel=0.2)  # of the moves between


def test_the_forecast_says_all_that_would_happen(make_rig: MakeRig) -> None:
    rig = make_rig({"slm1.settle": "auto"})
    plan = default_plan(rig)
    text = "\n".join(forecast_lines(rig, make_forecast(rig, plan, list(range(20)))))
    for words in (
        "camera: virtual",
        "power up to 1, exposure 1e-05 s … 0.5 s, stage 0 mm … 10 mm",
        "slm1: how fast it settles is measured",
        "stage to 5 mm\n  450 nm: 8 captures, power 0.",
        "exposure searched",
        "48 captures, of which 28 are there",
        "on the bench, 184 kB of data",  # (2·16·24 + 2·32·48)·48 bytes
    ):
        assert words in text
    stated = make_forecast(rig, _plan(rig, 0.01), [0, 1])
    assert "exposure 0.01 s" in "\n".join(forecast_lines(rig, stated))


def test_the_forecast_of_time_is_near_what_the_bench_takes(make_rig: MakeRig, tmp_path: Path) -> None:
    """Within a factor of two: moves, exposures and tries are typical ones."""
    rig = make_rig()
    plan = default_plan(rig)
    store = _store(plan, tmp_path)
    with direct_devices(rig) as devices:
        Measurement(rig, devices).run(plan, store, _ignore)
        took = devices.clock.now()
    assert took / 2 < make_forecast(rig, plan, range(len(plan.requests))).bench_s < took * 2


def test_a_fourier_bench_is_measured_and_its_settling_too(make_rig: MakeRig, tmp_path: Path) -> None:
    changes: dict[str, Any] = {"slm2": None, "geometry": {"focal_length": "50 mm"}, "stage.range": ["-2 mm", "2 mm"]}
    rig = make_rig({**changes, "slm1.settle": "auto", "virtual.settle": 0.03})
    plan = CapturePlan(default_plan(rig).requests[6:10])
    store = _store(plan, tmp_path)
    with direct_devices(rig) as devices:
        assert Measurement(rig, devices).run(plan, store, _ignore)
    captures = store.finish()
    assert captures.is_fourier and len(captures) == 4
    found = read_bench_record(tmp_path / "X.h5").settling["slm1"]
    assert found.constant_s == pytest.approx(0.03, rel=0.02, abs=5 * found.deviation_s)


def test_patterns_are_levels_and_never_changed(make_rig: MakeRig) -> None:
    """What is sent is what is stored."""
    rig = make_rig()
    sent: list[Levels] = []

    class Modulator:
        shape, settle_s = rig.slm_shape, 0.0

        def show(self, levels: Levels) -> None:
            sent.append(levels)

        def close(self) -> None:
            pass

    devices = dataclasses.replace(direct_devices(rig), modulators=(Modulator(), Modulator()))
    request = default_plan(rig).requests[0]
    capture = Measurement(rig, devices).take(request, request.levels(rig))
    assert np.array_equal(capture.levels[0], np.stack(sent)) and capture.levels.dtype == np.uint8


def test_a_session_that_needs_too_much_memory_is_refused_before_anything_is_opened(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = make_rig()
    monkeypatch.setenv("HOLOVIEW_MEMORY", "1MB")
    with pytest.raises(UserError, match="captures: needs about"):
        make_forecast(rig, default_plan(rig), []).require_memory()
