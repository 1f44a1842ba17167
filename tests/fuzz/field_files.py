"""Small valid holograms in every format that other programs write, and hostile ones whose headers or links lie."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np
import OpenEXR
import scipy.io
import tifffile
from PIL import Image
from safetensors.numpy import save_file

from tests.fuzz.trial import Case

_SHAPE = (18, 22)
_WAVES = [640e-9, 532e-9, 473e-9]
MAT_HEADER = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
NOTES = """pitch = ["8 um", "8 um"]
wavelengths = ["532 nm"]
distance = "20 cm"
conjugated = true
phase_levels = 255
"""
RAW_NOTES = """pitch = "8 um"
wavelengths = ["532 nm"]
[binary]
dtype = "<f4"
shape = [18, 22]
parts = ["real", "imaginary"]
interleaved = false
order = "F"
"""


def make_fields(folder: Path) -> None:
    """One file of each format, with notes beside one picture and one dump."""
    rng = np.random.default_rng(5)
    u = rng.normal(size=(3, *_SHAPE)) + 1j * rng.normal(size=(3, *_SHAPE))
    levels = rng.integers(0, 256, _SHAPE).astype(np.uint8)
    np.save(folder / "u.npy", u)
    np.savez(folder / "u.npz", Hol=u, pp=8e-6, wlen=_WAVES)
    np.savez_compressed(folder / "packed.npz", Hol=u[0], z=0.2)
    whole = {"CGH": {"Hol": np.moveaxis(u, 0, -1), "setup": {"pp": 8e-6, "wlen": _WAVES}}, "cells": [1.0, "a", levels]}
    scipy.io.savemat(folder / "u.mat", whole)
    scipy.io.savemat(folder / "packed.mat", {"dh": u[0], "pp": 8e-6}, do_compression=True)
    with h5py.File(folder / "u73.mat", "w", userblock_size=512) as file:
        pairs = np.empty(_SHAPE[::-1], [("real", "<f8"), ("imag", "<f8")])
        pairs["real"], pairs["imag"] = u[0].T.real, u[0].T.imag
        file.create_dataset("CGH/Hol", data=pairs, chunks=(8, 8), compression="gzip")
        file["CGH/Hol"].attrs["MATLAB_class"] = np.bytes_("double")
        file["CGH/pp"] = [[8e-6]]
    with (folder / "u73.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    with h5py.File(folder / "u.h5", "w") as file:
        file["a/field"] = u
        file["a"].attrs["wavelength"] = _WAVES
    tifffile.imwrite(folder / "u.tif", u[0].astype("c8"))
    tifffile.imwrite(folder / "stack.tif", np.stack([levels] * 3), photometric="minisblack", compression="zlib")
    channels = {c: u[i].real.astype("f4").copy() for i, c in enumerate("RGB")}
    OpenEXR.File({}, channels).write(str(folder / "u_real.exr"))
    for name in ("phase.png", "phase.bmp", "phase.jpg", "phase.pgm", "phase.gif"):
        Image.fromarray(levels).save(folder / name)
    (folder / "phase.png.holoview.toml").write_text(NOTES, encoding="utf-8")
    (folder / "u.ohc").write_bytes(openholo(u))
    (folder / "text.ohc").write_bytes(_openholo_text(u[0]))
    save_file({"u_real": u[0].real.astype("f4"), "u_imag": u[0].imag.astype("f4")}, folder / "u.safetensors")
    rows = "\r\n".join(" ".join(f"{x:.4g}" for x in row) for row in u[0].real)
    (folder / "u.txt").write_bytes(rows.encode())
    (folder / "u.raw").write_bytes(b"HOLO" + np.stack([u[0].real, u[0].imag]).astype("<f4").tobytes())
    (folder / "u.raw.holoview.toml").write_text(RAW_NOTES, encoding="utf-8")


def openholo(u: np.ndarray, columns: int | None = None, count: int = 3, kind: int = 10, store: int = 1) -> bytes:
    """An OpenHolo file with any sizes and codes in its header."""
    body = np.stack([u.real, u.imag]).astype("<f8").tobytes()
    width = u.shape[2] if columns is None else columns
    fields = (97, width, u.shape[1], 8e-6, 8e-6, 1, count, 1, 2, 1, kind, store, 2, 0, -1.0, 1.0, len(body), 0)
    header = struct.pack("<IIIddBIBBBBBBBddQB", *fields) + struct.pack("<3d", *_WAVES)
    start = 24 + len(header)
    return struct.pack("<2sQBBIII", b"OH", start + len(body), 3, 0, 0, 0, start) + header + body


def _openholo_text(u: np.ndarray) -> bytes:
    fields = (88, u.shape[1], u.shape[0], 8e-7, 8e-7, 1, 1, 2, 2, 1, 10, 1, 2, 0, -1, 1, 16 * u.size, 0, 5.32e-7)
    head = (b"OH", b"1", b"\0", b"\2", b"0", b"0", b"120", *(str(field).encode() for field in fields))
    numbers = " ".join(f"{x:.6g}" for x in np.stack([u.real, u.imag]).ravel())
    return b"\r\n".join(head) + b"\r\n" + numbers.encode()


def read_field(name: str) -> None:
    """Reads a file with guesses for whatever it doesn't say, whole and in parts; what is read is finite."""
    from dataclasses import replace

    from holoview.holograms.fields.reading import ReadRequest, read_wavefield
    from holoview.util.errors import UserError

    request = ReadRequest(accept_guesses=True)
    reading = read_wavefield(name, request)
    for part in (reading, read_wavefield(name, replace(request, region=(1, 1, 4, 4), decimate=2))):
        values = part.recording.pictures if part.wavefield is None else part.wavefield.values
        assert np.isfinite(values).all()
    for candidate in reading.candidates[1:4]:
        try:
            read_wavefield(name, replace(request, variable=candidate.name))
        except UserError as error:
            assert len(str(error).splitlines()) == 1


