"""Maps of a bench that were learned from captures, and what they make of light; all differentiable.

The hyperspectral model of HoloChrome, and the fringing of its modulators, for a wavelength λ and a reference λ₀:

    modulator m    share of the stroke = linear between the knots of a table that rises; an optical path, so that its
                   phase at λ is that at λ₀ times λ₀/λ
    fringing       a modulator's optical path is blurred by a Gaussian of some variance: pixels leak into neighbours
    source         exp(a(λ) + 2πi·p(λ)/λ): maps on nodes, at anchor wavelengths, linear in λ between them
    warp           modulator 2 is seen at r − d(r), d the thin-plate spline through displacements of nodes
                   (Duchon 1977; Bookstein, IEEE PAMI 11, 567 (1989))
    relay          exp(b(s) + 2πi·opd/λ), opd = Σ_jp c_jp·Z_j(s)·((λ − λ₀)/100 nm)^p over direction sines s = λu: what
                   is fixed in the glass shrinks in frequency as λ₀/λ

Every tensor is zero where the bench is nominal.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch.nn.functional import interpolate

from holoview.model.effects.hook_contexts import ModulatorContext, RelayContext
from holoview.numerics.resample import centred_indices, interpolate_at
from holoview.numerics.zernike import zernike
from holoview.util.errors import UserError

Tensor = torch.Tensor
Pair = tuple[int, int]

_SLOPE_M = 100e-9
_LATTICE = 96  # nodes a side on which a thin-plate spline is evaluated; it is smooth between them

_LEAST_VARIANCE = 1e-6  # pixels²: a blur of a thousandth of a pixel changes nothing

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
    """Which maps there are, and how fine. An empty tuple or (0, 0): no such map.

    modulators: how many; knots: of each table; anchors_m: rising wavelengths of the source's maps; source_nodes,
    warp_nodes, pupil_nodes: rows and columns of nodes; noll1, noll2: Zernike terms of each relay; degree: of their
    polynomial in the wavelength; sine1, sine2: radius of each relay's aperture; fringing: whether that is learned.
    """

    modulators: int
    reference_m: float
    anchors_m: tuple[float, ...]
    knots: int = 16
    source_nodes: Pair = (12, 16)
    warp_nodes: Pair = (0, 0)
    noll1: tuple[int, ...] = ()
    noll2: tuple[int, ...] = ()
    degree: int = 1
    pupil_nodes: Pair = (0, 0)
    sine1: float = 1.0
    sine2: float = 1.0
    fringing: bool = True

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Shape of every tensor; a size of zero where there is no such map."""
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
        """As JSON."""
        return json.dumps(dataclasses.asdict(self))

    @staticmethod
    def from_json(text: str, where: str) -> MapLayout:
        """From JSON. Raises UserError when it isn't a layout."""
        try:
            values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in json.loads(text).items()}
            return MapLayout(**values)
        except (ValueError, TypeError, AttributeError) as error:
            raise UserError(where, f"can't be read: {error}", expected="the layout of a calibration") from error


class MapCache:
    """Results between calls: `fixed` ones of a layout, and `made` ones that hold until the tensors change."""

    def __init__(self) -> None:
        self.fixed: dict[Hashable, Tensor] = {}
        self.made: dict[Hashable, Tensor] = {}


