"""What is found out of a bench stands in the capture file, where readers of captures ignore it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from holoview.captures import read_captures, write_captures
from holoview.captures.validation import check_settings
from holoview.rig import RigDescription
from holoview.rig.measure.camera_pictures import DarkFrame
from holoview.rig.measure.capture_folder import BenchRecord, read_bench_record
from holoview.rig.measure.settling import Settling
from holoview.util.errors import UserError
from tests.rig.conftest import CAMERA_SHAPE

MakeRig = Callable[..., RigDescription]
RECORD = BenchRecord(
    dark=tuple(
        DarkFrame(s, np.random.default_rng(k).random(CAMERA_SHAPE).astype(np.float32), 0.8 + k, 16)
        for k, s in enumerate((0.01, 0.3))
    ),
    settling={"slm2": Settling(0.02, 1e-4, 0.14)},
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
