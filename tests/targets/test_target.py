"""A bench and a picture become the focal stack that is optimised for."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image

from holoview.holograms.targets.picture import Picture, scale_saturation
from holoview.holograms.targets.target import Placement, target_for
from holoview.light.colour import SRGB_TO_XYZ
from holoview.light.model.system import System
from holoview.util.errors import UserError

Bench = Callable[..., System]

SHAPE = (40, 60)
FFT = 2e-5  # blurring in float32: some 1e-6 of the brightest light a kernel reaches, over small coverages at edges


@pytest.fixture
def scene(tmp_path: Path) -> tuple[Picture, Placement]:
    """A colourful picture with a near disc before a slanted far wall."""
    random = np.random.default_rng(7)
    rgb = np.kron(random.random((10, 15, 3)), np.ones((4, 4, 1))).astype(np.float32)
    y, x = np.indices(SHAPE)
    depth = np.where((y - 18) ** 2 + (x - 25) ** 2 < 100, 0.1, 0.5 + 0.5 * x / SHAPE[1])
    np.save(tmp_path / "depth.npy", depth)
    return Picture(rgb, "scene"), Placement(depth=tmp_path / "depth.npy")


def test_a_picture_without_depth_is_sharp_on_the_middle_plane(bench: Bench, scene: Any) -> None:
    system = bench(5, SHAPE)
    target = target_for(system, scene[0])
    assert target.planes_m == tuple(system.planes_m) and target.stack.shape == (5, *SHAPE, 3)
    assert target.stack[2] == pytest.approx(scene[0].rgb, abs=FFT)
    contrast = target.stack.std(axis=(1, 2, 3))
    assert contrast.argmax() == 2 and contrast[0] == pytest.approx(contrast[4], rel=1e-4)


def test_black_in_a_depth_map_is_near_and_stands_at_the_largest_plane(bench: Bench, tmp_path: Path) -> None:
    """The left half, code 0, is sharp at 10 mm, the right half, code 1, at 9 mm; or where the placement puts them."""
    columns = np.arange(SHAPE[1])
    np.save(tmp_path / "halves.npy", np.broadcast_to(np.where(columns < 30, 0.0, 1.0), SHAPE))
    rgb = np.broadcast_to((columns // 2 % 2)[None, :, None], (*SHAPE, 3)).astype(np.float32)
    picture, depth = Picture(rgb, "stripes"), tmp_path / "halves.npy"

    def contrasts(**place: float) -> list[list[bool]]:
        """Whether the near and the far half are sharp, at 9, 9.5 and 10 mm."""
        stack = target_for(bench(3, SHAPE), picture, Placement(depth=depth, **place)).stack[:, 20, :, 1]
        return [[bool(part.std() > 0.4) for part in (plane[4:20], plane[40:56])] for plane in stack]

    assert contrasts() == [[False, True], [False, False], [True, False]]
    assert contrasts(nearest_m=9.5e-3) == [[False, True], [True, False], [False, False]]
    assert contrasts(farthest_m=9.5e-3) == [[False, False], [False, True], [True, False]]


def test_planes_between_the_optimised_ones_belong_to_the_same_scene(bench: Bench, scene: Any) -> None:
    system = bench(3, SHAPE)
    own = target_for(system, *scene)
    planes = np.sort(np.append(system.planes_m, (system.planes_m[1:] + system.planes_m[:-1]) / 2))
    both = target_for(system, *scene, planes=planes)
    assert both.planes_m == tuple(planes)
    assert both.stack[::2] == pytest.approx(own.stack, abs=FFT), "rendering more planes changes none"
    alone = target_for(system, *scene, planes=[planes[1]])
    assert alone.stack[0] == pytest.approx(both.stack[1], abs=FFT), "the depth range is the system's"
    reference = target_for(system.edit({"planes": planes.tolist()}), *scene)
    assert both.stack == pytest.approx(reference.stack, abs=FFT)


def test_saturation_applies_to_the_scene_before_it_is_blurred(bench: Bench, scene: Any) -> None:
    system = bench(3, SHAPE)
    picture, placement = scene
    dull = Picture(scale_saturation(picture.rgb, 0.4), "dull")
    found = target_for(system, picture, placement, saturation=0.4).stack
    assert (found == target_for(system, dull, placement).stack).all()
    grey = target_for(system, picture, placement, saturation=0.0).stack
    luminance = target_for(system, picture, placement).stack @ SRGB_TO_XYZ[1]
    assert grey == pytest.approx(np.repeat(luminance[..., None], 3, axis=-1), abs=FFT), "luminance blurs the same"


def test_wide_gamut_light_stays_outside_0_to_1(bench: Bench, tmp_path: Path) -> None:
    cyan = np.tile(np.float32([0.05, 0.3, 0.35]), (*SHAPE, 1))
    tifffile.imwrite(tmp_path / "a.tif", cyan, photometric="rgb")
    target = target_for(bench(3, SHAPE), tmp_path / "a.tif", space="xyz", brightness=4.0)
    assert target.stack.min() < -1 and target.stack.max() > 1
    assert target.stack @ SRGB_TO_XYZ.T == pytest.approx(np.broadcast_to(4 * cyan, (3, *cyan.shape)), abs=1e-5)
    assert target.notes[0] == "CIE XYZ converted to linear sRGB"


def test_what_was_done_to_the_picture_is_told(bench: Bench, tmp_path: Path) -> None:
    Image.fromarray(np.full((*SHAPE, 2), 100, np.uint8), mode="LA").save(tmp_path / "a.png")
    assert target_for(bench(1, SHAPE), tmp_path / "a.png").notes == (
        "alpha composited over black",
        "grey copied to red, green and blue",
    )
    tifffile.imwrite(tmp_path / "b.tif", np.full((*SHAPE, 3), 3.0, np.float32), photometric="rgb")
    bright = target_for(bench(1, SHAPE), tmp_path / "b.tif")
    assert bright.stack.max() == pytest.approx(3) and "values up to 3 kept" in bright.notes[1]


def refused(*arguments: Any, **options: Any) -> str:
    with pytest.raises(UserError) as caught:
        target_for(*arguments, **options)
    return str(caught.value)


def test_a_depth_map_of_another_size_is_refused(bench: Bench, scene: Any, tmp_path: Path) -> None:
    np.save(tmp_path / "small.npy", np.zeros((30, 60)))
    message = refused(bench(3, SHAPE), scene[0], Placement(depth=tmp_path / "small.npy"))
    assert message == f"{tmp_path / 'small.npy'}: 60 x 30 pixels; expected the picture's size, 60 x 40"


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ({"nearest_m": 8e-3}, "the nearest depth: 8 mm; expected inside the planes, 9 mm to 10 mm; move it, or"),
        ({"farthest_m": 11e-3}, "the farthest depth: 11 mm; expected inside the planes, 9 mm to 10 mm"),
        (
            {"nearest_m": 9e-3, "farthest_m": 10e-3},
            "depth range: near at 9 mm, far at 10 mm; expected near at the larger distance: the viewer looks against",
        ),
        ({"at_m": 9.5e-3}, "a depth map and one distance; expected one of them"),
    ],
)
def test_depths_that_the_planes_do_not_reach_are_refused(
    bench: Bench, scene: Any, place: dict[str, float], words: str
) -> None:
    assert words in refused(bench(3, SHAPE), scene[0], Placement(depth=scene[1].depth, **place))


@pytest.mark.parametrize("at_m", [1e-3, 12e-3, math.nan])
def test_a_picture_outside_the_planes_is_refused(bench: Bench, scene: Any, at_m: float) -> None:
    message = refused(bench(3, SHAPE), scene[0], Placement(at_m=at_m))
    assert "the picture's distance" in message and "expected inside the planes, 9 mm to 10 mm" in message


@pytest.mark.parametrize("brightness", [0.0, -1.0, math.nan, math.inf])
def test_a_brightness_that_makes_no_sense_is_refused(bench: Bench, scene: Any, brightness: float) -> None:
    message = refused(bench(3, SHAPE), scene[0], brightness=brightness)
    assert message == f"brightness: {brightness:g}; expected a positive number; 1 changes nothing"


@pytest.mark.parametrize("saturation", [-0.1, math.nan, math.inf])
def test_a_saturation_that_makes_no_sense_is_refused(bench: Bench, scene: Any, saturation: float) -> None:
    message = refused(bench(3, SHAPE), scene[0], saturation=saturation)
    assert message == f"saturation: {saturation:g}; expected a factor of 0 or more; 0 is grey, 1 changes nothing"


def test_a_picture_that_was_read_has_no_other_space(bench: Bench, scene: Any) -> None:
    with pytest.raises(ValueError, match="give it to read_picture"):
        target_for(bench(3, SHAPE), scene[0], space="xyz")


@pytest.mark.parametrize("planes", [[], [math.nan], [[9e-3]]])
def test_planes_that_are_no_list_of_distances_are_refused(bench: Bench, scene: Any, planes: list[float]) -> None:
    with pytest.raises(ValueError, match="expected finite distances in metres"):
        target_for(bench(3, SHAPE), scene[0], planes=planes)
