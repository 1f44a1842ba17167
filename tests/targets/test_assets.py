"""The demonstration pictures are what their README says, and the defocus model agrees with a real lens."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from holoview.holograms.targets.defocus import LightCone, diffraction_half_angle
from holoview.holograms.targets.focal_stack import render_focal_stack
from holoview.holograms.targets.picture import read_depth, read_picture
from holoview.util.files import data_dir
from tests.targets.conftest import read_stack

ASSETS = data_dir("assets")
SHAPE = (768, 1024)
BLUR_PX = 18  # half-width from the first plane to the last, as rendered
PITCH_M = 4e-6
# Measured 39.4 41.3 43.3 43.3 41.9 dB, from the farthest plane to the nearest; 0.3 dB is left for other FFTs. What
# differs: reflections, which a depth map can't place, and the guessed colours behind near things, most on the farthest
# plane, where near objects are blurred most.
BOUNDS_DB = (39.0, 41.0, 43.0, 43.0, 41.6)


@pytest.fixture(scope="module")
def lens_stack() -> NDArray[np.float32]:
    return read_stack(ASSETS / "still-life-stack", SHAPE)


@pytest.fixture(scope="module")
def model_stack() -> NDArray[np.float32]:
    cone = LightCone(math.tan(diffraction_half_angle(550e-9, 8e-6)))
    span_m = BLUR_PX * PITCH_M / cone.half_width
    depth_m = 9e-3 + (1 - read_depth(ASSETS / "still-life-depth.png")) * span_m
    picture = read_picture(ASSETS / "still-life.png").rgb
    return render_focal_stack(picture, depth_m, 9e-3 + np.linspace(0, 1, 5) * span_m, PITCH_M, cone)


def psnr(found: NDArray[np.float32], truth: NDArray[np.float32]) -> NDArray[np.float64]:
    """Of linear light, per plane, against white = 1."""
    error = np.mean((found.astype(np.float64) - truth) ** 2, axis=(1, 2, 3))
    return np.asarray(-10 * np.log10(error))


@pytest.mark.long
def test_every_picture_has_the_size_that_the_readme_says() -> None:
    for name in ("still-life.png", "resolution.png"):
        picture = read_picture(ASSETS / name)
        assert picture.rgb.shape == (*SHAPE, 3) and picture.notes == ()
    assert read_depth(ASSETS / "still-life-depth.png").shape == SHAPE
    assert len(list((ASSETS / "still-life-stack").iterdir())) == 5


def test_all_pictures_together_stay_small() -> None:
    assert sum(file.stat().st_size for file in ASSETS.rglob("*.png")) <= 4_000_000


def test_the_still_life_reaches_from_near_to_far_and_is_nowhere_black() -> None:
    depth = read_depth(ASSETS / "still-life-depth.png")
    assert depth.min() < 0.01 and depth.max() == 1
    light = read_picture(ASSETS / "still-life.png").rgb
    assert light.max(axis=-1).min() > 0
    background = light[depth == 1].max(axis=-1)
    assert background.min() > 0.02 and np.median(background) > 0.1


def test_the_still_life_holds_saturated_colours_beside_greys() -> None:
    light = read_picture(ASSETS / "still-life.png").rgb.reshape(-1, 3)
    saturation = 1 - light.min(axis=1) / light.max(axis=1)
    strongest = light[saturation > 0.85].argmax(axis=1)
    assert np.bincount(strongest, minlength=3).min() > 0.003 * len(light)
    assert np.mean(saturation < 0.1) > 0.05


def test_the_chart_holds_the_primaries_white_and_black() -> None:
    chart = read_picture(ASSETS / "resolution.png").rgb
    assert chart[72, [72, 152, 232]].tolist() == [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert chart.min() == 0 and chart.max() == 1


@pytest.mark.explores
def test_the_model_agrees_with_the_lens(model_stack: NDArray[np.float32], lens_stack: NDArray[np.float32]) -> None:
    found = psnr(model_stack, lens_stack)
    assert (found > BOUNDS_DB).all(), found


def test_the_model_is_far_nearer_to_the_lens_than_no_defocus_at_all(
    model_stack: NDArray[np.float32], lens_stack: NDArray[np.float32]
) -> None:
    sharp = np.broadcast_to(read_picture(ASSETS / "still-life.png").rgb, lens_stack.shape)
    assert (psnr(model_stack, lens_stack) - psnr(sharp, lens_stack) > 10).all()