# --- hostile files ---


def hostile_fields() -> Iterator[Case]:
    """Files whose headers claim much, that unpack to much, that go deep, or that name other files."""
    for name, data in _hostile().items():
        yield Case("fields", name, _writer(name, data), call=_reader(name))
    for name in ("loop.h5", "linked.h5", "virtual.h5", "external.h5"):
        yield Case("fields", name, _h5_writer(name), call=_reader(name))
    for index, text in enumerate(_HOSTILE_NOTES):
        name = f"notes {index}.npy"
        notes = {name: _npy("<c8", "(18, 22)", bytes(8 * 18 * 22)), f"{name}.holoview.toml": text.encode()}
        yield Case("fields", name, _writer(notes), call=_reader(name))


def _writer(name: str | dict[str, bytes], data: bytes = b"") -> Callable[[Path], None]:
    files = name if isinstance(name, dict) else {name: data}

    def write(folder: Path) -> None:
        for file, content in files.items():
            (folder / file).write_bytes(content)

    return write


def _reader(name: str) -> Callable[[], None]:
    return lambda: read_field(name)


_HOSTILE_NOTES = (
    'pitch = "8 m"', "pitch = []", "pitch = [1, 2, 3]", "pitch = true", 'wavelengths = ["0 nm"]', "wavelengths = nan",
    'distance = "1e400 mm"', "phase_levels = 0", "phase_levels = nan", "refractive_index = -1", "parts = [[]]",
    "quantity = 3", 'quantity = "colour"', 'variable = ""', 'variable = ",,,"', "nosuch = 1", "binary = 3",
    '[binary]\ndtype = "O"\nshape = [1, 1]', '[binary]\ndtype = "<f4"\nshape = [-1, 4]', '[binary]\ndtype = "<f4"',
    '[binary]\ndtype = "<f4"\nshape = [99999999999, 99999999999]', '[binary]\ndtype = "(2,2)f4"\nshape = [2, 2]',
    '[binary]\ndtype = "<f4"\nshape = [2, 2]\noffset = -5', '[binary]\ndtype = "<f4"\nshape = []\norder = "X"',
    '[binary]\ndtype = "<f4"\nshape = [2, 2]\nparts = ["a", "b", "c"]', '[binary]\ndtype = ","\nshape = [2, 2]',
    '[binary]\ndtype = "<c16"\nshape = [2, 2]\nparts = ["real", "imaginary"]\ninterleaved = true', "colour_axis = 1",
    'colour_axis = "middle"', "transposed = 3", 'recording = "x"', 'recording = "off-axis"', "[[pitch]]", "a = [[[",
    "orders = 3", "orders = [[]]", "orders = [[0.1]]", 'orders = [["a", 0.1]]', "orders = [[0.7, 0.1]]", "steps = 3",
    "orders = [[0, 0]]", "orders = [[0.1, 0.2, -1]]", "orders = [[nan, 0.2]]", 'steps = "some"', "steps = [1]",
    "steps = [[0], 1, 2]", 'recording = "phase-shifting"\nsteps = [0, 0, 0]', "steps = [0, 90, 180]",
    "colour_shifts = 1", "colour_shifts = [[1]]", 'colour_shifts = [["1 m", "0 m"]]',
    'colour_shifts = [["nan m", "0 m"]]', 'colour_shifts = [["1 um", "0 m"], ["0 m", 1]]',
)  # fmt: skip


