"""Files that somebody wrote to do harm: headers that lie, lists without end, names that lead to pipes, long texts.

Each family draws its cases at random; the files are small, whatever they claim.
"""

from __future__ import annotations

import io
import json
import os
import socket
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import count
from pathlib import Path
from threading import Thread
from typing import TypeVar

import h5py
import numpy as np
import OpenEXR
from PIL import Image, ImageCms, features

from tests.fuzz.corpus import HOSTILE, READERS, TORCH
from tests.fuzz.drawn_chains import chains
from tests.fuzz.field_files import MAT_HEADER, NOTES, read_field
from tests.fuzz.trial import Case
from tests.fuzz.valid_files import BENCH, small_system, valid, write

Random = np.random.Generator
Maker = Callable[[Random], Case]
T = TypeVar("T")

HUGE = (0, 1, 2, 7, 16, 255, 65535, 65536, 2**20, 2**24, 2**27, 2**31 - 1, 2**31, 2**32 - 1)
"""Numbers that headers claim."""


def chosen(rng: Random, values: Sequence[T]) -> T:
    """One of the values."""
    return values[int(rng.integers(len(values)))]


def field_case(family: str, name: str, data: bytes, notes: bytes = b"") -> Case:
    """A case of one file that is read as a field; notes: the content of those beside it."""
    files = {name: data} | ({f"{name}.holoview.toml": notes} if notes else {})
    return Case(
        family, f"{name} of {len(data)} bytes", lambda folder: write(folder, files), call=lambda: read_field(name)
    )


# --- names that lead to something else --------------------------------------------------------------------------------


