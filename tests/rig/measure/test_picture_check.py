"""Pictures that a camera can't have taken are found; those that it can have taken, however alike, are not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from holoview.captures.dataset import Camera
from holoview.captures.virtual_measurement import read_out
from holoview.rig.devices import Counts, DeviceError, DeviceGone
from holoview.rig.measure.camera_pictures import ATTEMPTS, CheckedCamera, PictureCheck

FACTS = Camera(pitch_m=4e-6, bit_depth=12, electrons_per_count=4.0, read_noise=6.0, black_level=64)
SHAPE = (24, 32)
SCENE = np.linspace(0, 1200, 24 * 32).reshape(SHAPE)


def _picture(seed: int, facts: Camera = FACTS, light: float = 1.0) -> Counts:
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
    check = PictureCheck(FACTS, SHAPE)
    assert check.fault(_picture(0)) is None
    found = check.fault(WRONG[name][0])
    assert found is not None and WRONG[name][1] in found
    assert check.fault(_picture(2)) is None


def test_pictures_of_a_still_bench_are_right_however_many(seeds: int = 300) -> None:
    """Bright, dark, saturated in part or whole: chance equality of rows is never taken for a fault."""
    for light in (1.0, 0.0, 20.0):
        check = PictureCheck(FACTS, SHAPE)
        assert not any(check.fault(_picture(seed, light=light)) for seed in range(seeds))


def test_where_nothing_is_noisy_pictures_may_be_equal() -> None:
    """Dark pictures of a quiet camera, saturated ones, and those of a camera without noise."""
    quiet = dataclasses.replace(FACTS, read_noise=0.5)
    for facts, picture in (
        (quiet, np.full(SHAPE, 64, np.uint16)),
        (FACTS, np.full(SHAPE, 4095, np.uint16)),
        (dataclasses.replace(FACTS, read_noise=0.0, electrons_per_count=1e6), _picture(0)),
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
    camera = CheckedCamera(_Camera(_picture(0), _picture(0), timeout, _picture(1)), FACTS, said.append)
    assert np.array_equal(camera.take(), _picture(0)) and said == []
    assert np.array_equal(camera.take(), _picture(1))
    assert said == ["camera: the picture before, again; taken again", "camera: no picture within 1 s; taken again"]
    camera.close()


def test_a_camera_that_goes_on_so_is_out_of_order() -> None:
    device = _Camera(*[_picture(0)[:5]] * (ATTEMPTS + 1))
    expected = rf"camera: a picture of 5 × 32 pixels, not 24 × 32, {ATTEMPTS} times in a row; check its cable"
    with pytest.raises(DeviceError, match=expected):
        CheckedCamera(device, FACTS, lambda _: None).take()
    assert len(device.answers) == 1


def test_a_camera_that_is_gone_isnt_asked_again() -> None:
    device = _Camera(DeviceGone("camera", "is unplugged"), _picture(0))
    with pytest.raises(DeviceGone, match="unplugged"):
        CheckedCamera(device, FACTS, lambda _: None).take()
    assert len(device.answers) == 1