def _npy(descr: str, shape: str, data: bytes = b"", fortran: str = "False") -> bytes:
    text = f"{{'descr': {descr!r}, 'fortran_order': {fortran}, 'shape': {shape}, }}"
    header = text.encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data


def _npz(member: bytes, name: str = "u.npy") -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr(name, member)
    return file.getvalue()


def _mat(kind: int, sizes: tuple[int, ...], body: bytes, flags: int = 6) -> bytes:
    shape = struct.pack(f"<II{len(sizes)}i", 5, 4 * len(sizes), *sizes) + bytes(4 * (len(sizes) % 2))
    matrix = struct.pack("<IIII", 6, 8, flags, 0) + shape + struct.pack("<HH4s", 1, 1, b"u") + body
    return struct.pack("<II", kind, len(matrix)) + matrix


def _nested(depth: int) -> bytes:
    inner = b""
    for _ in range(depth):
        inner = struct.pack("<II", 14, len(inner)) + inner
    return MAT_HEADER + _mat(14, (1, 1), inner, flags=2)


def _packed(matrix: bytes, stated: int | None = None) -> bytes:
    data = bytearray(matrix)
    if stated is not None:
        data[4:8] = struct.pack("<I", stated)
    packed = zlib.compress(bytes(data), 1)
    return MAT_HEADER + struct.pack("<II", 15, len(packed)) + packed


