"""Where an error lives that no effect of the library explains.

- *Free maps.* Each place (source, modulator, relay, camera) gets smooth maps of amplitude, optical path or response,
  fitted to the fine captures by L-BFGS and compared on the held-out captures. The error lives at the place whose maps
  predict these best. `suggest_for` says which effect to write for a place, and which captures would show more of the
  error.
- *Pixel maps.* Smooth maps can't show a single column or row. `PixelMap` compares, at the modulator's full resolution,
  the fall of χ² if a pixel showed one level whatever is sent (`replacement_gains`) with the fall for all other pixels,
  and for whole lines with other lines. Lines that stand out get free levels, pixel by pixel and capture by capture:
  where these explain the excess and differ between captures, the lines flicker.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from scipy.optimize import OptimizeResult, minimize

from holoview.bench.captures.dataset import Captures
from holoview.bench.diagnose.fit import FittedValues
from holoview.bench.diagnose.likelihood import Comparison
from holoview.bench.diagnose.search_context import SearchContext
from holoview.bench.diagnose.starts.stuck import LEVELS, LINE_SEGMENTS, MIN_LINE_SIGMAS, NEAR_BEST_LINES
from holoview.bench.diagnose.starts.transmission_slopes import (
    line_gains,
    replacement_gains,
    significance,
    squared_residuals,
)
from holoview.light.effects.slm_stuck import describe_places
from holoview.light.model.chain import pixel_shape, way_words
from holoview.light.model.effects.effect import Effect, Parameter, Values
from holoview.light.model.effects.hook_contexts import CameraContext, ModulatorContext, RelayContext
from holoview.light.model.elements import Pixels
from holoview.light.model.system import System
from holoview.light.numerics.sampling import first_of_part

Tensor = torch.Tensor
Floats = NDArray[np.float64]

SURFACE_POINTS = (6, 8)
"""[points] Rows and columns of control points over a modulator or the camera. Evidence: none recorded."""

PUPIL_POINTS = (8, 8)
"""[points] Rows and columns of control points over a pupil. Evidence: none recorded."""

RESPONSE_POINTS = 9
"""[points] Control points of a response curve. Evidence: none recorded."""

ITERATIONS = 15
"""[1] Iterations of L-BFGS. Evidence: none recorded."""

PATH_SCALE_M = 50e-9
"""[m] Optical path that a map's unit stands for, which scales the optimiser's steps. Evidence: none recorded."""

RELATIVE_SCALE = 0.1
"""[1] Relative amplitude or response that a map's unit stands for. Evidence: none recorded."""

MIN_SHARE = 0.1
"""[1] Places are told that explain at least this share of the excess … Evidence: none recorded."""

_FREE_LEVELS_SHARE = 0.5
"""[1] Free levels of lines are told if they leave less than this share of the excess. Evidence: as for a cause."""

_CHANGING_AGREEMENT = 0.6
"""[1] Levels change if their phasors agree less. Evidence: derivation: the mean of five random phasors has a modulus of
0.4 ± 0.2; measured: constant levels agreed by 0.77 to 1.0."""

_FIRST_CAPTURES = 2
"""[captures] Where free levels leave more in these, which have the most excess, the others aren't fitted. Evidence: the
cost: with 1024 × 768 modulator pixels all captures took minutes."""

_LEVEL_ITERATIONS = 20
"""[1] Iterations of L-BFGS on the levels of lines. Evidence: measured: after 20 less than 1 % of the excess is left."""

NEAR_BEST_SHARE = 0.7
"""[1] A place is named if it explains at least this share of the excess that the best place explains. Evidence: none
recorded."""

_NEIGHBOURS = ("above", "below", "left", "right")


@dataclass(frozen=True, eq=False)
class ShownMap:
    """A fitted map: (y, x) over a surface or a pupil, or a few numbers (response curve, neighbours, single values).

    values: optical paths in m where `unit` is "m", relative changes where it is "1". extent: where a map lies, from its
    left, right, lower and upper edge; None for a few numbers. axis: the quantity of `extent`, or of the axis over which
    the numbers lie. labels: one for each number where the numbers aren't a curve.
    """

    name: str
    values: NDArray[np.float64]
    unit: str
    extent: tuple[float, float, float, float] | None = None
    axis: str = ""
    labels: tuple[str, ...] = ()


