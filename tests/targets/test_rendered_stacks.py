"""Ready focal stacks: a folder, the pages of a TIFF, the parts or layers of an OpenEXR file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image

from holoview.colour import SRGB_TO_XYZ, srgb_decode
from holoview.model.system import System
from holoview.targets.focal_stack import is_stack, target_from_stack
from holoview.targets.picture import scale_saturation
from holoview.util.errors import UserError
from tests.targets.conftest import read_stack

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
    assert target.notes == ()


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