def _hostile() -> dict[str, bytes]:
    rng = np.random.default_rng(7)
    u = rng.normal(size=(3, *_SHAPE)) + 1j * rng.normal(size=(3, *_SHAPE))
    numbers = struct.pack("<II", 9, 8) + bytes(8)
    huge = "(" + ", ".join(["999999999"] * 3) + ")"
    return {
        "huge.npy": _npy("<c16", huge),
        "huge int.npy": _npy("<c16", "(" + "9" * 4000 + ", 2)"),
        "negative.npy": _npy("<c16", "(-4, 4)", bytes(256)),
        "objects.npy": _npy("|O", "(4, 4)", bytes(256)),
        "records.npy": _npy("|V8", "(4, 4)", bytes(256)),
        "deep.npy": b"\x93NUMPY\x01\x00" + struct.pack("<H", 9000) + b"(" * 9000,
        "code.npy": _npy("<c16", "__import__('os').system('true')"),
        "nan.npy": _npy("<f8", "(18, 22)", np.full(_SHAPE, np.nan).tobytes()),
        "infinite.npy": _npy("<f8", "(18, 22)", np.full(_SHAPE, np.inf).tobytes()),
        "overflow.npy": _npy("<f8", "(18, 22)", np.full(_SHAPE, 1e300).tobytes()),
        "no axes.npy": _npy("<c16", "()", bytes(16)),
        "six axes.npy": _npy("<c8", "(3, 3, 3, 3, 3, 3)", bytes(8 * 729)),
        "fortran.npy": _npy("<c8", "(18, 22)", bytes(8 * 396), "True"),
        "one row.npy": _npy("<c8", "(1, 400)", bytes(8 * 400)),
        "zeros.npy": _npy("<f4", "(18, 22)", bytes(4 * 396)),
        "bomb.npz": _npz(_npy("<c16", "(4096, 4096)", bytes(1 << 28))),
        "larger bomb.npz": _npz(_npy("<c16", "(16384, 16384)", bytes(1 << 26))),
        "absolute.npz": _npz(_npy("<c8", "(18, 22)", bytes(8 * 396)), "../../../etc/u.npy"),
        "empty.npz": _npz(b""),
        "nested 10.mat": _nested(10),
        "nested 20000.mat": _nested(20000),
        "huge.mat": MAT_HEADER + _mat(14, (65536, 65536), numbers),
        "overflowing.mat": MAT_HEADER + _mat(14, (2**31 - 1,) * 8, numbers),
        "negative.mat": MAT_HEADER + _mat(14, (-1, 4), numbers),
        "object.mat": MAT_HEADER + _mat(14, (1, 1), numbers, flags=3),
        "opaque.mat": MAT_HEADER + _mat(14, (1, 1), numbers, flags=17),
        "sparse.mat": MAT_HEADER + _mat(14, (4, 4), numbers, flags=5),
        "function.mat": MAT_HEADER + _mat(14, (4, 4), numbers, flags=16),
        "unknown class.mat": MAT_HEADER + _mat(14, (4, 4), numbers, flags=99),
        "bomb.mat": _packed(_mat(14, (8192, 16384), struct.pack("<II", 9, 1 << 27) + bytes(1 << 27), flags=9)),
        "lying bomb.mat": _packed(_mat(14, (8, 8), struct.pack("<II", 9, 1 << 27) + bytes(1 << 27), flags=9), 200),
        "claims 4 GB.mat": _packed(_mat(14, (8, 8), struct.pack("<II", 9, 2**32 - 1) + bytes(64), flags=9), 2**32 - 1),
        "many.mat": MAT_HEADER + _mat(14, (1, 1), numbers) * 2000,
        "no text.mat": MAT_HEADER,
        "wide.ohc": openholo(u, columns=2**32 - 1),
        "no columns.ohc": openholo(u, columns=0),
        "wavelengths.ohc": openholo(u, count=2**32 - 1),
        "pictures.ohc": openholo(u, kind=11),
        "links.ohc": openholo(u, store=2) + b"/etc/passwd\0" * 10,
        "codes.ohc": openholo(u, kind=99),
        "text.ohc": b"OH\r\n" + b"9" * 5000 + b"\r\n" * 30,
        "ragged.txt": b"1 2 3\n4 5\n6 7 8 9\n",
        "numbers.txt": b"1e999 2 3\n4 nan 5\n" + b"1" * 4000 + b" 2 3\n",
        "pickle.pt": b"\x80\x04cos\nsystem\n(S'true'\ntR.",
        "archive.pt": _npz(b"\x80\x02}.", "archive/data.pkl"),
        "many axes.safetensors": _safetensors('{"u":{"dtype":"F32","shape":[99999,99999],"data_offsets":[0,4]}}'),
        "deep.safetensors": _safetensors('{"u":' + "[" * 5000 + "]" * 5000 + "}"),
        "empty.bin": b"",
        "nothing.bin": b"\1\2\3",
        "header only.tif": b"II*\x00\x08\x00\x00\x00",
        "plain.bmp": b"BM" + struct.pack("<IIIIiiHHIIiiII", 54, 0, 54, 40, 60000, 60000, 1, 24, 0, 0, 1, 1, 0, 0),
        "wide.pgm": b"P5\r\n2000000000 2000000000\r\n255\r\n\0\0",
    }


def _safetensors(header: str) -> bytes:
    return struct.pack("<Q", len(header)) + header.encode() + bytes(4)


def _h5_writer(name: str) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        with h5py.File(folder / "other.h5", "w") as other:
            other["u"] = np.ones(_SHAPE)
        with h5py.File(folder / name, "w") as file:
            if name == "loop.h5":
                file.create_group("a")["b"] = file["/"]
            if name == "linked.h5":
                file["u"] = h5py.ExternalLink("other.h5", "u")
                file["v"] = h5py.SoftLink("/v")
            if name == "virtual.h5":
                layout = h5py.VirtualLayout(_SHAPE, "f8")
                layout[:] = h5py.VirtualSource(folder / "other.h5", "u", _SHAPE)
                file.create_virtual_dataset("u", layout)
            if name == "external.h5":
                file.create_dataset("u", _SHAPE, "u1", external=[("/etc/passwd", 0, 396)])

    return write
