"""Calibrations of slmsuite are read: those of its layout, and one that slmsuite itself writes."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from holoview.bench.calibrate.lut_fit import fit_lut
from holoview.bench.calibrate.sweep import sweep_of_readings
from holoview.bench.captures.slmsuite_calibration import FourierCalibration, PixelCalibration, read_slmsuite
from holoview.util.errors import UserError
from tests.captures.slmsuite_files import fourier, pixel, save


def test_a_fourier_calibration_states_lengths_and_the_axis(tmp_path: Path) -> None:
    found = read_slmsuite(save(tmp_path / "f.h5", fourier(0.25 / 12e-6, (163, 118))))
    assert isinstance(found, FourierCalibration)
    assert found.focal_px * 12e-6 == pytest.approx(0.25)
    assert found.axis_px == pytest.approx((118, 163))  # (y, x)
    assert (found.wavelength_m, found.pitch_m, found.camera_pitch_m) == pytest.approx((532e-9, 36e-6, 12e-6))


def test_lengths_that_slmsuite_does_not_know_stay_unknown(tmp_path: Path) -> None:
    found = read_slmsuite(save(tmp_path / "f.h5", fourier(1000.0, (10, 20), cam_pitch_um=None)))
    assert isinstance(found, FourierCalibration)
    assert found.camera_pitch_m is None


def test_a_pixel_calibration_gives_the_phase_of_each_level(tmp_path: Path) -> None:
    """Without noise the curve through its knots is exact to 0.01 of the stroke (as in `test_lut_fit`)."""
    truth = 2.4 * np.pi * (np.arange(64) / 63) ** 1.3
    found = read_slmsuite(save(tmp_path / "p.h5", pixel(truth)))
    assert isinstance(found, PixelCalibration)
    assert [(sweep.period_px, sweep.direction) for sweep in found.sweeps] == [(8, "x"), (16, "x")]
    lut = fit_lut([sweep_of_readings(one.levels, one.power, "p") for one in found.sweeps])
    assert lut.stroke == pytest.approx(2.4 * np.pi, rel=0.01)
    assert np.abs(lut.phase - truth).max() < 0.02 * truth[-1]


BAD = {
    "holds nothing": {},
    "several levels": {"levels": np.arange(4) * 64, "periods": [8], "orders": [1], "data": np.zeros((2, 1, 4, 4, 1))},
    "the first order": {"levels": np.arange(16), "periods": [8], "orders": [0], "data": np.zeros((2, 1, 16, 16, 1))},
    "an array of shape": {"levels": np.arange(16), "periods": [8], "orders": [1], "data": np.zeros((2, 16, 16))},
    "aren't finite": {"M": np.full((2, 2), np.nan), "b": np.zeros((2, 1))},
    "camera pixels a unit of sine": {"M": np.zeros((2, 2)), "b": np.zeros((2, 1))},
    "holds NX, NY": {"NX": 5, "NY": 6},
}


@pytest.mark.parametrize("said", BAD)
def test_other_files_are_refused_in_words(said: str, tmp_path: Path) -> None:
    words = {"several levels": "at least 12 grey levels"}.get(said, said)
    with pytest.raises(UserError, match=words):
        read_slmsuite(save(tmp_path / "bad.h5", BAD[said]))
    with h5py.File(tmp_path / "captures.h5", "w") as file:
        file.attrs["format"] = "holoview-captures"
    with pytest.raises(UserError, match="is of another kind"):
        read_slmsuite(tmp_path / "captures.h5")


def test_what_slmsuite_itself_saves_is_read(tmp_path: Path) -> None:
    files = pytest.importorskip("slmsuite.holography.analysis.files", exc_type=ImportError)
    files.save_h5(str(tmp_path / "f.h5"), fourier(1000.0, (10, 20), cam_pitch_um=None))
    found = read_slmsuite(tmp_path / "f.h5")
    assert isinstance(found, FourierCalibration)
    assert found.focal_px == pytest.approx(1000)
    assert found.wavelength_m == pytest.approx(532e-9)
