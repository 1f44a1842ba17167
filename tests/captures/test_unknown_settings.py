"""What nobody stated is estimated from the pictures, and said."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from holoview.bench.captures import Captures, read_captures, write_captures
from holoview.bench.captures.unknown_settings import with_estimates
from holoview.light.numerics.photon_transfer import transfer_of_pictures, transfer_of_repeats

Make = Callable[..., Captures]
GAIN, READ = 3.0, 2.0


def _speckle(seed: int, shape: tuple[int, int] = (300, 400), grain_px: float = 3.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    field = gaussian_filter(rng.normal(size=shape), grain_px) + 1j * gaussian_filter(rng.normal(size=shape), grain_px)
    light = np.abs(field) ** 2
    return np.asarray(200 * light / light.mean())


def _photographed(light: np.ndarray, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.asarray(np.round(rng.poisson(light * GAIN) / GAIN + rng.normal(0, READ, light.shape)))


def test_one_picture_of_speckle_tells_gain_and_read_noise() -> None:
    picture = _photographed(_speckle(1), 2)
    found = transfer_of_pictures([picture], [np.ones(picture.shape, bool)])
    assert found is not None
    assert found.electrons_per_count == pytest.approx(GAIN, rel=5 * found.relative_error)
    assert found.relative_error < 0.1
    # r² is the variance of the darkest pixels, 4 ± 5·4·√(2/5000) of some thousand, and σ² of shot noise around them.
    assert found.read_noise_counts == pytest.approx(READ, rel=0.2)


def test_two_pictures_of_one_pattern_tell_it_whatever_the_grain() -> None:
    light = _speckle(3, grain_px=0.7)
    first, second = _photographed(light, 4), _photographed(0.8 * light, 5)
    found = transfer_of_repeats(first, second, np.ones(light.shape, bool))
    assert found is not None
    assert found.electrons_per_count == pytest.approx(GAIN, rel=0.1)


def test_fine_speckle_tells_nothing_rather_than_something_wrong() -> None:
    for seed in range(3):
        picture = _photographed(_speckle(seed, grain_px=0.6), seed)
        found = transfer_of_pictures([picture], [np.ones(picture.shape, bool)])
        assert found is None or found.electrons_per_count == pytest.approx(GAIN, rel=0.3)


def test_unknown_settings_of_a_file_are_estimated_and_stay_said(make_captures: Make, tmp_path: Path) -> None:
    captures = make_captures(4)
    images = captures.images.copy()
    images[1] = 64 + (images[1] - 64) // 2
    write_captures(tmp_path / "c.h5", dataclasses.replace(captures, images=images))
    with h5py.File(tmp_path / "c.h5", "a") as file:
        file["camera"].attrs["electrons_per_count"] = "unknown"
        file["camera"].attrs["read_noise"] = "unknown"
        for name in ("power", "exposure"):
            del file[name]
            file[name] = "unknown"
    read = read_captures(tmp_path / "c.h5")
    assert read.camera.electrons_per_count > 0
    assert len(read.estimated) == 3
    mean = images.mean(axis=(1, 2)) - 64
    same = read.wavelength_m == read.wavelength_m[1]
    assert (read.exposure_s / mean)[same].std() == pytest.approx(0, abs=1e-9)  # in proportion to the light
    assert (read.power == 1).all()
    write_captures(tmp_path / "d.h5", read)
    again = read_captures(tmp_path / "d.h5")  # numbers now, which older programs read
    assert again.estimated == read.estimated
    assert again.camera == read.camera
    assert with_estimates(again) is again
