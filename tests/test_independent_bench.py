"""The forward model explains what an independent float64 program computed, down to the camera's noise.

The files hold 12-bit pictures of a virtual bench: two modulators of 16 levels, a gap, two irises, Poisson and read
noise.
Everything that could be confused is in there: orientation, upsampling, padding, the irises, the phase's 1/λ.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import holoview as hv
from holoview.light.model.bench_parts import Modulator, Relay, Sampling
from holoview.light.model.system import System

h5py = pytest.importorskip("h5py", reason="h5py reads the sample captures")

FOLDER = Path(__file__).resolve().parents[0] / "data"
CHI2_TOLERANCE = 0.035
"""χ²/n of n = 49152 pixels scatters by √(2/n) = 0.0064; five of these, and the fitted gain's own error."""


def _open(name: str) -> h5py.File:
    return h5py.File(FOLDER / f"{name}.h5")


def _bench(file: h5py.File, capture: int, gap_error_m: float) -> System:
    geometry, camera = file["geometry"].attrs, file["camera"].attrs
    modulators = tuple(
        Modulator(
            pitch_m=float(slm.attrs["pitch"]),
            shape=slm["levels"].shape[1:],
            stroke_m=float(slm.attrs["opd_range"]),
            levels=int(slm.attrs["num_levels"]),
        )
        for slm in (file["slm1"], file["slm2"])
    )
    return System(
        wavelengths_m=[float(file["wavelength"][capture])],
        amplitudes=[[1.0]],
        modulators=modulators,
        gap_m=float(geometry["gap"]) + gap_error_m,
        planes_m=[float(file["distance"][capture])],
        relay1=Relay(iris_na=float(geometry["iris1_na"])),
        relay2=Relay(iris_na=float(geometry["iris2_na"])),
        observer="mono",
        sampling=Sampling(upsample=round(modulators[0].pitch_m / camera["pitch"])),
    )


def _chi2(file: h5py.File, capture: int, gap_error_m: float = 0.0) -> float:
    """χ² per pixel of one capture, one gain fitted, weighted by the camera's own noise model."""
    system, camera = _bench(file, capture, gap_error_m), file["camera"].attrs
    drive = np.stack([file[slm]["levels"][capture] / (file[slm].attrs["num_levels"] - 1) for slm in ("slm1", "slm2")])[
        None
    ]
    predicted = hv.simulate(system, drive, backend="torch64").intensity[0, 0]
    counts = file["camera/images"][capture].astype(float)
    valid = counts < 2 ** int(camera["bit_depth"]) - 1
    seen, predicted = counts[valid] - camera["black_level"], predicted[valid]
    predicted = predicted * (predicted @ seen) / (predicted @ predicted)
    electrons = float(camera["electrons_per_count"])
    variance = (predicted * electrons + camera["read_noise"] ** 2) / electrons**2 + 1 / 12
    return float(np.mean((seen - predicted) ** 2 / variance))


@pytest.mark.parametrize("capture", [0, 1, 4, 7])
def test_a_bench_without_faults_is_explained_to_its_noise(capture: int) -> None:
    with _open("sample_consistent") as file:
        assert _chi2(file, capture) == pytest.approx(1.0, abs=CHI2_TOLERANCE)


def test_a_longer_gap_is_seen_and_explains_the_rest() -> None:
    with _open("sample_gap") as file:
        assert _chi2(file, 0) > 10
        assert _chi2(file, 0, gap_error_m=0.108e-3) == pytest.approx(1.0, abs=CHI2_TOLERANCE)
