"""What the datasets and attributes of a capture file, version 1, may be (`docs/captures.md`).

Ranges of lengths are those of `validation`, which can tell a wrong unit.
"""

from __future__ import annotations

from holoview.util.file_schema import ArraySchema, NumberSchema

_COUNTS = ("uint8", "uint16")
_REAL = ("float64", "float32", "float16", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64")

LEVELS = tuple(ArraySchema(f"slm{n}/levels", _COUNTS, ("capture", "row", "column")) for n in (1, 2))
"""Of each modulator; a file of a single one has the first only."""

IMAGES = ArraySchema("camera/images", _COUNTS, ("capture", "camera row", "camera column"))

PER_CAPTURE = tuple(ArraySchema(name, _REAL, ("capture",)) for name in ("wavelength", "distance", "power", "exposure"))

SLM_NUMBERS = (
    NumberSchema("pitch"),
    NumberSchema("num_levels", 2, 65536, whole=True),
    NumberSchema("opd_range"),
)
CAMERA_NUMBERS = (
    NumberSchema("pitch"),
    NumberSchema("bit_depth", 1, 16, whole=True),
    NumberSchema("electrons_per_count", 1e-9, 1e9),
    NumberSchema("read_noise", 0, 1e9),
    NumberSchema("black_level", 0, 65535),
)
GEOMETRY_NUMBERS = (NumberSchema("gap", optional=True), NumberSchema("focal_length", optional=True))
"""Attributes of slm1, slm2, camera and geometry."""

VERSION = NumberSchema("version", whole=True)
