"""A folder of pictures → captures: `captures.csv` says what was sent and seen, `bench.toml` what it was measured on.

captures.csv, a line a capture; lengths with their units, exposures in seconds:

    image,slm1,slm2,wavelength,distance,power,exposure
    seen-000.tif,sent1-000.png,sent2-000.png,520 nm,4 mm,0.9,0.0167

bench.toml:

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
    iris2_na = 0.03
"""

from __future__ import annotations

import csv
import os
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image

from holoview.captures.dataset import Camera, Captures, SlmSpec
from holoview.captures.validation import check_captures
from holoview.model.field_types import Number
from holoview.util.errors import UserError, suggest_matches

ProgressCallback = Callable[[int, int], None]
TABLE_FILE, BENCH_FILE = "captures.csv", "bench.toml"

_COLUMNS: dict[str, Number] = {
    "wavelength": Number("nm", low=100e-9, high=10e-6),
    "distance": Number("mm", low=-1.0, high=1.0),
    "power": Number(low=0.0),
    "exposure": Number(low=0.0),
}
_SLM_KEYS: dict[str, Number] = {"pitch": Number("um"), "num_levels": Number(), "opd_range": Number("nm")}
_CAMERA_KEYS: dict[str, Number] = {
    "pitch": Number("um"),
    "bit_depth": Number(),
    "electrons_per_count": Number(),
    "read_noise": Number(),
    "black_level": Number(),
}
_GEOMETRY_KEYS: dict[str, Number] = {
    "gap": Number("mm"),
    "iris1_na": Number(),
    "iris2_na": Number(),
    "focal_length": Number("mm"),
}


def import_folder(path: str | os.PathLike[str], progress: ProgressCallback | None = None) -> Captures:
    """The session of a folder.

    Raises UserError that names the file, line and column or key of what is missing or wrong.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise UserError(str(folder), "no such folder", expected=f"a folder with {TABLE_FILE} and {BENCH_FILE}")
    bench = _read_bench_toml(folder / BENCH_FILE)
    panels = tuple(_slm_spec(bench[name]) for name in ("slm1", "slm2") if name in bench)
    names = ["image", *(f"slm{n + 1}" for n in range(len(panels)))]
    rows = _read_table(folder / TABLE_FILE, names)
    images, levels = [], []
    for number, row in enumerate(rows):
        images.append(read_greyscale(folder / row["image"]))
        levels.append([read_greyscale(folder / row[name]) for name in names[1:]])
        if progress is not None:
            progress(number + 1, len(rows))
    columns = {name: np.array([row[name] for row in rows], dtype=np.float64) for name in _COLUMNS}
    geometry = bench.get("geometry", {})
    captures = Captures(
        levels=_stacked([_stacked(pair, "patterns of one capture") for pair in levels], "patterns"),
        images=_stacked(images, "pictures").astype(np.uint16),
        wavelength_m=columns["wavelength"],
        distance_m=columns["distance"],
        power=columns["power"],
        exposure_s=columns["exposure"],
        slms=panels,
        camera=Camera(
            bench["camera"]["pitch"],
            int(bench["camera"]["bit_depth"]),
            *(bench["camera"][name] for name in ("electrons_per_count", "read_noise", "black_level")),
        ),
        gap_m=geometry.get("gap"),
        iris1_na=geometry.get("iris1_na"),
        iris2_na=geometry.get("iris2_na"),
        focal_length_m=geometry.get("focal_length"),
    )
    check_captures(captures)
    return captures


def _slm_spec(table: Mapping[str, float]) -> SlmSpec:
    return SlmSpec(table["pitch"], int(table["num_levels"]), table["opd_range"])


def _read_bench_toml(path: Path) -> dict[str, dict[str, float]]:
    """bench.toml in SI units, complete."""
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise UserError(str(path), "no such file", expected="a description of the bench in TOML") from error
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise UserError(str(path), f"can't be read: {error}", expected="a description of the bench in TOML") from error
    kinds = {"slm1": _SLM_KEYS, "slm2": _SLM_KEYS, "camera": _CAMERA_KEYS, "geometry": _GEOMETRY_KEYS}
    read: dict[str, dict[str, float]] = {}
    for name, table in tables.items():
        if name not in kinds or not isinstance(table, Mapping):
            raise UserError(f"{path}: {name}", "unknown table", remedy=suggest_matches(name, kinds))
        read[name] = {key: _value(kinds[name], key, value, f"{path}: {name}") for key, value in table.items()}
    for name in ("slm1", "camera", *(["slm2"] if "slm2" in read else [])):
        for key in kinds[name]:
            if key not in read.get(name, {}):
                raise UserError(f"{path}: {name}.{key}", "is missing")
    return read


def _value(kinds: Mapping[str, Number], key: str, value: Any, where: str) -> float:
    if key not in kinds:
        raise UserError(f"{where}.{key}", "unknown key", remedy=suggest_matches(key, kinds))
    number = kinds[key].parse(value, f"{where}.{key}")
    assert number is not None
    return number


def _read_table(path: Path, names: list[str]) -> list[dict[str, Any]]:
    """Lines of captures.csv, numbers in SI units."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = list(csv.DictReader(file, skipinitialspace=True))
    except FileNotFoundError as error:
        raise UserError(str(path), "no such file", expected="a table with a line a capture") from error
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UserError(str(path), f"can't be read: {error}", expected="a table with a line a capture") from error
    if not lines:
        raise UserError(str(path), "is empty", expected=f"columns {', '.join([*names, *_COLUMNS])}, a line a capture")
    rows = []
    for number, line in enumerate(lines, start=2):
        row: dict[str, Any] = {}
        for name in (*names, *_COLUMNS):
            text = line.get(name)
            if not text:
                raise UserError(f"{path}, line {number}: {name}", "is missing")
            row[name] = text if name in names else _number(_COLUMNS[name], text, f"{path}, line {number}: {name}")
        rows.append(row)
    return rows


def _number(kind: Number, text: str, where: str) -> float:
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
    """Grey values (y, x) as they are, uint8 or uint16."""
    try:
        if path.suffix.lower() in (".tif", ".tiff"):
            values = tifffile.imread(path)
        else:
            with Image.open(path) as picture:
                values = np.asarray(picture)
    except FileNotFoundError as error:
        raise UserError(str(path), "no such file", expected=f"a picture that {TABLE_FILE} names") from error
    except Exception as error:  # each decoder raises its own
        raise UserError(str(path), f"can't be decoded: {error}", expected="a greyscale PNG or TIFF") from error
    if values.ndim == 2 and values.dtype.kind == "i" and values.size and values.min() >= 0:
        values = values.astype(np.uint16) if values.max() < 65536 else values  # Pillow's 16-bit modes
    if values.ndim != 2 or values.dtype not in (np.uint8, np.uint16):
        found = f"an array of shape {values.shape}, {values.dtype}"
        raise UserError(str(path), found, expected="a greyscale picture of 8 or 16 bits")
    return values


def _stacked(arrays: list[NDArray[Any]], what: str) -> NDArray[Any]:
    shapes = {array.shape for array in arrays}
    if len(shapes) > 1:
        raise UserError(what, f"have shapes {sorted(shapes)}", expected="one shape")
    return np.stack(arrays)
