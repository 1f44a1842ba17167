"""Hostile binary files that once ended badly: pictures, HDF5, and safetensors whose content can't be."""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from safetensors import safe_open
from safetensors.numpy import load, save

from tests.fuzz.corpus import READERS, TORCH, files_case
from tests.fuzz.trial import Case
from tests.fuzz.valid_files import CAPTURES, SHAPE, valid, write

Files = dict[str, bytes]
TensorEdit = Callable[[dict[str, Any], dict[str, str]], None]
H5Edit = Callable[[h5py.File], None]
OPTIMISE = ("optimise", "bench.toml")
SHORT = ("--iterations", "1", "--json")
CHECK = ("captures", "check", "captures.h5", "--json")


# --- pictures --------------------------------------------------------------------------------------------------------


def png(width: int, height: int, bits: int, colour: int, rows: bytes, *chunks: tuple[bytes, bytes]) -> bytes:
    """A PNG file with any header, around compressed rows."""
    header = struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0)
    parts = [(b"IHDR", header), *chunks, (b"IDAT", rows), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)) for name, data in parts
    )


def tiff(compression: int, data: bytes, width: int = 32, height: int = 24) -> bytes:
    """A grey TIFF file of one strip with the compressed data given."""
    tags = [(256, 4, 1, width), (257, 4, 1, height), (258, 3, 1, 8), (259, 3, 1, compression), (262, 3, 1, 1)]
    tags += [(273, 4, 1, 8 + 2 + 9 * 12 + 4), (277, 3, 1, 1), (278, 4, 1, height), (279, 4, 1, len(data))]
    entries = b"".join(struct.pack("<HHII", *tag) for tag in tags)
    return b"II*\x00" + struct.pack("<I", 8) + struct.pack("<H", 9) + entries + struct.pack("<I", 0) + data


