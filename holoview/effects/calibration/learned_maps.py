"""Maps of a display that a calibration learned from captures, and what they do to light; all differentiable.

The hyperspectral model of HoloChrome, with the fringing of its modulators, at a wavelength λ with a reference λ₀:

    modulator m    fraction of the stroke: a rising table, linear between its knots. It is an optical path, so that the
                   phase at λ is that at λ₀ times λ₀/λ.
    fringing       the optical path of a modulator is blurred by a Gaussian, as fields reach neighbouring pixels
    source         exp(a(λ) + 2πi·p(λ)/λ): maps on nodes at anchor wavelengths, linear in λ between them
    warp           modulator 2 is seen at r − d(r), where d is the thin-plate spline through displacements at nodes
                   (Duchon 1977; Bookstein, IEEE PAMI 11, 567 (1989))
    relay          exp(b(s) + 2πi·opd/λ), opd = Σ_jp c_jp·Z_j(s)·((λ − λ₀)/100 nm)^p over direction sines s = λu from
                   the centre of its stops.
                   What is fixed in the optics shrinks in frequency as λ₀/λ.

All tensors are zero for the nominal display.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass

import torch
from torch.nn.functional import interpolate

from holoview.model.effects.hook_contexts import ModulatorContext, RelayContext
from holoview.numerics.knots import knot_interval
from holoview.numerics.resample import centred_indices, interpolate_at
from holoview.numerics.thin_plate_spline import thin_plate_spline_matrix
from holoview.numerics.zernike import zernike

Tensor = torch.Tensor
RowsColumns = tuple[int, int]

_WAVELENGTH_UNIT_M = 100e-9  # of the polynomials in the wavelength
_LATTICE = 96  # points along a side at which a thin-plate spline is evaluated; between them it is interpolated
_LEAST_VARIANCE = 1e-6  # pixels²; a blur of a thousandth of a pixel changes nothing

TENSORS = (
    "lut_steps",
    "fringing_px2",
    "source_log_amplitude",
    "source_opd_m",
    "warp_m",
    "zernike1_m",
    "zernike2_m",
    "pupil1_log_amplitude",
    "pupil2_log_amplitude",
)


@dataclass(frozen=True)
class MapLayout:
    """Which maps there are, and their sizes. An empty tuple or (0, 0) means that there is no such map.

    modulators: number of modulators.
    reference_m: the wavelength λ₀.
    anchors_m: wavelengths of the source's maps, rising.
    knots: of each response table.
    source_nodes, warp_nodes, pupil_nodes: (rows, columns) of nodes.
    noll1, noll2: Noll indices of the Zernike terms of each relay.
    degree: of their polynomial in the wavelength.
    sine1, sine2: direction sine at the edge of each relay's aperture.
    fringing: whether fringing is learned.
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

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The shape of every tensor; a size is 0 where there is no such map."""
        powers, anchors = self.degree + 1, len(self.anchors_m)
        has_relay1 = self.modulators == 2
        return {
            "lut_steps": (self.modulators, self.knots - 1),
            "fringing_px2": (self.modulators,) if self.fringing else (0,),
            "source_log_amplitude": (anchors, *self.source_nodes),
            "source_opd_m": (anchors, *self.source_nodes),
            "warp_m": (2, *self.warp_nodes),
            "zernike1_m": (len(self.noll1), powers),
            "zernike2_m": (len(self.noll2), powers),
            "pupil1_log_amplitude": self.pupil_nodes if has_relay1 else (0, 0),
            "pupil2_log_amplitude": self.pupil_nodes,
        }

    def to_json(self) -> str:
        """The layout as JSON."""
        return json.dumps(dataclasses.asdict(self))


class MapCache:
    """Intermediate results that are reused between calls.

    of_layout: depend on the layout only.
    of_tensors: valid until the tensors change.
    """

    def __init__(self) -> None:
        self.of_layout: dict[Hashable, Tensor] = {}
        self.of_tensors: dict[Hashable, Tensor] = {}


class LearnedMaps:
    """The tensors of a layout by their names, and what they do to light.

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
        """The fraction of the nominal stroke at each knot, (knots,), from 0; it rises for every value of the tensor."""
        steps = self.tensors["lut_steps"][modulator].exp() / (self.layout.knots - 1)
        return torch.cat([steps.new_zeros(1), steps.cumsum(dim=0)])

    def stroke_response(self, share: Tensor, modulator: int) -> Tensor:
        """The fraction of the nominal stroke that pixels show for the fraction `share` that was sent."""
        table = self.response_table(modulator).to(share.dtype)
        index, fraction = knot_interval(share, self.layout.knots - 1)
        return table[index] * (1 - fraction) + table[index + 1] * fraction

    def with_fringing(self, path_m: Tensor, context: ModulatorContext) -> Tensor:
        """The optical path of a modulator, blurred by fringing.

        The variance is clamped from below, but its gradient passes: otherwise a step to a negative variance could never
        be undone.
        """
        variance = self.tensors["fringing_px2"][context.number]
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
        coefficients = self.tensors[f"zernike{context.relay + 1}_m"]
        x = (context.wavelength_m - self.layout.reference_m) / _WAVELENGTH_UNIT_M
        powers = torch.tensor([x**p for p in range(self.layout.degree + 1)], dtype=coefficients.dtype)
        terms = self._zernikes(context)
        return torch.tensordot((coefficients @ powers).to(terms.dtype), terms, dims=1)

    def relay_amplitude(self, context: RelayContext) -> Tensor:
        """The amplitude transmission of a relay at the frequencies of the context, (rows, columns)."""
        nodes, sine = self.tensors[f"pupil{context.relay + 1}_log_amplitude"], self._sine(context)
        scale = [(n - 1) / 2 / sine for n in nodes.shape]
        shape = (len(context.sine_y), context.sine_x.shape[1])
        sine_y, sine_x = context.sines_from_centre
        y, x = (s.to(nodes.dtype).expand(shape) for s in (sine_y * scale[0], sine_x * scale[1]))
        return interpolate_at(nodes, y, x).exp()

    def pupil(self, pupil: Tensor, context: RelayContext) -> Tensor:
        """The complex pupil times what was learned about the relay."""

        def make() -> Tensor:
            shape = (len(context.sine_y), context.sine_x.shape[1])
            learned = torch.ones(shape, dtype=pupil.dtype)
            if self.has(f"pupil{context.relay + 1}_log_amplitude"):
                learned = learned * self.relay_amplitude(context)
            if self.has(f"zernike{context.relay + 1}_m"):
                learned = context.delayed(learned, self.relay_opd(context))
            return learned

        return pupil * _cached(self._of_tensors, ("pupil", *_frequencies_key(context)), make)

    def _sine(self, context: RelayContext) -> float:
        return self.layout.sine2 if context.relay else self.layout.sine1

    def _zernikes(self, context: RelayContext) -> Tensor:
        noll = self.layout.noll2 if context.relay else self.layout.noll1

        def make() -> Tensor:
            radius = torch.hypot(*context.sines_from_centre) / self._sine(context)
            return torch.stack([zernike(j, radius, context.angle) for j in noll])

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
