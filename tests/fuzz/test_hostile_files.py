"""A few files of each hostile family: what is said of them, and that long ones take no longer than reading them."""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import tifffile

from holoview.bench.captures.capture_file import read_captures
from holoview.commands.cli import main
from holoview.holograms.fields.interpret.remembered import notes_path, remember
from holoview.holograms.fields.reading import ReadRequest, read_wavefield
from holoview.holograms.files.image_reader import picture_count, read_raster
from holoview.holograms.hologram import Hologram
from holoview.holograms.view import random_drive
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.files import read_bytes
from holoview.util.safetensors_file import metadata_of, open_tensors
from holoview.util.text import plain_name
from holoview.viewer.document.file_loader import read_content
from holoview.viewer.page.link import shown_by_link
from holoview.viewer.page.page import read_page
from tests.fuzz.field_files import MAT_HEADER
from tests.fuzz.hostile_files import FAMILIES, SPECIAL, npy
from tests.fuzz.trial import Case
from tests.fuzz.valid_files import BENCH, small_system, valid, write

needs_fork = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes in folders")
_FEW = ("array headers", "tensor headers", "MATLAB elements", "HDF5 structures", "picture headers", "hostile pages")


def _refusal(path: Path, read: Callable[[Path], object]) -> str:
    with pytest.raises(UserError) as caught:
        read(path)
    return str(caught.value)


def _read(path: Path) -> object:
    return read_wavefield(path, ReadRequest(accept_guesses=True))


# --- names that lead to something else --------------------------------------------------------------------------------


@needs_fork
@pytest.mark.parametrize(
    ("file", "content", "arguments"),
    [
        ("bench.toml", "", ("info", "bench.toml")),
        ("base.toml", 'base = "base.toml"\n', ("info", "bench.toml")),
        ("page.html", "", ("export", "page.html", "--html", "o.html")),
        ("page.html", "", ("render", "page.html#plane=3mm")),
        ("page.html", "", ("view", "page.html", "--offscreen")),
        ("rig.toml", "", ("rig", "show", "rig.toml")),
        ("maps.safetensors", BENCH + "[effects.calibrated]\nfile = 'maps.safetensors'\n", ("render", "bench.toml")),
        ("field.npy", BENCH + "[effects.source_field]\nfile = 'field.npy'\n", ("render", "bench.toml")),
        ("u.npy.holoview.toml", "", ("info", "u.npy", "--guess")),
        ("path.csv", BENCH, ("render", "bench.toml", "--pupil-path", "path.csv")),
    ],
)
@pytest.mark.parametrize("kind", ["pipe", "zeros without end"])
def test_every_file_that_a_command_meets_is_one_or_is_refused(
    file: str,
    content: str,
    arguments: tuple[str, ...],
    kind: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    files = {"bench.toml": content.encode(), "u.npy": npy("<c8", "(18, 22)", bytes(8 * 396))}
    write(tmp_path, {name: data for name, data in files.items() if name != file})
    SPECIAL[kind](tmp_path / file)
    assert main(arguments) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("holoview: ")]
    assert f"{file}: is a {'pipe' if kind == 'pipe' else 'device'}" in line


@needs_fork
def test_a_file_of_the_kernel_without_end_is_empty(tmp_path: Path) -> None:
    SPECIAL["pages of the kernel"](tmp_path / "u.npy")
    assert "the file is empty" in _refusal(tmp_path / "u.npy", _read)
    assert read_bytes(tmp_path / "u.npy", "numbers") == b""


@needs_fork
def test_a_large_file_is_refused_by_its_size(tmp_path: Path) -> None:
    for name, read in (("bench.toml", main), ("page.html", read_page)):
        SPECIAL["3 GB of nothing"](tmp_path / name)
        if read is main:
            assert main(["info", str(tmp_path / name)]) == 2
        else:
            assert "has 3.22 GB, more than 256 MiB" in _refusal(tmp_path / name, read_page)


