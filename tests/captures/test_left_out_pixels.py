"""Pixels that a mask or a region of interest leaves out count nowhere, on the way through files and cuts too."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from holoview.bench.calibrate.exposure import ExposureLimits, plan_exposures
from holoview.bench.captures import Captures, read_captures, write_captures
from holoview.bench.captures.dataset import Camera, SlmSpec, join_captures
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.prepared_captures import prepare_captures
from holoview.bench.captures.records.trials import Trials, central_region, picture_window
from holoview.bench.captures.validation import capture_sheet, summarise
from holoview.bench.diagnose.correct.bad_captures import find_useless_captures
from holoview.util.errors import UserError

Make = Callable[..., Captures]


def _random_mask(captures: Captures, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).random(captures.images.shape) < 0.7


def test_a_mask_goes_through_files_subsets_and_joins(make_captures: Make, tmp_path: Path) -> None:
    plain = make_captures(4)
    usable = _random_mask(plain)
    masked = dataclasses.replace(plain, usable=usable)
    write_captures(tmp_path / "c.h5", masked)
    read = read_captures(tmp_path / "c.h5")
    assert read.usable is not None and np.array_equal(read.usable, usable)
    part = masked.subset([2, 0])
    assert part.usable is not None and np.array_equal(part.usable, usable[[2, 0]])
    joined = join_captures([part, plain.subset([1])])
    assert joined.usable is not None and np.array_equal(joined.usable[:2], usable[[2, 0]]) and joined.usable[2].all()
    write_captures(tmp_path / "p.h5", plain)  # a file without a mask has none
    assert read_captures(tmp_path / "p.h5").usable is None
    with h5py.File(tmp_path / "p.h5") as file:
        assert "mask" not in file["camera"]


def test_a_mask_of_all_pictures_and_a_region_add_up(make_captures: Make, tmp_path: Path) -> None:
    captures = make_captures(3)
    write_captures(tmp_path / "c.h5", captures)
    mask = _random_mask(captures)[0]
    with h5py.File(tmp_path / "c.h5", "a") as file:
        file["camera/mask"] = mask.astype(np.uint8) * 255
        file["camera"].attrs["roi"] = [3, 60, 5, 79]
    read = read_captures(tmp_path / "c.h5")
    region = np.zeros(captures.shape, bool)
    region[3:60, 5:79] = True
    assert read.usable is not None
    assert all(np.array_equal(one, mask & region) for one in read.usable)
    summary = summarise(read)["left_out"]
    assert summary["share"] == pytest.approx(1 - (mask & region).mean())
    assert (summary["rows"], summary["columns"]) == ([3, 60], [5, 79])
    assert not prepare_captures(read).usable[:, ~(mask & region)].any()
    assert capture_sheet(read).shape == capture_sheet(captures).shape


@pytest.mark.parametrize(
    ("mask", "roi", "said"),
    [
        (np.ones((5, 5), np.uint8), None, "an array of shape"),
        (np.zeros((64, 80), np.uint8), None, "leaves 0 pixels"),
        (None, [0, 65, 0, 80], "within the picture's 64 rows and 80 columns"),
        (None, [9, 9, 0, 80], "within the picture's"),
        (None, [0, 8], "four whole numbers"),
        (None, "all", "four whole numbers"),
    ],
)
def test_impossible_masks_are_refused(
    mask: np.ndarray | None, roi: object, said: str, make_captures: Make, tmp_path: Path
) -> None:
    write_captures(tmp_path / "c.h5", make_captures(3))
    with h5py.File(tmp_path / "c.h5", "a") as file:
        if mask is not None:
            file["camera/mask"] = mask
        if roi is not None:
            file["camera"].attrs["roi"] = roi
    with pytest.raises(UserError, match=said):
        read_captures(tmp_path / "c.h5")


def test_saturation_that_is_left_out_makes_no_capture_bad(make_captures: Make) -> None:
    captures = make_captures(6)
    images = captures.images.copy()
    images[2, 6:42, 6:74] = 4095
    usable = images < 4095
    masked = dataclasses.replace(captures, images=images, usable=usable)
    assert [bad.index for bad in find_useless_captures(dataclasses.replace(captures, images=images), {})] == [2]
    assert find_useless_captures(masked, {}) == ()
    assert summarise(masked)["saturated"]["worst"] == 0
    limits = ExposureLimits()
    bright = plan_exposures(masked, None, limits)[0].reached
    assert bright <= 0.9 * 4095  # what is left out needs no headroom
    assert "clipped" not in plan_exposures(masked, None, limits)[0].note


def test_what_is_left_out_does_not_change_the_check_of_records(make_captures: Make) -> None:
    """Whatever counts stand in the pixels that are left out, the contrasts that are compared are the same."""
    captures = make_captures(3)
    usable = np.ones(captures.images.shape, bool)
    usable[:, 20:40, 30:50] = False
    other = np.where(usable, captures.images, 4000).astype(np.uint16)
    trials = [Trials(dataclasses.replace(captures, images=i, usable=usable), {}) for i in (captures.images, other)]
    assert trials[0].coarseness(1) == trials[1].coarseness(1)


def _fourier(usable: np.ndarray | None = None) -> Captures:
    rng = np.random.default_rng(3)
    return Captures(
        levels=rng.integers(0, 256, (2, 1, 24, 32), dtype=np.uint8),
        images=rng.integers(10, 200, (2, 120, 150), dtype=np.uint16),
        wavelength_m=np.full(2, 532e-9),
        distance_m=np.zeros(2),
        power=np.ones(2),
        exposure_s=np.ones(2),
        slms=(SlmSpec(36e-6, 256, 532e-9),),
        camera=Camera(12e-6, 8, 8.0, 8.0, 2.0),
        focal_length_m=0.1,
        axis_m=(3.3e-5, -4.1e-5),
        usable=usable,
    )


EFFECTS: tuple[dict[str, dict[str, float]], ...] = (
    {},
    {"crosstalk": {"sigma": 0.4}},
    {"vignetting": {"fall_y": 0.3, "slope_x": 0.1}},
    {"camera_alignment": {"shift_x": 20e-6, "magnification": 1.01}},
)


def test_the_middle_of_a_far_field_is_where_pixels_count_and_is_predicted_there() -> None:
    """A window beside the middle is predicted as that part of the whole picture, with effects of modulator and camera.
    In float32, of 32 × 24 pixels' light: 1e-4 of the brightest (2⁻²⁴ · √768 · a few operations, and phases of up to
    100 rad)."""
    usable = np.zeros((2, 120, 150), bool)
    usable[:, 60:, 90:] = True
    whole = _fourier(usable)
    cut = central_region(whole, 10)
    assert cut.usable is not None and cut.usable.all()
    window = picture_window(whole, cut.shape)
    assert window[0].start >= 60 and window[1].start >= 90
    for effects in EFFECTS:
        signals = [Predictor(one)([0, 1], effects).signal.numpy() for one in (whole, cut)]
        assert np.abs(signals[1] - signals[0][:, *window]).max() < 1e-4 * signals[0].max()


def test_without_a_mask_the_middle_stays_the_middle() -> None:
    whole = _fourier()
    cut = central_region(whole, 10)
    assert cut.axis_m == whole.axis_m
    assert np.array_equal(whole.images[:, *picture_window(whole, cut.shape)], cut.images)