class LearnedMaps:
    """Tensors of a layout, by name. kept: where to keep results; None computes everything anew."""

    def __init__(self, layout: MapLayout, tensors: Mapping[str, Tensor], kept: MapCache | None = None) -> None:
        self.layout, self.tensors = layout, dict(tensors)
        self._fixed = None if kept is None else kept.fixed
        self._made = None if kept is None else kept.made

    @staticmethod
    def nominal(layout: MapLayout, dtype: torch.dtype = torch.float32) -> LearnedMaps:
        """A bench that is as it should be."""
        return LearnedMaps(layout, {name: torch.zeros(shape, dtype=dtype) for name, shape in layout.shapes().items()})

    def has(self, name: str) -> bool:
        """Whether there is such a map."""
        return self.tensors[name].numel() > 0

    # --- modulators -------------------------------------------------------------------------------------------------

    def response_table(self, modulator: int) -> Tensor:
        """Share of the nominal stroke at each knot (knots,), from 0; rises whatever the tensor holds."""
        steps = self.tensors["lut_steps"][modulator].exp() / (self.layout.knots - 1)
        return torch.cat([steps.new_zeros(1), steps.cumsum(dim=0)])

    def stroke_response(self, share: Tensor, modulator: int) -> Tensor:
        """Share of the nominal stroke that pixels show for the share that was sent."""
        table = self.response_table(modulator).to(share.dtype)
        place = (share * (self.layout.knots - 1)).clamp(0, self.layout.knots - 1)
        left = place.floor().clamp_max(self.layout.knots - 2)
        index, rest = left.long(), place - left
        return table[index] * (1 - rest) + table[index + 1] * rest

    def with_fringing(self, path_m: Tensor, at: ModulatorContext) -> Tensor:
        """A modulator's optical path as its pixels' neighbours leave it.

        Below zero, where the variance stops, gradients still pass: else a step too far could never be taken back.
        """
        variance = self.tensors["fringing_px2"][at.number]
        stopped = variance + (variance.clamp_min(_LEAST_VARIANCE) - variance).detach()
        return at.blurred(path_m, stopped.to(path_m.dtype).sqrt())

    def source_field(self, at: ModulatorContext) -> Tensor:
        """Complex amplitude of the light on the first modulator's pixels (rows, columns)."""

        def make() -> Tensor:
            amplitude, path = (self.source_map(name, at) for name in ("source_log_amplitude", "source_opd_m"))
            return torch.polar(amplitude.exp(), path * (2 * math.pi / at.wavelength_m))

        return _cached(self._made, ("source", at.wavelength_m, at.shape), make)

    def source_map(self, name: str, at: ModulatorContext) -> Tensor:
        """A map of the source on the first modulator's pixels (rows, columns), in the tensor's unit."""
        return _on_grid(self.interpolate_wavelength(name, at.wavelength_m), at.shape)

    def interpolate_wavelength(self, name: str, wavelength_m: float) -> Tensor:
        """A map of the source at a wavelength: linear between anchors, constant beyond them."""
        maps, anchors = self.tensors[name], self.layout.anchors_m
        right = next((i for i, anchor in enumerate(anchors) if anchor >= wavelength_m), len(anchors) - 1)
        left = max(right - 1, 0)
        if anchors[right] <= wavelength_m or left == right:
            return maps[right]
        share = (wavelength_m - anchors[left]) / (anchors[right] - anchors[left])
        return (1 - share) * maps[left] + share * maps[right]

    def displacement(self, shape: Pair) -> Tensor:
        """How far (y, x in m) what modulator 2 shows at each place of a grid over it was moved, (2, rows, columns)."""

        def make() -> Tensor:
            nodes = self.tensors["warp_m"]
            lattice = (min(shape[0], _LATTICE), min(shape[1], _LATTICE))
            spline = _cached(
                self._fixed, ("spline", shape), lambda: self._spline(lattice, shape[1] / shape[0]).to(nodes)
            )
            moved = (nodes.flatten(1) @ spline.T).reshape(2, *lattice)
            return interpolate(moved[None], size=shape, mode="bilinear", align_corners=False)[0]

        return _cached(self._made, ("displacement", shape), make)

    def _spline(self, lattice: Pair, aspect: float) -> Tensor:
        return _thin_plate(self.layout.warp_nodes, lattice, aspect)

    def warped_transmission(self, light: Tensor, at: ModulatorContext) -> Tensor:
        """Modulator 2's transmission, of samples, as it arrives."""
        light = at.sampled(light)
        rows, columns = light.shape
        step = at.pitch_m * at.shape[0] / rows
        moved = self.displacement((rows, columns)) / step
        y = centred_indices(rows, moved.dtype, moved.device)[:, None] - moved[0]
        x = centred_indices(columns, moved.dtype, moved.device)[None, :] - moved[1]
        return interpolate_at(light, y.to(light.real.dtype), x.to(light.real.dtype))

    # --- relays -----------------------------------------------------------------------------------------------------

    def relay_opd(self, at: RelayContext) -> Tensor:
        """Optical path (m) of a relay at its frequencies (rows, columns)."""
        coefficients = self.tensors[f"zernike{at.relay + 1}_m"]
        x = (at.wavelength_m - self.layout.reference_m) / _SLOPE_M
        powers = torch.tensor([x**p for p in range(self.layout.degree + 1)], dtype=coefficients.dtype)
        terms = self._zernikes(at)
        return torch.tensordot((coefficients @ powers).to(terms.dtype), terms, dims=1)

    def relay_amplitude(self, at: RelayContext) -> Tensor:
        """Amplitude that a relay transmits at its frequencies (rows, columns)."""
        nodes, sine = self.tensors[f"pupil{at.relay + 1}_log_amplitude"], self._sine(at)
        scale = [(n - 1) / 2 / sine for n in nodes.shape]
        shape = (len(at.sine_y), at.sine_x.shape[1])
        y, x = (s.to(nodes.dtype).expand(shape) for s in (at.sine_y * scale[0], at.sine_x * scale[1]))
        return interpolate_at(nodes, y, x).exp()

    def pupil(self, pupil: Tensor, at: RelayContext) -> Tensor:
        """A relay's complex pupil, with what was learned about it."""

        def make() -> Tensor:
            shape = (len(at.sine_y), at.sine_x.shape[1])
            made = torch.ones(shape, dtype=pupil.dtype)
            if self.has(f"pupil{at.relay + 1}_log_amplitude"):
                made = made * self.relay_amplitude(at)
            if self.has(f"zernike{at.relay + 1}_m"):
                made = at.delayed(made, self.relay_opd(at))
            return made

        return pupil * _cached(self._made, ("pupil", *_place(at)), make)

    def _sine(self, at: RelayContext) -> float:
        return self.layout.sine2 if at.relay else self.layout.sine1

    def _zernikes(self, at: RelayContext) -> Tensor:
        noll = self.layout.noll2 if at.relay else self.layout.noll1

        def make() -> Tensor:
            radius = torch.hypot(at.sine_y, at.sine_x) / self._sine(at)
            return torch.stack([zernike(j, radius, at.angle) for j in noll])

        return _cached(self._fixed, ("zernikes", *_place(at)), make)