def _bind(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


SPECIAL: dict[str, Callable[[Path], object]] = {
    "pipe": os.mkfifo,
    "zeros without end": lambda path: path.symlink_to("/dev/zero"),
    "random numbers": lambda path: path.symlink_to("/dev/urandom"),
    "terminal": lambda path: path.symlink_to("/dev/ptmx"),
    "folder": Path.mkdir,
    "socket": _bind,
    "pages of the kernel": lambda path: path.symlink_to("/proc/self/pagemap"),
    "memory of the process": lambda path: path.symlink_to("/proc/self/mem"),
    "link to itself": lambda path: path.symlink_to(path.name),
    "link to nothing": lambda path: path.symlink_to("nothing"),
    "3 GB of nothing": lambda path: os.truncate((path.touch(), path)[1], 3 << 30),
    "no permission": lambda path: (path.touch(), path.chmod(0)),
}
"""What stands where a file should, by its kind."""

_NAMED_BY: dict[str, tuple[str, tuple[str, ...]]] = {
    "base.toml": ("base = 'base.toml'\n", ("info", "bench.toml")),
    "maps.safetensors": (BENCH + "[effects.calibrated]\nfile = 'maps.safetensors'\n", ("render", "bench.toml", *TORCH)),
    "field.npy": (BENCH + "[effects.source_field]\nfile = 'field.npy'\n", ("render", "bench.toml", *TORCH)),
}
_NAMED: dict[str, tuple[str, ...]] = READERS | {
    "page.html": ("info", "page.html"),
    "page.html#plane=3mm": ("render", "page.html#plane=3mm", *TORCH),
    "u.npy": ("info", "u.npy", "--pitch", "8um", "--wavelength", "532nm"),
    "u.npz": ("focus", "u.npz", "--pitch", "8um", "--wavelength", "532nm"),
    "u.mat": ("info", "u.mat", "--guess"),
    "u.h5": ("render", "u.h5", "--guess", *TORCH),
    "u.tif": ("compare", "u.tif", "u.tif"),
    "u.exr": ("point", "u.exr", "--guess", "--at", "0,0mm"),
    "u.bmp": ("info", "u.bmp", "--guess", "--remember"),
    "u.raw": ("info", "u.raw", "--file-note", "binary.dtype=float32", "binary.shape=[4,4]"),
    "rig.toml": ("rig", "show", "rig.toml"),
    "path.csv": ("render", "bench.toml", "--pupil-path", "path.csv", *TORCH),
    "film.mp4": ("optimise", "bench.toml", "film.mp4", "--iterations", "1"),
    "stack": ("optimise", "bench.toml", "stack", "--iterations", "1"),
    "target.png": ("export", "bench.toml", "--html", "o.html", "--target", "target.png"),
}


def special(rng: Random) -> Case:
    """What isn't a plain file in the place of one that a command, a preset, a folder or the name of notes leads to."""
    kind = chosen(rng, list(SPECIAL))
    place = int(rng.integers(10))
    if place < 2:
        file = chosen(rng, list(_NAMED_BY))
        text, arguments = _NAMED_BY[file]
        files = {"bench.toml": text.encode()}
    elif place == 2:
        file, arguments = "u.npy.holoview.toml", ("info", "u.npy", "--guess")
        files = {"u.npy": npy("<c8", "(18, 22)", bytes(8 * 396))}
    elif place == 3:
        file, arguments = chosen(rng, list(valid("folder"))), ("captures", "import", ".", "-o", "o.h5")
        files = {name: data for name, data in valid("folder").items() if name != file}
    else:
        file = chosen(rng, list(_NAMED))
        arguments = _NAMED[file]
        files = {"bench.toml": BENCH.encode(), "p.png": valid("picture")["picture.png"]}
    path = file.partition("#")[0]
    files.pop(path, None)

    def prepare(folder: Path) -> None:
        write(folder, files)
        SPECIAL[kind](folder / path)

    return Case("special files everywhere", f"{kind} as {file}", prepare, arguments)


# --- plain arrays -----------------------------------------------------------------------------------------------------


def npy(descr: str, shape: str, data: bytes = b"", version: int = 1, length: int | None = None) -> bytes:
    """A .npy file with any header. length: that it claims for its header."""
    text = f"{{'descr': {descr!r}, 'fortran_order': False, 'shape': {shape}, }}".encode().ljust(117) + b"\n"
    size = len(text) if length is None else length
    form = "<H" if version == 1 else "<I"
    return (
        b"\x93NUMPY"
        + bytes((version, 0))
        + struct.pack(form, size & (0xFFFF if version == 1 else 2**32 - 1))
        + text
        + data
    )


def arrays(rng: Random) -> Case:
    """.npy and .npz files whose headers claim much, are of other types, or go deep."""
    kinds = (
        "<f4",
        "<c16",
        "|O",
        "<U9999999",
        "|V1000000000",
        "<M8[ns]",
        "(2,3)<f4",
        ">f8",
        "|S",
        "<f2",
        "|b1",
        "x",
        "<i3",
    )
    shapes = ("(18, 22)", "()", "(0, 4)", "(-1, 4)", f"({chosen(rng, HUGE)}, {chosen(rng, HUGE)})", "(1,) * 40")
    shapes += ("(" + "9" * int(rng.integers(1, 5000)) + ", 2)", "(" + ", ".join(["1"] * int(rng.integers(65))) + ")")
    shapes += ("(" * 50 + "1" + ")" * 50, "(3.5, 2)", "(True, 2)", "'ab'", "None", "((1, 2), 3)")
    data = bytes(int(rng.integers(4)) * 1584)
    length = None if rng.random() < 0.8 else chosen(rng, HUGE)
    content = npy(chosen(rng, kinds), chosen(rng, shapes), data, int(rng.integers(1, 4)), length)
    if rng.random() < 0.6:
        return field_case("array headers", "u.npy", content)
    file = io.BytesIO()
    with zipfile.ZipFile(
        file, "w", (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2)[int(rng.integers(3))]
    ) as out:
        for number in range(chosen(rng, (1, 2, 3, 1500))):
            out.writestr(f"u{number}.npy", content)
        if rng.random() < 0.3:
            out.writestr("bomb.npy", npy("<c16", "(2048, 4096)", bytes(1 << 27)))
    packed = bytearray(file.getvalue())
    if rng.random() < 0.5:  # sizes in the archive that lie
        at = packed.rfind(b"PK\x01\x02") + chosen(rng, (20, 24, 42))
        packed[at : at + 4] = struct.pack("<I", chosen(rng, HUGE))
    return field_case("array headers", "u.npz", bytes(packed))


def tensors(rng: Random) -> Case:
    """Safetensors whose header claims what the file doesn't hold."""
    entry = {
        "dtype": chosen(rng, ("F32", "F64", "C64", "BF16", "F4", "", 3, None, "U8")),
        "shape": chosen(rng, ([4, 4], [], [2**31, 2**31], [-1, 4], [1] * 100, "4", None, [4.0, 4], [2**70], {"a": 1})),
        "data_offsets": chosen(
            rng, ([0, 64], [0, 2**40], [64, 0], [-8, 56], [0], [0, 64, 64], None, [0, 2**63], [0.0, 64])
        ),
    }
    header = json.dumps(
        {"u": entry, "__metadata__": chosen(rng, ({}, {"a": "1"}, {"a": 1}, 3, [], {"pitch": "9" * 5000}))}
    )
    if rng.random() < 0.2:
        depth = int(rng.integers(40, 5000))
        header = '{"u":' + "[" * depth + "]" * depth + "}"
    length = len(header) if rng.random() < 0.7 else int(rng.integers(2**63))
    return field_case("tensor headers", "u.safetensors", struct.pack("<Q", length) + header.encode() + bytes(64))


def shrinking(rng: Random) -> Case:
    """A file that another program makes shorter and longer while it is read."""
    names = [name for name in valid("field") if not name.endswith(".toml")]
    name = chosen(rng, names)
    size = len(valid("field")[name])
    lengths = [int(n) for n in rng.integers(0, size, 20)]

    def read() -> None:
        def change() -> None:
            for length in lengths:
                os.truncate(name, length)
                os.truncate(name, 1 << 20)

        thread = Thread(target=change, daemon=True)
        thread.start()
        read_field(name)

    return Case("shrinking files", name, lambda folder: write(folder, valid("field")), call=read)


# --- MATLAB -----------------------------------------------------------------------------------------------------------


def _element(kind: int, data: bytes, size: int | None = None) -> bytes:
    return struct.pack("<II", kind, len(data) if size is None else size) + data + bytes(-len(data) % 8)


def matrix(rng: Random, depth: int, name: bytes = b"u") -> bytes:
    """A matrix of MATLAB with any class, sizes that may lie, and matrices inside, some of which are as they should."""
    kind = int(rng.integers(1, 19)) if depth and rng.random() < 0.9 else int(rng.integers(4, 16))
    lies = rng.random() < 0.3
    count = int(rng.integers(0, 4))
    sizes = [chosen(rng, HUGE) % 2**31 for _ in range(int(rng.integers(1, 5)))] if lies else [1, count]
    flags = kind | (0x0800 if rng.random() < 0.2 else 0)
    head = (
        struct.pack("<IIII", 6, 8, flags, 0) + _element(5, struct.pack(f"<{len(sizes)}i", *sizes)) + _element(1, name)
    )
    inner = b"".join(matrix(rng, depth - 1, b"") for _ in range(count)) if depth else b""
    if kind == 1:
        body = inner
    elif kind in (2, 3):
        length = chosen(rng, (8, 32, 0, -1, 2**31 - 1, 1))
        texts = _element(1, b"class") if kind == 3 else b""
        body = (
            texts
            + _element(5, struct.pack("<i", length))
            + _element(1, b"field\0\0\0" * int(rng.integers(0, 3)))
            + inner
        )
    else:
        part = chosen(rng, (1, 2, 4, 5, 6, 7, 9, 12, 16, 17, 18, 14, 99))
        size = None if rng.random() < 0.8 else chosen(rng, HUGE)
        body = _element(part, bytes(chosen(rng, (0, 1, 8, 64))), size) * int(rng.integers(0, 4)) + inner
    size = None if rng.random() < 0.8 else chosen(rng, HUGE)
    return struct.pack("<II", 14, len(head + body) if size is None else size) + head + body


def matlab(rng: Random) -> Case:
    """Cells, structures and texts that claim more than there is, and that go deep; also packed."""
    if rng.random() < 0.1:
        deep = b""
        for _ in range(int(rng.integers(5, 20_000))):
            deep = struct.pack("<IIIIIIiiII", 6, 8, 1, 0, 5, 8, 1, 1, 1, 0) + deep
            deep = struct.pack("<II", 14, len(deep)) + deep
        parts = [deep]
    else:
        parts = [matrix(rng, int(rng.integers(0, 5))) for _ in range(int(rng.integers(1, 4)))]
    if rng.random() < 0.4:
        packed = [zlib.compress(part) for part in parts]
        parts = [struct.pack("<II", 15, len(part)) + part for part in packed]
    return field_case("MATLAB elements", "u.mat", MAT_HEADER + b"".join(parts))


# --- HDF5 -------------------------------------------------------------------------------------------------------------


def _hdf5(folder: Path, name: str, rng: Random) -> None:
    kind = int(rng.integers(9))
    with h5py.File(folder / name, "w") as h5:
        h5["u"] = np.ones((18, 22))
        if kind == 0:
            h5.create_dataset("v", (chosen(rng, HUGE[4:12]), 4), "f4", chunks=(1, 1))
        elif kind == 1:
            h5.create_dataset("v", (2**20, 2**20), "f8", chunks=(2**10, 2**10), compression="gzip")
        elif kind == 2:
            data = np.zeros((64, 4096, 64), "u1")
            h5.create_dataset("v", data=data, chunks=data.shape, compression="gzip", shuffle=True, fletcher32=True)
        elif kind == 3:
            group = h5
            for _ in range(int(rng.integers(5, 300))):
                group = group.create_group("a")
            group["b"] = h5["/"]
        elif kind == 4:
            for number in range(int(rng.integers(1, 3000))):
                h5[f"a{number}"] = h5py.SoftLink(f"/a{number + 1}")
        elif kind == 5:
            h5["v"] = h5py.ExternalLink(chosen(rng, (name, "/dev/zero", "pipe", "nothing")), "u")
        elif kind == 6:
            h5.create_dataset("v", (4, 4), h5py.string_dtype())
            h5["w"] = np.zeros((3, 3), np.dtype([("real", "f8"), ("imag", "f8"), ("more", "S9")]))
            h5.create_dataset("x", (3, 3), h5py.ref_dtype)
        elif kind == 7:
            for number in range(200):
                h5["u"].attrs[f"a{number}"] = number
            h5.attrs["pitch"] = np.zeros(8000)
        else:
            h5.create_dataset("v", (2, 3, 4), "f8", external=[("pipe", 0, h5py.h5f.UNLIMITED)])
    os.mkfifo(folder / "pipe")


def hdf5(rng: Random) -> Case:
    """Chunks without number, filters, groups and links that lead in circles; with damage to a third of them."""
    seed, damage = int(rng.integers(1 << 30)), rng.random() < 0.35

    def prepare(folder: Path) -> None:
        again = np.random.default_rng(seed)
        _hdf5(folder, "u.h5", again)
        if damage:
            data = bytearray((folder / "u.h5").read_bytes())
            for _ in range(int(again.integers(1, 6))):
                at = int(again.integers(min(len(data), 4096)))
                data[at : at + 4] = struct.pack("<I", chosen(again, HUGE))
            (folder / "u.h5").write_bytes(data)

    if rng.random() < 0.3:
        return Case("HDF5 structures", f"captures {seed}", prepare, ("captures", "check", "u.h5", "--json"))
    return Case("HDF5 structures", f"field {seed}", prepare, call=partial(read_field, "u.h5"))


# --- pictures ---------------------------------------------------------------------------------------------------------


def _tiff(rng: Random) -> bytes:
    """Lists of pages that are long, bite their tails or lie elsewhere, with tags that claim anything."""
    is_big = rng.random() < 0.3
    head = b"II+\x00\x08\x00\x00\x00" + struct.pack("<Q", 16) if is_big else b"II*\x00" + struct.pack("<I", 8)
    count = chosen(rng, (1, 2, 3, 50, 12_000))
    tags = [(256, 4, 1, 22), (257, 4, 1, 18), (258, 3, 1, 8), (259, 3, 1, 1), (262, 3, 1, 1), (273, 4, 1, 8)]
    tags += [(277, 3, 1, 1), (278, 4, 1, 18), (279, 4, 1, 396)]
    out = bytearray(head)
    for page in range(count):
        entries = b""
        for tag, kind, number, value in tags:
            if page < 3 and rng.random() < 0.08:
                kind, number, value = int(rng.integers(0, 20)), chosen(rng, HUGE), chosen(rng, HUGE)
            entries += struct.pack("<HHQQ" if is_big else "<HHII", tag, kind, number, value)
        size = (8 if is_big else 2) + len(entries) + (8 if is_big else 4)
        following = len(out) + size if page + 1 < count else chosen(rng, (0, 0, 8, 16, 2**31, len(out)))
        out += (
            struct.pack("<Q" if is_big else "<H", len(tags))
            + entries
            + struct.pack("<Q" if is_big else "<I", following)
        )
    return bytes(out) + bytes(396)


def _png(rng: Random) -> bytes:
    width, height = (chosen(rng, HUGE) for _ in range(2))
    bits, colour = chosen(rng, (1, 2, 4, 8, 16, 32)), int(rng.integers(8))
    zeros = zlib.compress(bytes(chosen(rng, (10, 1000, 50_000_000))), 1)
    parts = [(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, int(rng.integers(2))))]
    if rng.random() < 0.3:
        parts.append((b"zTXt", b"a\0\0" + zlib.compress(bytes(80_000_000), 1)))
    parts += [(b"IDAT", zeros), (b"IEND", b"")]
    chunk = lambda name, data: struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))  # noqa: E731
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(name, data) for name, data in parts)


