"""Maps of a display that a calibration learned from captures, and their action on light; all differentiable.

The hyperspectral model of HoloChrome, with the fringing of its modulators, at a wavelength λ with a reference λ₀:

    modulator m    fraction of the stroke: a rising table, linear between its knots. It is an optical path, so that the
                   phase at λ is that at λ₀ times λ₀/λ.
    fringing       the optical path of a modulator is blurred by a Gaussian, as fields reach neighbouring pixels
    source         exp(a(λ) + 2πi·p(λ)/λ): maps on nodes at anchor wavelengths, linear in λ between them
    warp           modulator 2 is seen at r − d(r), where d is the thin-plate spline through displacements at nodes
                   (Duchon 1977; Bookstein, IEEE PAMI 11, 567 (1989))
                   Of a chain every element that shows patterns has a table and fringing, and none a warp; the source is
                   the light on its field, and each of its spaces, that to the planes too, is a relay.
    relay          exp(b(s) + 2πi·opd/λ), opd = Σ_jp c_jp·Z_j(s)·((λ − λ₀)/100 nm)^p over direction sines s = λu from
                   the centre of its stops.
                   A feature fixed in the optics shrinks in frequency as λ₀/λ.

All tensors are zero for the nominal display. Their file is one of safetensors, in SI units, with the metadata format,
version, layout (JSON) and summary (JSON: the captures they were learned from, and how well they predict others).
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import re
from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import torch
from torch.nn.functional import interpolate

from holoview.light.model.chain import way_words
from holoview.light.model.effects.hook_contexts import ModulatorContext, RelayContext
from holoview.light.numerics.resample import centred_indices, interpolate_at
from holoview.light.numerics.sampling import knot_interval
from holoview.light.numerics.surfaces import thin_plate_spline_matrix, zernike
from holoview.util.errors import UserError
from holoview.util.safetensors_file import TensorFormat
from holoview.util.tables import ArraySchema, parse_json_table, read_record

Tensor = torch.Tensor
RowsColumns = tuple[int, int]

_WAVELENGTH_UNIT_M = 100e-9  # of the polynomials in the wavelength
_LATTICE = 96  # points along a side at which a thin-plate spline is evaluated; between them it is interpolated
_LEAST_VARIANCE = 1e-6  # pixels²; a blur of a thousandth of a pixel changes nothing


@dataclass(frozen=True)
class RelayMaps:
    """The maps of one relay. name: for people. zernike, pupil: names of its tensors.

    noll: Noll indices of its Zernike terms. pupil_nodes: (rows, columns). sine: direction sine at its edge.
    """

    name: str
    zernike: str
    pupil: str
    noll: tuple[int, ...]
    pupil_nodes: RowsColumns
    sine: float


def map_kind(name: str) -> str:
    """A tensor's name without its relay: "zernike_m" of "zernike1_m" and of "zernike_m/space1"."""
    return re.sub(r"^(zernike|pupil)[12]|/.*", r"\1", name)


