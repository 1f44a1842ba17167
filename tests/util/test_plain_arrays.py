"""Windows of arrays in files are numpy's slices; headers that claim more than the file holds are refused."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from holoview.util import plain_arrays
from holoview.util.errors import UserError
from holoview.util.plain_arrays import read_npy_header, read_window


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_a_window_is_the_slice_of_the_whole(data: st.DataObject, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("windows") / "f"
    shape = data.draw(st.lists(st.integers(1, 7), min_size=0, max_size=4))
    order = data.draw(st.sampled_from("CF"))
    offset, piece = data.draw(st.integers(0, 9)), data.draw(st.sampled_from([1, 16, 1 << 24]))
    values = np.arange(np.prod(shape, dtype=int), dtype=">i2").reshape(shape)
    path.write_bytes(bytes(offset) + values.tobytes(order))
    window = []
    for size in shape:
        first = data.draw(st.integers(0, size))
        window.append(slice(first, data.draw(st.integers(first, size))))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plain_arrays, "_PIECE_BYTES", piece)  # all ways to read are taken
        read = read_window(path, values.dtype, shape, offset, window, order)
    assert np.array_equal(read, values[tuple(window)])


def test_a_file_that_became_shorter_is_named_with_its_size(tmp_path: Path) -> None:
    path = tmp_path / "f"
    path.write_bytes(bytes(100))
    with pytest.raises(
        UserError, match=r"f: became shorter while it was read: 100 bytes; expected 64 bytes at byte 64"
    ):
        read_window(path, np.dtype("f8"), (16,), 0, (slice(8, 16),))


def _npy(text: str, data: bytes = b"") -> bytes:
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode() + data


@pytest.mark.parametrize(
    ("shape", "kind", "found"),
    [
        ("(4, 4)", "<f8", "truncated or damaged: 64 bytes of numbers; expected 128 bytes"),
        ("(65536, 65536)", "<c16", "truncated or damaged"),
        ("(" + "9" * 400 + ", 2)", "<f4", "truncated or damaged"),
        ("(2, 2)", "|O", "pickled Python objects"),
        ("(2, 2)", "<U1000000", "values of type <U1000000"),
        ("(-2, 2)", "<f4", "shape"),
        ("(" + "1, " * 40 + ")", "<f4", "shape"),
        ("(" * 400 + "1" + ")" * 400, "<f4", "header of the array is damaged"),
    ],
)
def test_headers_are_compared_with_the_size_of_the_file(shape: str, kind: str, found: str) -> None:
    content = _npy(f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}}}", bytes(64))
    with pytest.raises(UserError, match=found):
        read_npy_header(io.BytesIO(content), len(content), "f")


def test_what_numpy_writes_is_read(tmp_path: Path) -> None:
    for values in (np.arange(6.0).reshape(2, 3), np.asfortranarray(np.arange(6).reshape(2, 3)), np.array(3 + 1j)):
        np.save(tmp_path / "f.npy", values)
        data = (tmp_path / "f.npy").read_bytes()
        header = read_npy_header(io.BytesIO(data), len(data), "f")
        assert np.array_equal(header.array(data[header.offset :]), values)