def _gif(rng: Random) -> bytes:
    width, height = (chosen(rng, HUGE) & 0xFFFF for _ in range(2))
    frame = b"\x2c" + struct.pack("<HHHHB", 0, 0, width, height, 0) + b"\x02\x02\x4c\x01\x00"
    return b"GIF89a" + struct.pack("<HHBBB", width, height, 0xF0, 0, 0) + bytes(6) + frame * int(rng.integers(1, 2000))


def _bmp(rng: Random) -> bytes:
    sizes = [chosen(rng, HUGE) for _ in range(3)]
    header = struct.pack(
        "<IIIHHIIIIII", 40, sizes[0], sizes[1], 1, chosen(rng, (1, 4, 8, 16, 24, 32)), 0, 0, 1, 1, 0, 0
    )
    return b"BM" + struct.pack("<III", sizes[2], 0, 54) + header + bytes(64)


def _pgm(rng: Random) -> bytes:
    numbers = [chosen(rng, (*HUGE, "9" * 4000, "-1", "#" * 100)) for _ in range(3)]
    return b"P%d\n%s\n" % (int(rng.integers(1, 8)), " ".join(map(str, numbers)).encode()) + bytes(64)


def _exr(rng: Random) -> bytes:
    file = io.BytesIO()
    rows = np.ones((18, 22), np.float32)
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    name = f"/dev/shm/holoview-fuzz-{os.getpid()}.exr"
    OpenEXR.File(header, {"R": rows, "G": rows, "B": rows}).write(name)
    data = bytearray(Path(name).read_bytes())
    Path(name).unlink()
    for _ in range(int(rng.integers(1, 6))):
        at = int(rng.integers(min(len(data), 600)))
        data[at : at + 4] = struct.pack("<I", chosen(rng, HUGE))
    file.write(data)
    return file.getvalue()


