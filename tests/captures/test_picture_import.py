"""One picture and its pattern become captures: the placement is found, what was assumed is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from benchmarks.plain_light import hologram_levels
from benchmarks.real_benches import draw, measure
from holoview.bench.captures.dataset import SHAPE_KEEPING, turned
from holoview.bench.captures.picture_geometry import find_placements, zero_order_mask
from holoview.bench.captures.picture_import import KnownBench, PictureAndPattern, import_pictures, overlay_sheet
from holoview.bench.captures.prepared_captures import prepare_captures
from holoview.bench.captures.unknown_settings import dark_noise
from holoview.util.errors import UserError
from tests.captures.far_field import CAMERA_PITCH_M, PITCH_M, WAVELENGTH_M, FarField, photograph, spread_pattern
from tests.explored import explored

KNOWN = KnownBench(WAVELENGTH_M, PITCH_M, CAMERA_PITCH_M, 0.25)
PATTERN = (48, 64)
BENCH = FarField(coma=-0.3, defocus=0.1)
SMALL = FarField(radius=20.0, coma=0, defocus=0, axis=(58.0, 82.0), shape=(120, 160))
"""Half as many pixels along a side, and in the disc, where no length and no noise is measured: a fourth of the time."""


@pytest.mark.long
@pytest.mark.parametrize("orientation", explored(SHAPE_KEEPING, ["flip_x"]))
def test_orientation_focal_length_and_axis_are_found(orientation: str) -> None:
    bench = FarField(coma=-0.5, defocus=0.2)
    pattern = spread_pattern(3)
    upright = photograph(pattern, bench, seed=4)
    taken = np.ascontiguousarray(turned(upright, orientation))
    found = import_pictures([PictureAndPattern(taken, pattern)], replace(KNOWN, focal_length_m=0.26))
    captures = found.captures
    assert found.placements[0].orientation == orientation
    # Scales are tried in steps of 0.6 %, and envelopes are binned by two pixels or so; speckle then moves the axis.
    assert captures.focal_length_m == pytest.approx(bench.focal_length_m, rel=0.01)
    axis = [a - (n - 1) / 2 for a, n in zip(bench.axis, bench.shape, strict=True)]
    assert np.array(captures.axis_m) / CAMERA_PITCH_M == pytest.approx(axis, abs=3.0)
    assert "electrons a count" in " ".join(found.notes)
    assert "a full turn" in " ".join(found.notes)


@pytest.mark.long
def test_the_saturated_zero_order_and_what_is_masked_are_left_out() -> None:
    pattern = spread_pattern(5, PATTERN)
    picture = photograph(pattern, SMALL, seed=6)
    usable = np.ones(picture.shape, bool)
    usable[:, 150:] = False
    found = import_pictures([PictureAndPattern(picture, pattern)], KNOWN, usable=usable)
    row, column = (round(a) for a in SMALL.axis)
    kept = found.captures.usable_pixels(0)
    assert not kept[row - 1 : row + 2, column - 1 : column + 2].any()
    assert not kept[:, 150:].any()
    assert kept[:, :150].mean() > 0.9  # the zero order is a spot
    assert (found.captures.images[0] == picture).all()  # nothing is painted over
    assert not prepare_captures(found.captures).usable[0][~kept].any()


@pytest.mark.long
def test_a_pattern_that_was_not_shown_is_refused() -> None:
    picture = photograph(spread_pattern(7, PATTERN), SMALL, seed=8)
    other = np.random.default_rng(9).integers(0, 256, PATTERN).astype(np.uint8)
    with pytest.raises(UserError, match="stands nowhere"):
        import_pictures([PictureAndPattern(picture, other)], KNOWN)


@pytest.mark.long
def test_in_a_small_picture_of_a_few_blobs_the_pattern_that_was_shown_stands_out_of_others(tmp_path: Path) -> None:
    """Others have blobs as well, which their placement lays onto those of the picture: grains alone tell them apart."""
    drawn = replace(draw(5, "none", "picture", 64), patterns="blobs")
    file = measure(drawn, tmp_path, 3)
    picture, shown = (np.asarray(Image.open(file.with_name(f"{drawn.name}{end}.png"))) for end in ("", "-mask"))
    bench, rng = drawn.bench, np.random.default_rng(11)
    assert bench.focal_length_m is not None
    scale = drawn.wavelengths_m[0] * bench.focal_length_m / (bench.pitch_m * bench.camera_pitch_m)
    found = []
    for pattern in (shown, *(hologram_levels(rng, bench.shape, "blobs") for _ in range(2))):
        speckle = find_placements(picture, pattern / 256, zero_order_mask(picture, 255), scale)[0].speckle
        assert speckle is not None
        found.append(speckle.significance)
    assert found[0] > 7 > max(found[1:])


def _shown(seeds: list[int], wrong: int | None = None, *, is_small: bool = False) -> list[PictureAndPattern]:
    """Pictures of one bench with their patterns; the pattern of the picture `wrong`, of a small bench, is another."""
    is_small = is_small or wrong is not None
    bench, shape = (replace(SMALL, coma=-0.3, defocus=0.1), PATTERN) if is_small else (BENCH, (96, 128))
    patterns = [spread_pattern(seed, shape) for seed in seeds]
    pictures = [photograph(pattern, bench, seed=seed + 100) for pattern, seed in zip(patterns, seeds, strict=True)]
    if wrong is not None:
        patterns[wrong] = spread_pattern(999, shape)
    pairs = enumerate(zip(pictures, patterns, strict=True))
    return [PictureAndPattern(a, b, f"seen{k}.png", f"mask{k}.png") for k, (a, b) in pairs]


@pytest.mark.long
def test_several_pictures_have_one_geometry() -> None:
    found = import_pictures(_shown([11, 12, 13]), replace(KNOWN, focal_length_m=0.26))
    captures = found.captures
    assert captures.focal_length_m == pytest.approx(BENCH.focal_length_m, rel=0.01)
    axis = [a - (n - 1) / 2 for a, n in zip(BENCH.axis, BENCH.shape, strict=True)]
    assert np.array(captures.axis_m) / CAMERA_PITCH_M == pytest.approx(axis, abs=3.0)  # as of one picture
    assert len(captures) == 3
    assert "in each of 3 pictures" in " ".join(found.notes)
    sheet = overlay_sheet(found)
    assert sheet.shape[2] == 3
    # The predicted picture is green over the measured red: where speckle agrees, both are bright.
    assert sheet.shape[0] > 3 * 300


@pytest.mark.long
@pytest.mark.parametrize("wrong", [0, 2])
def test_the_one_pattern_of_several_that_was_not_shown_is_named(wrong: int) -> None:
    with pytest.raises(UserError, match=rf"seen{wrong}\.png.*mask{wrong}\.png stands nowhere"):
        import_pictures(_shown([11, 12, 13], wrong), KNOWN)


@pytest.mark.long
def test_the_camera_is_estimated_where_nobody_states_it() -> None:
    """The bench has 8 electrons a count and a read noise of one count. 10⁵ pixels tell the gain to 7 % or so, as the
    estimate says itself; speckle that differs within windows adds up to a sixth (measured, 9 pictures)."""
    found = import_pictures(_shown([11, 12]), KNOWN).captures
    assert found.camera.electrons_per_count == pytest.approx(8, rel=0.35)
    assert found.camera.read_noise / found.camera.electrons_per_count == pytest.approx(1.0, abs=0.3)
    assert sum("electrons a count" in sentence for sentence in found.estimated) == 1
    assert any("brightness" in sentence for sentence in found.estimated)
    stated = replace(KNOWN, bit_depth=8, electrons_per_count=8.0, read_noise=8.0, black_level=2.0)
    shown = [replace(one, power=2.0, exposure_s=0.1) for one in _shown([11, 12], is_small=True)]
    known = import_pictures(shown, stated).captures
    assert len(known.estimated) == 1 and known.estimated[0].startswith("focal length and axis")
    assert known.camera.electrons_per_count == 8.0
    assert known.exposure_s.tolist() == [0.1, 0.1]


def test_a_picture_that_shows_a_corner_of_the_far_field_is_refused() -> None:
    picture = photograph(spread_pattern(7), FarField(), seed=8)[:64, :64]
    with pytest.raises(UserError, match="pixels of a far field"):
        import_pictures([PictureAndPattern(picture, spread_pattern(7))], replace(KNOWN, focal_length_m=0.5))


def test_pictures_of_several_shapes_are_refused() -> None:
    shown = _shown([11, 12])
    shown[1] = replace(shown[1], picture=shown[1].picture[:-4])
    with pytest.raises(UserError, match=r"seen1\.png.*as the first"):
        import_pictures(shown, KNOWN)


@pytest.mark.parametrize(
    ("picture", "pattern", "said"),
    [
        (np.zeros((80, 80), np.uint8), spread_pattern(1), "at most 0 counts"),
        (np.full((80, 80), 99, np.uint8), np.full((32, 32), 7, np.uint8), "level 7 everywhere"),
        (np.full((20, 80), 99, np.uint8), spread_pattern(1), "at least 64 pixels"),
    ],
)
def test_pictures_that_cant_be_placed_are_refused(picture: np.ndarray, pattern: np.ndarray, said: str) -> None:
    with pytest.raises(UserError, match=said):
        import_pictures([PictureAndPattern(picture, pattern)], replace(KNOWN, focal_length_m=None))


def test_the_noise_of_dark_pixels_is_measured() -> None:
    """3 × 10⁴ pairs of the darkest tenth; choosing the darkest by their means leaves their differences as they are."""
    light = 20 + np.random.default_rng(2).normal(0, 3, (550, 550))
    assert dark_noise(np.round(light).astype(np.uint16)) == pytest.approx(3, rel=0.05)
