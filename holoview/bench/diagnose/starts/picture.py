"""Starting values that pictures show directly: displacements, ghosts, smears, and planes that are off.

Displacements, such as tilts, shifts and decentres: the displacement of the captures from their prediction is measured
by cross-correlation, the displacement that each parameter causes is predicted, and least squares give the parameters
that cause the measured displacement.

Ghosts: peaks of the residual's correlation with the prediction.

Smears: to first order, a line of length (y, x) adds (y²·m_yy + 2·y·x·m_yx + x²·m_xx)/24 to the prediction m. Least
squares give the three coefficients; their symmetric matrix has the line along its principal axis.

Planes: the smoothest captures of each plane are predicted at distances around the set distance, for all planes at once:
each has its own minimum of χ². There is a start only where the minima differ by more than noise both from one error
that all planes share and from an error that grows with the distance; other effects state these by one number.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d

from holoview.bench.captures.patterns import pattern_roughness
from holoview.bench.captures.prepared_captures import Images
from holoview.bench.diagnose.fit import FittedValues
from holoview.bench.diagnose.likelihood import Comparison, GainFit
from holoview.bench.diagnose.search_context import SearchContext
from holoview.light.model.effects.effect import Effect, StartKind
from holoview.util.errors import UserError

_MIN_DISPLACEMENT_PX = 0.3
"""[px] Smaller displacements of the images give no start. Evidence: a local fit starts well from the identity there."""
_MIN_RESPONSE_PX = 0.05  # [px] A parameter that moves images by less at its typical size isn't used.
_DISPLACEMENT_RCOND = 0.05  # [1] Singular values of the displacements below this share of the largest are dropped.
_GHOST_PEAKS = 3  # [1] Peaks of the correlation tried as ghost images.
_GHOST_MIN_SHIFT_PX = 3.0  # [px] Peaks nearer to zero shift aren't ghost images.
_GHOST_SEPARATION_PX = 3.0  # [px] Peaks nearer to a higher one are part of it.
_PLANE_CAPTURES = 2
"""[captures] The smoothest of each plane, which are predicted. Evidence: a second wavelength has other minima beside
the true minimum."""
_PLANE_DEPTHS = (0.06, 0.12, 0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0)
"""[depths] Errors either way, in depths of field λ/NA². Evidence: as `DEFOCUS_DEPTHS`."""
_PLANE_FIRST_STEP = 0.2
"""[1] First step of the refinement over the error. Evidence: derivation: half the distance to the next trial error."""
_PLANE_LEAST_STEP = 0.02  # [depths] The first step is at least this. Evidence: the same for an error of 0.
_PLANE_STEP_RATIO = 0.4  # [1] Each step over the one before.
_PLANE_ROUNDS = 4  # [1] Steps. Evidence: a local fit follows.
_PLANE_MIN_GAIN = 25.0
"""[Δχ²] Errors of single planes must gain so much over one error of all planes, and each plane's error over none, times
χ²/n where that is above 1. Evidence: 5 σ for one number, as for a cause (`min_delta_chi2`)."""

StartingValues = list[dict[str, float]]
StartProvider = Callable[[Effect], StartingValues]
Vector = NDArray[np.float64]
Floats = NDArray[np.float64]


class DisplacementStarts:
    """For an effect, starting values that move the prediction onto the captures; none where they coincide already."""

    def __init__(self, base: FittedValues, comparison: Comparison) -> None:
        self._base, self._comparison = base, comparison
        light = np.where(comparison.weight > 0, comparison.light, 0.0)
        self._predicted = np.asarray(comparison.predictor(comparison.indices, base).signal)
        self._displacement = measure_displacement(light, self._predicted)

    def __call__(self, effect: Effect) -> StartingValues:
        if StartKind.DISPLACEMENT not in effect.start_kinds or np.hypot(*self._displacement) < _MIN_DISPLACEMENT_PX:
            return []
        movers, responses = [], []
        for p in effect.parameters:
            if p.secondary or p.even_symmetric or p.non_smooth or not p.free_entries(p.identity):
                continue
            size = p.scan[2] if p.scan else p.prior
            response = self._response(effect, {p.name: p.identity + size})
            if response is not None and np.hypot(*response) > _MIN_RESPONSE_PX:
                movers.append(p)
                responses.append(response / size)
        if not movers:
            return []
        rcond = _DISPLACEMENT_RCOND
        solved = np.linalg.lstsq(np.stack(responses, axis=1), self._displacement, rcond=rcond)[0]
        return [{p.name: min(max(p.identity + d, p.low), p.high) for p, d in zip(movers, solved, strict=True)}]

    def _response(self, effect: Effect, values: dict[str, float]) -> Vector | None:
        """(y, x) pixels by which these values move the prediction; None for values that no bench can have."""
        try:
            moved = self._comparison.predictor(self._comparison.indices, {**self._base, effect.id: values})
        except UserError:
            return None
        return measure_displacement(np.asarray(moved.signal), self._predicted)


def measure_displacement(images: Images, reference: Images) -> Vector:
    """(y, x) pixels by which `images` are displaced from `reference`: the peak of the captures' summed correlation."""
    shape = images.shape[1:]
    total = np.zeros(shape)
    for image, other in zip(images, reference, strict=True):
        first, second = (np.fft.rfft2(_normalised(a)) for a in (image, other))
        total += np.fft.irfft2(first * second.conj(), s=shape)
    peak = np.unravel_index(int(np.argmax(total)), shape)
    return np.array([_subsample_peak(total, peak, axis) for axis in (0, 1)])


