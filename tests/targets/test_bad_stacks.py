"""Every unusable focal stack ends in one line that names the file and the picture in it, and says what to do."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image

from holoview.model.system import System
from holoview.targets.focal_stack import is_stack, target_from_stack
from holoview.util.errors import UserError
from tests.targets.conftest import read_stack

Bench = Callable[..., System]
WriteExr = Callable[..., Path]
Layers = Callable[..., dict[str, NDArray[np.float32]]]

SHAPE = (6, 8)
CODES = np.random.default_rng(3).integers(0, 256, (2, *SHAPE, 3), dtype=np.uint8)
LIGHT = np.random.default_rng(4).random((3, *SHAPE, 3), dtype=np.float32)


def pages(tmp_path: Path, stack: NDArray[np.float32]) -> Path:
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
            "expected a PNG, JPEG, TIFF or OpenEXR picture; save it in one of these formats",
        )


def test_one_picture_is_no_stack_of_five(tmp_path: Path, bench: Bench) -> None:
    Image.fromarray(CODES[0]).save(tmp_path / "a.png")
    says(
        lambda: target_from_stack(bench(5), tmp_path / "a.png"),
        "a.png: holds 1 picture; expected one for each of 5 planes",
    )


def test_pictures_of_different_sizes_are_refused(tmp_path: Path, bench: Bench) -> None:
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        file.write(CODES[0], photometric="rgb")
        file.write(CODES[1, :, :5], photometric="rgb")
    says(
        lambda: target_from_stack(bench(2), tmp_path / "a.tif"),
        "a.tif, page 2: is 5 × 6; expected 8 × 6 as a.tif, page 1; render all at one size",
    )
    Image.fromarray(CODES[0]).save(tmp_path / "plane-0.png")
    Image.fromarray(CODES[1, :, :5]).save(tmp_path / "plane-1.png")
    files = [tmp_path / "plane-0.png", tmp_path / "plane-1.png"]
    says(lambda: read_stack(files, SHAPE), "plane-1.png: is 5 × 6; expected 8 × 6 as plane-0.png")


def test_nan_is_found_on_its_plane(tmp_path: Path, bench: Bench, write_exr: WriteExr, layers: Layers) -> None:
    broken = LIGHT[:3].copy()
    broken[1, 2, 3, 0] = math.nan
    files = {
        pages(tmp_path, broken): "stack.tif, page 2",
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
    path = pages(tmp_path, LIGHT[:2])
    with tifffile.TiffFile(path, mode="r+b") as file:
        file.pages[1].tags["ImageWidth"].overwrite(0)
    says(lambda: target_from_stack(bench(2), path), str(path), "has no pixels: 0 × 6")


def test_integers_are_no_xyz(tmp_path: Path, bench: Bench) -> None:
    tifffile.imwrite(tmp_path / "a.tif", CODES[:2], photometric="rgb")
    says(
        lambda: target_from_stack(bench(2), tmp_path / "a.tif", space="xyz"),
        "a.tif, page 1: holds integers, a display signal; expected three float channels of CIE XYZ; save it as float",
    )


@pytest.mark.parametrize("brightness", [0.0, -0.5, math.nan])
def test_a_stack_needs_light(tmp_path: Path, bench: Bench, brightness: float) -> None:
    says(
        lambda: target_from_stack(bench(2), pages(tmp_path, LIGHT[:2]), brightness=brightness),
        f"brightness: {brightness:g}; expected a positive number; 1 changes nothing",
    )


@pytest.mark.parametrize("saturation", [-0.5, math.nan])
def test_a_saturation_that_makes_no_sense_is_refused(tmp_path: Path, bench: Bench, saturation: float) -> None:
    says(
        lambda: target_from_stack(bench(2), pages(tmp_path, LIGHT[:2]), saturation=saturation),
        f"saturation: {saturation:g}; expected a factor of 0 or more",
    )