@dataclass(frozen=True)
class MapLayout:
    """The maps of a calibration and their sizes. An empty tuple or (0, 0) means that there is no such map.

    modulators: number of modulators, of a chain of elements that show patterns.
    reference_m: the wavelength λ₀.
    anchors_m: wavelengths of the source's maps, rising.
    knots: of each response table.
    source_nodes, warp_nodes, pupil_nodes: (rows, columns) of nodes.
    noll1, noll2: Noll indices of the Zernike terms of each relay; of a chain of the spaces between its elements, and of
    that to the planes.
    degree: of their polynomial in the wavelength.
    sine1, sine2: direction sine at the edge of each relay's aperture.
    fringing: whether fringing is learned.
    elements: of a chain, the names of the elements that show patterns, in order; empty of a short form.
    relays: of a chain, the names (`Way.relay_words`) of its spaces, that to the planes last.
    sines: of a chain, the direction sine at the edge of the aperture of each of `relays`. Files that former versions
    wrote of chains have none: their relays are the first space, "" without one, and that to the planes, with the
    tensors and sines of relays 1 and 2.
    """

    modulators: int
    reference_m: float
    anchors_m: tuple[float, ...]
    knots: int = 16
    source_nodes: RowsColumns = (12, 16)
    warp_nodes: RowsColumns = (0, 0)
    noll1: tuple[int, ...] = ()
    noll2: tuple[int, ...] = ()
    degree: int = 1
    pupil_nodes: RowsColumns = (0, 0)
    sine1: float = 1.0
    sine2: float = 1.0
    fringing: bool = True
    elements: tuple[str, ...] = ()
    relays: tuple[str, ...] = ()
    sines: tuple[float, ...] = ()

    @property
    def relay_maps(self) -> tuple[RelayMaps, ...]:
        """The maps of each relay, in the order of the light."""
        if self.sines:
            nolls = (*[self.noll1] * (len(self.relays) - 1), self.noll2)
            return tuple(
                RelayMaps(name, f"zernike_m/{name}", f"pupil_log_amplitude/{name}", noll, self.pupil_nodes, sine)
                for name, noll, sine in zip(self.relays, nolls, self.sines, strict=True)
            )
        names = self.relays or ("relay 1", "relay 2")
        has_relay1 = names[0] != "" if self.relays else self.modulators == 2
        nodes = self.pupil_nodes if has_relay1 else (0, 0)
        return (
            RelayMaps(names[0], "zernike1_m", "pupil1_log_amplitude", self.noll1, nodes, self.sine1),
            RelayMaps(names[1], "zernike2_m", "pupil2_log_amplitude", self.noll2, self.pupil_nodes, self.sine2),
        )

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The shape of every tensor; a size is 0 where there is no such map."""
        powers, anchors = self.degree + 1, len(self.anchors_m)
        return {
            "lut_steps": (self.modulators, self.knots - 1),
            "fringing_px2": (self.modulators,) if self.fringing else (0,),
            "source_log_amplitude": (anchors, *self.source_nodes),
            "source_opd_m": (anchors, *self.source_nodes),
            "warp_m": (2, *self.warp_nodes),
            **{own.zernike: (len(own.noll), powers) for own in self.relay_maps},
            **{own.pupil: own.pupil_nodes for own in self.relay_maps},
        }

    def to_json(self) -> str:
        """The layout as JSON; of a short form as former versions read it."""
        table = dataclasses.asdict(self)
        own = {name: value for name, value in table.items() if value or name not in ("elements", "relays", "sines")}
        return json.dumps(own)

    def number_of(self, context: ModulatorContext) -> int:
        """The index of the table and the fringing of a modulator."""
        return self.elements.index(context.element) if self.elements else context.number


class MapCache:
    """Intermediate results that are reused between calls.

    of_layout: depend on the layout only.
    of_tensors: valid until the tensors change.
    """

    def __init__(self) -> None:
        self.of_layout: dict[Hashable, Tensor] = {}
        self.of_tensors: dict[Hashable, Tensor] = {}


class LearnedMaps:
    """The tensors of a layout by their names, and their action on light.

    cache: where intermediate results are kept; None computes everything anew.
    """

    def __init__(self, layout: MapLayout, tensors: Mapping[str, Tensor], cache: MapCache | None = None) -> None:
        self.layout, self.tensors = layout, dict(tensors)
        self._of_layout = None if cache is None else cache.of_layout
        self._of_tensors = None if cache is None else cache.of_tensors

    @staticmethod
    def nominal(layout: MapLayout, dtype: torch.dtype = torch.float32) -> LearnedMaps:
        """The maps of the nominal display: zeros."""
        return LearnedMaps(layout, {name: torch.zeros(shape, dtype=dtype) for name, shape in layout.shapes().items()})

    def has(self, name: str) -> bool:
        """Whether there is a map of this name."""
        return self.tensors[name].numel() > 0

    # --- modulators -------------------------------------------------------------------------------------------------

    def response_table(self, modulator: int) -> Tensor:
        """The fraction of the nominal stroke at each knot, (knots,), from 0, rising for every value of the tensor."""
        steps = self.tensors["lut_steps"][modulator].exp() / (self.layout.knots - 1)
        return torch.cat([steps.new_zeros(1), steps.cumsum(dim=0)])

    def stroke_response(self, share: Tensor, context: ModulatorContext) -> Tensor:
        """The fraction of the nominal stroke that pixels show for the fraction `share` that was sent."""
        table = self.response_table(self.layout.number_of(context)).to(share.dtype)
        index, fraction = knot_interval(share, self.layout.knots - 1)
        return table[index] * (1 - fraction) + table[index + 1] * fraction

    def with_fringing(self, path_m: Tensor, context: ModulatorContext) -> Tensor:
        """The optical path of a modulator, blurred by fringing.

        The variance is clamped from below, but its gradient passes: otherwise a step to a negative variance could never
        be undone.
        """
        if self.layout.elements and context.element not in self.layout.elements:
            return path_m  # of a mask
        variance = self.tensors["fringing_px2"][self.layout.number_of(context)]
        clamped = variance + (variance.clamp_min(_LEAST_VARIANCE) - variance).detach()
        return context.blurred(path_m, clamped.to(path_m.dtype).sqrt())

    def source_field(self, context: ModulatorContext) -> Tensor:
        """The complex amplitude of the light on the pixels of the first modulator, (rows, columns)."""

        def make() -> Tensor:
            amplitude, path = (self.source_map(name, context) for name in ("source_log_amplitude", "source_opd_m"))
            return torch.polar(amplitude.exp(), path * (2 * math.pi / context.wavelength_m))

        return _cached(self._of_tensors, ("source", context.wavelength_m, context.shape), make)

    def source_map(self, name: str, context: ModulatorContext) -> Tensor:
        """A map of the source at the pixels of the first modulator, (rows, columns), in the tensor's unit."""
        return _bicubic(self.interpolate_wavelength(name, context.wavelength_m), context.shape)

    def interpolate_wavelength(self, name: str, wavelength_m: float) -> Tensor:
        """A map of the source at a wavelength, on its nodes: linear between anchors, constant beyond them."""
        maps, anchors = self.tensors[name], self.layout.anchors_m
        right = next((i for i, anchor in enumerate(anchors) if anchor >= wavelength_m), len(anchors) - 1)
        left = max(right - 1, 0)
        if anchors[right] <= wavelength_m or left == right:
            return maps[right]
        fraction = (wavelength_m - anchors[left]) / (anchors[right] - anchors[left])
        return (1 - fraction) * maps[left] + fraction * maps[right]

    def displacement(self, shape: RowsColumns) -> Tensor:
        """The displacement (y, x), in m, of modulator 2 on a grid of `shape` over it, (2, rows, columns)."""

        def make() -> Tensor:
            nodes = self.tensors["warp_m"]
            lattice = (min(shape[0], _LATTICE), min(shape[1], _LATTICE))
            spline = _cached(
                self._of_layout, ("spline", shape), lambda: self._spline(lattice, shape[1] / shape[0]).to(nodes)
            )
            displacement = (nodes.flatten(1) @ spline.T).reshape(2, *lattice)
            return interpolate(displacement[None], size=shape, mode="bilinear", align_corners=False)[0]

        return _cached(self._of_tensors, ("displacement", shape), make)

    def _spline(self, lattice: RowsColumns, aspect: float) -> Tensor:
        return thin_plate_spline_matrix(self.layout.warp_nodes, lattice, aspect)

    def warped_transmission(self, transmission: Tensor, context: ModulatorContext) -> Tensor:
        """The transmission of modulator 2, of samples, with the warp."""
        transmission = context.sampled(transmission)
        rows, columns = transmission.shape
        step = context.pitch_m * context.shape[0] / rows
        displacement = self.displacement((rows, columns)) / step
        y = centred_indices(rows, displacement.dtype, displacement.device)[:, None] - displacement[0]
        x = centred_indices(columns, displacement.dtype, displacement.device)[None, :] - displacement[1]
        real = transmission.real.dtype
        return interpolate_at(transmission, y.to(real), x.to(real))

    # --- relays -----------------------------------------------------------------------------------------------------

    def relay_opd(self, context: RelayContext) -> Tensor:
        """The optical path (m) of a relay at the frequencies of the context, (rows, columns)."""
        coefficients = self.tensors[self.layout.relay_maps[context.relay].zernike]
        x = (context.wavelength_m - self.layout.reference_m) / _WAVELENGTH_UNIT_M
        powers = torch.tensor([x**p for p in range(self.layout.degree + 1)], dtype=coefficients.dtype)
        terms = self._zernikes(context)
        return torch.tensordot((coefficients @ powers).to(terms.dtype), terms, dims=1)

    def relay_amplitude(self, context: RelayContext) -> Tensor:
        """The amplitude transmission of a relay at the frequencies of the context, (rows, columns)."""
        own = self.layout.relay_maps[context.relay]
        nodes = self.tensors[own.pupil]
        scale = [(n - 1) / 2 / own.sine for n in nodes.shape]
        shape = (len(context.sine_y), context.sine_x.shape[1])
        sine_y, sine_x = context.sines_from_centre
        y, x = (s.to(nodes.dtype).expand(shape) for s in (sine_y * scale[0], sine_x * scale[1]))
        return interpolate_at(nodes, y, x).exp()

    def pupil(self, pupil: Tensor, context: RelayContext) -> Tensor:
        """The complex pupil times the learned pupil of the relay; of a chain unchanged where none was learned."""
        if self.layout.relays:
            own = way_words(context.names)
            if own not in self.layout.relays:
                return pupil
            context = dataclasses.replace(context, relay=self.layout.relays.index(own))
        maps = self.layout.relay_maps[context.relay]

        def make() -> Tensor:
            shape = (len(context.sine_y), context.sine_x.shape[1])
            learned = torch.ones(shape, dtype=pupil.dtype)
            if self.has(maps.pupil):
                learned = learned * self.relay_amplitude(context)
            if self.has(maps.zernike):
                learned = context.delayed(learned, self.relay_opd(context))
            return learned

        return pupil * _cached(self._of_tensors, ("pupil", *_frequencies_key(context)), make)

    def _zernikes(self, context: RelayContext) -> Tensor:
        own = self.layout.relay_maps[context.relay]

        def make() -> Tensor:
            radius = torch.hypot(*context.sines_from_centre) / own.sine
            return torch.stack([zernike(j, radius, context.angle) for j in own.noll])

        return _cached(self._of_layout, ("zernikes", *_frequencies_key(context)), make)


