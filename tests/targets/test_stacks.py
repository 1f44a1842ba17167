"""Focal stacks that were rendered elsewhere, in every container that may hold one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image

import holoview as hv
from holoview.colour import srgb_decode
from holoview.errors import UserError
from holoview.system import System
from holoview.targets.stacks import is_stack, read_stack, stack_for

SHAPE = (6, 8)


def _light(planes: int = 3) -> np.ndarray:
    return np.random.default_rng(0).random((planes, *SHAPE, 3)).astype(np.float32)


def _tiff(path: Path, light: np.ndarray) -> Path:
    tifffile.imwrite(path / "stack.tif", light, photometric="rgb")
    return path / "stack.tif"


def _exr_parts(path: Path, light: np.ndarray) -> Path:
    kind = {"type": OpenEXR.scanlineimage}
    parts = [
        OpenEXR.Part(
            kind | {"name": f"plane {i}"}, {c: np.ascontiguousarray(page[..., j]) for j, c in enumerate("RGB")}
        )
        for i, page in enumerate(light)
    ]
    OpenEXR.File(parts).write(str(path / "parts.exr"))
    return path / "parts.exr"


def _exr_layers(path: Path, light: np.ndarray) -> Path:
    layers = {
        f"plane{8 + i}.{c}": np.ascontiguousarray(page[..., j])
        for i, page in enumerate(light)
        for j, c in enumerate("RGB")
    }
    OpenEXR.File({"type": OpenEXR.scanlineimage}, layers).write(str(path / "layers.exr"))
    return path / "layers.exr"


def _folder(path: Path, light: np.ndarray) -> Path:
    for i, page in enumerate(light):
        tifffile.imwrite(path / f"plane-{8 + i}.tif", page, photometric="rgb")
    return path


@pytest.mark.parametrize("write", [_tiff, _exr_parts, _exr_layers, _folder])
def test_planes_come_back_in_their_order(write: Callable[..., Path], tmp_path: Path) -> None:
    light = _light()
    path = write(tmp_path, light)
    assert is_stack(path)
    np.testing.assert_array_equal(read_stack(path, SHAPE, pictures=3), light)


def test_sixteen_bit_pages_are_a_display_signal(tmp_path: Path) -> None:
    levels = np.random.default_rng(1).integers(0, 65536, (2, *SHAPE, 3)).astype(np.uint16)
    tifffile.imwrite(tmp_path / "s.tif", levels, photometric="rgb")
    np.testing.assert_allclose(read_stack(tmp_path / "s.tif", SHAPE), srgb_decode(levels / 65535), rtol=1e-6)


def test_one_picture_is_no_stack(tmp_path: Path) -> None:
    Image.new("RGB", (8, 6)).save(tmp_path / "one.png")
    tifffile.imwrite(tmp_path / "one.tif", _light(1)[0], photometric="rgb")
    assert not is_stack(tmp_path / "one.png")
    assert not is_stack(tmp_path / "one.tif")


def _system(**changes: Any) -> System:
    return hv.load("holochrome-8").edit({"shape": [3, 4], "planes": ["0.1 mm", "0.2 mm", "0.3 mm"]} | changes)


def test_a_stack_for_a_bench_has_its_planes_brightness_and_saturation(tmp_path: Path) -> None:
    path = _tiff(tmp_path, _light())
    target = stack_for(_system(), path, brightness=0.5, saturation=0.0)
    assert target.planes_m == (1e-4, 2e-4, 3e-4)
    luminance = _light() @ np.array([0.2126, 0.7152, 0.0722])
    np.testing.assert_allclose(target.stack, np.repeat(0.5 * luminance[..., None], 3, axis=-1), atol=2e-4)


def test_another_number_of_pictures_than_planes_is_refused(tmp_path: Path) -> None:
    path = _tiff(tmp_path, _light(2))
    with pytest.raises(UserError, match="holds 2 pictures; expected one for each of 3 planes; change the planes"):
        stack_for(_system(), path)


def test_a_page_of_another_size_is_named(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "s.tif") as file:
        file.write(_light()[0], photometric="rgb")
        file.write(_light()[0, :4], photometric="rgb")
    with pytest.raises(UserError, match=r"s\.tif: is 8 × 4; expected 8 × 6 as s\.tif"):
        read_stack(tmp_path / "s.tif", SHAPE)


@pytest.mark.parametrize("name", ["stack.tif", "parts.exr"])
def test_not_a_number_and_truncation_are_refused(name: str, tmp_path: Path) -> None:
    light = _light()
    light[1, 2, 3, 0] = np.nan
    path = _tiff(tmp_path, light) if name == "stack.tif" else _exr_parts(tmp_path, light)
    with pytest.raises(UserError, match="1 of 144 values are NaN or infinite"):
        read_stack(path, SHAPE)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(UserError, match=r"truncated or damaged|not a picture"):
        read_stack(path, SHAPE)
