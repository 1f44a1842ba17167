"""The middle of a large session is predicted like the whole, and mirrored records stay mirrored in it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from holoview.captures import Captures
from holoview.captures.predictor import Predictor
from holoview.captures.records import find_record_errors
from holoview.captures.records.central_region import central_captures, central_region
from holoview.captures.records.settings import DEFAULT
from holoview.captures.virtual_measurement import AcquisitionSettings, make_captures
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


def test_a_mistake_is_found_in_it(large: Captures) -> None:
    settings = dataclasses.replace(DEFAULT, region_px=SIDE_PX)
    found = find_record_errors(spoiled(large, turn("slm2", "flip_y")), settings=settings)
    assert [c.label for c in found.corrections] == ["slm2_orientation flip_y"]


def test_a_small_session_or_a_fourier_bench_is_taken_whole() -> None:
    plain = pictures()
    assert central_region(plain, 64) is plain
    fourier = dataclasses.replace(
        plain, levels=plain.levels[:, :1], slms=plain.slms[:1], gap_m=None, focal_length_m=0.2
    )
    assert central_region(fourier, 8) is fourier


def test_of_a_long_session_the_middle_is_considered(large: Captures) -> None:
    assert central_captures(large, len(large)) is large
    middle = central_captures(large, 5)
    assert len(middle) in (5, 6) and (len(large) - len(middle)) % 2 == 0
    first = (len(large) - len(middle)) // 2
    assert np.array_equal(middle.images, large.images[first : first + len(middle)])
    settings = dataclasses.replace(DEFAULT, most_captures=10)
    wrong = spoiled(large, late(1, ("slm1", "slm2")))
    found = find_record_errors(wrong, settings=settings)
    assert [c.label for c in found.corrections] == ["capture_order offset:+1"]
    assert len(found.corrected(wrong)) == len(large) - 1  # it isn't known whether the ends belong together
