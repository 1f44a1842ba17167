"""A picture with depth is sharp where it belongs, blurred elsewhere, and near things hide far ones.

The viewer looks against the light: near is at the larger distance z behind the last modulator.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image

from holoview.holograms.targets.defocus import Aperture, LightCone, blur_kernel
from holoview.holograms.targets.focal_stack import Target, is_stack, render_focal_stack, target_from_stack
from holoview.holograms.targets.picture import scale_saturation
from holoview.light.colour import SRGB_TO_XYZ, srgb_decode
from holoview.light.model.system import System
from holoview.util.errors import UserError
from tests.targets.conftest import read_stack

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


Bench = Callable[..., System]
WriteExr = Callable[..., Path]
Layers = Callable[..., dict[str, NDArray[np.float32]]]

SHAPE = (6, 8)
CODES = np.random.default_rng(3).integers(0, 256, (12, *SHAPE, 3), dtype=np.uint8)
LIGHT = np.random.default_rng(4).random((12, *SHAPE, 3), dtype=np.float32)


def test_a_folder_is_read_in_the_order_of_its_numbers(tmp_path: Path) -> None:
    for number in (10, 9, 0):
        Image.new("RGB", (8, 6), (number, 0, 0)).save(tmp_path / f"plane-{number}.png")
    (tmp_path / "notes.txt").write_text("not a picture")
    (tmp_path / ".plane-5.png").write_text("hidden")
    read = read_stack(tmp_path, (3, 4))
    assert read.shape == (3, 3, 4, 3) and read.dtype == np.float32
    assert (np.diff(read[:, 0, 0, 0]) > 0).all()
    listed = read_stack([tmp_path / "plane-9.png", str(tmp_path / "plane-0.png")], (3, 4))
    assert (listed == read[[1, 0]]).all()


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float16, np.float32, np.float64])
@pytest.mark.parametrize("options", [{}, {"compression": "deflate"}, {"planarconfig": "separate"}, {"bigtiff": True}])
def test_tiff_pages_are_planes(tmp_path: Path, dtype: type[np.generic], options: dict[str, Any]) -> None:
    integers = np.issubdtype(dtype, np.integer)
    stack = CODES[:5].astype(dtype) * (257 if dtype is np.uint16 else 1) if integers else LIGHT[:5].astype(dtype)
    written = np.moveaxis(stack, -1, 1) if "planarconfig" in options else stack
    tifffile.imwrite(tmp_path / "stack.tif", written, photometric="rgb", **options)
    expected = srgb_decode(CODES[:5] / 255) if integers else stack
    assert is_stack(tmp_path / "stack.tif")
    assert read_stack(tmp_path / "stack.tif", SHAPE) == pytest.approx(np.asarray(expected, np.float32), abs=1e-7)


def test_grey_tiff_pages_are_planes_too(tmp_path: Path) -> None:
    for imagej in (False, True):
        tifffile.imwrite(tmp_path / "grey.tif", LIGHT[:4, ..., 0], imagej=imagej, photometric="minisblack")
        read = read_stack(tmp_path / "grey.tif", SHAPE)
        assert (read == LIGHT[:4, ..., :1]).all()


def test_the_thumbnail_of_a_tiff_is_no_plane(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "photo.tif") as file:
        file.write(CODES[0], photometric="rgb")
        file.write(CODES[0, ::2, ::2], photometric="rgb", subfiletype=1)
    assert not is_stack(tmp_path / "photo.tif")
    assert read_stack(tmp_path / "photo.tif", SHAPE, pictures=1).shape == (1, *SHAPE, 3)


def test_exr_parts_are_planes_in_the_order_of_their_numbers(tmp_path: Path, write_exr: WriteExr) -> None:
    parts = [(f"plane {i}", {"RGB": LIGHT[i]}) for i in (10, 9, 11)]
    path = write_exr(tmp_path / "stack.exr", *parts)
    assert is_stack(path)
    assert (read_stack(path, SHAPE) == LIGHT[[9, 10, 11]]).all()


def test_exr_parts_without_numbers_stay_in_the_order_of_the_file(tmp_path: Path, write_exr: WriteExr) -> None:
    path = write_exr(tmp_path / "stack.exr", ("near", {"RGB": LIGHT[0]}), ("far", {"RGB": LIGHT[1]}))
    assert (read_stack(path, SHAPE) == LIGHT[:2]).all()


@pytest.mark.parametrize("name", ["{}", "plane-{}", "stack.z{}mm"])
def test_numbered_exr_layers_are_planes(tmp_path: Path, write_exr: WriteExr, layers: Layers, name: str) -> None:
    path = write_exr(tmp_path / "stack.exr", ("", layers(LIGHT, name)))
    assert is_stack(path)
    assert (read_stack(path, SHAPE) == LIGHT).all(), "0 to 11, in the order of the numbers"


def test_a_part_may_name_its_channels_after_itself(tmp_path: Path, write_exr: WriteExr) -> None:
    parts = [(f"z{i}", {f"z{i}.{c}": LIGHT[i, ..., k].copy() for k, c in enumerate("RGB")}) for i in range(3)]
    assert (read_stack(write_exr(tmp_path / "stack.exr", *parts), SHAPE) == LIGHT[:3]).all()


def test_the_alpha_of_a_layer_is_its_own(tmp_path: Path, bench: Bench, write_exr: WriteExr, layers: Layers) -> None:
    channels = layers(LIGHT[:2]) | {"1.A": np.full(SHAPE, 0.5, np.float32)}
    target = target_from_stack(bench(2), write_exr(tmp_path / "stack.exr", ("", channels)))
    assert (target.stack == LIGHT[:2]).all(), "colours in OpenEXR are premultiplied"
    assert target.notes == ('stack.exr, layer "1": alpha composited over black',)


def test_a_rendered_picture_with_depth_and_passes_is_one_picture(
    tmp_path: Path, bench: Bench, write_exr: WriteExr, layers: Layers
) -> None:
    depth = {"Z": np.ones(SHAPE, np.float32)}
    beauty = write_exr(tmp_path / "a.exr", ("", {"RGB": LIGHT[0], **layers(LIGHT[1:3], "light{}"), **depth}))
    several = write_exr(tmp_path / "b.exr", ("beauty", {"RGB": LIGHT[0]}), ("depth", depth))
    for path, note in ((beauty, "left out: light0, light1"), (several, "left out: depth")):
        assert not is_stack(path)
        target = target_from_stack(bench(1), path)
        assert (target.stack == LIGHT[:1]).all() and target.notes == (note,)


def test_passes_without_numbers_are_not_taken_for_planes(tmp_path: Path, write_exr: WriteExr, layers: Layers) -> None:
    path = write_exr(tmp_path / "a.exr", ("", layers(LIGHT[:1], "diffuse") | layers(LIGHT[1:2], "gloss")))
    for read in (is_stack, lambda p: read_stack(p, SHAPE)):
        with pytest.raises(UserError, match=r"a\.exr: has the channels .*diffuse\.R.*a numbered layer for each plane"):
            read(path)


def test_only_files_of_several_pictures_and_folders_are_stacks(tmp_path: Path, write_exr: WriteExr) -> None:
    Image.fromarray(CODES[0]).save(tmp_path / "a.png")
    Image.fromarray(CODES[0]).save(tmp_path / "b.jpg")
    tifffile.imwrite(tmp_path / "c.tif", CODES[0], photometric="rgb")
    write_exr(tmp_path / "d.exr", ("", {"RGB": LIGHT[0]}))
    assert not any(is_stack(file) for file in tmp_path.iterdir())
    assert is_stack(tmp_path) and is_stack(str(tmp_path))


def pages(tmp_path: Path, stack: NDArray[np.float32]) -> Path:
    tifffile.imwrite(tmp_path / "stack.tif", stack, photometric="rgb")
    return tmp_path / "stack.tif"


def test_a_stack_becomes_the_target_of_the_planes(tmp_path: Path, bench: Bench) -> None:
    system = bench(5)
    target = target_from_stack(system, pages(tmp_path, LIGHT[:5]), brightness=0.5)
    assert (target.stack == LIGHT[:5] * np.float32(0.5)).all() and target.brightness == 0.5
    assert target.planes_m == tuple(system.planes_m) and target.source == str(tmp_path / "stack.tif")
    assert target.notes == ("states no colour space: taken as linear sRGB",)


def test_a_stack_is_fitted_to_the_simulation_grid(tmp_path: Path, bench: Bench) -> None:
    target = target_from_stack(bench(2, (12, 20)), pages(tmp_path, np.full((2, 40, 50, 3), 0.25, np.float32)))
    assert target.stack.shape == (2, 12, 20, 3)
    assert np.abs(target.stack - 0.25).max() < 1e-6


def test_saturation_and_space_apply_to_every_plane(tmp_path: Path, bench: Bench) -> None:
    xyz = (LIGHT[:3] @ SRGB_TO_XYZ.T).astype(np.float32)
    target = target_from_stack(bench(3), pages(tmp_path, xyz), saturation=0.5, space="xyz")
    assert target.stack == pytest.approx(scale_saturation(LIGHT[:3], 0.5), abs=3e-6)
    assert target.notes[0] == "CIE XYZ converted to linear sRGB"


def test_notes_that_all_planes_share_are_told_once(tmp_path: Path, bench: Bench) -> None:
    Image.new("L", (8, 6), 9).save(tmp_path / "0.png")
    Image.new("LA", (8, 6), (9, 9)).save(tmp_path / "1.png")
    target = target_from_stack(bench(2), tmp_path)
    assert target.notes == ("grey copied to red, green and blue", "1.png: alpha composited over black")


@pytest.mark.parametrize("kind", ["folder", "pages", "parts", "layers"])
@pytest.mark.parametrize(("planes", "wanted"), [(1, "one for each of 1 plane"), (5, "one for each of 5 planes")])
def test_another_number_of_pictures_than_planes_is_refused(
    tmp_path: Path, bench: Bench, write_exr: WriteExr, layers: Layers, kind: str, planes: int, wanted: str
) -> None:
    path = tmp_path / "stack"
    if kind == "folder":
        path.mkdir()
        for i in range(3):
            Image.fromarray(CODES[i]).save(path / f"{i}.png")
    elif kind == "pages":
        tifffile.imwrite(path, CODES[:3], photometric="rgb")
    elif kind == "parts":
        write_exr(path, *((f"{i}", {"RGB": LIGHT[i]}) for i in range(3)))
    else:
        write_exr(path, ("", layers(LIGHT[:3])))
    with pytest.raises(UserError) as caught:
        target_from_stack(bench(planes), path)
    remedy = "change the planes (--set planes=…) or the stack"
    assert str(caught.value) == f"{path}: holds 3 pictures; expected {wanted}; {remedy}"


DAMAGED_CODES = np.random.default_rng(3).integers(0, 256, (2, *SHAPE, 3), dtype=np.uint8)
DAMAGED_LIGHT = np.random.default_rng(4).random((3, *SHAPE, 3), dtype=np.float32)


def damaged_pages(tmp_path: Path, stack: NDArray[np.float32]) -> Path:
    """A TIFF with a page a picture."""
    tifffile.imwrite(tmp_path / "stack.tif", stack, photometric="rgb")
    return tmp_path / "stack.tif"


def says(read: Callable[[], object], *words: str) -> None:
    """`read` raises a UserError of one line that holds `words`."""
    with pytest.raises(UserError) as caught:
        read()
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


def test_an_empty_folder_is_refused(tmp_path: Path, bench: Bench) -> None:
    (tmp_path / "notes.txt").write_text("no picture")
    says(lambda: target_from_stack(bench(5), tmp_path), str(tmp_path), "holds no pictures", "one a plane (.png, .jpg")
    says(lambda: read_stack([], SHAPE), "focal stack: holds no pictures")


def test_a_missing_stack_is_refused(tmp_path: Path, bench: Bench) -> None:
    for read in (is_stack, lambda path: target_from_stack(bench(5), path)):
        says(lambda read=read: read(tmp_path / "no.tif"), str(tmp_path / "no.tif"), "no such file")


@pytest.mark.parametrize("name", ["a.tif", "a.exr", "a.png"])
def test_text_under_another_name_is_refused(tmp_path: Path, bench: Bench, name: str) -> None:
    (tmp_path / name).write_text("plane;distance\n1;9 mm\n")
    for read in (is_stack, lambda path: target_from_stack(bench(5), path)):
        says(
            lambda read=read: read(tmp_path / name),
            f"{tmp_path / name}: is not a picture that can be read",
            "WebP, AVIF, HEIC, GIF, PNG, JPEG, TIFF or OpenEXR picture; save it in one of these formats",
        )


def test_one_picture_is_no_stack_of_five(tmp_path: Path, bench: Bench) -> None:
    Image.fromarray(DAMAGED_CODES[0]).save(tmp_path / "a.png")
    says(
        lambda: target_from_stack(bench(5), tmp_path / "a.png"),
        "a.png: holds 1 picture; expected one for each of 5 planes",
    )


def test_pictures_of_different_sizes_are_refused(tmp_path: Path, bench: Bench) -> None:
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        file.write(DAMAGED_CODES[0], photometric="rgb")
        file.write(DAMAGED_CODES[1, :, :5], photometric="rgb")
    says(
        lambda: target_from_stack(bench(2), tmp_path / "a.tif"),
        "a.tif, page 2: is 5 × 6; expected 8 × 6 as a.tif, page 1; render all at one size",
    )
    Image.fromarray(DAMAGED_CODES[0]).save(tmp_path / "plane-0.png")
    Image.fromarray(DAMAGED_CODES[1, :, :5]).save(tmp_path / "plane-1.png")
    files = [tmp_path / "plane-0.png", tmp_path / "plane-1.png"]
    says(lambda: read_stack(files, SHAPE), "plane-1.png: is 5 × 6; expected 8 × 6 as plane-0.png")


def test_nan_is_found_on_its_plane(tmp_path: Path, bench: Bench, write_exr: WriteExr, layers: Layers) -> None:
    broken = DAMAGED_LIGHT[:3].copy()
    broken[1, 2, 3, 0] = math.nan
    files = {
        damaged_pages(tmp_path, broken): "stack.tif, page 2",
        write_exr(tmp_path / "p.exr", *((f"z{i}", {"RGB": p}) for i, p in enumerate(broken))): 'p.exr, part "z1"',
        write_exr(tmp_path / "l.exr", ("", layers(broken))): 'l.exr, layer "1"',
    }
    for path, where in files.items():
        says(
            lambda path=path: target_from_stack(bench(3), path),
            f"{where}: 1 of 144 values are NaN or infinite; expected finite numbers; repair the file",
        )


@pytest.mark.parametrize("name", ["pages.tif", "apart.tif", "parts.exr", "layers.exr"])
@pytest.mark.parametrize("share", [0.01, 0.1, 0.5, 0.9, 0.99])
def test_a_stack_that_is_cut_off_is_refused_and_never_shortened(
    tmp_path: Path, write_exr: WriteExr, layers: Layers, name: str, share: float
) -> None:
    noise = np.random.default_rng(5).random((5, 64, 64, 3), dtype=np.float32)
    path = tmp_path / name
    if name == "pages.tif":  # all directories but the first lie behind the data, so that the first page stays whole
        tifffile.imwrite(path, noise, photometric="rgb")
    elif name == "apart.tif":
        with tifffile.TiffWriter(path) as file:
            for picture in noise:
                file.write(picture, photometric="rgb", compression="deflate")
    elif name == "parts.exr":
        write_exr(path, *((f"{i}", {"RGB": picture}) for i, picture in enumerate(noise)))
    else:
        write_exr(path, ("", layers(noise)))
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    says(lambda: read_stack(path, SHAPE), str(path), "data is truncated or damaged", "save or copy the file again")
    if name == "parts.exr" and share >= 0.5:
        says(lambda: read_stack(path, SHAPE), f"{int(share * 5)} of 5 parts are whole")


def test_a_page_without_pixels_is_refused(tmp_path: Path, bench: Bench) -> None:
    path = damaged_pages(tmp_path, DAMAGED_LIGHT[:2])
    with tifffile.TiffFile(path, mode="r+b") as file:
        file.pages[1].tags["ImageWidth"].overwrite(0)
    says(lambda: target_from_stack(bench(2), path), str(path), "has no pixels: 0 × 6")


def test_integers_are_no_xyz(tmp_path: Path, bench: Bench) -> None:
    tifffile.imwrite(tmp_path / "a.tif", DAMAGED_CODES[:2], photometric="rgb")
    says(
        lambda: target_from_stack(bench(2), tmp_path / "a.tif", space="xyz"),
        "a.tif, page 1: holds integers, a display signal; expected three float channels of CIE XYZ; save it as float",
    )


@pytest.mark.parametrize("brightness", [0.0, -0.5, math.nan])
def test_a_stack_needs_light(tmp_path: Path, bench: Bench, brightness: float) -> None:
    says(
        lambda: target_from_stack(bench(2), damaged_pages(tmp_path, DAMAGED_LIGHT[:2]), brightness=brightness),
        f"brightness: {brightness:g}; expected a positive number; 1 changes nothing",
    )


@pytest.mark.parametrize("saturation", [-0.5, math.nan])
def test_a_saturation_that_makes_no_sense_is_refused(tmp_path: Path, bench: Bench, saturation: float) -> None:
    says(
        lambda: target_from_stack(bench(2), damaged_pages(tmp_path, DAMAGED_LIGHT[:2]), saturation=saturation),
        f"saturation: {saturation:g}; expected a factor of 0 or more",
    )