def _cached(cache: dict[Hashable, Tensor] | None, key: Hashable, make: Callable[[], Tensor]) -> Tensor:
    if cache is None:
        return make()
    if key not in cache:
        cache[key] = make()
    return cache[key]


def _frequencies_key(context: RelayContext) -> tuple[Hashable, ...]:
    """A cache key of the relay and the frequencies of a context."""
    return (
        context.relay,
        context.wavelength_m,
        context.centre,
        len(context.sine_y),
        context.sine_x.shape[1],
        float(context.sine_x.abs().max()),
    )


def _bicubic(nodes: Tensor, shape: RowsColumns) -> Tensor:
    """A map of `shape`, bicubic between nodes (y, x), of which the outermost lie on the edges."""
    return interpolate(nodes[None, None], size=shape, mode="bicubic", align_corners=True)[0, 0]


# --- the file of a calibration --------------------------------------------------------------------------------------

# The bounds are far outside those of any bench, and narrow enough for every result to be finite.
_F32 = ("float32",)
_LOG_AMPLITUDE = (-20.0, 20.0)
_PATH_M = (-1e-4, 1e-4)
_SOURCE = ("anchor", "source rows", "source columns")

_SCHEMAS = (
    ArraySchema("lut_steps", _F32, ("modulator", "step"), -20.0, 20.0),
    ArraySchema("fringing_px2", _F32, ("fringed modulator",), -400.0, 400.0),
    ArraySchema("source_log_amplitude", _F32, _SOURCE, *_LOG_AMPLITUDE),
    ArraySchema("source_opd_m", _F32, _SOURCE, *_PATH_M),
    ArraySchema("warp_m", _F32, (2, "warp rows", "warp columns"), -1e-2, 1e-2),
)


