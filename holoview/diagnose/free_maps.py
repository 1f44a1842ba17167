"""Where an error lives that no effect of the library explains: smooth maps, free at one place at a time.

Each place gets maps that can express anything smooth and pixel-local there (amplitude, optical path, response), fitted
to the fine captures by L-BFGS and judged on the held-out ones. The place whose maps predict most is where to look.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize

from holoview.diagnose.comparison import Comparison
from holoview.diagnose.free_parameters import FittedValues
from holoview.diagnose.screening import relative_model_error
from holoview.diagnose.search_context import SearchContext
from holoview.model.effects.effect import Effect
from holoview.model.effects.hook_contexts import CameraContext, ModulatorContext, RelayContext
from holoview.model.effects.parameter import Parameter, Values

Tensor = torch.Tensor

_GRID = (6, 8)  # control points of a map
_PUPIL = (8, 8)
_CURVE = 9  # control points of a response
_ITERATIONS = 15
_PATH_M = 50e-9  # optical path that a map's unit stands for
_SHARE = 0.1  # amplitude or response that a map's unit stands for
_LEAST_SHARE, _NEARLY = 0.1, 0.7


class FreeMaps(Effect):
    """Maps at one place as an effect that holds tensors; all zero changes nothing."""

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
        """Sets all maps from one vector; the leaves, to read gradients from."""
        at, leaves = 0, []
        for name, old in self.maps.items():
            part = torch.from_numpy(vector[at : at + old.numel()].copy()).reshape(old.shape).requires_grad_(grad)
            self.maps[name] = part
            leaves.append(part)
            at += old.numel()
        return leaves


class FreeSource(FreeMaps):
    """Amplitude and wavefront of the light on the first modulator."""

    id = "free_source"
    acts_on = ("source",)

    def __init__(self) -> None:
        super().__init__({"amplitude": _GRID, "path": _GRID})

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        if context.number != 0:
            return transmission
        phase = (2 * math.pi * _PATH_M / context.wavelength_m) * _upsample_map(
            self.maps["path"], transmission.shape, transmission.real.dtype
        )
        amplitude = 1.0 + _SHARE * _upsample_map(self.maps["amplitude"], transmission.shape, transmission.real.dtype)
        return transmission * torch.polar(amplitude, phase)


class FreeModulator(FreeMaps):
    """What a modulator shows: a response curve, its stroke over the surface, a mixture with neighbouring pixels."""

    def __init__(self, modulator_index: int) -> None:
        super().__init__(
            {"curve": (_CURVE,), "stroke": _GRID, "neighbours": (4,)} | ({"path": _GRID} if modulator_index else {})
        )
        self.modulator_index, self.id = modulator_index, f"free_modulator_{modulator_index + 1}"  # type: ignore[misc]
        self.acts_on = (f"modulator {modulator_index + 1}",)  # type: ignore[misc]

    def stroke_response(self, share: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        if context.number != self.modulator_index:
            return share
        bent = share + _SHARE * _interpolate_curve(self.maps["curve"].to(share.dtype), share)
        bent = bent * (1.0 + _SHARE * _upsample_map(self.maps["stroke"], share.shape, share.dtype))
        weights = _SHARE * self.maps["neighbours"].to(share.dtype)
        up, down = torch.cat([bent[:1], bent[:-1]]), torch.cat([bent[1:], bent[-1:]])
        left, right = torch.cat([bent[:, :1], bent[:, :-1]], 1), torch.cat([bent[:, 1:], bent[:, -1:]], 1)
        mixed = sum(w * (other - bent) for w, other in zip(weights, (up, down, left, right), strict=True))
        return bent + mixed

    def optical_path(self, path_m: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        if context.number != self.modulator_index or "path" not in self.maps:
            return path_m
        return path_m + _PATH_M * _upsample_map(self.maps["path"], path_m.shape, path_m.dtype)


class FreeRelay(FreeMaps):
    """Amplitude and optical path over a relay's pupil."""

    def __init__(self, relay_index: int) -> None:
        super().__init__({"amplitude": _PUPIL, "path": _PUPIL})
        self.relay_index, self.id = relay_index, f"free_relay_{relay_index + 1}"  # type: ignore[misc]
        self.acts_on = (f"relay {relay_index + 1}",)  # type: ignore[misc]

    def pupil(self, pupil: Tensor, context: RelayContext, v: Values) -> Tensor:
        if context.relay != self.relay_index:
            return pupil
        reach = context.iris_na if context.iris_na < 1 else float(context.sine_y.abs().max())
        real = pupil.real.dtype
        y, x = (s.to(real) / reach for s in (context.sine_y, context.sine_x))
        places = torch.stack([x.expand(len(y), -1), y.expand(-1, x.shape[1])], dim=-1)[None]
        maps = torch.stack([self.maps["amplitude"], self.maps["path"]]).to(real)[None]
        amplitude, path = torch.nn.functional.grid_sample(maps, places, padding_mode="border", align_corners=True)[0]
        return pupil * torch.polar(1.0 + _SHARE * amplitude, (2 * math.pi * _PATH_M / context.wavelength_m) * path)


