"""Exposures chosen once and shortened when pictures get brighter; dark level; saturation; few moves of the stage."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.bench.experiment.bench_camera import BenchCamera, PictureRequest
from holoview.bench.rig.devices import Counts
from tests.experiment.camera_loop.conftest import SHAPE, BenchHere, MakeRig

Λ = 520e-9
BLACK = np.zeros((1, 2, *SHAPE), np.uint16)


class _Lamp(BenchHere):
    """A camera that sees `rate` counts per second where a laser is on, 64 counts, a dark pattern and noise."""

    rate = 1e5

    def take(self) -> Counts:
        self.taken += 1
        picture = np.full(self.shape, 64.0) + np.arange(self.shape[1]) % 3
        if self.bench.laser is not None:
            picture += self.rate * self.bench.exposure_s * self.bench.laser[1]
            picture[:4] += 4 * self.rate * self.bench.exposure_s
        picture += 1.5 * np.random.default_rng(self.taken).standard_normal(self.shape)
        return np.clip(np.rint(picture), 0, 4095).astype(np.uint16)


def _shot(distance_m: float = 0.0, frame: int = 0) -> PictureRequest:
    return PictureRequest(frame, Λ, distance_m)


def test_light_is_what_comes_above_the_dark_picture_per_second_and_power(make_rig: MakeRig) -> None:
    bench = _Lamp(make_rig())
    (picture,) = BenchCamera(bench.rig, bench.devices()).record(BLACK, [_shot()])
    assert not picture.saturated.any()
    assert picture.light[4:].mean() == pytest.approx(1e5, rel=2e-3)
    assert picture.light[:4].mean() == pytest.approx(5e5, rel=2e-3)


def test_an_exposure_is_searched_once_and_kept(make_rig: MakeRig) -> None:
    bench = _Lamp(make_rig())
    camera = BenchCamera(bench.rig, bench.devices())
    camera.record(BLACK, [_shot()])
    searched, exposure_s = camera.pictures, camera.exposures_s[Λ]
    camera.record(BLACK, [_shot(), _shot()])
    assert camera.pictures == searched + 2 and camera.exposures_s[Λ] == exposure_s


def test_a_brighter_picture_shortens_the_exposure_and_is_taken_again(make_rig: MakeRig) -> None:
    bench = _Lamp(make_rig())
    camera = BenchCamera(bench.rig, bench.devices())
    camera.record(BLACK, [_shot()])
    before = camera.exposures_s[Λ]
    bench.rate *= 3
    (picture,) = camera.record(BLACK, [_shot()])
    assert camera.exposures_s[Λ] < before / 2
    assert not picture.saturated.any()
    assert picture.light[4:].mean() == pytest.approx(3e5, rel=2e-3)


def test_after_pictures_that_are_much_darker_the_exposure_is_searched_anew(make_rig: MakeRig) -> None:
    bench = _Lamp(make_rig())
    camera = BenchCamera(bench.rig, bench.devices())
    camera.record(BLACK, [_shot()])
    before = camera.exposures_s[Λ]
    bench.rate /= 10
    camera.record(BLACK, [_shot()])
    camera.record(BLACK, [_shot()])
    assert camera.exposures_s[Λ] > 4 * before


def test_what_stays_saturated_at_the_shortest_exposure_is_marked(make_rig: MakeRig) -> None:
    bench = _Lamp(make_rig())
    bench.rate = 1.5e8  # 1500 counts in 10 µs, in the first rows five times as many
    (picture,) = BenchCamera(bench.rig, bench.devices()).record(BLACK, [_shot()])
    assert picture.saturated[:4].all() and not picture.saturated[4:].any()


def test_the_stage_goes_through_the_planes_once_and_back_the_next_time(make_rig: MakeRig) -> None:
    bench = _Lamp(make_rig())
    moves: list[float] = []
    move = bench.bench.move_to
    bench.bench.move_to = lambda z: (moves.append(z), move(z))[1]  # type: ignore[method-assign]
    camera = BenchCamera(bench.rig, bench.devices())
    shots = [_shot(z, frame) for frame in (0, 1) for z in (1e-3, 3e-3, 2e-3)]
    for _ in range(2):
        assert len(camera.record(np.concatenate([BLACK, BLACK]), shots)) == 6
    assert moves == [1e-3, 2e-3, 3e-3, 2e-3, 1e-3]


def test_pictures_come_in_the_order_of_their_shots(make_rig: MakeRig) -> None:
    bench = _Lamp(make_rig())
    pictures = BenchCamera(bench.rig, bench.devices()).record(BLACK, [_shot(3e-3), _shot(1e-3), _shot(2e-3)])
    assert [float(p.capture.distance_m[0]) for p in pictures] == pytest.approx([3e-3, 1e-3, 2e-3])


def test_at_rest_the_lasers_are_off(make_rig: MakeRig) -> None:
    bench = _Lamp(make_rig())
    camera = BenchCamera(bench.rig, bench.devices())
    camera.record(BLACK, [_shot()])
    camera.rest()
    assert bench.was_off
