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

from holoview.diagnose.bench import Bench
from holoview.diagnose.comparison import Comparison
from holoview.diagnose.screen import mismatch
from holoview.diagnose.unknowns import Found
from holoview.effects.effect import Effect
from holoview.effects.parameter import Parameter, Values
from holoview.effects.places import Aperture, Sensor, Surface

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
    where: ClassVar[tuple[str, ...]] = ()

    def __init__(self, shapes: dict[str, tuple[int, ...]]) -> None:
        self.maps = {name: torch.zeros(shape, dtype=torch.float64) for name, shape in shapes.items()}

    @property
    def count(self) -> int:
        """How many numbers are free."""
        return sum(m.numel() for m in self.maps.values())

    def load(self, vector: NDArray[np.float64], *, grad: bool = False) -> list[Tensor]:
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
    where = ("source",)

    def __init__(self) -> None:
        super().__init__({"amplitude": _GRID, "path": _GRID})

    def transmission(self, light: Tensor, at: Surface, v: Values) -> Tensor:
        if at.number != 0:
            return light
        phase = (2 * math.pi * _PATH_M / at.wavelength_m) * _spread(self.maps["path"], light.shape, light.real.dtype)
        amplitude = 1.0 + _SHARE * _spread(self.maps["amplitude"], light.shape, light.real.dtype)
        return light * torch.polar(amplitude, phase)


class FreeModulator(FreeMaps):
    """What a modulator shows: a response curve, its stroke over the surface, a mixture with neighbouring pixels."""

    def __init__(self, number: int) -> None:
        super().__init__(
            {"curve": (_CURVE,), "stroke": _GRID, "neighbours": (4,)} | ({"path": _GRID} if number else {})
        )
        self.number, self.id = number, f"free_modulator_{number + 1}"  # type: ignore[misc]
        self.where = (f"modulator {number + 1}",)  # type: ignore[misc]

    def response(self, share: Tensor, at: Surface, v: Values) -> Tensor:
        if at.number != self.number:
            return share
        bent = share + _SHARE * _curve(self.maps["curve"].to(share.dtype), share)
        bent = bent * (1.0 + _SHARE * _spread(self.maps["stroke"], share.shape, share.dtype))
        weights = _SHARE * self.maps["neighbours"].to(share.dtype)
        up, down = torch.cat([bent[:1], bent[:-1]]), torch.cat([bent[1:], bent[-1:]])
        left, right = torch.cat([bent[:, :1], bent[:, :-1]], 1), torch.cat([bent[:, 1:], bent[:, -1:]], 1)
        mixed = sum(w * (other - bent) for w, other in zip(weights, (up, down, left, right), strict=True))
        return bent + mixed

    def path(self, path_m: Tensor, at: Surface, v: Values) -> Tensor:
        if at.number != self.number or "path" not in self.maps:
            return path_m
        return path_m + _PATH_M * _spread(self.maps["path"], path_m.shape, path_m.dtype)


class FreeRelay(FreeMaps):
    """Amplitude and optical path over a relay's pupil."""

    def __init__(self, relay: int) -> None:
        super().__init__({"amplitude": _PUPIL, "path": _PUPIL})
        self.relay, self.id = relay, f"free_relay_{relay + 1}"  # type: ignore[misc]
        self.where = (f"relay {relay + 1}",)  # type: ignore[misc]

    def pupil(self, pupil: Tensor, at: Aperture, v: Values) -> Tensor:
        if at.relay != self.relay:
            return pupil
        reach = at.iris_na if at.iris_na < 1 else float(at.sine_y.abs().max())
        real = pupil.real.dtype
        y, x = (s.to(real) / reach for s in (at.sine_y, at.sine_x))
        places = torch.stack([x.expand(len(y), -1), y.expand(-1, x.shape[1])], dim=-1)[None]
        maps = torch.stack([self.maps["amplitude"], self.maps["path"]]).to(real)[None]
        amplitude, path = torch.nn.functional.grid_sample(maps, places, padding_mode="border", align_corners=True)[0]
        return pupil * torch.polar(1.0 + _SHARE * amplitude, (2 * math.pi * _PATH_M / at.wavelength_m) * path)


