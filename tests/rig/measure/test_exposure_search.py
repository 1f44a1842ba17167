"""The exposure search, against a camera whose light is a known number of counts per second."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.captures.dataset import Camera
from holoview.rig.devices import Counts
from holoview.rig.measure.camera_pictures import BRIGHT_QUANTILE, take_exposed

FACTS = Camera(pitch_m=4e-6, bit_depth=12, electrons_per_count=4.0, read_noise=3.0, black_level=64)
RAMP = np.linspace(0, 1, 2001)[1:].reshape(40, 50)  # brightest quantile: 0.999


class LinearCamera:
    """Counts = black + rate · exposure · ramp, as whole numbers up to saturation. taken: exposures of its pictures."""

    shape = (40, 50)

    def __init__(self, rate: float, exposures_s: tuple[float, float] = (1e-6, 10.0)) -> None:
        self.rate, self.exposures_s, self._exposure_s = rate, exposures_s, float("nan")
        self.taken: list[float] = []

    def set_exposure(self, exposure_s: float) -> float:
        low, high = self.exposures_s
        assert low <= exposure_s <= high
        self._exposure_s = exposure_s
        return exposure_s

    def take(self) -> Counts:
        self.taken.append(self._exposure_s)
        counts = FACTS.black_level + self.rate * self._exposure_s * RAMP
        return np.minimum(np.rint(counts), FACTS.saturation).astype(np.uint16)

    def close(self) -> None:
        pass


def _share(picture: Counts) -> float:
    bright = float(np.quantile(picture, BRIGHT_QUANTILE))
    return (bright - FACTS.black_level) / (FACTS.saturation - FACTS.black_level)


@pytest.mark.parametrize("start", [1e-6, 1e-4, 1e-2, 1.0, 10.0, 1e3])
@pytest.mark.parametrize("rate", [1e4, 1e6, 1e8])
def test_the_brightest_pixels_end_within_the_range_from_any_start(rate: float, start: float) -> None:
    camera = LinearCamera(rate)
    picture, exposure = take_exposed(camera, FACTS, start)
    assert 0.4 <= _share(picture) <= 0.95
    assert exposure == camera.taken[-1]  # the picture that is returned has the exposure that is returned
    assert len(camera.taken) <= 2 + np.ceil(np.log(1e7) / np.log(8))  # each step changes it by a factor of 8 at least


def test_a_good_start_needs_a_single_picture() -> None:
    camera = LinearCamera(1e6)
    _, exposure = take_exposed(camera, FACTS, 0.6 * 4031 / 1e6)
    assert camera.taken == [exposure] == [0.6 * 4031 / 1e6]


def test_from_a_linear_picture_the_next_one_hits_the_target() -> None:
    camera = LinearCamera(1e6)
    picture, _ = take_exposed(camera, FACTS, 0.2 * 4031 / 1e6)
    assert len(camera.taken) == 2
    assert _share(picture) == pytest.approx(0.8, abs=2e-3)  # of the quantile, and of whole counts


@pytest.mark.parametrize(("rate", "end"), [(1e3, 1), (1e9, 0)], ids=["too dark", "too bright"])
def test_what_no_exposure_reaches_ends_at_the_nearest_one(rate: float, end: int) -> None:
    camera = LinearCamera(rate, (1e-4, 0.1))
    _, exposure = take_exposed(camera, FACTS, 1e-2)
    assert exposure == camera.exposures_s[end]


def test_a_bench_without_light_ends_at_the_longest_exposure() -> None:
    camera = LinearCamera(0.0)
    _, exposure = take_exposed(camera, FACTS, 1e-2)
    assert exposure == 10.0 and len(camera.taken) <= 13