def _normalised(image: NDArray[np.floating]) -> NDArray[np.float64]:
    """The image without its mean, of unit power."""
    a = image - image.mean(dtype=np.float64)
    return np.asarray(a / max(float(np.linalg.norm(a)), 1e-30), dtype=np.float64)


def _subsample_peak(correlation: NDArray[np.float64], peak: tuple[np.intp, ...], axis: int) -> float:
    """The peak's position on one axis by a parabola through three samples, in −n/2 … n/2."""
    n = correlation.shape[axis]
    values = []
    for step in (-1, 0, 1):
        at = list(peak)
        at[axis] = (peak[axis] + step) % n
        values.append(correlation[tuple(at)])
    curvature = values[0] - 2 * values[1] + values[2]
    offset = 0.5 * (values[0] - values[2]) / curvature if curvature < 0 else 0.0
    position = int(peak[axis])
    return (position - n if position > n // 2 else position) + float(offset)


class GhostStarts:
    """For an effect that copies images, the shifts and strengths that the captures suggest; none for others."""

    def __init__(self, fitted: GainFit, comparison: Comparison) -> None:
        model = np.where(comparison.weight > 0, fitted.expected, 0.0)
        self._peaks = _correlation_peaks(comparison.residual_counts(fitted), model)

    def __call__(self, effect: Effect) -> StartingValues:
        if StartKind.GHOST not in effect.start_kinds:
            return []
        return [{"strength": s, "shift_y": float(y), "shift_x": float(x)} for s, y, x in self._peaks]


def _correlation_peaks(residual: NDArray[np.float32], model: NDArray[np.float32]) -> list[tuple[float, int, int]]:
    """(strength, y, x) of the highest positive peaks away from zero shift."""
    shape = model.shape[1:]
    centred = model - model.mean(axis=(1, 2), keepdims=True)
    spectra = zip(np.fft.rfft2(residual), np.fft.rfft2(centred), strict=True)
    total = np.fft.irfft2(sum(r * m.conj() for r, m in spectra), s=shape)
    power = float(np.square(centred, dtype=np.float64).sum())
    y, x = (np.fft.fftfreq(n, 1 / n).round().astype(int) for n in shape)
    total[np.hypot(y[:, None], x[None, :]) < _GHOST_MIN_SHIFT_PX] = -np.inf
    peaks = []
    for _ in range(_GHOST_PEAKS):
        at = np.unravel_index(int(np.argmax(total)), shape)
        if not total[at] > 0:
            break
        peaks.append((float(min(total[at] / power, 1.0)), int(y[at[0]]), int(x[at[1]])))
        away = np.hypot(_wrapped(y - y[at[0]], shape[0])[:, None], _wrapped(x - x[at[1]], shape[1])[None, :])
        total[away < _GHOST_SEPARATION_PX] = -np.inf
    return peaks


def _wrapped(difference: NDArray[np.int_], n: int) -> NDArray[np.int_]:
    """Differences of positions on a period of n, in −n/2 … n/2."""
    return (difference + n // 2) % n - n // 2


class SmearStarts:
    """For an effect that smears images along a line, the line that the captures suggest; none for others."""

    def __init__(self, fitted: GainFit, comparison: Comparison) -> None:
        self._line = _principal_line(_second_moments(fitted, comparison))

    def __call__(self, effect: Effect) -> StartingValues:
        if self._line is None or StartKind.SMEAR not in effect.start_kinds:
            return []
        return [dict(zip(("length_y", "length_x"), self._line, strict=True))]


def _second_moments(fitted: GainFit, comparison: Comparison) -> NDArray[np.float64]:
    """24 times the coefficients of the second derivatives, as the symmetric matrix (y, x) × (y, x), px²."""
    model = fitted.expected
    yy, xx = (correlate1d(model, (1.0, -2.0, 1.0), axis=axis, mode="nearest") for axis in (1, 2))
    yx = np.gradient(np.gradient(model, axis=1), axis=2)
    columns = np.stack([(comparison.weight * m).ravel() for m in (model, yy, 2 * yx, xx)])
    normal = (columns @ columns.T).astype(np.float64)
    right = (columns @ fitted.residual.ravel()).astype(np.float64)
    _, a, b, c = np.linalg.lstsq(normal, right, rcond=None)[0]
    return 24 * np.array([[a, b], [b, c]])


def _principal_line(moments: NDArray[np.float64]) -> tuple[float, float] | None:
    """(y, x) of the line with the moments' largest principal value, y ≥ 0; None where no value is positive."""
    values, axes = np.linalg.eigh(moments)
    if not values[-1] > 0:
        return None
    y, x = np.sqrt(values[-1]) * axes[:, -1] * (1.0 if axes[0, -1] >= 0 else -1.0)
    return float(y), float(x)


class PlaneStarts:
    """For an effect of errors of planes, the errors that the captures suggest on top of a base; none for others."""

    def __init__(self, context: SearchContext, base: FittedValues) -> None:
        self._context, self._base = context, base
        self._found: dict[str, StartingValues] = {}

    def __call__(self, effect: Effect) -> StartingValues:
        if StartKind.PLANES not in effect.start_kinds or self._is_known(effect):
            return []
        if effect.id not in self._found:
            search = _PlaneSearch(self._context, self._base, effect)
            start = search.run() if len(search.planes_m) > 1 else None
            self._found[effect.id] = [] if start is None else [start]
        return self._found[effect.id]

    def _is_known(self, effect: Effect) -> bool:
        """Whether the base has the effect, or an error that all planes share."""
        return bool({effect.id, *self._context.equivalents.get(effect.id, ())} & self._base.keys())


class _PlaneSearch:
    """The search for the errors of all planes. planes_m: their recorded distances."""

    def __init__(self, context: SearchContext, base: FittedValues, effect: Effect) -> None:
        self._base, self._effect = base, effect
        captures = context.data.captures
        self.planes_m = np.unique(captures.distance_m[context.kept])
        indices = np.array([k for z in self.planes_m for k in self._smoothest(context, float(z))])
        self._of_plane = captures.distance_m[indices][None, :] == self.planes_m[:, None]
        sine = captures.relay2.first_order_sine(float(captures.wavelengths_m.mean()), captures.slms[0].pitch_m)
        self._depth_m = float(captures.wavelengths_m.mean()) / sine**2
        self._lowest_m = -np.inf if captures.is_fourier else 0.0
        self._comparison = context.tolerant_comparison(indices, context.relative_model_error(base, indices))

    def _smoothest(self, context: SearchContext, plane_m: float) -> list[int]:
        """The smoothest captures of a plane, of different wavelengths if there are several."""
        captures, roughness = context.data.captures, pattern_roughness(context.data.captures)
        own = sorted((int(k) for k in context.kept if captures.distance_m[k] == plane_m), key=lambda k: roughness[k])
        first = {float(captures.wavelength_m[k]): k for k in reversed(own)}
        ordered = sorted(own, key=lambda k: (first[float(captures.wavelength_m[k])] != k, roughness[k]))
        return ordered[:_PLANE_CAPTURES]

    def run(self) -> dict[str, Any] | None:
        """The errors of the planes that are off; None where a simpler effect states them, or no plane is off."""
        nothing = np.zeros(len(self.planes_m))
        before, errors = self._costs(nothing), self._on_grid()
        errors, after, curvature = self._refined(errors)
        least = _PLANE_MIN_GAIN * max(1.0, float(after.sum()) / self._comparison.pixel_count)
        ones = np.ones(len(self.planes_m))
        if min(_beyond(errors, curvature, shape) for shape in (ones, self.planes_m)) < least:
            return None
        off = before - after > least
        if not off.any():
            return None
        return {"distances": tuple(self.planes_m[off].tolist()), "errors": tuple(errors[off].tolist())}

    def _on_grid(self) -> Floats:
        """The best error of each plane, among distances so close that no minimum is missed."""
        depths = np.array(_PLANE_DEPTHS)
        tried = self._depth_m * np.concatenate([[0.0], depths, -depths])
        costs = [self._costs(np.full(len(self.planes_m), error)) for error in tried]
        return np.asarray(tried[np.argmin(costs, axis=0)])

    def _refined(self, errors: Floats) -> tuple[Floats, Floats, Floats]:
        """The minima near these errors, Σ residual² there, and its curvature (half the second derivative)."""
        step = np.maximum(_PLANE_FIRST_STEP * np.abs(errors), _PLANE_LEAST_STEP * self._depth_m)
        here = self._costs(errors)
        curvature = np.zeros_like(errors)
        for _ in range(_PLANE_ROUNDS):
            low, high = self._costs(errors - step), self._costs(errors + step)
            bend = low + high - 2 * here
            is_bowl = (bend > 0) & np.isfinite(bend)  # at the lowest place of the camera a side is infinite
            vertex = np.where(is_bowl, (low - high) / (2 * np.where(is_bowl, bend, 1.0)), np.sign(low - high))
            moved = errors + step * np.clip(vertex, -1.0, 1.0)
            there = self._costs(moved)
            curvature = np.where(is_bowl, bend, 0.0) / (2 * step**2)
            better = there < here
            errors, here = np.where(better, moved, errors), np.where(better, there, here)
            step = step * _PLANE_STEP_RATIO
        return errors, here, curvature

    def _costs(self, errors: Floats) -> Floats:
        """Σ residual² of each plane's captures with these errors; infinite where the camera can't be."""
        possible = self.planes_m + errors >= self._lowest_m
        given = np.where(possible, errors, 0.0)
        own: dict[str, Any] = {"distances": tuple(self.planes_m.tolist()), "errors": tuple(given.tolist())}
        squares = self._comparison.fit_gains({**self._base, self._effect.id: own}).squares
        return np.where(possible, self._of_plane @ np.asarray(squares, dtype=np.float64), np.inf)


def _beyond(errors: Floats, curvature: Floats, shape: Floats) -> float:
    """How much Σ residual² exceeds its minimum, by its curvature, if all errors are in proportion to `shape`."""
    power = float((curvature * shape**2).sum())
    amount = float((curvature * shape * errors).sum()) / power if power > 0 else 0.0
    return float((curvature * np.square(errors - amount * shape)).sum())