class FreeCamera(FreeMaps):
    """Sensitivity over the sensor, a blur of neighbouring pixels, a response that isn't straight."""

    id = "free_camera"
    where = ("camera",)

    def __init__(self) -> None:
        super().__init__({"gain": _GRID, "neighbours": (4,), "bend": (1,), "pedestal": (1,)})

    def image(self, image: Tensor, at: Sensor, v: Values) -> Tensor:
        own = {name: m.to(image.dtype) for name, m in self.maps.items()}
        mean = image.mean().detach()
        up, down = torch.roll(image, 1, 0), torch.roll(image, -1, 0)
        left, right = torch.roll(image, 1, 1), torch.roll(image, -1, 1)
        mixed = sum(
            _SHARE * w * (other - image) for w, other in zip(own["neighbours"], (up, down, left, right), strict=True)
        )
        image = image + mixed + _SHARE * mean * own["pedestal"]
        image = image * (1.0 + _SHARE * _spread(self.maps["gain"], image.shape, image.dtype))
        return image + _SHARE * own["bend"] * image * (image / (image + 2 * mean))


@dataclass(frozen=True)
class Freed:
    """What maps at one place gained on held-out captures, and the maps."""

    place: str
    share: float
    effect: FreeMaps
    values: Found


def places(bench: Bench, base: Found, comparison: Comparison) -> list[Freed]:
    """Every place with its maps fitted on top of `base`, the most telling first. comparison: held-out captures."""
    before = comparison.chi2(base)
    jobs = [partial(_freed, bench, base, comparison, effect, before) for effect in _effects(bench)]
    return sorted(bench.team.in_threads(jobs), key=lambda freed: -freed.share)


def lives_in(freed: list[Freed]) -> dict[str, float]:
    """The places that explain a good part, nearly as much as the best, with their shares."""
    best = freed[0].share if freed else 0.0
    return {f.place: f.share for f in freed if f.share >= max(_LEAST_SHARE, _NEARLY * best)}


def _effects(bench: Bench) -> Iterator[FreeMaps]:
    yield FreeSource()
    yield FreeModulator(0)
    if len(bench.measured.captures.panels) > 1:
        yield FreeRelay(0)
        yield FreeModulator(1)
    yield FreeRelay(1)
    yield FreeCamera()


def _freed(bench: Bench, base: Found, held_out: Comparison, effect: FreeMaps, before: float) -> Freed:
    predictor = bench.predict.make(extra=[effect])
    values: Found = {**base, effect.id: {"on": 1.0}}
    fit = bench.coarse_comparison(bench.split.fine, min(0.5, 0.5 * mismatch(bench, base)))
    weight, light = torch.from_numpy(fit.weight), torch.from_numpy(fit.light)
    data, count = weight * light, fit.count

    def loss(vector: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        leaves = effect.load(vector, grad=True)
        prediction = predictor(fit.indices, values, grad=True)
        model = weight * prediction.signal
        shown = data - weight * (prediction.offset - bench.measured.camera.black_level)
        gain = (shown * model).sum((1, 2), keepdim=True) / (model * model).sum((1, 2), keepdim=True).clamp_min(1e-30)
        total = (shown - gain.detach() * model).square().sum(dtype=torch.float64) / count
        gradients = torch.autograd.grad(total, leaves, allow_unused=True)
        flat = [
            (torch.zeros_like(leaf) if g is None else g).double().ravel().numpy()
            for leaf, g in zip(leaves, gradients, strict=True)
        ]
        return float(total.detach()), np.concatenate(flat)

    found = minimize(loss, np.zeros(effect.count), jac=True, method="L-BFGS-B", options={"maxiter": _ITERATIONS})
    effect.load(found.x)
    judged = Comparison(predictor, held_out.measured, held_out.indices, _variance(held_out), shifts=held_out.shifts)
    share = (before - judged.chi2(values)) / max(before - 1.0, 1e-9)
    return Freed(effect.where[0], float(np.clip(share, 0.0, 1.0)), effect, values)


def _variance(comparison: Comparison) -> NDArray[np.float32]:
    """The variance behind a comparison's weights; huge where a pixel isn't usable."""
    return np.where(comparison.weight > 0, 1.0 / np.maximum(comparison.weight, 1e-12) ** 2, 1e24).astype(np.float32)


def _spread(control: Tensor, shape: torch.Size, dtype: torch.dtype) -> Tensor:
    """A map over a whole surface from its control points."""
    return torch.nn.functional.interpolate(
        control.to(dtype)[None, None], size=tuple(shape), mode="bicubic", align_corners=True
    )[0, 0]


def _curve(control: Tensor, share: Tensor) -> Tensor:
    """A piecewise linear function of the share of the stroke, 0 … 1."""
    at = share.clamp(0.0, 1.0) * (len(control) - 1)
    low = at.detach().floor().clamp(max=len(control) - 2)
    part = at - low
    index = low.long()
    return control[index] * (1 - part) + control[index + 1] * part
