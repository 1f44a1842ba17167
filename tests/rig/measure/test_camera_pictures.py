"""Pictures: the exposure search, checks of what a camera can't have taken, dark frames."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from holoview.bench.captures.dataset import Camera
from holoview.bench.captures.virtual_measurement import read_out
from holoview.bench.rig.camera_pictures import (
    ATTEMPTS,
    BRIGHT_QUANTILE,
    CheckedCamera,
    DarkFrame,
    PictureCheck,
    dark_exposures,
    dark_notes,
    take_dark_frame,
    take_exposed,
)
from holoview.bench.rig.devices import Counts, DeviceError, DeviceGone
from tests.rig.conftest import CAMERA_SHAPE, MakeRig, direct_devices

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


CHECKED = Camera(pitch_m=4e-6, bit_depth=12, electrons_per_count=4.0, read_noise=6.0, black_level=64)
SHAPE = (24, 32)
SCENE = np.linspace(0, 1200, 24 * 32).reshape(SHAPE)


def _picture(seed: int, facts: Camera = CHECKED, light: float = 1.0) -> Counts:
    return read_out(facts, light * SCENE, facts.black_level, np.random.default_rng(seed))


def _torn(upper: Counts, lower: Counts, row: int) -> Counts:
    return np.concatenate([upper[:row], lower[row:]])


WRONG: dict[str, tuple[Counts, str]] = {
    "again": (_picture(0), "the picture before, again"),
    "torn below": (_torn(_picture(1), _picture(0), 20), "a part of the one before"),
    "torn above": (_torn(_picture(0), _picture(1), 3), "a part of the one before"),
    "empty below": (_torn(_picture(1), np.zeros(SHAPE, np.uint16), 12), "lower part is empty"),
    "short": (_picture(1)[:12], "12 × 32 pixels, not 24 × 32"),
    "colour": (np.stack([_picture(1)] * 3, axis=-1), "24 × 32 × 3 pixels"),
    "deeper": (_picture(1) * np.uint16(8), "more than 12 bits"),
    "floats": (_picture(1).astype(np.float32), "counts of type float32"),  # type: ignore[dict-item]
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_pictures_are_found(name: str) -> None:
    check = PictureCheck(CHECKED, SHAPE)
    assert check.fault(_picture(0)) is None
    found = check.fault(WRONG[name][0])
    assert found is not None and WRONG[name][1] in found
    assert check.fault(_picture(2)) is None


def test_pictures_of_a_still_bench_are_right_however_many(seeds: int = 300) -> None:
    """Bright, dark, saturated in part or whole: chance equality of rows is never taken for a fault."""
    for light in (1.0, 0.0, 20.0):
        check = PictureCheck(CHECKED, SHAPE)
        assert not any(check.fault(_picture(seed, light=light)) for seed in range(seeds))


def test_where_nothing_is_noisy_pictures_may_be_equal() -> None:
    """Dark pictures of a quiet camera, saturated ones, and those of a camera without noise."""
    quiet = dataclasses.replace(CHECKED, read_noise=0.5)
    for facts, picture in (
        (quiet, np.full(SHAPE, 64, np.uint16)),
        (CHECKED, np.full(SHAPE, 4095, np.uint16)),
        (dataclasses.replace(CHECKED, read_noise=0.0, electrons_per_count=1e6), _picture(0)),
    ):
        check = PictureCheck(facts, SHAPE)
        assert check.fault(picture) is None and check.fault(picture) is None


class _Camera:
    """Gives what it is told to, in order."""

    shape, exposures_s = SHAPE, (1e-4, 1.0)

    def __init__(self, *answers: Counts | Exception) -> None:
        self.answers = list(answers)

    def set_exposure(self, exposure_s: float) -> float:
        return exposure_s

    def take(self) -> Counts:
        answer = self.answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def close(self) -> None:
        raise AssertionError("not its to close")


def test_what_is_wrong_is_taken_again_and_told() -> None:
    said: list[str] = []
    timeout = DeviceError("camera", "no picture within 1 s", remedy="plug it in")
    camera = CheckedCamera(_Camera(_picture(0), _picture(0), timeout, _picture(1)), CHECKED, said.append)
    assert np.array_equal(camera.take(), _picture(0)) and said == []
    assert np.array_equal(camera.take(), _picture(1))
    assert said == ["camera: the picture before, again; taken again", "camera: no picture within 1 s; taken again"]
    camera.close()


def test_a_camera_that_goes_on_so_is_out_of_order() -> None:
    device = _Camera(*[_picture(0)[:5]] * (ATTEMPTS + 1))
    expected = rf"camera: a picture of 5 × 32 pixels, not 24 × 32, {ATTEMPTS} times in a row; check its cable"
    with pytest.raises(DeviceError, match=expected):
        CheckedCamera(device, CHECKED, lambda _: None).take()
    assert len(device.answers) == 1


def test_a_camera_that_is_gone_isnt_asked_again() -> None:
    device = _Camera(DeviceGone("camera", "is unplugged"), _picture(0))
    with pytest.raises(DeviceGone, match="unplugged"):
        CheckedCamera(device, CHECKED, lambda _: None).take()
    assert len(device.answers) == 1


PIXELS = math.prod(CAMERA_SHAPE)


def _frame(exposure_s: float = 0.01, level: float = 64.0, noise: float = FACTS.dark_noise) -> DarkFrame:
    return DarkFrame(exposure_s, np.full(CAMERA_SHAPE, level, np.float32), noise, 16)


def test_a_frame_has_the_camera_s_level_and_noise(make_rig: MakeRig) -> None:
    devices = direct_devices(make_rig({"virtual": {"effects": {"camera_black": {"black": 7.0}}}}))
    frame = take_dark_frame(devices.camera, 0.02, 9)
    σ = FACTS.dark_noise
    assert (frame.exposure_s, frame.pictures, frame.mean.shape) == (0.02, 9, CAMERA_SHAPE)
    assert frame.level == pytest.approx(71, abs=5 * σ / (9 * PIXELS) ** 0.5)
    assert frame.noise == pytest.approx(σ, rel=5 / (2 * 8 * PIXELS) ** 0.5)
    assert frame.mean.std() == pytest.approx(σ / 3, rel=5 / (2 * PIXELS) ** 0.5)


def test_what_agrees_with_rig_toml_isnt_noted() -> None:
    assert not dark_notes([], FACTS) and not dark_notes([_frame(), _frame(0.5)], FACTS)
    assert not dark_notes([_frame(level=64.4, noise=1.2 * FACTS.dark_noise)], FACTS)


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        ([_frame(level=70.9)], "have 70.9 counts, but rig.toml states black_level = 64"),
        ([_frame(level=63.0)], "63.0 counts"),
        ([_frame(noise=math.sqrt(2.0**2 + 1 / 12))], "read noise of 8 electrons, but rig.toml states read_noise = 3"),
        ([_frame(noise=0.3)], "read_noise = 3"),
        ([_frame(0.1, level=66.0), _frame(0.01, level=64.2)], "grow by 20 counts a second"),
    ],
)
def test_what_differs_is_said_with_the_number_that_would_be_right(frames: list[DarkFrame], words: str) -> None:
    notes = dark_notes(frames, FACTS)
    assert len(notes) == 1 and words in next(iter(notes.values()))


@pytest.mark.parametrize(
    ("used", "there", "wanted"),
    [
        ([], [], []),
        ([0.01], [], [0.01]),
        ([0.01, 0.012], [], [0.01]),
        ([0.03, 0.01, 0.1], [], [0.01, 0.1]),
        ([0.03, 0.01, 0.1], [0.0101], [0.1]),
        ([0.03, 0.01, 0.1], [0.0101, 0.09], []),
    ],
)
def test_frames_are_taken_at_the_shortest_and_longest_exposure(
    used: list[float], there: list[float], wanted: list[float]
) -> None:
    assert dark_exposures(used, there) == wanted


def test_light_in_the_room_grows_with_the_exposure(make_rig: MakeRig) -> None:
    effects: dict[str, Any] = {"ambient": {"level": 20.0}}
    devices = direct_devices(make_rig({"virtual": {"effects": effects}}))
    frames = [take_dark_frame(devices.camera, exposure_s, 4) for exposure_s in (0.01, 0.4)]
    assert "growth" in dark_notes(frames, FACTS)