def _webp(rng: Random) -> bytes:
    """An animation, or one picture, whose canvas, frames, stream and lengths state sizes of their own."""

    def pair() -> bytes:
        return b"".join((chosen(rng, HUGE) & 0xFFFFFF).to_bytes(3, "little") for _ in range(2))

    def chunk(name: bytes, data: bytes) -> bytes:
        length = len(data) if rng.random() < 0.9 else chosen(rng, HUGE)
        return name + struct.pack("<I", length) + data + bytes(len(data) % 2)

    stream = chunk(b"VP8L", b"\x2f" + struct.pack("<I", chosen(rng, HUGE) & 0x0FFFFFFF) + bytes(24))
    frames = chunk(b"ANMF", bytes(6) + pair() + bytes(4) + stream) * int(rng.integers(0, 2000))
    body = b"WEBP" + chunk(b"VP8X", b"\x02\0\0\0" + pair()) + chunk(b"ANIM", bytes(6)) + (frames or stream)
    return b"RIFF" + struct.pack("<I", chosen(rng, (len(body), len(body), *HUGE))) + body


def _avif(rng: Random) -> bytes:
    """A picture in boxes, some of whose lengths, sizes, bits and places lie; bare boxes where there is no encoder."""
    stream = io.BytesIO()
    if features.check("avif"):
        Image.new("RGB", (22, 18)).save(stream, "AVIF")
    data = bytearray(stream.getvalue() or b"\0\0\0\x18ftypavif\0\0\0\0avifmif1\0\0\0\x14ispe" + bytes(12))
    names = [name for name in (b"ispe", b"pixi", b"av1C", b"iloc", b"meta", b"iprp", b"ipco", b"mdat") if name in data]
    for _ in range(int(rng.integers(1, 4))):
        at = data.find(chosen(rng, names)) + chosen(rng, (-4, 4, 8, 12))
        data[at : at + 4] = struct.pack(">I", chosen(rng, HUGE))
    return bytes(data)