def pictures() -> Iterator[Case]:
    """Pictures whose headers claim much, and that unpack to more than they claim."""
    zeros = zlib.compress(bytes(100_000_000), 9)
    bench = {"bench.toml": valid("picture")["bench.toml"], "p.png": valid("picture")["picture.png"]}
    files = {
        "11584 px.png": png(11584, 11584, 8, 2, zeros),
        "11584 px of 16 bits.png": png(11584, 11584, 16, 6, zeros),
        "two thousand million px.png": png(2**31 - 1, 2**31 - 1, 8, 2, zeros),
        "no px.png": png(0, 0, 8, 2, zeros),
        "colour type 9.png": png(8, 8, 8, 9, zeros),
        "text that unpacks.png": png(
            8, 8, 8, 2, zlib.compress(bytes(8 * 25)), (b"zTXt", b"a\0\0" + zlib.compress(bytes(200_000_000), 9))
        ),
        "profile that unpacks.png": png(
            8, 8, 8, 2, zlib.compress(bytes(8 * 25)), (b"iCCP", b"a\0\0" + zlib.compress(bytes(200_000_000), 9))
        ),
        "strip that unpacks.tif": tiff(8, zlib.compress(bytes(4_000_000_000 // 2), 9)),
        "wide.tif": tiff(8, zlib.compress(bytes(1000)), 2**31 - 1, 2**31 - 1),
        "11584 px.tif": tiff(8, zlib.compress(bytes(1000)), 11584, 11584),
        "compression 65535.tif": tiff(65535, b"1234"),
        "list of pages that bites its tail.tif": tiff(1, bytes(768))[:118] + struct.pack("<I", 8) + bytes(768),
        "array of 2^60.npy": _npy("(1073741824, 1073741824)"),
        "array of 2^33.npy": _npy("(92682, 92682)"),
        "array of objects.npy": _npy("(24, 32)", "|O"),
        "array with a deep header.npy": _npy("(" * 2000 + "1" + ")" * 2000),
        "array of -1.npy": _npy("(-1, 4)"),
        "jpeg of 65500 px.jpg": valid("picture")["picture.jpg"].replace(
            b"\xff\xc0\x00\x11\x08\x00\x18\x00\x20", b"\xff\xc0\x00\x11\x08\xff\xdc\xff\xdc"
        ),
    }
    for name, content in files.items():
        all_files = bench | {name: content}
        yield files_case("pictures", name, all_files, *OPTIMISE, name, *SHORT)
        yield files_case("pictures", f"{name} as depth", all_files, *OPTIMISE, "p.png", "--depth", name, *SHORT)
        if name.endswith("png"):
            yield files_case(
                "pictures", f"{name} as pattern", all_files, "render", "bench.toml", "--slm1", name, *TORCH
            )
        folder = valid("folder") | {"seen0" + name[-4:]: content}
        folder["captures.csv"] = folder["captures.csv"].replace(b"seen0.png", b"seen0" + name[-4:].encode())
        yield files_case("pictures", f"{name} in a folder", folder, "captures", "import", ".", "-o", "o.h5")


def _npy(shape: str, kind: str = "<f8") -> bytes:
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".encode().ljust(118) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + bytes(64)


# --- HDF5 ------------------------------------------------------------------------------------------------------------


def captures() -> Iterator[Case]:
    """Capture files that lead elsewhere, unpack to much, or hold what can't be."""
    for name, edit in {**_other_data(), **_wrong_data(), **_wrong_attributes()}.items():

        def prepare(folder: Path, edit: H5Edit = edit) -> None:
            secret = {"other.h5": valid("captures")["captures.h5"], "secret.bin": bytes(_SECRET)}
            write(folder, valid("captures") | secret)
            os.mkfifo(folder / "pipe")
            with h5py.File(folder / "captures.h5", "a") as h5:
                edit(h5)

        yield Case("captures", name, prepare, CHECK)


def _replaced(name: str, *arguments: Any, **keywords: Any) -> H5Edit:
    def edit(h5: h5py.File) -> None:
        if name in h5:
            del h5[name]
        h5.create_dataset(name, *arguments, **keywords)

    return edit


def _linked(name: str, link: Any) -> H5Edit:
    def edit(h5: h5py.File) -> None:
        if name in h5:
            del h5[name]
        h5[name] = link

    return edit


def _virtual(h5: h5py.File) -> None:
    layout = h5py.VirtualLayout(h5["camera/images"].shape, np.uint16)
    layout[:] = h5py.VirtualSource("other.h5", "camera/images", h5["camera/images"].shape)
    del h5["camera/images"]
    h5.create_virtual_dataset("camera/images", layout)


def _attribute(group: str, name: str, value: Any) -> H5Edit:
    def edit(h5: h5py.File) -> None:
        h5[group].attrs[name] = value

    return edit


_SECRET = 2 * SHAPE[0] * SHAPE[1] * 4 * CAPTURES  # bytes


def _other_data() -> dict[str, H5Edit]:
    """That lead to other files, or declare more than there is."""
    chunks = {"chunks": (1, 1024, 1024), "compression": "gzip"}
    return {
        "external storage": _replaced(
            "camera/images", (CAPTURES, 24, 32), np.uint16, external=[("secret.bin", 0, _SECRET)]
        ),
        "external storage on a FIFO": _replaced(
            "camera/images", (CAPTURES, 24, 32), np.uint16, external=[("pipe", 0, _SECRET)]
        ),
        "virtual dataset": _virtual,
        "external link": _linked("camera/images", h5py.ExternalLink("other.h5", "camera/images")),
        "external link to a group": _linked("camera", h5py.ExternalLink("other.h5", "camera")),
        "soft link": _linked("wavelength", h5py.SoftLink("/distance")),
        "soft link to itself": _linked("wavelength", h5py.SoftLink("/wavelength")),
        "7 GB of nothing": _replaced("camera/images", (CAPTURES, 21000, 21000), np.uint16, **chunks),
        "7 GB of levels": _replaced("slm1/levels", (CAPTURES, 30000, 30000), np.uint8, **chunks),
        "10^18 captures": _replaced("wavelength", (10**18,), "f8", chunks=(1024,)),
        "a chunk of 2 GB": _replaced("power", (CAPTURES,), "f8", chunks=(2**28,), maxshape=(None,), compression="gzip"),
    }


def _wrong_data() -> dict[str, H5Edit]:
    """Of a type, shape or value that can't be."""
    return {
        "levels in floats": _replaced("slm1/levels", data=np.zeros((CAPTURES, *SHAPE))),
        "text as power": _replaced("power", data=np.array([b"a"] * CAPTURES)),
        "compound": _replaced("power", (CAPTURES,), np.dtype([("a", "f8")])),
        "references": _replaced("power", (CAPTURES,), h5py.ref_dtype),
        "texts of any length": _replaced("power", (CAPTURES,), h5py.string_dtype()),
        "power without shape": _replaced("power", data=h5py.Empty("f8")),
        "power NaN": _replaced("power", data=np.full(CAPTURES, np.nan)),
        "power infinite": _replaced("power", data=np.full(CAPTURES, np.inf)),
        "power tiny": _replaced("power", data=np.full(CAPTURES, 5e-324)),
        "power huge": _replaced("power", data=np.full(CAPTURES, 1e308)),
        "exposure huge": _replaced("exposure", data=np.full(CAPTURES, 1e308)),
        "one number as power": _replaced("power", data=1.0),
        "a group as power": lambda h5: (h5.pop("power"), h5.create_group("power")),  # type: ignore[dict-item]
        "a dataset as slm1": lambda h5: (h5.pop("slm1"), h5.create_dataset("slm1", data=1)),  # type: ignore[dict-item]
        "a dataset as geometry": _replaced("geometry", data=1),
        "a dataset as slm2": _replaced("slm2", data=1),
    }


def _wrong_attributes() -> dict[str, H5Edit]:
    """Of values that can't be."""
    numbers = (
        np.nan,
        np.inf,
        -1.0,
        0.0,
        12.5,
        1e300,
        1e-300,
        "12",
        b"\xff",
        [1, 2],
        2**63,
        np.zeros(5000),
        True,
        h5py.Empty("f8"),
    )
    edits: dict[str, H5Edit] = {}
    for group, names in (
        ("slm1", ("pitch", "num_levels", "opd_range")),
        ("camera", ("pitch", "bit_depth", "electrons_per_count", "read_noise", "black_level")),
        ("geometry", ("gap", "iris2_na", "focal_length", "square2", "centre2_na")),
        ("/", ("format", "version", "corrections")),
    ):
        edits |= {f"{group} {name} {str(v)[:12]}": _attribute(group, name, v) for name in names for v in numbers}
    return edits


# --- safetensors -----------------------------------------------------------------------------------------------------

COMMANDS: dict[str, tuple[str, tuple[str, ...]]] = {
    "hologram": ("hologram.safetensors", READERS["hologram.safetensors"]),
    "checkpoint": (
        "checkpoint.safetensors",
        (*OPTIMISE, "picture.png", "--iterations=3", "--resume=checkpoint.safetensors"),
    ),
    "maps": ("maps.safetensors", ("render", "calibrated.toml", *TORCH)),
    "calibration checkpoint": ("calibration.safetensors", ()),
}
"""For each kind of safetensors file its name and a command that reads it; that of a calibration is read alone."""


def texts_of(path: Path) -> dict[str, str]:
    """The metadata of a safetensors file."""
    with safe_open(path, framework="numpy") as file:
        return dict(file.metadata() or {})


def changed_tensors(kind: str, change: TensorEdit, family: str, name: str) -> Case:
    """A valid file of a kind with some of its tensors and texts changed."""
    file, arguments = COMMANDS[kind]

    def prepare(folder: Path) -> None:
        write(folder, valid(kind))
        tensors, texts = load((folder / file).read_bytes()), texts_of(folder / file)
        change(tensors, texts)
        (folder / file).write_bytes(save(tensors, texts))

    def read() -> None:
        from holoview.bench.calibrate.train import load_checkpoint

        load_checkpoint(file)

    return Case(family, name, prepare, arguments, None if arguments else read)


def tensor_names(kind: str) -> list[str]:
    """The names of the tensors in a valid file of a kind."""
    return sorted(load(valid(kind)[COMMANDS[kind][0]]))


def tensors() -> Iterator[Case]:
    """Every tensor of every safetensors file: with other numbers, types, shapes, or missing; and other metadata."""
    changes: dict[str, Callable[[np.ndarray], Any]] = {
        "NaN": lambda a: np.full_like(a, np.nan) if a.dtype.kind == "f" else a - 1,
        "infinite": lambda a: np.full_like(a, np.inf) if a.dtype.kind == "f" else a * 0 + 127,
        "1e38": lambda a: (a * 0 + 1e38).astype(a.dtype) if a.dtype.kind == "f" else a,
        "-1e38": lambda a: (a * 0 - 1e38).astype(a.dtype) if a.dtype.kind == "f" else a,
        "int8": lambda a: a.astype(np.int8),
        "float16": lambda a: a.astype(np.float16),
        "complex": lambda a: a.astype(np.complex64),
        "flat": np.ravel,
        "empty": lambda a: a[..., :0],
        "one more": lambda a: np.concatenate([a, a], axis=-1),
        "transposed": lambda a: np.ascontiguousarray(a.T),
    }
    for kind in COMMANDS:
        for tensor in tensor_names(kind):
            for name, change in changes.items():

                def apply(arrays: dict[str, Any], texts: dict[str, str], t: str = tensor, c: Any = change) -> None:
                    arrays[t] = np.ascontiguousarray(c(arrays[t]))

                yield changed_tensors(kind, apply, f"{kind}s", f"{tensor} {name}")

            def removed(arrays: dict[str, Any], texts: dict[str, str], t: str = tensor) -> None:
                del arrays[t]

            yield changed_tensors(kind, removed, f"{kind}s", f"{tensor} missing")
        yield from _metadata(kind)


def _metadata(kind: str) -> Iterator[Case]:
    file = COMMANDS[kind][0]
    with_texts = json.loads(valid(kind)[file][8 : 8 + int.from_bytes(valid(kind)[file][:8], "little")])["__metadata__"]
    wrong = ("", "{", "[]", "3", "[" * 5000, '{"a": 1}', "null", "\x00", '{"iterations": NaN}', "é" * 100)
    for key in with_texts:
        for text in wrong:
            yield changed_tensors(
                kind, lambda a, t, k=key, x=text: t.update({k: x}), f"{kind}s", f"{key} {text[:20]!r}"
            )
        if not with_texts[key].startswith("{"):
            continue
        for entry in json.loads(with_texts[key]):
            for value in (
                None,
                "a",
                -1,
                0,
                1e300,
                float("nan"),
                float("inf"),
                10**30,
                [],
                [1, 2],
                {},
                True,
                [10**9, 10**9],
            ):

                def change(arrays: Any, texts: dict[str, str], k: str = key, e: str = entry, v: Any = value) -> None:
                    texts[k] = json.dumps(json.loads(texts[k]) | {e: v})

                yield changed_tensors(kind, change, f"{kind}s", f"{key} {entry} {str(value)[:12]}")
