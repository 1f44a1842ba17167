"""Reads and writes the capture file, version 1: HDF5 with patterns, camera images, settings and nominal geometry.

`docs/captures.md` lists every dataset and attribute; ranges of lengths are those of `validation`, which tells a wrong
unit. HDF5 can store data in other files (external storage, virtual datasets) and lead to other files and places
(external and soft links): a file from a stranger could make a reader read any file of its user. Such files are refused
(`open_plain_hdf5`, `DatasetReader`), and data are read within the memory that is allowed.

`import_folder` reads a folder of images: `captures.csv` lists the captures, `bench.toml` gives the nominal geometry.

captures.csv has one line per capture; lengths carry their unit, exposures are in seconds:

    image,slm1,slm2,wavelength,distance,power,exposure
    seen-000.tif,sent1-000.png,sent2-000.png,520 nm,4 mm,0.9,0.0167

bench.toml describes modulators, camera and distances:

    [slm1]                  # and [slm2]
    pitch = "8 um"
    num_levels = 256
    opd_range = "825 nm"
    [camera]
    pitch = "4 um"
    bit_depth = 12
    electrons_per_count = 4.0
    read_noise = 3.0
    black_level = 64
    [geometry]              # gap with two modulators; focal_length for a Fourier bench
    gap = "1 mm"
    iris1_na = 0.03
    square2 = "first order at 550 nm"
    centre2_na = [0.0, 0.001]
"""

from __future__ import annotations

import io
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.count_bits import counts_as_stated
from holoview.bench.captures.dataset import Captures, Masks, SlmSpec
from holoview.bench.captures.nominal_bench import (
    MAY_BE_UNKNOWN,
    STOP_KEYS,
    BenchTables,
    camera_from_attributes,
    parse_bench_tables,
    slm_from_attributes,
    slm_of,
    stop_attributes,
    stops_from_attributes,
)
from holoview.bench.captures.picture_files import UNKNOWN, read_greyscale
from holoview.bench.captures.unknown_settings import with_estimates
from holoview.bench.captures.validation import check_captures
from holoview.light.model.elements import Pixels
from holoview.light.model.fields import Number
from holoview.light.model.preset import dumps, from_table
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.files import read_text, require_file
from holoview.util.memory_limit import format_size, require_memory
from holoview.util.number_text import read_csv
from holoview.util.progress import StepCallback
from holoview.util.reader_process import call_in_child
from holoview.util.tables import ArraySchema, NumberSchema, parse_toml