def _cached(kept: dict[Hashable, Tensor] | None, key: Hashable, make: Callable[[], Tensor]) -> Tensor:
    if kept is None:
        return make()
    if key not in kept:
        kept[key] = make()
    return kept[key]


def _place(at: RelayContext) -> tuple[Hashable, ...]:
    """What tells apertures apart."""
    return at.relay, at.wavelength_m, len(at.sine_y), at.sine_x.shape[1], float(at.sine_x.abs().max())


def _on_grid(nodes: Tensor, shape: Pair) -> Tensor:
    """Nodes (y, x), the outermost on the edges, as a map of `shape`: cubic between them."""
    return interpolate(nodes[None, None], size=shape, mode="bicubic", align_corners=True)[0, 0]


def _thin_plate(nodes: Pair, lattice: Pair, aspect: float) -> Tensor:
    """(places, nodes) float64: the values at a lattice of the thin-plate spline through values at equidistant nodes.

    f(r) = Σ_i w_i·U(|r − r_i|) + a + b·r with U = ρ² log ρ and Σ w_i = Σ w_i·r_i = 0, which makes it linear in the
    values at the nodes.
    """
    at, to = _lattice(nodes, aspect, corners=True), _lattice(lattice, aspect, corners=False)
    count = len(at)
    system = torch.zeros(count + 3, count + 3, dtype=torch.float64)
    system[:count, :count] = _thin_plate_kernel(torch.cdist(at, at))
    system[:count, count:] = _affine(at)
    system[count:, :count] = _affine(at).T
    solved = torch.linalg.inv(system)[:, :count]
    return torch.cat([_thin_plate_kernel(torch.cdist(to, at)), _affine(to)], dim=1) @ solved


def _lattice(shape: Pair, aspect: float, *, corners: bool) -> Tensor:
    """Places (n, 2) over a rectangle of height 2 and width 2·aspect: on its edges, or in the middle of equal cells."""
    sides = []
    for n in shape:
        ends = 1.0 if corners else 1 - 1 / n
        sides.append(torch.linspace(-ends, ends, n, dtype=torch.float64))
    y, x = torch.meshgrid(sides[0], sides[1] * aspect, indexing="ij")
    return torch.stack([y.flatten(), x.flatten()], dim=1)


def _affine(places: Tensor) -> Tensor:
    return torch.cat([torch.ones(len(places), 1, dtype=places.dtype), places], dim=1)


def _thin_plate_kernel(distance: Tensor) -> Tensor:
    return distance.square() * distance.clamp_min(1e-30).log()