_PICTURES: dict[str, Callable[[Random], bytes]] = {
    "u.tif": _tiff, "u.png": _png, "u.gif": _gif, "u.bmp": _bmp, "u.pgm": _pgm, "u.exr": _exr, "u.webp": _webp,
    "u.avif": _avif, "u.heic": lambda rng: _avif(rng).replace(b"avif", b"heic"),
}  # fmt: skip


def pictures(rng: Random) -> Case:
    """Pictures whose headers claim much, or whose pages have no end, as fields and as targets."""
    name = chosen(rng, list(_PICTURES))
    data = _PICTURES[name](rng)
    is_field = name in ("u.bmp", "u.pgm") or (rng.random() < 0.6 and name not in ("u.webp", "u.avif", "u.heic"))
    if is_field:
        return field_case("picture headers", name, data)

    def read() -> None:
        from holoview.holograms.files.image_reader import animation_count, picture_count, read_rasters

        for raster in read_rasters(Path(name)):
            assert raster.values.size
        picture_count(Path(name))
        animation_count(Path(name))

    return Case("picture headers", f"target {name}", lambda folder: write(folder, {name: data}), call=read)


# --- texts ------------------------------------------------------------------------------------------------------------

_UNITS_OF_TEXT = (
    "1", "9", ".", "1.", "-", " ", "\t", ",", "1,", "1 ", "e", "1e", "a", "a.", "[", "{a=", '"', "\\", "é", "=", "\n",
    "1\n", "(", "0x", "#", "\x00", "\r", "'", "1_", "inf ", "ab-", "- ", "<", ";", "'''",
)  # fmt: skip