def test_notes_arent_written_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "other").write_text("mine", encoding="utf-8")
    notes_path(tmp_path / "u.npy").symlink_to("other")
    (tmp_path / "other").write_text("", encoding="utf-8")
    with pytest.raises(UserError, match="is a link, which isn't followed"):
        remember(tmp_path / "u.npy", ReadRequest(pitch_m=(8e-6, 8e-6)))
    assert (tmp_path / "other").read_text(encoding="utf-8") == ""


@pytest.mark.parametrize(
    ("note", "found"),
    [
        ("refractive_index = 1e9", "from 0.1 to 10"),
        ("phase_levels = 1e300", "phase levels"),
        ('colour_shifts = [["5 m", "0 m"]]', "colour shift"),
    ],
)
def test_notes_are_bounded_as_options_are(note: str, found: str, tmp_path: Path) -> None:
    write(tmp_path, {"u.npy": npy("<c8", "(18, 22)", bytes(8 * 396)), "u.npy.holoview.toml": note.encode()})
    assert found in _refusal(tmp_path / "u.npy", _read)


# --- headers that lie -------------------------------------------------------------------------------------------------


def _element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def _matrix(kind: int, sizes: tuple[int, ...], body: bytes, name: bytes = b"") -> bytes:
    head = struct.pack("<IIII", 6, 8, kind, 0) + _element(5, struct.pack(f"<{len(sizes)}i", *sizes)) + _element(1, name)
    return struct.pack("<II", 14, len(head + body)) + head + body


_NUMBERS = _matrix(6, (1, 2), _element(9, bytes(16)))
_MATLAB = {
    "a cell of cells": (_matrix(1, (30000, 30000), b"", b"u"), "an array of shape \\(30000, 30000\\) in"),
    "a cell of few bytes": (_matrix(1, (40, 1), _NUMBERS, b"u"), "40 cells or fields in 72 bytes"),
    "a text of nothing": (_matrix(1, (1, 1), _matrix(4, (20, 1), b""), b"u"), "20 numbers in 0 bytes"),
    "a structure": (
        _matrix(2, (9, 1), _element(5, struct.pack("<i", 1)) + _element(1, b"abcdefgh"), b"u"),
        "72 cells or fields in 0 bytes",
    ),
    "parts that end elsewhere": (_matrix(1, (1, 1), _NUMBERS + bytes(64), b"u"), "holds no array"),
}


@pytest.mark.parametrize("name", _MATLAB)
@pytest.mark.parametrize("is_packed", [False, True])
def test_elements_of_matlab_hold_what_they_declare(name: str, is_packed: bool, tmp_path: Path) -> None:
    data, found = _MATLAB[name]
    packed = zlib.compress(data)
    stored = struct.pack("<II", 15, len(packed)) + packed if is_packed else data
    (tmp_path / "u.mat").write_bytes(MAT_HEADER + stored)
    with pytest.raises(UserError, match=found):
        _read(tmp_path / "u.mat")


def test_chunks_and_sizes_of_hdf5_are_bounded(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "u.h5", "w") as h5:
        h5.create_dataset("u", (1000, 1000), "f4", chunks=(1, 1))
    assert "u: is cut into 1000000 chunks of 4 bytes" in _refusal(tmp_path / "u.h5", _read)
    with h5py.File(tmp_path / "v.h5", "w") as h5:
        h5.create_dataset("u", (1 << 20, 1 << 20), "f8", chunks=(1024, 1024))
    assert "u: declares 8.8e+03 GB of data in a file of" in _refusal(tmp_path / "v.h5", _read)
    write(tmp_path, valid("captures"))
    with h5py.File(tmp_path / "captures.h5", "a") as h5:
        group = h5
        for _ in range(2000):
            group = group.create_group("a")
        group["b"] = h5["/"]
    assert "holds more than 10000 objects" in _refusal(tmp_path / "captures.h5", read_captures)


