"""What a file of learned maps may hold: the layout's ranges, and type, sizes and bounds of each tensor.

The bounds are far outside what any bench has, and narrow enough for every result to be finite.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from holoview.effects.calibration.learned_maps import MapLayout
from holoview.util.errors import UserError
from holoview.util.file_schema import ArraySchema
from holoview.util.tables import read_record

_F32 = ("float32",)
_LOG_AMPLITUDE = (-20.0, 20.0)
_PATH_M = (-1e-4, 1e-4)
_SOURCE = ("anchor", "source rows", "source columns")

MAP_SCHEMAS = (
    ArraySchema("lut_steps", _F32, ("modulator", "step"), -20.0, 20.0),
    ArraySchema("fringing_px2", _F32, ("fringed modulator",), -400.0, 400.0),
    ArraySchema("source_log_amplitude", _F32, _SOURCE, *_LOG_AMPLITUDE),
    ArraySchema("source_opd_m", _F32, _SOURCE, *_PATH_M),
    ArraySchema("warp_m", _F32, (2, "warp rows", "warp columns"), -1e-2, 1e-2),
    ArraySchema("zernike1_m", _F32, ("term of relay 1", "power"), *_PATH_M),
    ArraySchema("zernike2_m", _F32, ("term of relay 2", "power"), *_PATH_M),
    ArraySchema("pupil1_log_amplitude", _F32, ("pupil 1 rows", "pupil 1 columns"), *_LOG_AMPLITUDE),
    ArraySchema("pupil2_log_amplitude", _F32, ("pupil 2 rows", "pupil 2 columns"), *_LOG_AMPLITUDE),
)
"""Of each tensor of `learned_maps.TENSORS`, in that order."""

_EXPECTED = "the layout of a calibration"
_MOST = {"knots": 4096, "degree": 8, "anchors_m": 256, "noll1": 231, "noll2": 231}
_MOST_NODES = {"source_nodes": 4096, "warp_nodes": 32, "pupil_nodes": 1024}
_WAVELENGTHS_M = (100e-9, 10e-6)


def read_layout(text: str, where: str) -> MapLayout:
    """The layout of a JSON text. Raises UserError, with the place `where`, when it isn't one."""
    layout = read_record(MapLayout, text, where, _EXPECTED)
    for name, expected in _faults(layout):
        raise UserError(f"{where}: {name}", str(getattr(layout, name)), expected=expected)
    return layout


def map_sizes(layout: MapLayout) -> dict[str, int]:
    """The sizes that the tensors of a layout have, by the names of their axes."""
    shapes = layout.shapes()
    return {
        axis: size
        for schema in MAP_SCHEMAS
        for axis, size in zip(schema.axes or (), shapes[schema.name], strict=True)
        if isinstance(axis, str)
    }


def _faults(layout: MapLayout) -> Iterator[tuple[str, str]]:
    """Each field of a layout that is out of range, with what is expected."""
    if layout.modulators not in (1, 2):
        yield "modulators", "1 or 2"
    low, high = _WAVELENGTHS_M
    if not low <= layout.reference_m <= high:
        yield "reference_m", f"a wavelength from {low:g} to {high:g} m"
    anchors = layout.anchors_m
    rising = all(a < b for a, b in pairwise(anchors))
    if not (0 < len(anchors) <= _MOST["anchors_m"] and rising and low <= anchors[0] and anchors[-1] <= high):
        yield "anchors_m", f"rising wavelengths from {low:g} to {high:g} m"
    if not 2 <= layout.knots <= _MOST["knots"]:
        yield "knots", f"2 to {_MOST['knots']}"
    if not 0 <= layout.degree <= _MOST["degree"]:
        yield "degree", f"0 to {_MOST['degree']}"
    for name, most in _MOST_NODES.items():
        nodes = getattr(layout, name)
        if not (nodes == (0, 0) and name != "source_nodes") and not all(2 <= n <= most for n in nodes):
            yield name, f"2 to {most} rows and columns"
    for name in ("noll1", "noll2"):
        if not all(1 <= index <= _MOST[name] for index in getattr(layout, name)):
            yield name, f"indices from 1 to {_MOST[name]}"
    for name in ("sine1", "sine2"):
        if not 1e-6 <= getattr(layout, name) <= 1:
            yield name, "a direction sine above 0, at most 1"