FORMAT_NAME, FORMAT_VERSION = "holoview-captures", 1
_COUNTS = ("uint8", "uint16")
_REAL = ("float64", "float32", "float16", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64")

LEVELS = tuple(ArraySchema(f"slm{n}/levels", _COUNTS, ("capture", "row", "column")) for n in (1, 2))
"""Of each modulator; a file of one modulator has only the first."""

IMAGES = ArraySchema("camera/images", _COUNTS, ("capture", "camera row", "camera column"))

MASK = "camera/mask"
MASKS = tuple(
    ArraySchema(MASK, ("uint8", "bool"), axes)
    for axes in (("camera row", "camera column"), ("capture", "camera row", "camera column"))
)
"""Optional: 0 leaves a pixel out, of all pictures or of each."""

PER_CAPTURE = tuple(ArraySchema(name, _REAL, ("capture",)) for name in ("wavelength", "distance", "power", "exposure"))

SLM_NUMBERS = (NumberSchema("pitch"), NumberSchema("num_levels", 2, 65536, whole=True), NumberSchema("opd_range"))
CAMERA_NUMBERS = (
    NumberSchema("pitch"),
    NumberSchema("bit_depth", 1, 16, whole=True),
    NumberSchema("electrons_per_count", 1e-9, 1e9),
    NumberSchema("read_noise", 0, 1e9),
    NumberSchema("black_level", 0, 65535),
    NumberSchema("integrates", 0, 1, whole=True, optional=True),
)
AXIS_NUMBERS = (NumberSchema("axis_y", -1.0, 1.0, optional=True), NumberSchema("axis_x", -1.0, 1.0, optional=True))
"""Of the camera on a Fourier bench: where the zero order is from the centre of the pictures, m."""

GEOMETRY_NUMBERS = (NumberSchema("gap", optional=True), NumberSchema("focal_length", optional=True))
"""Attributes of slm1, slm2, camera and geometry."""

VERSION = NumberSchema("version", whole=True)

_PEAK_SHARE = 1.6  # of the data: while they are checked, a mask of the pictures is held beside them
_GEOMETRY = "geometry attribute "  # before its name, in errors


def read_captures(path: str | os.PathLike[str], check: Callable[[Captures], object] = check_captures) -> Captures:
    """Reads a capture file.

    check: raises UserError for captures that aren't wanted; `records.plausible_units` accepts captures whose units it
    can correct.
    Raises UserError that names the file and the dataset when the file is missing, cut short, not HDF5 or of another
    format, when a dataset is missing or isn't as its schema says, when data are elsewhere or need too much
    memory, and when `check` refuses the captures.
    """
    remedy = "`holoview captures import` converts a folder of pictures"
    with open_plain_hdf5(Path(path), "a capture file (HDF5)", remedy) as h5:
        captures = with_estimates(_read(h5))
        check(captures)
    return captures


def is_capture_file(path: Path) -> bool:
    """Whether a file is HDF5 with the format of captures; False for a file that is missing."""
    if path.suffix.lower() not in (".h5", ".hdf5") or not path.is_file():
        return False
    with open_plain_hdf5(path, "a capture file (HDF5)", "") as h5:
        return _decode_attribute(read_attribute(h5, "format")) == FORMAT_NAME


def write_captures(
    path: str | os.PathLike[str],
    captures: Captures,
    check: Callable[[Captures], object] = check_captures,
    extend: Callable[[h5py.File], object] = lambda _: None,
) -> None:
    """Writes a capture file, with notes of corrections, completely or not at all.

    check: raises UserError for captures that mustn't be written. extend: adds content that readers of captures ignore.
    Raises as `check` does, and WriteError.
    """
    check(captures)
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as h5:
        h5.attrs["format"], h5.attrs["version"] = FORMAT_NAME, FORMAT_VERSION
        if captures.corrections:
            h5.attrs["corrections"] = list(captures.corrections)
        if captures.estimated:
            h5.attrs["estimated"] = list(captures.estimated)
        if captures.chain is not None:
            write_chain(h5, captures)
        for number, slm in enumerate(captures.slms if captures.chain is None else ()):
            group = h5.create_group(f"slm{number + 1}")
            group.create_dataset("levels", data=captures.levels[:, number], compression="gzip", compression_opts=4)
            group.attrs.update(pitch=slm.pitch_m, num_levels=slm.num_levels, opd_range=slm.opd_range_m)
        camera = h5.create_group("camera")
        camera.create_dataset("images", data=captures.images, compression="gzip", compression_opts=4)
        if captures.usable is not None:
            is_one = bool((captures.usable == captures.usable[:1]).all())
            mask = captures.usable[0] if is_one else captures.usable
            camera.create_dataset("mask", data=mask.astype(np.uint8), compression="gzip", compression_opts=4)
        c = captures.camera
        if any(captures.axis_m):
            camera.attrs.update(axis_y=captures.axis_m[0], axis_x=captures.axis_m[1])
        camera.attrs.update(pitch=c.pitch_m, bit_depth=c.bit_depth, electrons_per_count=c.electrons_per_count)
        camera.attrs.update(read_noise=c.read_noise, black_level=c.black_level)
        if c.integrates is not None:
            camera.attrs["integrates"] = int(c.integrates)
        columns = (captures.wavelength_m, captures.distance_m, captures.power, captures.exposure_s)
        for schema, values in zip(PER_CAPTURE, columns, strict=True):
            h5.create_dataset(schema.name, data=values.astype(np.float64))
        geometry = h5.create_group("geometry")
        for name, value in (("gap", captures.gap_m), ("focal_length", captures.focal_length_m)):
            if value is not None:
                geometry.attrs[name] = value
        geometry.attrs.update(stop_attributes(captures.relay1, 1) | stop_attributes(captures.relay2, 2))
        extend(h5)
    write_file(path, buffer.getbuffer())


def _read(h5: h5py.File) -> Captures:
    _check_format(h5)
    sizes: dict[str, int] = {}
    slms = ["slm1", "slm2"] if plain_child(h5, "slm2") is not None else ["slm1"]
    chain = _chain(h5)
    schemas = LEVELS[: len(slms)] if chain is None else chain_levels(chain)
    levels = [DatasetReader(h5, schema, sizes) for schema in schemas]
    images = DatasetReader(h5, IMAGES, sizes)
    known = [schema for schema in PER_CAPTURE if not _is_unknown(h5, schema.name)]
    columns = {schema.name: DatasetReader(h5, schema, sizes) for schema in known}
    found = plain_child(h5, MASK)
    is_each = isinstance(found, h5py.Dataset) and found.ndim == 3
    mask = None if found is None else DatasetReader(h5, MASKS[is_each], sizes)
    datasets = [*levels, images, *columns.values(), *([] if mask is None else [mask])]
    needed = _PEAK_SHARE * sum(d.size_bytes for d in datasets) + 2 * max(d.chunk_bytes for d in datasets)
    require_memory("captures", needed, remedy="give it fewer captures")
    geometry, camera = _geometry(h5), _numbers(h5, "camera", (*CAMERA_NUMBERS, *AXIS_NUMBERS))
    axis_m = camera.get("axis_y", 0.0), camera.get("axis_x", 0.0)
    if any(axis_m) and geometry.get("focal_length") is None:
        raise UserError(
            "camera.axis_y, axis_x",
            "stated for a near field",
            expected="an axis on a Fourier bench alone",
            remedy="leave them out, and cut the pictures so that their centre is the modulators' centre",
        )
    return Captures(
        levels=_read_levels(levels),
        images=_read_images(images),
        wavelength_m=columns["wavelength"].read().astype(np.float64),
        distance_m=columns["distance"].read().astype(np.float64),
        power=_column(columns, "power", images.shape[0]),
        exposure_s=_column(columns, "exposure", images.shape[0]),
        slms=tuple(slm_from_attributes(_numbers(h5, slm, SLM_NUMBERS)) for slm in slms)
        if chain is None
        else _slms_of_chain(h5, chain, levels),
        chain=chain,
        camera=camera_from_attributes(camera),
        axis_m=axis_m,
        usable=_usable(h5, mask, images.shape),
        gap_m=geometry.get("gap"),
        relay1=stops_from_attributes(geometry, 1, _GEOMETRY),
        relay2=stops_from_attributes(geometry, 2, _GEOMETRY),
        focal_length_m=geometry.get("focal_length"),
        corrections=_texts(h5, "corrections"),
        estimated=_texts(h5, "estimated"),
    )


def _is_unknown(h5: h5py.File, name: str) -> bool:
    """Whether powers or exposures are the text "unknown"."""
    found = plain_child(h5, name) if name in ("power", "exposure") else None
    is_text = isinstance(found, h5py.Dataset) and found.shape == () and h5py.check_string_dtype(found.dtype) is not None
    return is_text and _decode_attribute(found[()]) == UNKNOWN  # type: ignore[index]


def _column(columns: dict[str, DatasetReader], name: str, count: int) -> NDArray[np.float64]:
    return columns[name].read().astype(np.float64) if name in columns else np.full(count, np.nan)


def _check_format(h5: h5py.File) -> None:
    name, version = _decode_attribute(read_attribute(h5, "format")), read_attribute(h5, "version")
    if name != FORMAT_NAME:
        raise UserError("attribute format", f'"{name}"' if name else "is missing", expected=f'"{FORMAT_NAME}"')
    if version is None or VERSION.read(version, "attribute version") != FORMAT_VERSION:
        raise UserError("attribute version", f"{version}", expected=f"{FORMAT_VERSION}, the only one that is known")


def _read_levels(readers: Sequence[DatasetReader]) -> NDArray[np.unsignedinteger]:
    """The levels (capture, modulator, y, x) of all modulators."""
    captures = readers[0].shape[0]
    shape = [max(reader.shape[axis] for reader in readers) for axis in (1, 2)]
    common_type = np.result_type(*(reader.dtype.newbyteorder("=") for reader in readers))
    levels = np.zeros((captures, len(readers), *shape), dtype=common_type)
    for number, reader in enumerate(readers):
        reader.read_into(levels[:, number, : reader.shape[1], : reader.shape[2]])
    return levels


# --- a chain of elements ----------------------------------------------------------------------------------------------

CHAIN = "chain"
"""The attribute of a file whose bench is a chain: the bench as a preset's TOML, in place of slm1, slm2 and geometry."""


def chain_levels(chain: System) -> list[ArraySchema]:
    """The datasets of levels of the elements of a chain that show patterns, in order."""
    names = chain.drive_shapes
    return [ArraySchema(f"elements/{n}/levels", _COUNTS, ("capture", f"row of {n}", f"column of {n}")) for n in names]


def write_chain(h5: h5py.File, captures: Captures) -> None:
    """The bench and the levels of captures of a chain."""
    assert captures.chain is not None
    h5.attrs[CHAIN] = dumps(captures.chain)
    shapes = captures.chain.drive_shapes
    for number, (schema, slm) in enumerate(zip(chain_levels(captures.chain), captures.slms, strict=True)):
        _, rows, columns = list(shapes.values())[number]
        own = captures.levels[:, number, :rows, :columns]
        h5.create_dataset(schema.name, data=own, compression="gzip", compression_opts=4)
        h5[schema.name].attrs["num_levels"] = slm.num_levels


def _chain(h5: h5py.File) -> System | None:
    """The chain that a file states; None for a bench of the short form."""
    text = _decode_text(read_attribute(h5, CHAIN))
    if not text:
        return None
    where = f"attribute {CHAIN}"
    table = parse_toml(text, where, "a bench in TOML")
    elements = table.get("elements")
    if isinstance(elements, list) and any(isinstance(e, Mapping) and "file" in e for e in elements):
        raise UserError(where, "a mask from a file", expected="named masks: captures read no other files")
    for key in ("base", "effects", "eye"):
        if key in table:
            raise UserError(where, f'has "{key}"', expected="a nominal chain of elements alone")
    try:
        chain = from_table(table)
    except UserError as error:
        raise error.inside(f"{where}: ") from error
    if not chain.is_chain:
        raise UserError(where, "one or two phase modulators", expected="slm1 and slm2 for these")
    return chain


def _slms_of_chain(h5: h5py.File, chain: System, levels: Sequence[DatasetReader]) -> tuple[SlmSpec, ...]:
    """What the file states of the elements that show patterns."""
    found = []
    shown = [e for e in chain.elements if isinstance(e, Pixels) and e.is_driven]
    for element, (_, *shape), reader in zip(shown, chain.drive_shapes.values(), levels, strict=True):
        if list(reader.shape[1:]) != shape:
            raise UserError(reader.name, f"{reader.shape[1:]} pixels", expected=f"{tuple(shape)}, as the chain has")
        count, own = int(_numbers(h5, reader.name, SLM_NUMBERS[1:2])["num_levels"]), slm_of(element)
        if own.shares and count != own.num_levels:
            where = f"{reader.name} attribute num_levels"
            raise UserError(where, f"{count}", expected=f"{own.num_levels}, as the chain has")
        found.append(replace(own, num_levels=count))
    return tuple(found)


def _read_images(reader: DatasetReader) -> NDArray[np.uint16]:
    images = np.empty(reader.shape, dtype=np.uint16)
    reader.read_into(images)
    return images


def _usable(h5: h5py.File, mask: DatasetReader | None, shape: tuple[int, ...]) -> Masks | None:
    """The pixels (capture, y, x) of the mask and the region of interest; None where the file has neither."""
    camera = plain_child(h5, "camera")
    roi = None if camera is None else read_attribute(camera, "roi")
    if mask is None and roi is None:
        return None
    usable = np.ones(shape[1:], bool) if mask is None else mask.read() != 0
    if roi is not None:
        numbers = np.atleast_1d(roi)
        if numbers.shape != (4,) or numbers.dtype.kind not in "iuf" or (numbers != np.round(numbers)).any():
            raise UserError("camera attribute roi", f"{roi}", expected="four whole numbers: [y0, y1, x0, x1]")
        y0, y1, x0, x1 = (int(n) for n in numbers)
        usable &= region_mask((y0, y1, x0, x1), (shape[1], shape[2]), "camera attribute roi")
    return np.broadcast_to(usable, shape)


def region_mask(roi: tuple[int, int, int, int], shape: tuple[int, int], where: str) -> Masks:
    """True in the rows y0 … y1 − 1 and columns x0 … x1 − 1 of a picture. roi: (y0, y1, x0, x1).

    Raises UserError that names `where` for a region that is empty or not within the picture.
    """
    y0, y1, x0, x1 = roi
    if not (0 <= y0 < y1 <= shape[0] and 0 <= x0 < x1 <= shape[1]):
        found = f"rows {y0}:{y1}, columns {x0}:{x1}"
        expected = f"first and behind the last, within the picture's {shape[0]} rows and {shape[1]} columns"
        raise UserError(where, found, expected=expected)
    region = np.zeros(shape, bool)
    region[y0:y1, x0:x1] = True
    return region


def _geometry(h5: h5py.File) -> dict[str, Any]:
    """The attributes of the geometry that the file has."""
    group, lengths = plain_child(h5, "geometry"), _numbers(h5, "geometry", GEOMETRY_NUMBERS)
    stops = {} if group is None else {name: read_attribute(group, name) for name in STOP_KEYS}
    return {name: value for name, value in stops.items() if value is not None} | lengths


def _numbers(h5: h5py.File, group_name: str, schemas: Sequence[NumberSchema]) -> dict[str, float]:
    """The attributes of a group that it has; UserError where one is missing that isn't optional."""
    group = plain_child(h5, group_name)
    values = {}
    for schema in schemas:
        where = f"{group_name} attribute {schema.name}"
        value = None if group is None else read_attribute(group, schema.name)
        if value is not None and schema.name in MAY_BE_UNKNOWN and _decode_text(value) == UNKNOWN:
            values[schema.name] = math.nan
        elif value is not None:
            values[schema.name] = schema.read(value, where)
        elif not schema.optional:
            raise UserError(where, "is missing", expected="a number")
    return values


def _texts(h5: h5py.File, name: str) -> tuple[str, ...]:
    texts = read_attribute(h5, name)
    return () if texts is None else tuple(_decode_attribute(text) for text in np.atleast_1d(texts))


def _decode_text(value: Any) -> str:
    return _decode_attribute(value) if isinstance(value, str | bytes) else ""


def _decode_attribute(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value or "")


# --- HDF5 files that hold all of their data themselves ---------------------------------------------------------------

_COPY = "copy them into the file"
_MOST_ATTRIBUTE_BYTES = 1 << 16
_FEW_CHUNKS, _SMALL_CHUNK_BYTES = 20_000, 1024  # more chunks than these are larger: each is looked up by itself
_MOST_RATIO, _FREE_BYTES = 2000, 64 << 20
"""Size of data over that of their file, beyond the free bytes: deflate's limit is 1032 for each filter in a chain."""


@contextmanager
def open_plain_hdf5(path: Path, expected: str, remedy: str) -> Iterator[h5py.File]:
    """A file that is open to be read; use `plain_child`, `read_attribute` and `DatasetReader` on it.

    expected, remedy: for the error. Raises UserError for a path that isn't a regular file, isn't HDF5, or is cut short;
    in the block, HDF5's errors become a UserError that says that the file is damaged.
    """
    require_file(path, expected)
    call_in_child(str(path), path, partial(_try_hdf5, path))
    try:
        h5 = h5py.File(path, "r")
    except (OSError, RuntimeError, ValueError) as error:
        truncated = "truncated" in str(error)
        found = "is cut short: it ends before its data do" if truncated else "isn't an HDF5 file"
        raise UserError(str(path), found, expected=expected, remedy="copy it again" if truncated else remedy) from error
    with h5:
        try:
            yield h5
        except UserError as error:
            raise error.inside(f"{path}: ") from error
        except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:
            reason = " ".join(str(error).split())
            raise UserError(str(path), f"is damaged: {reason}", remedy="copy or write the file again") from error


_MOST_OBJECTS = 10_000


def _try_hdf5(path: Path) -> None:
    """Has the library parse the descriptions of all that is in a file, without its numbers; other files are left alone.

    In a child process, where the library may crash. Raises UserError for more objects than any file that is known.
    """
    seen = 0
    with suppress(OSError, RuntimeError, ValueError, KeyError, TypeError), h5py.File(path, "r") as h5:
        waiting: list[h5py.Group] = [h5]
        while waiting and seen <= _MOST_OBJECTS:
            group = waiting.pop()
            for name in islice(group, _MOST_OBJECTS):
                seen += 1
                if isinstance(group.get(name, getlink=True), h5py.HardLink):
                    found = group[name]
                    if isinstance(found, h5py.Group):
                        waiting.append(found)
                    elif isinstance(found, h5py.Dataset):
                        _ = found.shape, found.dtype, found.chunks, list(found.attrs)
    if seen > _MOST_OBJECTS:
        raise UserError(str(path), f"holds more than {_MOST_OBJECTS} objects", expected="captures")


def plain_child(h5: h5py.File, name: str) -> h5py.Group | h5py.Dataset | None:
    """The group or dataset of a path such as "slm1/levels", None where there is none.

    Raises UserError where a link on the way isn't a hard link.
    """
    found: Any = h5
    for part in name.split("/"):
        link = found.get(part, getlink=True) if isinstance(found, h5py.Group) else None
        if link is None:
            return None
        if not isinstance(link, h5py.HardLink):
            kind = "an external" if isinstance(link, h5py.ExternalLink) else "a soft"
            raise UserError(name, f"is {kind} link", expected="the data themselves", remedy=_COPY)
        found = found.get(part)
    return found


def read_attribute(holder: h5py.Group | h5py.Dataset, name: str) -> Any:
    """The value of an attribute, None where there is none. Raises UserError for a large one."""
    if name not in holder.attrs:
        return None
    if holder.attrs.get_id(name).get_storage_size() > _MOST_ATTRIBUTE_BYTES:
        expected = f"at most {_MOST_ATTRIBUTE_BYTES >> 10} KiB"
        raise UserError(f"attribute {name}", "is larger than any that is known", expected=expected)
    return holder.attrs[name]


class DatasetReader:
    """A dataset that is checked against its schema before it is read.

    Raises UserError when it is missing, isn't what the schema says, or has its data elsewhere.

    sizes: the known sizes that the schemas name; the sizes that this file tells are added.
    """

    def __init__(self, h5: h5py.File, schema: ArraySchema, sizes: dict[str, int]) -> None:
        self.name, self._schema = schema.name, schema
        dataset = plain_child(h5, schema.name)
        if not isinstance(dataset, h5py.Dataset):
            raise UserError(schema.name, "is missing", expected="a dataset of this name")
        if dataset.is_virtual or dataset.external:
            raise UserError(schema.name, "has its data in other files", expected="the data themselves", remedy=_COPY)
        self._dataset = dataset
        self.dtype: np.dtype[Any] = dataset.dtype
        self.shape: tuple[int, ...] = dataset.shape or ()
        schema.check_header(dataset.dtype.newbyteorder("=").name, self.shape, sizes)
        if 0 in self.shape:
            raise UserError(schema.name, f"an array of shape {self.shape}", expected="at least one number")
        self._check_ratio(Path(h5.filename).stat().st_size)
        self._check_chunks()

    @property
    def size_bytes(self) -> int:
        """Memory that all of its numbers take."""
        return math.prod(self.shape) * self.dtype.itemsize

    @property
    def chunk_bytes(self) -> int:
        """Memory that HDF5 takes to decompress a part."""
        return math.prod(self._dataset.chunks or (0,)) * self.dtype.itemsize

    def read(self) -> NDArray[Any]:
        """All numbers. Raises UserError for numbers that the schema doesn't allow."""
        values = np.asarray(self._dataset[()])
        self._schema.check_values(values)
        return values

    def read_into(self, array: NDArray[Any]) -> None:
        """Reads into an array of the same shape, some chunks of the file at a time."""
        count = (self._dataset.chunks or (1,))[0]
        for first in range(0, self.shape[0], count):
            array[first : first + count] = self._dataset[first : first + count]

    def _check_ratio(self, file_bytes: int) -> None:
        if max(self.size_bytes, self.chunk_bytes) > _FREE_BYTES + _MOST_RATIO * file_bytes:
            found = f"{format_size(self.size_bytes)} of data in a file of {format_size(file_bytes)}"
            raise UserError(self.name, found, expected="what was measured", remedy="write the file again")

    def _check_chunks(self) -> None:
        chunks = self._dataset.chunks or self.shape
        count = math.prod(-(-whole // part) for whole, part in zip(self.shape, chunks, strict=True))
        if count > max(_FEW_CHUNKS, self.size_bytes // _SMALL_CHUNK_BYTES):
            found = f"is cut into {count} chunks of {format_size(self.size_bytes / count)}"
            raise UserError(self.name, found, expected=f"chunks of at least {_SMALL_CHUNK_BYTES} bytes")


# --- a folder of images -----------------------------------------------------------------------------------------------


TABLE_FILE, BENCH_FILE = "captures.csv", "bench.toml"
_NAMED = f"a picture that {TABLE_FILE} names"

_VALUE_COLUMNS: dict[str, Number] = {
    "wavelength": Number("nm", low=100e-9, high=10e-6),
    "distance": Number("mm", low=-1.0, high=1.0),
    "power": Number(low=0.0),
    "exposure": Number(low=0.0),
}


def import_folder(
    path: str | os.PathLike[str], progress: StepCallback | None = None, tell: Callable[[str], None] = lambda _: None
) -> Captures:
    """Reads the captures of a folder with captures.csv, bench.toml and the images that they name.

    progress: called with (captures read, captures in all). tell: called with what was changed of the counts. Raises
    UserError for missing or wrong entries, which names the file, and the line and column or the key, and for impossible
    captures (`check_captures`).
    """
    folder = Path(path)
    if not folder.is_dir():
        raise UserError(str(folder), "no such folder", expected=f"a folder with {TABLE_FILE} and {BENCH_FILE}")
    bench = _read_bench_toml(folder / BENCH_FILE)
    file_columns = ["image", *(f"slm{n + 1}" for n in range(len(bench.slms)))]
    rows = _read_table(folder / TABLE_FILE, file_columns)
    images, levels = [], []
    for number, row in enumerate(rows):
        images.append(read_greyscale(folder / row["image"], _NAMED))
        levels.append([read_greyscale(folder / row[name], _NAMED) for name in file_columns[1:]])
        if progress is not None:
            progress(number + 1, len(rows))
    columns = {name: np.array([row[name] for row in rows], dtype=np.float64) for name in _VALUE_COLUMNS}
    captures = Captures(
        levels=_stack([_stack(patterns, "patterns of one capture") for patterns in levels], "patterns"),
        images=counts_as_stated(_stack(images, "pictures").astype(np.uint16), bench.camera.bit_depth, tell),
        wavelength_m=columns["wavelength"],
        distance_m=columns["distance"],
        power=columns["power"],
        exposure_s=columns["exposure"],
        **bench.as_fields(),
    )
    captures = with_estimates(captures)
    check_captures(captures)
    return captures


def _read_bench_toml(path: Path) -> BenchTables:
    expected = "a description of the bench in TOML"
    return parse_bench_tables(parse_toml(read_text(path, expected), str(path), expected), str(path))


def _read_table(path: Path, file_columns: list[str]) -> list[dict[str, Any]]:
    """The lines of captures.csv: texts of `file_columns` and SI values of the others, by column.

    Columns are separated by commas, or by semicolons, between which commas are decimal signs.
    """
    expected = "a table with a line a capture"
    lines, has_decimal_commas = read_csv(read_text(path, expected), str(path))
    if not lines:
        raise UserError(
            str(path), "is empty", expected=f"columns {', '.join([*file_columns, *_VALUE_COLUMNS])}, a line a capture"
        )
    rows = []
    for number, line in enumerate(lines, start=2):
        row: dict[str, Any] = {}
        for name in (*file_columns, *_VALUE_COLUMNS):
            text = line.get(name)
            if not text:
                raise UserError(f"{path}, line {number}: {name}", "is missing")
            where = f"{path}, line {number}: {name}"
            if name in file_columns:
                row[name] = text
            else:
                plain = text.replace(",", ".") if has_decimal_commas else text
                is_unknown = name in ("power", "exposure") and text == UNKNOWN
                row[name] = math.nan if is_unknown else _cell_value(_VALUE_COLUMNS[name], plain, where)
        rows.append(row)
    return rows


def _cell_value(kind: Number, text: str, where: str) -> float:
    value: Any = text
    if not kind.unit:
        try:
            value = float(text)
        except ValueError as error:
            raise UserError(where, f'"{text}"', expected="a number") from error
    number = kind.parse(value, where)
    assert number is not None
    return number


def _stack(arrays: list[NDArray[Any]], what: str) -> NDArray[Any]:
    shapes = {array.shape for array in arrays}
    if len(shapes) > 1:
        raise UserError(what, f"have shapes {sorted(shapes)}", expected="one shape")
    return np.stack(arrays)
