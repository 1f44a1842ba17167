"""A picture with depth is sharp where it belongs, blurred elsewhere, and near things hide far ones.

The viewer looks against the light: near is at the larger distance z behind the last modulator.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from holoview.targets.defocus import Aperture, LightCone, blur_kernel
from holoview.targets.focal_stack import Target, render_focal_stack
from holoview.util.errors import UserError

PITCH = 4e-6
SLOPE = 0.02
PER_PIXEL = PITCH / SLOPE  # metres of defocus that widen a blur's half-width by a pixel
FLOAT32_FFT = 3e-6


def stack(
    picture: NDArray[np.float32],
    depth: float | NDArray[np.floating],
    planes: list[float],
    aperture: Aperture = "square",
) -> NDArray[np.float32]:
    """`render_focal_stack` with distances from the viewer in pixels of blur: larger ones are farther, at smaller z."""
    at = [10e-3 - p * PER_PIXEL for p in planes]
    cone = LightCone(SLOPE, aperture)
    return render_focal_stack(picture, 10e-3 - np.asarray(depth) * PER_PIXEL, at, PITCH, cone)


def colour(red: float, green: float, blue: float) -> NDArray[np.float32]:
    return np.array([red, green, blue], dtype=np.float32)


def worst(found: NDArray[np.floating], expected: NDArray[np.floating] | float) -> float:
    """The largest difference."""
    return float(np.abs(found - expected).max())


def scene(seed: int = 0, shape: tuple[int, int] = (60, 80)) -> NDArray[np.float32]:
    return np.random.default_rng(seed).random((*shape, 3), dtype=np.float32)


@pytest.mark.parametrize("aperture", ["square", "disc"])
def test_a_point_out_of_focus_is_the_aperture_with_all_its_light(aperture: Aperture) -> None:
    point = np.zeros((61, 61, 3), dtype=np.float32)
    point[30, 30] = 0.5, 1, 2
    planes = stack(point, 0.0, [-8.25, 0, 3.5], aperture)
    for image, radius in zip(planes, (8.25, 0, 3.5), strict=True):
        reach = math.ceil(radius - 0.5) if radius else 0
        part = image[30 - reach : 31 + reach, 30 - reach : 31 + reach, 1]
        assert part == pytest.approx(blur_kernel(radius, aperture), abs=FLOAT32_FFT)
        assert image.sum(axis=(0, 1)) == pytest.approx([0.5, 1, 2], rel=1e-4)


def test_the_picture_in_focus_is_unchanged() -> None:
    picture = scene()
    assert (stack(picture, 3.0, [0, 3])[1] == picture).all()


def test_one_depth_and_an_even_depth_map_agree() -> None:
    picture = scene()
    single, mapped = stack(picture, 2.0, [0, 5]), stack(picture, np.full((60, 80), 2.0), [0, 5])
    assert (single == mapped).all()


@pytest.mark.parametrize("aperture", ["square", "disc"])
@pytest.mark.parametrize("kind", ["one depth", "ramp", "steps", "noise"])
def test_an_even_picture_stays_even_up_to_the_borders_whatever_its_depth(aperture: Aperture, kind: str) -> None:
    rows, columns = np.indices((60, 80))
    depth = {
        "one depth": np.asarray(4.0),
        "ramp": columns / 79 * 12,
        "steps": np.where((rows - 30) ** 2 + (columns - 50) ** 2 < 200, 0.0, 12.0),
        "noise": np.random.default_rng(3).random((60, 80)) * 12,
    }[kind]
    even = np.full((60, 80, 3), (0.2, 0.7, 1.5), dtype=np.float32)
    result = stack(even, depth, [0, 3, 6, 12], aperture)
    assert worst(result / even, 1) < 1e-5  # rounding of float32 FFTs, layer by layer


def test_a_near_edge_in_focus_is_sharp_and_the_far_one_shows_to_its_rim() -> None:
    near, far = colour(1, 0, 0), colour(0, 0, 1)
    left = np.arange(80) < 40
    picture = np.broadcast_to(np.where(left[:, None], near, far), (60, 80, 3)).astype(np.float32)
    depth = np.broadcast_to(np.where(left, 0.0, 10.0), (60, 80))
    result = stack(picture, depth, [0.0])[0]
    assert worst(result, picture) < 1e-5, "no dark halo, and the even far side is even up to the edge"


def test_a_near_edge_out_of_focus_is_a_linear_veil_over_the_sharp_far_side() -> None:
    left = np.arange(80) < 40
    near, far = colour(1, 0, 0), colour(0, 0, 1)
    picture = np.broadcast_to(np.where(left[:, None], near, far), (60, 80, 3)).astype(np.float32)
    result = stack(picture, np.broadcast_to(np.where(left, 0.0, 10.5), (60, 80)), [10.5])[0, 30]
    veil = np.clip((39.5 + 10.5 - np.arange(80)) / 21, 0, 1)  # share of a 21 pixel wide square on the near side
    assert result[:, 0] == pytest.approx(veil, abs=1e-5)
    assert result[:, 2] == pytest.approx(1 - veil, abs=1e-5)


def test_the_nearer_layer_hides_the_farther_one() -> None:
    spot = np.zeros((60, 80), dtype=bool)
    spot[20:40, 30:50] = True
    picture = np.where(spot[..., None], colour(0, 0.5, 0), colour(1, 1, 1)).astype(np.float32)
    hides = stack(picture, np.where(spot, 0.0, 8.0), [0.0])[0]
    assert hides[30, 40] == pytest.approx([0, 0.5, 0], abs=1e-5)
    assert worst(hides[22:38, 32:48], picture[22:38, 32:48]) < 1e-5, "no white from behind leaks in"


def test_a_near_disc_at_the_larger_distance_hides_a_bright_wall_and_never_the_other_way() -> None:
    """An opaque black disc at z = 11 mm before a white wall at 10 mm, 5 pixels of blur apart, in metres throughout."""
    wall_m, disc_m, slope, radius = 10e-3, 11e-3, 0.02, 15
    y, x = np.indices((81, 81)) - 40
    disc = np.hypot(y, x) < radius
    picture = np.repeat(np.where(disc, 0, 1)[..., None], 3, axis=2).astype(np.float32)
    cone = LightCone(slope, "disc")
    at_wall, at_disc = render_focal_stack(picture, np.where(disc, disc_m, wall_m), [wall_m, disc_m], PITCH, cone)
    assert worst(at_disc, picture) < 1e-5, "the edge is sharp, and the wall, even, ends sharply behind it"
    edge = at_wall[40, 40:, 1]
    blur = (disc_m - wall_m) * slope / PITCH
    assert edge[: int(radius - blur)].max() < 1e-5 and edge[int(radius + blur) + 2 :].min() > 1 - 1e-5
    assert 0.05 < edge[radius + 2] < 0.95 and 0.05 < edge[radius - 2] < 0.95, "the disc's blur veils the sharp wall"
    wrong = render_focal_stack(picture, np.where(disc, wall_m, disc_m), [disc_m], PITCH, cone)[0]
    assert worst(wrong[40, 40:, 1], picture[40, 40:, 1]) < 1e-5, (
        "farther than the wall it is a hole: the wall stays sharp"
    )


def test_the_blurred_wall_lies_behind_the_sharp_near_disc_and_not_over_it() -> None:
    y, x = np.indices((81, 81)) - 40
    disc = np.hypot(y, x) < 15
    stripes = np.repeat((x // 2 % 2)[..., None], 3, axis=2)
    picture = np.where(disc[..., None], colour(0.9, 0.1, 0.1), stripes).astype(np.float32)
    at_disc = stack(picture, np.where(disc, 0.0, 9.0), [0.0])[0]
    assert worst(at_disc[disc], picture[disc]) < 1e-5, "no stripe reaches over the disc"
    outside = np.hypot(y, x)[40] > 26
    assert worst(at_disc[40, outside, 1][9:-9], 0.5) < 0.06, "stripes of 4 pixels, blurred over 18, are grey"


def test_near_things_move_against_the_eye() -> None:
    """From a pupil that moves to +x, with focus between both, a near thing goes to −x by Δz·c and a far one to +x."""
    slope, far_m, near_m, focus_m = 0.02, 10e-3, 11e-3, 10.4e-3
    picture = np.zeros((41, 121, 3), dtype=np.float32)
    picture[20, 30], picture[20, 90] = 1, 1
    depth_m = np.broadcast_to(np.where(np.arange(121) < 60, near_m, far_m), (41, 121))
    cone = LightCone(0.0, "disc", centre=(0.0, slope))
    seen = render_focal_stack(picture, depth_m, [focus_m], PITCH, cone)[0, 20, :, 1]
    assert int(seen[:60].argmax()) == 30 + round((focus_m - near_m) * slope / PITCH) == 27
    assert int(seen[60:].argmax()) + 60 == 90 + round((focus_m - far_m) * slope / PITCH) == 92


def test_an_even_picture_stays_even_for_a_pupil_off_the_axis() -> None:
    even = np.full((30, 40, 3), (0.2, 0.7, 1.5), dtype=np.float32)
    depth_m = 10e-3 + np.broadcast_to(np.linspace(0, 2e-3, 40), (30, 40))
    result = render_focal_stack(even, depth_m, [10e-3, 12e-3], PITCH, LightCone(0.01, "disc", (-0.02, 0.03)))
    assert result.shape == (2, 30, 40, 3) and worst(result / even, 1) < 1e-5


def test_a_hole_shows_the_far_side_blurred_and_undarkened() -> None:
    hole = np.zeros((60, 80), dtype=bool)
    hole[24:36, 34:46] = True
    picture = np.where(hole[..., None], colour(0, 0, 1), colour(0.5, 0.5, 0.5)).astype(np.float32)
    result = stack(picture, np.where(hole, 8.0, 0.0), [0.0, 8.0])
    assert worst(result[0], picture) < 1e-5
    assert result[1].sum(axis=-1).min() > 0.99, "both sides together stay at least as bright as the darker one (1.0)"


def test_a_slanted_surface_has_no_seams() -> None:
    grey = np.full((60, 200, 3), 0.5, dtype=np.float32)
    result = stack(grey, np.broadcast_to(np.linspace(0, 20, 200), (60, 200)), [0, 10, 20])
    assert np.ptp(result) < 1e-4


def test_a_slanted_surface_is_sharp_only_where_it_crosses_the_plane() -> None:
    stripes = np.broadcast_to((np.arange(240) // 2 % 2)[None, :, None], (60, 240, 3)).astype(np.float32)
    depth = np.broadcast_to(np.linspace(0, 24, 240), (60, 240))
    contrast = stack(stripes, depth, [12.0])[0, 30, :, 1].reshape(24, 10).std(axis=1)
    assert contrast[11:13].min() > 0.45  # unblurred: 0.5
    assert contrast[:8].max() < 0.15 and contrast[16:].max() < 0.15


def test_more_layers_than_depths_change_nothing() -> None:
    picture = scene(4)
    depth = np.where(np.indices((60, 80))[1] < 33, 0.0, 7.0) * PER_PIXEL
    few, many = (render_focal_stack(picture, depth, [0.0], PITCH, LightCone(SLOPE), layers=n) for n in (2, 24))
    assert (few == many).all()


def test_brighter_than_white_stays_so() -> None:
    assert stack(np.full((20, 20, 3), 7.0, dtype=np.float32), 0.0, [5.0]) == pytest.approx(np.full((1, 20, 20, 3), 7.0))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rgb_linear": np.zeros((4, 4), np.float32)}, "expected \\(y, x, 3\\)"),
        ({"depth_m": np.zeros((4, 5))}, "depth \\(4, 5\\)"),
        ({"depth_m": math.nan}, "finite distances"),
        ({"planes_m": []}, "at least one plane"),
        ({"planes_m": [math.inf]}, "finite distances"),
        ({"pitch_m": 0.0}, "pitch"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(change: dict[str, object], words: str) -> None:
    good = {"rgb_linear": np.zeros((4, 4, 3), np.float32), "depth_m": 0.0, "planes_m": [0.0]}
    with pytest.raises(ValueError, match=words):
        render_focal_stack(**{**good, "pitch_m": PITCH, "cone": LightCone(SLOPE), **change})  # type: ignore[arg-type]


def test_a_target_holds_the_stack_at_its_brightness() -> None:
    target = Target.from_stack(np.full((2, 3, 4, 3), 0.5, np.float32), [9e-3, 11e-3], "grey", brightness=0.25)
    assert (target.stack == 0.125).all() and target.stack.dtype == np.float32
    assert target.planes_m == (9e-3, 11e-3) and target.brightness == 0.25 and target.source == "grey"


def test_a_target_needs_a_picture_for_each_plane() -> None:
    with pytest.raises(UserError, match="folder: has 2 pictures; expected one for each of the 3 planes"):
        Target.from_stack(np.zeros((2, 3, 4, 3), np.float32), [1.0, 2.0, 3.0], "folder")
    with pytest.raises(ValueError, match=r"expected \(plane, y, x, 3\)"):
        Target.from_stack(np.zeros((3, 4, 3), np.float32), [1.0], "flat")


@pytest.mark.parametrize("brightness", [0.0, -1.0, math.nan, math.inf])
def test_a_target_needs_light(brightness: float) -> None:
    with pytest.raises(UserError, match=r"brightness: .*; expected a positive number; 1 changes nothing"):
        Target.from_stack(np.zeros((1, 3, 4, 3), np.float32), [1.0], "dark", brightness)
