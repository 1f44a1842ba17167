"""Captures on the disk one by one: an interruption takes none, nothing foreign is mixed in; the bench's record."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from holoview.bench.captures import Captures, read_captures, write_captures
from holoview.bench.captures.validation import check_settings
from holoview.bench.rig import RigDescription
from holoview.bench.rig.camera_pictures import DarkFrame, SettlingTime
from holoview.bench.rig.capture_folder import BenchRecord, CaptureStore, read_bench_record
from holoview.bench.rig.capture_plan import CapturePlan, default_plan
from holoview.util.errors import UserError
from holoview.util.file_writer import WriteError
from tests.file_limits import limit_of_file_size
from tests.rig.conftest import CAMERA_SHAPE, MakeRig


def _plan(rig: RigDescription, count: int = 4) -> CapturePlan:
    return CapturePlan(default_plan(rig).requests[:count])


def _capture(rig: RigDescription, plan: CapturePlan, number: int) -> Captures:
    """As if taken: the picture holds its number."""
    request = plan.requests[number]
    picture = np.full((1, *rig.camera_shape), 1000 + number, np.uint16)
    settings = {"wavelength_m": request.wavelength_m, "distance_m": request.distance_m, "power": request.power}
    arrays = {name: np.array([value]) for name, value in settings.items()}
    return dataclasses.replace(rig.blank_capture(), levels=request.levels(rig)[None], images=picture, **arrays)


def _store(rig: RigDescription, plan: CapturePlan, tmp_path: Path, text: str = "rig") -> CaptureStore:
    return CaptureStore(tmp_path / "X.h5", plan, text)


def _names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_captures_are_joined_in_the_order_of_the_plan_whenever_they_came(make_rig: MakeRig, tmp_path: Path) -> None:
    rig = make_rig()
    plan = _plan(rig)
    store = _store(rig, plan, tmp_path)
    assert store.open() == [] and store.missing == [0, 1, 2, 3]
    for number in (3, 1):
        store.add(number, _capture(rig, plan, number))
    again = _store(rig, plan, tmp_path)
    assert again.open() == [] and again.missing == [0, 2]
    for number in again.missing:
        again.add(number, _capture(rig, plan, number))
    captures = again.finish()
    assert captures.images[:, 0, 0].tolist() == [1000, 1001, 1002, 1003]
    assert captures.power.tolist() == [request.power for request in plan.requests]
    assert np.array_equal(captures.levels, np.stack([request.levels(rig) for request in plan.requests]))
    assert np.array_equal(read_captures(tmp_path / "X.h5").images, captures.images)
    assert _names(tmp_path) == ["X.h5", "rig.toml"]


def test_another_plan_or_rig_is_refused_and_nothing_is_touched(make_rig: MakeRig, tmp_path: Path) -> None:
    rig = make_rig()
    plan = _plan(rig)
    first = _store(rig, plan, tmp_path)
    first.open()
    first.add(0, _capture(rig, plan, 0))
    for other in (_store(rig, _plan(rig, 3), tmp_path), _store(rig, plan, tmp_path, "another rig")):
        with pytest.raises(UserError, match=r"X\.h5\.captures: holds captures of another plan or rig"):
            other.open()
    assert _store(rig, plan, tmp_path).open() == [] and read_captures(first.folder / "00000.h5").power[0] > 0


def test_a_finished_session_isnt_overwritten(make_rig: MakeRig, tmp_path: Path) -> None:
    rig = make_rig()
    (tmp_path / "X.h5").write_bytes(b"precious")
    with pytest.raises(UserError, match=r"X\.h5: is there already"):
        _store(rig, _plan(rig), tmp_path).open()
    assert (tmp_path / "X.h5").read_bytes() == b"precious" and not (tmp_path / "X.h5.captures").exists()


@pytest.mark.long
@pytest.mark.parametrize("keep", [0, 1, 100, -1])
def test_a_damaged_capture_is_taken_again(make_rig: MakeRig, tmp_path: Path, keep: int) -> None:
    rig = make_rig()
    plan = _plan(rig)
    store = _store(rig, plan, tmp_path)
    store.open()
    for number in range(4):
        store.add(number, _capture(rig, plan, number))
    file = store.folder / "00002.h5"
    file.write_bytes(file.read_bytes()[:keep])
    again = _store(rig, plan, tmp_path)
    assert again.open() == [2] and again.missing == [2]
    again.add(2, _capture(rig, plan, 2))
    assert len(again.finish()) == 4


def test_a_damaged_state_is_named(make_rig: MakeRig, tmp_path: Path) -> None:
    rig = make_rig()
    store = _store(rig, _plan(rig), tmp_path)
    store.open()
    (store.folder / "session.json").write_text("{", encoding="utf-8")
    with pytest.raises(UserError, match=r"session\.json: can't be read"):
        store.open()


def test_pictures_that_are_all_dark_are_kept_one_by_one_but_no_session(make_rig: MakeRig, tmp_path: Path) -> None:
    rig = make_rig()
    plan = _plan(rig, 2)
    store = _store(rig, plan, tmp_path)
    store.open()
    for number in range(2):
        store.add(number, dataclasses.replace(_capture(rig, plan, number), images=rig.blank_capture().images))
    with pytest.raises(UserError, match="all are dark"):
        store.finish()
    assert _store(rig, plan, tmp_path).open() == [] and not (tmp_path / "X.h5").exists()


def test_without_captures_there_is_no_session(make_rig: MakeRig, tmp_path: Path) -> None:
    rig = make_rig()
    store = _store(rig, _plan(rig), tmp_path)
    store.open()
    with pytest.raises(UserError, match="holds no capture yet"):
        store.finish()


def test_a_full_disk_costs_the_capture_in_flight_only(make_rig: MakeRig, tmp_path: Path) -> None:
    rig = make_rig()
    plan = _plan(rig)
    store = _store(rig, plan, tmp_path)
    store.open()
    store.add(0, _capture(rig, plan, 0))
    with limit_of_file_size(2000), pytest.raises(WriteError, match=r"00001\.h5: can't be written.*free .* kB there"):
        store.add(1, _capture(rig, plan, 1))
    assert store.missing == [1, 2, 3] and _names(store.folder) == ["00000.h5", "session.json"]
    again = _store(rig, plan, tmp_path)
    assert again.open() == [] and again.missing == [1, 2, 3]


def test_a_program_killed_while_it_clears_up_leaves_a_whole_session(
    make_rig: MakeRig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = make_rig()
    plan = _plan(rig, 2)
    store = _store(rig, plan, tmp_path)
    store.open()
    for number in range(2):
        store.add(number, _capture(rig, plan, number))

    def end(path: Path) -> None:
        (path / "00000.h5").unlink()
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr("shutil.rmtree", end)
        store.finish()
    assert len(read_captures(tmp_path / "X.h5")) == 2
    with pytest.raises(UserError, match="is there already"):
        _store(rig, plan, tmp_path).open()
    assert _names(tmp_path) == ["X.h5", "rig.toml"]


RECORD = BenchRecord(
    dark=tuple(
        DarkFrame(s, np.random.default_rng(k).random(CAMERA_SHAPE).astype(np.float32), 0.8 + k, 16)
        for k, s in enumerate((0.01, 0.3))
    ),
    settling={"slm2": SettlingTime(0.02, 1e-4, 0.14)},
    notes=("dark pictures have 70.90 counts", "µ"),
)


def _assert_same(found: BenchRecord, expected: BenchRecord) -> None:
    assert (dict(found.settling), found.notes) == (dict(expected.settling), expected.notes)
    assert len(found.dark) == len(expected.dark)
    for a, b in zip(found.dark, expected.dark, strict=True):
        assert (a.exposure_s, a.noise, a.pictures) == (b.exposure_s, b.noise, b.pictures)
        assert np.array_equal(a.mean, b.mean)


@pytest.mark.parametrize("record", [RECORD, BenchRecord()], ids=["full", "empty"])
def test_a_record_is_read_as_it_was_written(tmp_path: Path, record: BenchRecord) -> None:
    record.write(tmp_path / "bench.h5")
    _assert_same(read_bench_record(tmp_path / "bench.h5"), record)


def test_a_capture_file_with_a_record_is_the_same_session(make_rig: MakeRig, tmp_path: Path) -> None:
    path, session = tmp_path / "X.h5", make_rig().blank_capture()
    write_captures(path, session, check_settings, RECORD.write_into)
    captures = read_captures(path, check_settings)
    assert np.array_equal(captures.levels, session.levels) and captures.camera == session.camera
    _assert_same(read_bench_record(path), RECORD)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda h5: h5["dark"].pop("noise"), "dark/noise: is missing"),
        (lambda h5: h5["dark/noise"].resize((1,)), "dark/noise"),
        (lambda h5: h5["settling/slm2"].attrs.pop("wait"), "is damaged"),
        (lambda h5: h5["dark/exposure"].write_direct(np.array([np.nan, 1.0])), "dark/exposure: holds nan"),
    ],
)
def test_what_is_wrong_in_a_record_is_named(tmp_path: Path, change: Callable[[h5py.File], object], words: str) -> None:
    path = tmp_path / "bench.h5"
    RECORD.write(path)
    with h5py.File(path, "a") as h5:
        noise = h5["dark"].pop("noise")
        values = noise[()] if noise is not None else np.zeros(2)
        h5["dark"].create_dataset("noise", data=values, maxshape=(None,))
        change(h5)
    with pytest.raises(UserError, match=words):
        read_bench_record(path)