def long_text(rng: Random) -> str:
    """Up to a million characters: a few pieces, each repeated, so that a search that goes back takes very long."""
    pieces = []
    for _ in range(int(rng.integers(1, 4))):
        count = chosen(rng, (3, 100, 1200, 2400, 20_000, 300_000))
        pieces.append(chosen(rng, _UNITS_OF_TEXT) * count)
    return "".join(pieces)


def texts(rng: Random) -> Case:
    """Long texts as numbers with units, tables, notes, presets, sweeps and links."""
    text = long_text(rng)
    data = text.encode()
    quoted = json.dumps(text, ensure_ascii=False)[1:-1].replace("\x7f", "")
    kind = int(rng.integers(9))
    if kind == 0:
        return field_case("long texts", "u.txt", b"1 2 3\n" * int(rng.integers(2)) + data)
    if kind == 1:
        notes = NOTES.replace("20 cm", quoted).encode()
        return field_case("long texts", "u.npy", npy("<c8", "(18, 22)", bytes(8 * 396)), notes)
    if kind == 2:
        return field_case("long texts", "u.ohc", b"OH\r\n" + data)
    commands: dict[int, tuple[dict[str, bytes], tuple[str, ...]]] = {
        3: ({"bench.toml": BENCH.replace('"8 um"', f'"{quoted} um"').encode()}, ("info", "bench.toml")),
        4: ({"bench.toml": data}, ("info", "bench.toml")),
        5: ({"sweep.csv": data}, ("calibrate", "lut", "sweep.csv")),
        6: (
            {"bench.toml": BENCH.encode(), "path.csv": data},
            ("render", "bench.toml", "--pupil-path", "path.csv", *TORCH),
        ),
        7: (valid("web page"), ("info", f"page.html#{text[:100_000].replace(chr(0), '')}")),
        8: ({"bench.toml": BENCH.replace('"small"', f'"{quoted}"').encode()}, ("render", "bench.toml", *TORCH)),
    }
    files, arguments = commands[kind]
    return Case("long texts", f"{kind}: {text[:20]!r} of {len(text)}", lambda folder: write(folder, files), arguments)


def pages(rng: Random) -> Case:
    """Web pages with beginnings that have no end, names without end, and JSON that goes deep."""
    start = '<script type="application/json" id="holoview-'
    pieces = (
        start + 'a">',
        start,
        start + "a" * 200,
        "</script>",
        "<script",
        '">',
        start + 'page">',
        "[" * 1000,
        '{"a":',
    )
    text = "".join(chosen(rng, pieces) * chosen(rng, (1, 10, 5000)) for _ in range(int(rng.integers(1, 6))))
    page = text.encode() if rng.random() < 0.5 else valid("web page")["page.html"] + text.encode()

    def read() -> None:
        from holoview.viewer.document.file_loader import read_content

        read_content("page.html", small_system())

    name = f"{text[:40]!r} of {len(text)}"
    return Case("hostile pages", name, lambda folder: write(folder, {"page.html": page}), call=read)


# --- a field over the network -----------------------------------------------------------------------------------------