def map_schemas(layout: MapLayout) -> tuple[ArraySchema, ...]:
    """The schemas of the tensors of a layout."""
    zernikes = [ArraySchema(own.zernike, _F32, (f"term of {own.name}", "power"), *_PATH_M) for own in layout.relay_maps]
    pupils = [
        ArraySchema(
            own.pupil, _F32, tuple(f"pupil {axis} of {own.name}" for axis in ("rows", "columns")), *_LOG_AMPLITUDE
        )
        for own in layout.relay_maps
    ]
    return (*_SCHEMAS, *zernikes, *pupils)


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
        for schema in map_schemas(layout)
        for axis, size in zip(schema.axes or (), shapes[schema.name], strict=True)
        if isinstance(axis, str)
    }


def _faults(layout: MapLayout) -> Iterator[tuple[str, str]]:
    """Each field of a layout that is out of range, with the range."""
    if layout.elements:
        if layout.modulators != len(layout.elements) or len({*layout.elements}) != layout.modulators:
            yield "elements", f"{layout.modulators} names that differ"
        count, relays = len(layout.sines) or 2, layout.relays
        nameless = "" in (relays if layout.sines else relays[1:])
        if nameless or len(relays) != count or len({*relays}) != count:
            yield "relays", f"{count} names that differ"
    elif layout.relays or layout.sines:
        yield "relays", "none without elements"
    elif layout.modulators not in (1, 2):
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
    for name, sines in (("sine1", (layout.sine1,)), ("sine2", (layout.sine2,)), ("sines", layout.sines)):
        if not all(1e-6 <= sine <= 1 for sine in sines):
            yield name, "a direction sine above 0, at most 1"


