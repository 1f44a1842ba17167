"""Dark frames: their mean and noise are the camera's, and what rig.toml states otherwise is said."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from holoview.captures.dataset import Camera
from holoview.rig import RigDescription
from holoview.rig.measure.camera_pictures import DarkFrame, dark_exposures, dark_notes, take_dark_frame
from tests.rig.conftest import CAMERA_SHAPE, direct_devices

MakeRig = Callable[..., RigDescription]
FACTS = Camera(pitch_m=4e-6, bit_depth=12, electrons_per_count=4.0, read_noise=3.0, black_level=64)
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