def pushes(rng: Random) -> Case:
    """A damaged .npy file sent to a listening viewer: the answer is JSON with a sentence, or the field is received."""
    kinds = ("<f4", "<c16", "|O", "<U9", "|V8", "x", ">c8")
    shape = str(
        chosen(rng, ("(18, 22)", f"({chosen(rng, HUGE)}, {chosen(rng, HUGE)})", "(-1, 4)", "()", "None", "(3, 18, 22)"))
    )
    body = npy(chosen(rng, kinds), shape, bytes(int(rng.integers(4)) * 3168), int(rng.integers(1, 4)))
    body = body[: int(rng.integers(1, len(body) + 1))] if rng.random() < 0.3 else body
    key = str(
        chosen(rng, ("pitch=8um&wavelength=532nm", "pitch=" + "9" * 3000, "", "wavelength=532nm&pitch=[", "pitch=nanm"))
    )

    def send() -> None:
        import http.client

        from holoview.holograms.fields.exchange import HOST, FieldListener

        os.environ["XDG_CACHE_HOME"] = str(Path.cwd())
        listening = FieldListener(lambda field: None)
        connection = http.client.HTTPConnection(HOST, listening.listener.port, timeout=20)
        headers = {"Authorization": f"Bearer {listening.listener.token}"}
        connection.request("PUT", f"/fields/u?{key}", body, headers)
        answer = connection.getresponse()
        told = json.loads(answer.read())
        assert answer.status == 200 or (400 <= answer.status < 500 and len(told["error"].splitlines()) == 1)

    return Case("pushed fields", f"{shape} {key[:20]}", lambda folder: None, call=send)


# --- what is measured, and who looks ----------------------------------------------------------------------------------

_VALUES = (*HOSTILE, "-1", "5", "60", "2.5", "1e6", "a,b", "0,0,4,4", "4,4,1,1")
_CONTRAST = ("region", "dark", "black", "gain", "read-noise", "repeat", "lasers", "together", "edge", "target")
_REPORT = ("edge", "contrast-ratio", "region", "observer", "plane", "target")
_METER = ("f-number", "pixel", "bits", "exposure")
_EYES = ("age", "field", "person", "lens", "macula", "L", "shift-M", "nosuch")
_WORDS = ("C", "C<", "C < 0.4", "C < nan", "C > 1e999", "PSNR > 3", "<", "C == C", "0.4 < C", "C < " + "9" * 3000)


def _damaged(rng: Random, data: bytes) -> bytes:
    """A file with some bytes changed, or cut off."""
    body = bytearray(data)
    for _ in range(int(rng.integers(1, 9))):
        body[int(rng.integers(len(body)))] = int(rng.integers(256))
    return bytes(body[: int(rng.integers(1, len(body) + 1))] if rng.random() < 0.4 else body)


def _picture_png(rng: Random, profile: bytes | None = None) -> bytes:
    """A small picture: of noise, of one value, or black."""
    shape = chosen(rng, ((24, 32, 3), (24, 32), (1, 1), (3, 2), (40, 40)))
    high = int(chosen(rng, (256, 1, 2)))
    pixels = rng.integers(0, high, shape, dtype=np.uint8) + np.uint8(255 * (high == 1 and rng.random() < 0.5))
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG", icc_profile=profile)
    return stream.getvalue()


def _response_table(rng: Random) -> bytes:
    """A table of cones or a camera, with gaps, other units, text, or too many columns."""
    first, step = chosen(rng, ((380, 5), (400, 40), (0.38, 0.01), (3800, 50), (700, -5), (500, 0)))
    columns = int(rng.integers(0, 5))
    cells = ("", "nan", "1e400", "0,5", "x", "-3", "0.4", "0.7", "120")
    rows = [
        ",".join([str(first + step * row), *(chosen(rng, cells) for _ in range(columns))])
        for row in range(int(chosen(rng, (0, 1, 2, 60, 4000))))
    ]
    return "\n".join([chosen(rng, ("", "wavelength,L,M,S", "nm,r,g,b", "a,a,a")), *rows]).encode()