class FreeMaps(Effect):
    """Maps at one place, as an effect that holds tensors. Maps of zeros change nothing."""

    id = "free_maps"
    cause = "Something smooth at one place that no effect describes."
    finding = "Free maps are on."
    parameters = (Parameter("on", "1: the maps are applied."),)
    acts_on: ClassVar[tuple[str, ...]] = ()

    def __init__(self, shapes: dict[str, tuple[int, ...]]) -> None:
        self.maps = {name: torch.zeros(shape, dtype=torch.float64) for name, shape in shapes.items()}

    @property
    def parameter_count(self) -> int:
        """How many numbers are free."""
        return sum(m.numel() for m in self.maps.values())

    def set_from_vector(self, vector: NDArray[np.float64], *, grad: bool = False) -> list[Tensor]:
        """Sets all maps from one vector; returns them as leaf tensors, with gradients if `grad`."""
        at, leaves = 0, []
        for name, old in self.maps.items():
            part = torch.from_numpy(vector[at : at + old.numel()].copy()).reshape(old.shape).requires_grad_(grad)
            self.maps[name] = part
            leaves.append(part)
            at += old.numel()
        return leaves

    def shown_maps(self) -> tuple[ShownMap, ...]:
        """The maps with their units. Of a path the mean is subtracted: no picture shows it."""
        shown = []
        for name, tensor in self.maps.items():
            values = tensor.detach().numpy().copy()
            if name == "path":
                shown.append(ShownMap(name, PATH_SCALE_M * (values - values.mean()), "m"))
            else:
                shown.append(ShownMap(name, RELATIVE_SCALE * values, "1"))
        return tuple(shown)


class FreeSource(FreeMaps):
    """Amplitude and wavefront of the light on the first modulator, or behind a static element of a chain."""

    id = "free_source"
    acts_on = ("source",)

    def __init__(self, element: str = "") -> None:
        super().__init__({"amplitude": SURFACE_POINTS, "path": SURFACE_POINTS})
        self.element = element
        if element:
            self.id, self.acts_on, self.on_all_elements = f"free_{element}", (element,), True  # type: ignore[misc]

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        if context.number != 0 or context.element != self.element:
            return transmission
        shape, real = transmission.shape, transmission.real.dtype
        radians = 2 * math.pi * PATH_SCALE_M / context.wavelength_m
        amplitude = 1.0 + RELATIVE_SCALE * _upsample_map(self.maps["amplitude"], shape, real)
        return transmission * torch.polar(amplitude, radians * _upsample_map(self.maps["path"], shape, real))


