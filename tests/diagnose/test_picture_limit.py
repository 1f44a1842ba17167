"""What is too large for the memory is cut to its middle, with a note, or refused with the numbers."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from holoview.bench.captures import Captures
from holoview.bench.captures.predictor import PLAIN, SamplingConfig
from holoview.bench.diagnose.config import RegionConfig
from holoview.bench.diagnose.crop import grid_samples, within_limits
from holoview.light.model.bench_parts import Relay
from holoview.util.errors import UserError
from tests.captures.conftest import pictures

SMALLEST = RegionConfig(side_px=4)


def _near(distance_m: float = 1e-4) -> Captures:
    """64 × 80 pixels of 4 µm behind modulators of 32 × 40 pixels of 8 µm."""
    return pictures(2, gap_m=distance_m, distance_m=np.full(2, distance_m))


def _far() -> Captures:
    plain = pictures(2)
    one = dataclasses.replace(plain, levels=plain.levels[:, :1], slms=plain.slms[:1], gap_m=None, relay1=Relay())
    return dataclasses.replace(one, focal_length_m=5e-3)


@pytest.mark.parametrize("captures", [_near(), _far()], ids=["near", "far"])
def test_what_is_small_is_taken_whole(captures: Captures) -> None:
    config = RegionConfig(max_picture_pixels=64 * 80, max_grid_samples=grid_samples(captures, PLAIN))
    assert within_limits(captures, PLAIN, config) == (captures, [])


@pytest.mark.parametrize("captures", [_near(), _far()], ids=["near", "far"])
def test_pictures_of_too_many_pixels_are_cut_to_their_middle(captures: Captures) -> None:
    config = dataclasses.replace(SMALLEST, max_picture_pixels=3000)
    cut, (note,) = within_limits(captures, PLAIN, config)
    assert 2400 < math.prod(cut.shape) <= 3000 and cut.frame == (64, 80)
    rows, columns = ((n - kept) // 2 for n, kept in zip((64, 80), cut.shape, strict=True))
    assert np.array_equal(cut.images, captures.images[:, rows : 64 - rows, columns : 80 - columns])
    assert "{1} × {0} of 80 × 64 camera pixels".format(*cut.shape) in note
    assert cut.images.base is None  # the whole ones needn't stay in memory


def test_modulators_whose_fields_are_too_large_are_cut() -> None:
    """Two samples a pixel, twice the size: 16 times the pixels; with finer samples four times as many."""
    captures = _near()
    assert grid_samples(captures, PLAIN) == 16 * 32 * 40
    assert grid_samples(captures, SamplingConfig(finer=2)) == 64 * 32 * 40
    config = dataclasses.replace(SMALLEST, max_grid_samples=12_000)
    cut, notes = within_limits(captures, PLAIN, config)
    assert len(notes) == 1 and grid_samples(cut, PLAIN) <= 12_000 and cut.slm_frame == (32, 40)


def test_what_cant_be_cut_far_enough_is_refused_with_the_numbers() -> None:
    """Light walks off over 19 pixels of 8 µm, more than half of the modulator."""
    with pytest.raises(UserError, match=r"a light field takes .* GB of memory, even with 40 x 32 pixels"):
        within_limits(_near(4e-3), PLAIN, dataclasses.replace(SMALLEST, max_grid_samples=10_000))
