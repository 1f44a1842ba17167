"""The middle of a large session is predicted like the whole, and mirrored records stay mirrored in it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from holoview.bench.captures import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.records import find_record_errors
from holoview.bench.captures.records.trials import central_captures, central_region, speckle_px
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.light.model.bench_parts import Relay
from tests.captures.conftest import pictures
from tests.captures.records.mistakes import late, spoiled, turn
from tests.captures.records.test_search import bench

SIDE_PX = 30
SHORT = {"gap": "0.3 mm", "planes": ["0.5 mm"]}


@pytest.fixture(scope="module")
def large() -> Captures:
    """A bench whose light walks off by few pixels beside its size."""
    system = bench(shape=(96, 112)).edit(SHORT)
    return make_captures(system, {}, AcquisitionSettings(captures_per_condition=4, seed=1))


def test_it_is_smaller_and_centred(large: Captures) -> None:
    part = central_region(large, SIDE_PX)
    assert part.levels.shape[2] < large.levels.shape[2] and part.levels.shape[3] < large.levels.shape[3]
    for turned in (turn("slm1", "rotate_180"), turn("images", "flip_x")):
        first, second = central_region(spoiled(large, turned), SIDE_PX), spoiled(part, turned)
        assert np.array_equal(first.levels, second.levels) and np.array_equal(first.images, second.images)


def test_its_pictures_are_those_of_the_whole(large: Captures) -> None:
    """Beside what a cut edge scatters beyond the geometrical walk-off."""
    part = central_region(large, SIDE_PX)
    seen = Predictor(part)([0]).signal[0].numpy()
    whole = Predictor(large)([0]).signal[0].numpy()
    y, x = ((n - m) // 2 for n, m in zip(whole.shape, seen.shape, strict=True))
    cut = whole[y : y + seen.shape[0], x : x + seen.shape[1]]
    assert np.corrcoef(seen.ravel(), cut.ravel())[0, 1] > 0.95


@pytest.mark.long
def test_a_mistake_is_found_in_it(large: Captures) -> None:
    found = find_record_errors(spoiled(large, turn("slm2", "flip_y")), region_px=SIDE_PX)
    assert [c.label for c in found.corrections] == ["slm2_orientation flip_y"]


def _far_field(focal_length_m: float) -> Captures:
    """Pictures of 64 × 80 pixels of 4 µm behind a lens and a modulator of 32 × 40 pixels of 8 µm."""
    plain = pictures(2)
    one = dataclasses.replace(plain, levels=plain.levels[:, :1], slms=plain.slms[:1], gap_m=None, relay1=Relay())
    return dataclasses.replace(one, focal_length_m=focal_length_m)


def test_a_small_session_is_taken_whole() -> None:
    plain = pictures()
    assert central_region(plain, 64) is plain
    coarse = _far_field(0.2)  # each speckle as large as the picture
    assert central_region(coarse, 8) is coarse


def test_a_far_field_is_cut_to_speckles() -> None:
    """λf/(n·p) = 600 nm · 5 mm/(32 · 8 µm) = 11.7 µm along y, 9.4 µm along x: 2.9 and 2.3 pixels."""
    far = _far_field(5e-3)
    assert speckle_px(far) == pytest.approx((600e-9 * 5e-3 / 256e-6 / 4e-6, 600e-9 * 5e-3 / 320e-6 / 4e-6))
    part = central_region(far, 8)
    assert part.shape == (24, 20) and part.frame == far.shape and part.levels is far.levels
    assert np.array_equal(part.images, far.images[:, 20:44, 30:50])
    assert central_region(far, 8, 4).shape == (48, 38)


@pytest.mark.parametrize(
    "effects",
    [
        {},
        {"crosstalk": {"sigma": 0.4}, "vignetting": {"fall_y": 0.3, "fall_x": 0.1}},
        {"camera_alignment": {"shift_y": 9e-6, "rotation": 0.02}},
        {"distance": {"distance_error": 1e-4}, "tilt": {"tilt_x": 1e-3}},
    ],
    ids=["nominal", "blurred paths and vignetting", "a turned camera", "defocus and tilt"],
)
def test_a_cut_far_field_is_predicted_exactly(effects: dict[str, dict[str, float]]) -> None:
    """To the rounding of f32 FFTs; a turned camera by interpolation of a grid of its own, four samples a speckle."""
    far = _far_field(5e-3)
    part = central_region(far, 8)
    whole, cut = (Predictor(one)([0], effects).signal[0].numpy() for one in (far, part))
    seen = whole[20:44, 30:50]
    accuracy = 0.03 if "camera_alignment" in effects else 1e-5
    assert np.abs(cut - seen).max() < accuracy * seen.max()


@pytest.mark.long
def test_of_a_long_session_the_middle_is_considered(large: Captures) -> None:
    assert central_captures(large, len(large)) is large
    middle = central_captures(large, 5)
    assert len(middle) in (5, 6) and (len(large) - len(middle)) % 2 == 0
    first = (len(large) - len(middle)) // 2
    assert np.array_equal(middle.images, large.images[first : first + len(middle)])
    wrong = spoiled(large, late(1, ("slm1", "slm2")))
    found = find_record_errors(wrong, most_captures=10)
    assert [c.label for c in found.corrections] == ["capture_order offset:+1"]
    assert len(found.corrected(wrong)) == len(large) - 1  # it isn't known whether the ends belong together