class FreeModulator(FreeMaps):
    """The response of a modulator: response curve, stroke over the surface, mixture with neighbouring pixels. The
    second modulator also has a map of optical path; the first modulator's belongs to the source.

    element: of a chain, the name of the element that shows patterns, the one of this index among them.
    """

    def __init__(self, modulator_index: int, element: str = "") -> None:
        surface = SURFACE_POINTS
        shapes = {"curve": (RESPONSE_POINTS,), "stroke": surface, "neighbours": (4,)}
        super().__init__({**shapes, "path": surface} if modulator_index else shapes)
        self.modulator_index, self.element, self.on_all_elements = modulator_index, element, bool(element)  # type: ignore[misc]
        self.id = f"free_{element or f'modulator_{modulator_index + 1}'}"  # type: ignore[misc]
        self.acts_on = (element or f"modulator {modulator_index + 1}",)  # type: ignore[misc]

    def _is_own(self, context: ModulatorContext) -> bool:
        return context.element == self.element if self.element else context.number == self.modulator_index

    def stroke_response(self, share: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        if not self._is_own(context):
            return share
        scale = RELATIVE_SCALE
        bent = share + scale * _interpolate_curve(self.maps["curve"].to(share.dtype), share)
        bent = bent * (1.0 + scale * _upsample_map(self.maps["stroke"], share.shape, share.dtype))
        weights = scale * self.maps["neighbours"].to(share.dtype)
        up, down = torch.cat([bent[:1], bent[:-1]]), torch.cat([bent[1:], bent[-1:]])
        left, right = torch.cat([bent[:, :1], bent[:, :-1]], 1), torch.cat([bent[:, 1:], bent[:, -1:]], 1)
        mixed = sum(w * (other - bent) for w, other in zip(weights, (up, down, left, right), strict=True))
        return bent + mixed

    def optical_path(self, path_m: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        if not self._is_own(context) or "path" not in self.maps:
            return path_m
        return path_m + PATH_SCALE_M * _upsample_map(self.maps["path"], path_m.shape, path_m.dtype)


class FreeRelay(FreeMaps):
    """Amplitude and optical path over a relay's pupil. names: of the elements of a chain that the relay is."""

    def __init__(self, relay_index: int, names: tuple[str, ...] | None = None) -> None:
        super().__init__({"amplitude": PUPIL_POINTS, "path": PUPIL_POINTS})
        self.relay_index, self.id = relay_index, f"free_relay_{relay_index + 1}"  # type: ignore[misc]
        self.names, self.on_all_elements = names, names is not None  # type: ignore[misc]
        self.acts_on = (f"relay {relay_index + 1}" if names is None else way_words(names),)  # type: ignore[misc]

    def pupil(self, pupil: Tensor, context: RelayContext, v: Values) -> Tensor:
        if context.relay != self.relay_index if self.names is None else context.names != self.names:
            return pupil
        sine_y, sine_x = context.sines_from_centre
        reach = context.pupil_radius if context.pupil_radius < 1 else float(sine_y.abs().max())
        real = pupil.real.dtype
        y, x = (s.to(real) / reach for s in (sine_y, sine_x))
        positions = torch.stack([x.expand(len(y), -1), y.expand(-1, x.shape[1])], dim=-1)[None]
        maps = torch.stack([self.maps["amplitude"], self.maps["path"]]).to(real)[None]
        amplitude, path = torch.nn.functional.grid_sample(maps, positions, padding_mode="border", align_corners=True)[0]
        radians = 2 * math.pi * PATH_SCALE_M / context.wavelength_m
        return pupil * torch.polar(1.0 + RELATIVE_SCALE * amplitude, radians * path)


class FreeCamera(FreeMaps):
    """Sensitivity over the sensor, mixture with neighbouring pixels, a non-linear response and a pedestal."""

    id = "free_camera"
    acts_on = ("camera",)

    def __init__(self) -> None:
        super().__init__({"gain": SURFACE_POINTS, "neighbours": (4,), "bend": (1,), "pedestal": (1,)})

    def image(self, image: Tensor, context: CameraContext, v: Values) -> Tensor:
        own, scale = {name: m.to(image.dtype) for name, m in self.maps.items()}, RELATIVE_SCALE
        mean = image.mean().detach()
        up, down = torch.roll(image, 1, 0), torch.roll(image, -1, 0)
        left, right = torch.roll(image, 1, 1), torch.roll(image, -1, 1)
        neighbours = zip(own["neighbours"], (up, down, left, right), strict=True)
        mixed = sum(scale * weight * (other - image) for weight, other in neighbours)
        image = image + mixed + scale * mean * own["pedestal"]
        image = image * (1.0 + scale * _upsample_map(self.maps["gain"], image.shape, image.dtype))
        return image + scale * own["bend"] * image * (image / (image + 2 * mean))


@dataclass(frozen=True)
class FreeMapFit:
    """A place, the share of the excess on held-out captures that maps there explain, 0 … 1, and the maps.

    was_ended: before the fit had converged, because its time was over.
    """

    location: str
    share: float
    maps: tuple[ShownMap, ...] = ()
    was_ended: bool = False


def fit_free_maps(
    context: SearchContext, base: FittedValues, comparison: Comparison, most_s: float = math.inf
) -> list[FreeMapFit]:
    """Every place with its maps fitted on top of `base`, the largest share first. comparison: held-out captures.

    most_s: seconds for all places, of which each has as many.
    """
    chi2, effects = comparison.chi2_per_pixel(base), list(_free_map_effects(context))
    most_s *= context.workers.workers / len(effects)
    jobs = [partial(_fit_free_map, context, base, comparison, effect, chi2, most_s) for effect in effects]
    return sorted(context.run_parallel(jobs), key=lambda fit: -fit.share)


def likely_fits(fits: list[FreeMapFit]) -> tuple[FreeMapFit, ...]:
    """The fits of places that explain a good part, and nearly as much as the best place. fits: best first."""
    best = fits[0].share if fits else 0.0
    return tuple(f for f in fits if f.share >= max(MIN_SHARE, NEAR_BEST_SHARE * best))


def _free_map_effects(context: SearchContext) -> Iterator[FreeMaps]:
    """Maps at each place of the bench. A bench with one modulator has only the second relay, a Fourier bench has no
    relay."""
    yield FreeSource()
    if (chain := context.data.captures.chain) is not None:
        yield from _free_maps_of_chain(chain)
        yield FreeCamera()
        return
    yield FreeModulator(0)
    if len(context.data.captures.slms) > 1:
        yield FreeRelay(0)
        yield FreeModulator(1)
    if not context.data.captures.is_fourier:
        yield FreeRelay(1)
    yield FreeCamera()


def _free_maps_of_chain(chain: System) -> Iterator[FreeMaps]:
    """Maps of each element with pixels, and of each space."""
    shown = list(chain.drive_shapes)
    for name, element in zip(chain.element_names, chain.elements, strict=True):
        if name in shown:
            yield FreeModulator(shown.index(name), name)
        elif isinstance(element, Pixels):
            yield FreeSource(name)
    for relay, names in enumerate(chain.way.relay_names):
        if chain.way.kernel(relay) is None:
            yield FreeRelay(relay, names)


def _fit_free_map(
    context: SearchContext, base: FittedValues, held_out: Comparison, effect: FreeMaps, base_chi2: float, most_s: float
) -> FreeMapFit:
    """Maps at one place, fitted to the fine captures. base_chi2: χ²/n of the held-out captures without them. most_s:
    seconds after which no other step is made."""
    until = time.monotonic() + most_s
    predictor = context.predictor.create(extra_effects=[effect])
    values: FittedValues = {**base, effect.id: {"on": 1.0}}
    fitted = context.half_tolerant_comparison(context.split.fine, context.relative_model_error(base))
    solution = minimize(
        partial(_loss_and_gradient, effect, values, fitted.with_predictor(predictor)),
        np.zeros(effect.parameter_count),
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": ITERATIONS},
        callback=partial(_stop_after, until),
    )
    effect.set_from_vector(solution.x)
    chi2 = held_out.with_predictor(predictor).chi2_per_pixel(values)
    share = (base_chi2 - chi2) / max(base_chi2 - 1.0, 1e-9)
    shown = tuple(placed_map(one, effect.acts_on[0], context.data.captures) for one in effect.shown_maps())
    was_ended = time.monotonic() > until and solution.nit < ITERATIONS
    return FreeMapFit(effect.acts_on[0], float(np.clip(share, 0.0, 1.0)), shown, was_ended)


def _stop_after(until: float, _: NDArray[np.float64]) -> None:
    """Ends a minimisation after its step, once the time is over."""
    if time.monotonic() > until:
        raise StopIteration


def placed_map(shown: ShownMap, location: str, captures: Captures) -> ShownMap:
    """A map with the coordinates of the surface that it lies over."""
    if shown.values.ndim == 1:
        over_levels = shown.name == "curve"
        labels = _NEIGHBOURS if shown.name == "neighbours" else () if over_levels else (shown.name,)
        return replace(shown, axis="share of the stroke" if over_levels else "", labels=labels)
    chain, of = captures.chain, "modulator pixels"
    if location != "camera" and chain is not None:
        element = dict(zip(chain.element_names, chain.elements, strict=True)).get(location)
        is_pupil = location != "source" and not isinstance(element, Pixels)
    else:
        is_pupil, element = location.startswith("relay"), None
    if is_pupil:
        return replace(shown, extent=(-1.0, 1.0, 1.0, -1.0), axis="pupil radii")
    if location == "camera":
        rows, columns = captures.shape
        whole = captures.frame or captures.shape
        top, left = first_of_part(whole, captures.shape, captures.centre_m, captures.camera.pitch_m)
    elif chain is not None:
        rows, columns = pixel_shape(element) if isinstance(element, Pixels) else chain.way.shape
        top, left, of = 0, 0, f"pixels of {location}" if element is not None else "samples of the field"
    else:
        (rows, columns), (top, left) = captures.levels.shape[2:], captures.first_pixel
    extent = (left - 0.5, left + columns - 0.5, top + rows - 0.5, top - 0.5)
    return replace(shown, extent=extent, axis="camera pixels" if location == "camera" else of)


def _loss_and_gradient(
    effect: FreeMaps, values: FittedValues, comparison: Comparison, vector: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64]]:
    """χ²/n with the maps that a vector holds and the best gain of each capture, and its gradient."""
    weight, light = torch.from_numpy(comparison.weight), torch.from_numpy(comparison.light)
    leaves = effect.set_from_vector(vector, grad=True)
    prediction = comparison.predictor(comparison.indices, values, grad=True)
    model = weight * prediction.signal
    dark = torch.from_numpy(prediction.counts_without_lasers(comparison.data.camera.black_level))
    data = weight * (light - dark)
    gain = (data * model).sum((1, 2), keepdim=True) / (model * model).sum((1, 2), keepdim=True).clamp_min(1e-30)
    total = (data - gain.detach() * model).square().sum(dtype=torch.float64) / comparison.pixel_count
    gradients = torch.autograd.grad(total, leaves, allow_unused=True)
    flat = [
        (torch.zeros_like(leaf) if g is None else g).double().ravel().numpy()
        for leaf, g in zip(leaves, gradients, strict=True)
    ]
    return float(total.detach()), np.concatenate(flat)


def _upsample_map(control: Tensor, shape: torch.Size, dtype: torch.dtype) -> Tensor:
    """A map over a whole surface by bicubic interpolation of its control points."""
    return torch.nn.functional.interpolate(
        control.to(dtype)[None, None], size=tuple(shape), mode="bicubic", align_corners=True
    )[0, 0]


def _interpolate_curve(control: Tensor, share: Tensor) -> Tensor:
    """A piecewise linear function of the share of the stroke, 0 … 1."""
    position = share.clamp(0.0, 1.0) * (len(control) - 1)
    low = position.detach().floor().clamp(max=len(control) - 2)
    part = position - low
    index = low.long()
    return control[index] * (1 - part) + control[index + 1] * part


_HOW = "docs/effects.md says how"
_SUGGESTIONS = {
    "source": (
        "an effect that overrides `transmission` for modulator 1, amplitude and wavefront of the light on it",
        "captures with flat patterns, which show the beam alone",
    ),
    "modulator 1": (
        "an effect that overrides `stroke_response` or `optical_path` for modulator 1",
        "captures with flat patterns at several levels, and one column or row at a time at another level",
    ),
    "modulator 2": (
        "an effect that overrides `stroke_response` or `optical_path` for modulator 2",
        "captures with modulator 1 flat and modulator 2 at several levels, then one column or row at another level",
    ),
    "relay 1": (
        "an effect that overrides `pupil` for relay 1",
        "captures with modulator 2 flat and white noise on modulator 1, which fills the pupil",
    ),
    "relay 2": (
        "an effect that overrides `pupil` for relay 2",
        "captures of white noise, which fills the pupil, at several distances",
    ),
    "camera": (
        "an effect that overrides `image`, which changes the picture that the camera collects",
        "a capture with all lasers off, and the same pattern at several exposures and positions of the camera",
    ),
}


def suggest_for(place: str) -> str:
    """A sentence on what to do about an error that lives at a place of `free_maps`: a part, or an element's name."""
    of_chain = f"an effect with `element_kinds` that acts on {place}"
    rough = f"captures with flat and with rough patterns on {place} or before it, at several distances"
    effect, captures = _SUGGESTIONS.get(place, (of_chain, rough))
    return f"Write {effect} ({_HOW}). More of it would be seen in {captures}."


@dataclass(frozen=True, eq=False)
class PixelMap:
    """How far the parts of modulator `number` (0 for the first) stand out from others, in standard deviations.

    Of a chain it is the element of this number among those that show patterns; element: its name, else empty.
    pixels (y, x), columns (x,), rows (y,): at the level that gains most. first_pixel: row and column of the map's first
    pixel, in the larger modulator of which the map is the middle.
    """

    number: int
    pixels: Floats
    columns: Floats
    rows: Floats
    first_pixel: tuple[int, int]
    element: str = ""

    @property
    def name(self) -> str:
        """The modulator's name."""
        return self.element or f"modulator {self.number + 1}"

    @property
    def line_sigmas(self) -> float:
        """How far the most conspicuous column or row stands out, in standard deviations."""
        return float(max(self.columns.max(), self.rows.max()))

    def describe_line(self) -> str:
        """The column or the row that stands out most."""
        lines = zip(("row", "column"), (self.rows, self.columns), self.first_pixel, strict=True)
        name, sigmas, first = max(lines, key=lambda line: float(line[1].max()))
        number = first + int(sigmas.argmax())
        return f"{name} {number} of {self.name} ({self.line_sigmas:.0f} σ)"

    def conspicuous_lines(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The columns and the rows, counted in the map, that stand out nearly as much as the most conspicuous line, and
        further than their neighbours."""
        least = max(MIN_LINE_SIGMAS, NEAR_BEST_LINES * self.line_sigmas)
        columns, rows = (
            np.flatnonzero((sigmas >= least) & (sigmas >= maximum_filter(sigmas, 3)))
            for sigmas in (self.columns, self.rows)
        )
        return columns, rows


def find_pixel_maps(context: SearchContext, base: FittedValues) -> tuple[PixelMap, ...]:
    """The maps of all modulators, from the residuals of the fine captures with a base."""
    captures = context.data.captures
    names = [""] * len(captures.slms) if captures.chain is None else list(captures.chain.drive_shapes)
    comparison = context.half_tolerant_comparison(context.split.fine, context.relative_model_error(base))
    found = []
    for number, gains in sorted(replacement_gains(context, base, comparison, LEVELS).items()):
        columns, rows = (significance(line_gains(gains, axis, LINE_SEGMENTS)).max(axis=0) for axis in (1, 2))
        pixels = significance(gains).max(axis=0)
        found.append(PixelMap(number, pixels, columns, rows, captures.first_pixel, names[number]))
    return tuple(found)


def line_notes(maps: Sequence[PixelMap]) -> list[str]:
    """A note on the most conspicuous line alone: its light spreads, so that other lines may stand out because of it.

    Of a chain it names those of other elements, too, that stand out nearly as far: a line of one is seen in another.
    """
    far = _conspicuous(maps)
    if not far:
        return []
    most, *others = far
    near = [one for one in others if one.element and one.line_sigmas >= NEAR_BEST_LINES * most.line_sigmas]
    beside = f", and nearly as far {' and '.join(one.describe_line() for one in near)}" if near else ""
    return [
        f"Of all columns and rows of modulators, {most.describe_line()} stands out most from its neighbours{beside}."
    ]


def _conspicuous(maps: Sequence[PixelMap]) -> list[PixelMap]:
    """The modulators with a column or row that stands out far, from the farthest on."""
    far = [one for one in maps if one.line_sigmas >= MIN_LINE_SIGMAS]
    return sorted(far, key=lambda one: -one.line_sigmas)


class FreeLevels(Effect):
    """Some pixels of one modulator show free levels, shares of the stroke, in place of the levels that were sent.

    modulator: where they are. places (y, x): the pixels. levels (pixel,): a tensor that is set from outside.
    """

    id = "free_levels"
    cause = "Some pixels show other levels than those that are sent."
    finding = "Free levels are on."
    parameters = (Parameter("on", "1: the levels are shown."),)
    order = 1

    def __init__(self, modulator: PixelMap, places: NDArray[np.bool_]) -> None:
        self.places, self.levels = torch.from_numpy(places), torch.zeros(int(places.sum()), dtype=torch.float64)
        self.element, self.on_all_elements = modulator.element, bool(modulator.element)  # type: ignore[misc]
        self.acts_on = (modulator.name,)  # type: ignore[misc]

    def stroke_response(self, share: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        if context.element != self.element:
            return share
        return share.masked_scatter(self.places, self.levels.to(share.dtype))


def flicker_notes(context: SearchContext, base: FittedValues, maps: Sequence[PixelMap]) -> list[str]:
    """A note on lines whose levels aren't in the file, constant or changing from capture to capture: where levels that
    are free in all of their pixels take away most of the excess.

    Lines of the most conspicuous modulator; of a chain of the element whose lines explain most.
    """
    far = _conspicuous(maps)
    tried = far if context.data.captures.chain is not None else far[:1]
    found = [note for one in tried if (note := _flicker_note(context, base, one)) is not None]
    return [max(found)[1]] if found else []


def _flicker_note(context: SearchContext, base: FittedValues, most: PixelMap) -> tuple[float, str] | None:
    """The share of the excess that the lines of a modulator explain, and the note; None where that is little."""
    columns, rows = most.conspicuous_lines()
    places = np.zeros(most.pixels.shape, dtype=bool)
    places[:, columns], places[rows] = True, True
    split = context.split
    indices = np.unique(np.concatenate([split.rough, split.held_out]))
    comparison = context.model_weighted_comparison(indices, base)
    effect = FreeLevels(most, places)
    probed = comparison.with_predictor(context.predictor.create(extra_effects=[effect]))
    values: FittedValues = {**base, effect.id: {"on": 1.0}}
    noise, sent, free = comparison.pixel_count / len(indices), 0.0, 0.0
    squares, fits = _squares(comparison, base), dict[int, Floats]()
    for k in np.argsort(-squares).tolist():
        fit = _fitted_levels(effect, values, probed, k)
        fits[k], free, sent = fit.x, free + float(fit.fun) - noise, sent + float(squares[k]) - noise
        if len(fits) in (_FIRST_CAPTURES, len(indices)) and free > _FREE_LEVELS_SHARE * sent:
            return None
    agreement = _agreement(context, most.number, indices, np.array([fits[k] for k in range(len(indices))]))
    top, left = most.first_pixel
    lines = describe_places((columns + left).tolist(), (rows + top).tolist(), ())
    shows = f"{lines} of {most.name} {'show' if len(columns) + len(rows) > 1 else 'shows'}"
    which = "that change from capture to capture" if agreement < _CHANGING_AGREEMENT else "other than those sent"
    explained = 1 - free / sent
    return explained, f"{shows} levels {which}: with free levels there, {explained:.0%} of the excess is explained."


def _agreement(context: SearchContext, number: int, indices: NDArray[np.intp], levels: Floats) -> float:
    """How far levels (capture, pixel) are the same light in all captures of a wavelength, up to 1: the mean modulus of
    the mean phasor; of an amplitude modulator 1 less the mean variance, in that of levels at random. 1 where each
    wavelength has one capture."""
    captures = context.data.captures
    stroke_m, lasers = captures.slms[number].opd_range_m, captures.laser_number[indices]
    if not stroke_m:
        groups = [levels[lasers == laser].clip(0, 1) for laser in np.unique(lasers)]
        spreads = [12 * group.var(axis=0, ddof=1).mean() for group in groups if len(group) > 1]
        return float(1 - np.mean(spreads)) if spreads else 1.0
    phasors = np.exp(2j * np.pi * stroke_m / captures.wavelength_m[indices][:, None] * levels)
    groups = [phasors[lasers == laser] for laser in np.unique(lasers)]
    shared = [np.abs(group.mean(axis=0)).mean() for group in groups if len(group) > 1]
    return float(np.mean(shared)) if shared else 1.0


def _squares(comparison: Comparison, values: FittedValues) -> Floats:
    """Σ residual² of each capture."""
    with torch.no_grad():
        every = range(len(comparison.indices))
        return np.array([float(squared_residuals(comparison, values, k)) for k in every])


def _fitted_levels(effect: FreeLevels, values: FittedValues, comparison: Comparison, position: int) -> OptimizeResult:
    """The levels of the free pixels that make Σ residual² of a capture least, from the best that is equal for all."""

    def squares_at(level: float) -> float:
        effect.levels = torch.full_like(effect.levels, float(level), requires_grad=False)
        with torch.no_grad():
            return float(squared_residuals(comparison, values, position))

    def squares_and_slope(levels: Floats) -> tuple[float, Floats]:
        effect.levels = torch.from_numpy(levels.copy()).requires_grad_()
        squares = squared_residuals(comparison, values, position)
        return float(squares.detach()), torch.autograd.grad(squares, [effect.levels])[0].numpy()

    first = np.full(len(effect.levels), min(LEVELS, key=squares_at))
    return minimize(squares_and_slope, first, jac=True, method="L-BFGS-B", options={"maxiter": _LEVEL_ITERATIONS})
