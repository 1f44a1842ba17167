"""A depth map becomes numbers from 0 (nearest) to 1 (farthest)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from holoview.holograms.targets.picture import read_depth
from holoview.util.errors import UserError


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_integer_png_spans_its_full_range(tmp_path: Path, dtype: type[np.unsignedinteger]) -> None:
    white = np.iinfo(dtype).max
    codes = np.array([[0, white // 3, white]], dtype=dtype)
    Image.fromarray(codes).save(tmp_path / "depth.png")
    depth = read_depth(tmp_path / "depth.png")
    assert depth.dtype == np.float32
    assert depth == pytest.approx(np.array([[0, 1 / 3, 1]]), abs=1e-6)


def test_depth_is_not_decoded_as_light(tmp_path: Path) -> None:
    Image.new("L", (2, 2), 128).save(tmp_path / "depth.png")
    assert read_depth(tmp_path / "depth.png") == pytest.approx(np.full((2, 2), 128 / 255), abs=1e-6)


def test_a_colour_file_with_equal_channels_passes_and_one_in_colour_fails(tmp_path: Path) -> None:
    Image.new("RGB", (2, 2), (51, 51, 51)).save(tmp_path / "grey.png")
    assert read_depth(tmp_path / "grey.png") == pytest.approx(np.full((2, 2), 0.2), abs=1e-6)
    Image.new("RGB", (2, 2), (51, 52, 51)).save(tmp_path / "colour.png")
    with pytest.raises(UserError, match=r"colour.png: is in colour"):
        read_depth(tmp_path / "colour.png")


def test_an_opaque_alpha_passes_and_a_hole_fails(tmp_path: Path) -> None:
    Image.new("LA", (2, 2), (51, 255)).save(tmp_path / "opaque.png")
    assert read_depth(tmp_path / "opaque.png").shape == (2, 2)
    Image.new("LA", (2, 2), (51, 254)).save(tmp_path / "hole.png")
    with pytest.raises(UserError, match="partly transparent"):
        read_depth(tmp_path / "hole.png")


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_float_arrays_are_taken_as_they_are(tmp_path: Path, dtype: type[np.floating]) -> None:
    values = np.array([[0, 0.25], [0.5, 1]], dtype=dtype)
    np.save(tmp_path / "depth.npy", values)
    assert (read_depth(tmp_path / "depth.npy") == values).all()


def test_integer_arrays_are_scaled(tmp_path: Path) -> None:
    np.save(tmp_path / "depth.npy", np.array([[0, 65535]], dtype=np.uint16))
    assert read_depth(tmp_path / "depth.npy").tolist() == [[0, 1]]


def test_exr_depth_is_read_from_its_only_channel(tmp_path: Path) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"Z": np.array([[0.0, 0.75]], dtype=np.float32)}) as file:
        file.write(str(tmp_path / "depth.exr"))
    assert read_depth(tmp_path / "depth.exr").tolist() == [[0, 0.75]]


@pytest.mark.parametrize("values", [[[0.0, 1.5]], [[-0.1, 1.0]]])
def test_float_depths_outside_0_to_1_are_refused(tmp_path: Path, values: list[list[float]]) -> None:
    np.save(tmp_path / "depth.npy", np.array(values))
    with pytest.raises(UserError, match=r"holds depths from .*; expected 0 \(nearest\) … 1 \(farthest\)"):
        read_depth(tmp_path / "depth.npy")


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (np.full((2, 2), np.nan), "4 of 4 values are NaN"),
        (np.zeros((2, 2, 3)), "shape (2, 2, 3)"),
        (np.zeros(4), "shape (4,)"),
        (np.zeros((0, 4)), "shape (0, 4)"),
        (np.zeros((2, 2), dtype=np.int64), "int64 values"),
        (np.zeros((2, 2), dtype=complex), "complex128 values"),
        (np.zeros((2, 2), dtype=bool), "bool values"),
        (np.array([[None]], dtype=object), "Python objects"),
    ],
)
def test_arrays_that_are_no_depth_are_refused(tmp_path: Path, array: np.ndarray, words: str) -> None:
    np.save(tmp_path / "depth.npy", array, allow_pickle=True)
    with pytest.raises(UserError) as caught:
        read_depth(tmp_path / "depth.npy")
    assert words in str(caught.value)


def test_an_exr_depth_with_a_border_without_data_is_refused(tmp_path: Path) -> None:
    windows = {"dataWindow": ((1, 1), (2, 2)), "displayWindow": ((0, 0), (3, 3))}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **windows}
    with OpenEXR.File(header, {"Z": np.ones((2, 2), np.float32)}) as file:
        file.write(str(tmp_path / "depth.exr"))
    with pytest.raises(UserError, match="is partly transparent; expected a depth everywhere"):
        read_depth(tmp_path / "depth.exr")