class FreeCamera(FreeMaps):
    """Sensitivity over the sensor, a blur of neighbouring pixels, a response that isn't straight."""

    id = "free_camera"
    acts_on = ("camera",)

    def __init__(self) -> None:
        super().__init__({"gain": _GRID, "neighbours": (4,), "bend": (1,), "pedestal": (1,)})

    def image(self, image: Tensor, context: CameraContext, v: Values) -> Tensor:
        own = {name: m.to(image.dtype) for name, m in self.maps.items()}
        mean = image.mean().detach()
        up, down = torch.roll(image, 1, 0), torch.roll(image, -1, 0)
        left, right = torch.roll(image, 1, 1), torch.roll(image, -1, 1)
        mixed = sum(
            _SHARE * w * (other - image) for w, other in zip(own["neighbours"], (up, down, left, right), strict=True)
        )
        image = image + mixed + _SHARE * mean * own["pedestal"]
        image = image * (1.0 + _SHARE * _upsample_map(self.maps["gain"], image.shape, image.dtype))
        return image + _SHARE * own["bend"] * image * (image / (image + 2 * mean))


@dataclass(frozen=True)
class FreeMapFit:
    """What maps at one place gained on held-out captures, and the maps."""

    location: str
    share: float
    effect: FreeMaps
    values: FittedValues


def fit_free_maps(context: SearchContext, base: FittedValues, comparison: Comparison) -> list[FreeMapFit]:
    """Every place with its maps fitted on top of `base`, the most telling first. comparison: held-out captures."""
    before = comparison.chi2_per_pixel(base)
    jobs = [partial(_fit_free_map, context, base, comparison, effect, before) for effect in _free_map_effects(context)]
    return sorted(context.workers.run_in_threads(jobs), key=lambda freed: -freed.share)


def likely_locations(fits: list[FreeMapFit]) -> dict[str, float]:
    """The places that explain a good part, nearly as much as the best, with their shares."""
    best = fits[0].share if fits else 0.0
    return {f.location: f.share for f in fits if f.share >= max(_LEAST_SHARE, _NEARLY * best)}


def _free_map_effects(context: SearchContext) -> Iterator[FreeMaps]:
    yield FreeSource()
    yield FreeModulator(0)
    if len(context.data.captures.slms) > 1:
        yield FreeRelay(0)
        yield FreeModulator(1)
    yield FreeRelay(1)
    yield FreeCamera()


def _fit_free_map(
    context: SearchContext, base: FittedValues, held_out: Comparison, effect: FreeMaps, before: float
) -> FreeMapFit:
    predictor = context.predictor.create(extra_effects=[effect])
    values: FittedValues = {**base, effect.id: {"on": 1.0}}
    fit = context.data_weighted_comparison(context.split.fine, min(0.5, 0.5 * relative_model_error(context, base)))
    weight, light = torch.from_numpy(fit.weight), torch.from_numpy(fit.light)
    data, count = weight * light, fit.pixel_count

    def loss(vector: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        leaves = effect.set_from_vector(vector, grad=True)
        prediction = predictor(fit.indices, values, grad=True)
        model = weight * prediction.signal
        shown = data - weight * (prediction.black_level - context.data.camera.black_level)
        gain = (shown * model).sum((1, 2), keepdim=True) / (model * model).sum((1, 2), keepdim=True).clamp_min(1e-30)
        total = (shown - gain.detach() * model).square().sum(dtype=torch.float64) / count
        gradients = torch.autograd.grad(total, leaves, allow_unused=True)
        flat = [
            (torch.zeros_like(leaf) if g is None else g).double().ravel().numpy()
            for leaf, g in zip(leaves, gradients, strict=True)
        ]
        return float(total.detach()), np.concatenate(flat)

    found = minimize(
        loss, np.zeros(effect.parameter_count), jac=True, method="L-BFGS-B", options={"maxiter": _ITERATIONS}
    )
    effect.set_from_vector(found.x)
    judged = Comparison(
        predictor, held_out.measured, held_out.indices, _variance_from_weights(held_out), fit_shifts=held_out.fit_shifts
    )
    share = (before - judged.chi2_per_pixel(values)) / max(before - 1.0, 1e-9)
    return FreeMapFit(effect.acts_on[0], float(np.clip(share, 0.0, 1.0)), effect, values)


def _variance_from_weights(comparison: Comparison) -> NDArray[np.float32]:
    """The variance behind a comparison's weights; huge where a pixel isn't usable."""
    return np.where(comparison.weight > 0, 1.0 / np.maximum(comparison.weight, 1e-12) ** 2, 1e24).astype(np.float32)


def _upsample_map(control: Tensor, shape: torch.Size, dtype: torch.dtype) -> Tensor:
    """A map over a whole surface from its control points."""
    return torch.nn.functional.interpolate(
        control.to(dtype)[None, None], size=tuple(shape), mode="bicubic", align_corners=True
    )[0, 0]


def _interpolate_curve(control: Tensor, share: Tensor) -> Tensor:
    """A piecewise linear function of the share of the stroke, 0 … 1."""
    at = share.clamp(0.0, 1.0) * (len(control) - 1)
    low = at.detach().floor().clamp(max=len(control) - 2)
    part = at - low
    index = low.long()
    return control[index] * (1 - part) + control[index + 1] * part