def measures(rng: Random) -> Case:
    """Photographs, instruments, observers, profiles, files of light and claims on a hologram."""
    kind, value = int(rng.integers(10)), chosen(rng, _VALUES)
    bench, photograph = {"bench.toml": BENCH.encode()}, {"seen.png": _picture_png(rng)}
    light = valid("light")
    name = chosen(rng, sorted(light))
    commands: dict[int, tuple[dict[str, bytes], tuple[str, ...]]] = {
        0: (photograph, ("contrast", "seen.png", "--json", f"--{chosen(rng, _CONTRAST)}={value}")),
        1: (photograph | {"dark.png": _picture_png(rng)}, ("contrast", "seen.png", "--dark", "dark.png", "--json")),
        2: (bench, ("contrast", "bench.toml", "--meter", "camera", f"--{chosen(rng, _METER)}={value}", "--json")),
        3: (bench, ("render", "bench.toml", f"--observer={chosen(rng, _EYES)} {value}", *TORCH)),
        4: (
            bench | {"who.csv": _response_table(rng)},
            ("render", "bench.toml", "--observer", "who.csv", *TORCH),
        ),
        5: (
            bench | {"picture.png": _picture_png(rng, _damaged(rng, _profile()))},
            ("optimise", "bench.toml", "picture.png", "--iterations", "1", "--json"),
        ),
        6: ({name: _damaged(rng, light[name])}, (chosen(rng, ("contrast", "compare")), name, "--json")),
        7: (valid("hologram"), ("report", "hologram.safetensors", "-o", "r.html", f"--claim={chosen(rng, _WORDS)}")),
        8: (valid("hologram"), ("report", "hologram.safetensors", "-o", "r.html", f"--{chosen(rng, _REPORT)}={value}")),
        9: (
            valid("hologram") | {"picture.png": _picture_png(rng)},
            ("contrast", "hologram.safetensors", "--target", "picture.png", "--json"),
        ),
    }
    files, arguments = commands[kind]
    if arguments[0] == "compare":
        arguments = ("compare", name, f"whole-{name}", "--json")
        files = files | {f"whole-{name}": light[name]}
    shown = " ".join(text[:20] for text in arguments[1:])
    return Case("measured numbers", f"{kind}: {shown!r}", lambda folder: write(folder, files), arguments)


_KEYS = ("planes", "frames", "pitch", "stroke", "shape", "levels", "name", "observer", "effects", "eye.pupil", "gap")
_KEYS += ("relay2.iris_na", "effects.stroke.stroke_error", "effects.distance.distance_error", "optimiser.iterations")
_KEYS += ("optimiser.eyebox", "optimiser.nosuch", "nosuch", "", "modulators.0.pitch", "a" * 5000, "x." * 500)
_ENDS = (*HOSTILE, "1", "3", "-1", "2.5", "1mm", "3mm", "5um", "0.1mrad", "1D", "1kg", "[1,2]", "{", '"', "a:b", "1,,")
_RANGES = ("1mm:3mm:3", "0:0.1:2", "1,2", "5um:9um:2", "800nm,900nm", "0:1um:2", "[12,16],[16,16]", "2,4", "-0.1:0.1:3")
_TOLERANCES = ("psnr=1dB", "light=1%", "contrast=1e-9", "psnr=nan", "=", "psnr=1e400", "nosuch=1", "psnr=" + "9" * 400)


def sweeps(rng: Random) -> Case:
    """Parameters, ranges, lists, measures and tolerances of a sweep that no bench has."""
    changes = []
    for _ in range(int(rng.integers(1, 3))):
        count = int(rng.integers(1, 5))
        text = chosen(rng, (":", ",", ":", ";")).join(chosen(rng, _ENDS) for _ in range(count))
        text = chosen(rng, _RANGES) if rng.random() < 0.6 else text
        changes.append(f"--set={chosen(rng, _KEYS)}={text}")
    more = [f"--measure={chosen(rng, ('light', 'contrast,eyebox', 'psnr', 'nosuch', '', 'light,' * 500))}"]
    more += [f"--tolerance={chosen(rng, _TOLERANCES)}"] if rng.random() < 0.3 else []
    more += [f"--region={chosen(rng, _VALUES)}"] if rng.random() < 0.2 else []
    more += [f"--plane={chosen(rng, _VALUES)}"] if rng.random() < 0.2 else []
    arguments = ("sweep", "bench.toml", "-o", "s.csv", *changes, *more)
    shown = " ".join(text[:30] for text in arguments[4:])
    return Case("sweeps", shown[:120], lambda folder: write(folder, {"bench.toml": BENCH.encode()}), arguments)


def _profile() -> bytes:
    return ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


FAMILIES: dict[str, Maker] = {
    "special files everywhere": special,
    "array headers": arrays,
    "tensor headers": tensors,
    "shrinking files": shrinking,
    "MATLAB elements": matlab,
    "HDF5 structures": hdf5,
    "picture headers": pictures,
    "long texts": texts,
    "hostile pages": pages,
    "pushed fields": pushes,
    "measured numbers": measures,
    "sweeps": sweeps,
    "chains": chains,
}
"""Each family of hostile files, with what draws one of its cases."""


def hostile_cases(seed: int, families: Sequence[str] | None = None) -> Iterator[Case]:
    """Cases without end, the families in turn; all if None. A case depends on the seed and its number alone."""
    makers = [make for name, make in FAMILIES.items() if families is None or name in families]
    for number in count():
        yield makers[number % len(makers)](np.random.default_rng((seed, number)))
