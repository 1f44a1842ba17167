"""Imports a folder of images: `captures.csv` lists the captures, `bench.toml` gives the nominal geometry.

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

import csv
import io
import os
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image

from holoview.captures.dataset import Captures
from holoview.captures.nominal_bench import BenchTables, parse_bench_tables
from holoview.captures.validation import check_captures
from holoview.model.fields import Number
from holoview.targets.image_reader import naming_missing_codecs, require_page_memory, require_picture_memory
from holoview.util.errors import UserError
from holoview.util.files import read_text, require_file
from holoview.util.progress import StepCallback
from holoview.util.tables import parse_toml

TABLE_FILE, BENCH_FILE = "captures.csv", "bench.toml"

_VALUE_COLUMNS: dict[str, Number] = {
    "wavelength": Number("nm", low=100e-9, high=10e-6),
    "distance": Number("mm", low=-1.0, high=1.0),
    "power": Number(low=0.0),
    "exposure": Number(low=0.0),
}


def import_folder(path: str | os.PathLike[str], progress: StepCallback | None = None) -> Captures:
    """Reads the captures of a folder with captures.csv, bench.toml and the images that they name.

    progress: called with (captures read, captures in all). Raises UserError for missing or wrong entries, which names
    the file, and the line and column or the key, and for impossible captures (`check_captures`).
    """
    folder = Path(path)
    if not folder.is_dir():
        raise UserError(str(folder), "no such folder", expected=f"a folder with {TABLE_FILE} and {BENCH_FILE}")
    bench = _read_bench_toml(folder / BENCH_FILE)
    file_columns = ["image", *(f"slm{n + 1}" for n in range(len(bench.slms)))]
    rows = _read_table(folder / TABLE_FILE, file_columns)
    images, levels = [], []
    for number, row in enumerate(rows):
        images.append(read_greyscale(folder / row["image"]))
        levels.append([read_greyscale(folder / row[name]) for name in file_columns[1:]])
        if progress is not None:
            progress(number + 1, len(rows))
    columns = {name: np.array([row[name] for row in rows], dtype=np.float64) for name in _VALUE_COLUMNS}
    captures = Captures(
        levels=_stack([_stack(patterns, "patterns of one capture") for patterns in levels], "patterns"),
        images=_stack(images, "pictures").astype(np.uint16),
        wavelength_m=columns["wavelength"],
        distance_m=columns["distance"],
        power=columns["power"],
        exposure_s=columns["exposure"],
        **bench.as_fields(),
    )
    check_captures(captures)
    return captures


def _read_bench_toml(path: Path) -> BenchTables:
    expected = "a description of the bench in TOML"
    return parse_bench_tables(parse_toml(read_text(path, expected), str(path), expected), str(path))


def _read_table(path: Path, file_columns: list[str]) -> list[dict[str, Any]]:
    """The lines of captures.csv: texts of `file_columns` and SI values of the others, by column."""
    expected = "a table with a line a capture"
    try:
        lines = list(csv.DictReader(io.StringIO(read_text(path, expected), newline=""), skipinitialspace=True))
    except csv.Error as error:
        raise UserError(str(path), f"can't be read: {error}", expected=expected) from error
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
            row[name] = text if name in file_columns else _cell_value(_VALUE_COLUMNS[name], text, where)
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


def read_greyscale(path: Path) -> NDArray[Any]:
    """Reads the values (y, x) of a greyscale PNG or TIFF unchanged, as uint8 or uint16.

    Raises UserError for a file that is missing, can't be decoded, or isn't greyscale of 8 or 16 bits.
    """
    require_file(path, f"a picture that {TABLE_FILE} names")
    try:
        if path.suffix.lower() in (".tif", ".tiff"):
            with naming_missing_codecs(path), tifffile.TiffFile(path) as file:
                require_page_memory(path, file.pages.first)
                values = np.asarray(file.pages.first.asarray())
        else:
            with Image.open(path, formats=("PNG",)) as image:
                require_picture_memory(path, image.width, image.height, 1)
                values = np.asarray(image)
    except UserError:
        raise
    except Exception as error:  # each decoder raises exceptions of its own
        raise UserError(str(path), f"can't be decoded: {error}", expected="a greyscale PNG or TIFF") from error
    if values.ndim == 2 and values.dtype.kind == "i" and values.size and values.min() >= 0:
        values = (
            values.astype(np.uint16) if values.max() < 65536 else values
        )  # Pillow decodes some 16-bit files as int32
    if values.ndim != 2 or values.dtype not in (np.uint8, np.uint16):
        found = f"an array of shape {values.shape}, {values.dtype}"
        raise UserError(str(path), found, expected="a greyscale picture of 8 or 16 bits")
    return values


def _stack(arrays: list[NDArray[Any]], what: str) -> NDArray[Any]:
    shapes = {array.shape for array in arrays}
    if len(shapes) > 1:
        raise UserError(what, f"have shapes {sorted(shapes)}", expected="one shape")
    return np.stack(arrays)