def test_lists_of_pages_end(tmp_path: Path) -> None:
    path = tmp_path / "u.tif"
    tifffile.imwrite(path, np.zeros((2, 18, 22), np.uint8), photometric="minisblack")
    with tifffile.TiffFile(path) as file:
        first, last = file.pages[0].offset, file.pages[1].offset
    data = bytearray(path.read_bytes())
    (tags,) = struct.unpack_from("<H", data, last)
    struct.pack_into("<I", data, last + 2 + 12 * tags, first)
    path.write_bytes(data)
    for read in (_read, read_raster, picture_count):
        assert "has a list of pages that leads back into itself" in _refusal(path, read)
    page = struct.pack("<H", 0)
    offsets = [8 + 6 * number for number in range(20_000)]
    path.write_bytes(b"II*\0\x08\0\0\0" + b"".join(page + struct.pack("<I", at + 6) for at in offsets))
    for read in (_read, read_raster):
        assert "has more than 10000 pages" in _refusal(path, read)


@pytest.mark.parametrize(
    ("header", "found"),
    [
        ({"dtype": "F32", "shape": [65536, 65536], "data_offsets": [0, 64]}, "shape (65536, 65536), F32, in 64 bytes"),
        ({"dtype": "F32", "shape": [4, 4], "data_offsets": [64, 128]}, "aren't those that its header places"),
        ({"dtype": "F32", "shape": [4, -4], "data_offsets": [0, 64]}, "sizes that are none"),
        ({"dtype": "F32", "shape": [4, 4]}, "no type, shape and offsets"),
        ([], "no type, shape and offsets"),
    ],
)
def test_headers_of_tensors_place_all_numbers(header: object, found: str, tmp_path: Path) -> None:
    text = json.dumps({"u": header}).encode()
    (tmp_path / "u.safetensors").write_bytes(struct.pack("<Q", len(text)) + text + bytes(64))
    assert found in _refusal(tmp_path / "u.safetensors", lambda path: open_tensors(path, "tensors"))
    assert metadata_of(tmp_path / "u.safetensors") == {}


# --- texts ------------------------------------------------------------------------------------------------------------


_LONG = 300_000
"""Characters; a search that takes time as their square takes hours."""


def test_long_numbers_are_read_in_one_go(tmp_path: Path) -> None:
    for text in ("1" * _LONG, "1." * _LONG, "-" * _LONG, " " * _LONG + "x", "1" * _LONG + " " + "1" * _LONG + "x"):
        with pytest.raises(UserError, match="is not a length"):
            units.parse(text, "gap")
        (tmp_path / "u.txt").write_text(f"{text}\n1 2 3\n", encoding="utf-8")
        with pytest.raises(UserError):
            _read(tmp_path / "u.txt")
    assert plain_name("- " * _LONG + " " * _LONG + "a", "x") == "x"


def test_states_of_links_are_bounded() -> None:
    system = small_system()
    hologram = Hologram(random_drive(system), system)
    with pytest.raises(UserError, match=f"link: {_LONG} characters"):
        shown_by_link(hologram, "1" * _LONG)
    for wrong in ("1", "laser", "=3", "laser1.2.3=off", "laser" + "1" * 4000 + "=off"):
        with pytest.raises(UserError, match="link: "):
            shown_by_link(hologram, wrong)


def test_pages_are_searched_once(tmp_path: Path) -> None:
    start = '<script type="application/json" id="holoview-'
    for text in (f'{start}a">' * (_LONG // 50), start * (_LONG // 50), f"{start}{'a' * _LONG}", "<script" * _LONG):
        (tmp_path / "page.html").write_text(text, encoding="utf-8")
        assert "holds no hologram" in _refusal(tmp_path / "page.html", read_page)
    page = valid("web page")["page.html"]
    (tmp_path / "page.html").write_bytes(page + (f'{start}a">' * 1000).encode())
    assert read_content(str(tmp_path / "page.html"), small_system()).drive is not None


# --- random ones ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("family", _FEW)
def test_hostile_files_are_refused_in_a_sentence_or_read(
    family: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In this process: the whole draw, with limits, is `make fuzz`."""
    monkeypatch.setenv("HOLOVIEW_MEMORY", "3GB")
    for number in range(4):
        case: Case = FAMILIES[family](np.random.default_rng((7, number)))
        folder = tmp_path / str(number)
        folder.mkdir()
        monkeypatch.chdir(folder)
        case.prepare(folder)
        if case.call is not None:
            try:
                case.call()
            except UserError as error:
                assert len(str(error).splitlines()) == 1