def _format(layout: MapLayout | None) -> TensorFormat:
    """The file format for the maps of a layout; with None, for reading the metadata only."""
    return TensorFormat(
        name="holoview-calibration",
        version="1",
        what="the maps of a calibration that `holoview calibrate` wrote",
        tensors=() if layout is None else map_schemas(layout),
        metadata_keys=("layout", "summary"),
    )


@dataclass(frozen=True)
class CalibrationFile:
    """Learned maps and the summary of their calibration."""

    maps: LearnedMaps
    summary: dict[str, Any]


def write_calibration(path: str | os.PathLike[str], learned: LearnedMaps, summary: Mapping[str, Any]) -> None:
    """Writes the file atomically. Raises UserError when it can't be written."""
    tensors = {name: tensor.detach().float().numpy() for name, tensor in learned.tensors.items()}
    _format(learned.layout).write(path, tensors, {"layout": learned.layout.to_json(), "summary": json.dumps(summary)})


def read_calibration(path: str | os.PathLike[str]) -> CalibrationFile:
    """Reads the file. Raises UserError when it is missing, damaged, of another format, or not as `map_schemas` says."""
    with _format(None).open(path) as file:
        texts = file.texts
    layout = read_layout(texts["layout"], f"{path}: layout")
    summary = parse_json_table(texts["summary"], f"{path}: summary", "the scores of a calibration")
    with _format(layout).open(path) as file:
        arrays = file.tensors(map_sizes(layout))
    maps = LearnedMaps(layout, {name: torch.from_numpy(array) for name, array in arrays.items()})
    return CalibrationFile(maps, summary)
