"""A target seen through a pupil: discs of its NA, moved by its decentre, each wavelength in focus where it is."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from holoview.holograms.targets.defocus import LightCone
from holoview.holograms.targets.focal_stack import render_focal_stack
from holoview.holograms.targets.light_field import ViewingPupil, colour_shares, render_through_pupil
from holoview.holograms.targets.picture import Picture
from holoview.holograms.targets.target import Placement, target_for
from holoview.light.colour import xyz_to_linear_srgb
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System

Bench = Callable[..., System]

SHAPE = (48, 64)
FLOAT32 = 1e-5  # sums over eight wavelengths of float32 transforms


def laser_rgb(system: System) -> NDArray[np.float64]:
    return np.asarray(xyz_to_linear_srgb(make_plan(system).colour_weights))


def point(row: int, column: int) -> NDArray[np.float32]:
    picture = np.zeros((*SHAPE, 3), dtype=np.float32)
    picture[row, column] = 1
    return picture


def test_a_target_seen_through_a_pupil_is_the_disc_of_its_na(bench: Bench) -> None:
    system = bench(3, SHAPE)
    pupil = ViewingPupil(0.05, centre=(0.02, -0.04))
    target = target_for(system, Picture(point(24, 32), "point"), Placement(at_m=9e-3), pupil=pupil)
    pitch_m = make_plan(system).grid.pitch_m
    y, x = np.indices(SHAPE)
    for image, plane_m in zip(target.stack[..., 1], system.planes_m, strict=True):
        distance_m = plane_m - 9e-3
        light = image.sum()
        radius = max(0.05 * distance_m / pitch_m, 0.5)
        middle = [(image * k).sum() / light for k in (y, x)]
        expected = [24 + 0.02 * distance_m / pitch_m, 32 - 0.04 * distance_m / pitch_m]
        assert middle == pytest.approx(expected, abs=1 / (8 * radius))  # see test_defocus
        area = np.count_nonzero(image > light / (2 * math.pi * radius**2))
        assert area == pytest.approx(math.pi * radius**2, abs=2 * math.pi * radius + 1), "within a pixel of its rim"


def test_without_a_pupil_the_first_order_blurs(bench: Bench) -> None:
    system = bench(2, SHAPE)
    picture = Picture(point(24, 32), "point")
    plain, pupil = target_for(system, picture), target_for(system, picture, pupil=ViewingPupil(0.01))
    assert plain.stack[0].max() < pupil.stack[0].max()


def test_shares_of_colours_add_up_to_the_colour_whatever_the_lasers_mix(bench: Bench) -> None:
    rgb = laser_rgb(bench(2))
    for lasers in (rgb, rgb[:3], rgb[[1, 6]], rgb[4:5]):
        shares = colour_shares(lasers)
        assert shares.sum(axis=0) == pytest.approx(np.eye(3), abs=1e-9)
    own = colour_shares(rgb) @ rgb[5]
    intensities = np.einsum("wc,wc->w", own, rgb) / np.einsum("wc,wc->w", rgb, rgb)
    assert own == pytest.approx(intensities[:, None] * rgb, abs=1e-9), "each share has the colour of its laser"


def test_equal_foci_of_all_wavelengths_change_nothing(bench: Bench) -> None:
    system, planes_m = bench(2), np.array([9e-3, 9.5e-3])
    picture = np.random.default_rng(0).random((*SHAPE, 3), dtype=np.float32)
    depth_m = 9e-3 + 0.5e-3 * np.random.default_rng(1).integers(0, 2, SHAPE)
    focus_m = np.repeat(planes_m[:, None], len(system.wavelengths_m), axis=1)
    seen = render_through_pupil(
        picture, depth_m, planes_m, 4e-6, ViewingPupil(0.03, (0.01, 0.0), focus_m), laser_rgb(system)
    )
    plain = render_focal_stack(picture, depth_m, planes_m, 4e-6, LightCone(0.03, "disc", (0.01, 0.0)))
    assert seen == pytest.approx(plain, abs=FLOAT32)


def test_a_wavelength_that_is_focused_elsewhere_is_blurred_there(bench: Bench) -> None:
    """White light of three lasers, of which the last is 0.4 mm out of focus: it alone is a disc, moved by Δz·c."""
    lasers = laser_rgb(bench(1))[[0, 4, 7]]
    na, slope, pitch_m, error_m = 0.05, 0.03, 4e-6, 0.4e-3
    focus_m = np.array([[9e-3, 9e-3, 9e-3 + error_m]])
    pupil = ViewingPupil(na, (0.0, slope), focus_m)
    seen = render_through_pupil(point(24, 32), 9e-3, [9e-3], pitch_m, pupil, lasers)[0]
    amounts = seen @ np.linalg.inv(lasers)
    whole = np.linalg.solve(lasers.T, np.ones(3))
    for laser in (0, 1):
        assert amounts[24, 32, laser] == pytest.approx(whole[laser], rel=1e-4)
    blurred = amounts[..., 2] / whole[2]
    x = np.arange(SHAPE[1])
    assert (blurred.sum(axis=0) * x).sum() == pytest.approx(32 + slope * error_m / pitch_m, abs=0.05)
    radius = na * error_m / pitch_m
    assert blurred[24, 35] == pytest.approx(1 / (math.pi * radius**2), rel=1e-3)


@pytest.mark.parametrize(
    "change",
    [
        {"na": 0.0},
        {"na": math.nan},
        {"na": 0.1, "centre": (0.0, 1.2)},
        {"na": 0.1, "focus_m": np.zeros(3)},
        {"na": 0.1, "focus_m": np.full((1, 8), math.nan)},
    ],
)
def test_pupils_that_make_no_sense_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="expected"):
        ViewingPupil(**change)  # type: ignore[arg-type]


def test_foci_of_other_planes_are_refused(bench: Bench) -> None:
    pupil = ViewingPupil(0.1, focus_m=np.full((2, 3), 9e-3))
    with pytest.raises(ValueError, match=r"expected \(plane, wavelength\) = \(3, 8\)"):
        target_for(bench(3, SHAPE), Picture(point(3, 3), "point"), pupil=pupil)


def test_the_eye_of_a_system_sees_its_target(bench: Bench) -> None:
    eye = {"eyepiece": "40 mm", "pupil": "3 mm", "pupil_x": "0.8 mm", "pupil_y": "-0.4 mm", "accommodation": [0.2, 0.9]}
    system, picture = bench(3, SHAPE).with_(eye=eye), Picture(point(24, 32), "point")
    assert system.eye is not None
    planes_m = 9e-3 + 0.04**2 * np.array([0.2, 0.9])
    focus_m = planes_m[:, None] + system.eye.focus_shift_m(system.wavelengths_m)
    expected = target_for(system, picture, pupil=ViewingPupil(0.0375, (-0.01, 0.02), focus_m), planes=planes_m.tolist())
    found = target_for(system, picture)
    assert found.planes_m == pytest.approx(planes_m.tolist(), rel=1e-12)
    assert np.abs(found.stack - expected.stack).max() <= FLOAT32


@pytest.mark.parametrize("axis", ["eyepiece", "pupil"])
def test_colours_separate_beside_the_axis_unless_the_eye_moves_as_a_whole(bench: Bench, axis: str) -> None:
    """A point at 9 mm, seen from x = 1 mm through 40 mm, focused 1 dioptre nearer: a slope of 0.025 over z − 9 mm."""
    system = bench(1, SHAPE).with_(
        wavelengths=["460 nm"],
        amplitudes=[[1.0]],
        eye={"pupil": "1 mm", "pupil_x": "1 mm", "accommodation": [1.0], "chromatic_axis": axis},
    )
    assert system.eye is not None
    image = target_for(system, Picture(point(24, 20), "point"), Placement(at_m=9e-3)).stack[0].sum(axis=-1)
    distance_m = 1.6e-3 + (float(system.eye.focus_shift_m(system.wavelengths_m)[0]) if axis == "eyepiece" else 0.0)
    middle = (image.sum(axis=0) @ np.arange(SHAPE[1])) / image.sum()
    assert middle == pytest.approx(20 + 0.025 * distance_m / make_plan(system).grid.pitch_m, abs=0.1)
