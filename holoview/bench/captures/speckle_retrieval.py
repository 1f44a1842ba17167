"""Amplitude and phase of the light on the modulator from pictures with known patterns, without a starting point.

The intensity I(x) = |Σ_j c_j·a_j(x)|² at a pixel is quadratic in the light's values c at the nodes of a lattice; a_j is
the field at the camera if only node j is lit. Where a picture is brighter than its surroundings, a(x) resembles c. The
leading eigenvector of Y = Σ_x T(x)·a(x)·a(x)† is therefore near c, with weights T that rise with the measured intensity
and are bounded: here the local contrast without its mean, over the local mean (spectral initialisation: Netrapalli,
Jain & Sanghavi, NIPS 2013; bounded weights: Chen & Candès, NIPS 2015; Mondelli & Montanari, Found. Comput. Math. 19,
703 (2019)). Y·c is the derivative of Σ_x T(x)·I(x), so that the predictor's own light serves. From there an ascent of
the correlation of local contrasts refines c, with the stroke. Patterns that are known and rough leave one solution.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize, nnls
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.prepared_captures import PreparedCaptures
from holoview.bench.captures.speckle_measure import SpeckleMeasure
from holoview.light.model.effects.effect import Effect, Parameter, Values
from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.light.numerics.speckle_match import SpeckleMatch, grain_px
from holoview.light.numerics.surfaces import zernike

Tensor = torch.Tensor

_NODES = 16  # along the modulator's longer side
_VECTORS, _RESTARTS, _TOLERANCE = 12, 3, 0.05  # of the Lanczos iteration, which needs a direction, no more
_STEP, _STROKE_STEP = 0.1, 0.02  # of Adam: of the brightest node's light, of the stroke
_BETAS = 0.8, 0.95
_BEAM_RADII = 0.15, 0.25, 0.4, 0.65, 1.0  # half sides, from which the nearest beam is sought
_BEAM_BOUNDS = ((0.08, 3.0), (0.8, 6.0), (-1.5, 1.5), (-1.5, 1.5))
_POINTS = 4  # between nodes, at which a beam is compared


class RetrievedLight(Effect):
    """Light before the first modulator by its values at the nodes of a lattice, cubic splines between them.

    coefficients: complex (row, column), of nodes; the outermost are at the modulator's edges. stroke: over the assumed.
    """

    id = "speckle_retrieval"
    cause = "A retrieval by speckle."
    finding = "A retrieval by speckle."
    parameters = (Parameter("on", "Whether it acts."),)
    acts_on = ("source", "modulator 1", "modulator 2")
    listed: ClassVar = False

    def __init__(self, shape: tuple[int, int]) -> None:
        """shape: of the modulator."""
        self.half_sides = tuple(n / max(shape) for n in shape)
        self.nodes = tuple(max(4, round(_NODES * half)) for half in self.half_sides)
        self.coefficients, self.stroke = torch.zeros(self.nodes, dtype=torch.complex64), torch.ones(())
        self._splines: dict[tuple[int, ...], tuple[Tensor, Tensor]] = {}

    def stroke_response(self, share: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        return share * self.stroke.to(share.dtype)

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        if context.number:
            return transmission
        shape = tuple(transmission.shape)
        if shape not in self._splines:
            y, x = (place.flatten() / context.half_width() for place in context.positions(transmission))
            self._splines[shape] = self._matrices(y, x)
        rows, columns = self._splines[shape]
        return transmission * (rows @ self.coefficients @ columns.T)

    def light_at(self, y: Tensor, x: Tensor) -> Tensor:
        """The light at rows y and columns x, places in half sides of the modulator, the longer."""
        rows, columns = self._matrices(y, x)
        return rows @ self.coefficients @ columns.T

    def _matrices(self, y: Tensor, x: Tensor) -> tuple[Tensor, Tensor]:
        """Of the splines (place, node) along each axis."""
        matrices = []
        for places, half, count in zip((y, x), self.half_sides, self.nodes, strict=True):
            nodes = torch.arange(count) - (count - 1) / 2
            far = (places[:, None] * ((count - 1) / (2 * half)) - nodes).abs()
            near = 2 / 3 - far.square() + far**3 / 2
            matrices.append(torch.where(far < 1, near, (2 - far).clamp_min(0) ** 3 / 6).to(torch.complex64))
        return matrices[0], matrices[1]


@dataclass(frozen=True)
class Retrieved:
    """Light at the nodes of the lattice, the stroke over the assumed one, and the speckle's correlations on the pixels
    by which it was sought and on those that were held out."""

    coefficients: Tensor
    stroke: float
    correlation: float
    held_out: float


@dataclass(frozen=True)
class NearestBeam:
    """A beam amplitude exp(−(r/radius)^(2·edge)) with a wavefront that resembles a retrieved light most.

    Lengths in half sides of the modulator. terms: {Noll index: radians r.m.s. over the beam's circle}. overlap: of the
    amplitudes, 1 for equal ones.
    """

    radius: float
    edge: float
    centre: tuple[float, float]
    terms: dict[int, float]
    overlap: float


class LightRetrieval:
    """Retrieves the light on the modulator from a few pictures of one wavelength."""

    def __init__(self, data: PreparedCaptures) -> None:
        captures = data.captures
        self._captures, self._indices = captures, np.arange(len(captures))
        self._begin()
        self._measure = measure = SpeckleMeasure(data)
        self._usable = data.usable
        self._weights = torch.zeros_like(measure.mean)
        contrast = measure.contrast[measure.fitted]
        self._weights[measure.fitted] = (contrast - contrast.mean()) / measure.mean[measure.fitted]

    def _begin(self) -> None:
        captures, self._calls = self._captures, 0
        self._light = RetrievedLight((captures.levels.shape[2], captures.levels.shape[3]))
        self._predict = Predictor(captures, [self._light], cache_mb=1)

    def for_thread(self) -> LightRetrieval:
        """The same for another thread: what predicts can't be shared."""
        other = copy.copy(self)
        other._begin()
        return other

    def start(self, stroke: float) -> Retrieved:
        """The leading eigenvector of the weighted intensities; any light where none leads, as of a wrong pattern."""
        shape = self._light.nodes
        count = shape[0] * shape[1]

        def weighted(vector: NDArray[np.complex64]) -> NDArray[np.complex64]:
            light = torch.from_numpy(vector.reshape(shape).astype(np.complex64)).requires_grad_(True)
            (self._predicted(light, torch.tensor(stroke)) * self._weights).sum().backward()  # type: ignore[no-untyped-call]
            assert light.grad is not None
            return np.asarray(light.grad.numpy().reshape(-1))

        parts = np.random.default_rng(0).standard_normal((2, count))
        first = (parts[0] + 1j * parts[1]).astype(np.complex64)
        try:
            _, vectors = eigsh(
                LinearOperator((count, count), matvec=weighted, dtype=np.complex64),
                k=1,
                which="LA",
                ncv=min(count, _VECTORS),
                maxiter=_RESTARTS,
                tol=_TOLERANCE,
                v0=first,
            )
        except ArpackNoConvergence:
            vectors = first[:, None]
        return self._judged(torch.from_numpy(vectors[:, 0].reshape(shape)), stroke)

    def ascend(self, start: Retrieved, steps: int) -> Retrieved:
        """The best light and stroke of an ascent of the correlation by Adam."""
        light = (start.coefficients / start.coefficients.abs().max()).requires_grad_(True)
        stroke = torch.tensor(start.stroke, requires_grad=True)
        groups = [{"params": [light], "lr": _STEP}, {"params": [stroke], "lr": _STROKE_STEP}]
        adam = torch.optim.Adam(groups, betas=_BETAS)
        best = (-1.0, start.coefficients, start.stroke)
        for number in range(steps):
            adam.param_groups[0]["lr"] = _STEP * (1 - 0.85 * number / steps)
            score = self._measure.correlation(self._predicted(light, stroke), self._measure.fitted)
            if score.item() > best[0]:
                best = (score.item(), light.detach().clone(), stroke.item())
            adam.zero_grad()
            (-score).backward()  # type: ignore[no-untyped-call]
            adam.step()
        return self._judged(best[1], best[2])

    def matches(self, retrieved: Retrieved, chance: float) -> list[SpeckleMatch]:
        """How the held-out speckle of each picture stands with a light, in standard deviations above what chance gives.

        chance: correlation of held-out speckle with patterns that weren't shown. A standard deviation is that of
        Fisher's transform of the correlation of as many numbers as there are grains.
        """
        with torch.no_grad():
            predicted = self._predicted(retrieved.coefficients, torch.tensor(retrieved.stroke))
        found = []
        for number, one in enumerate(self._measure.held_out):
            pixels = torch.zeros_like(self._measure.held_out)
            pixels[number] = one
            grain = grain_px(self._measure.contrast[number].double().numpy(), self._usable[number])
            grains = max(float(one.sum()) / max(2 * grain, 1.0) ** 2, 4.0)
            with torch.no_grad():
                correlation = float(self._measure.correlation(predicted, pixels))
            beyond = math.atanh(min(correlation, 0.999)) - math.atanh(min(max(chance, 0.0), 0.999))
            found.append(SpeckleMatch(correlation, max(beyond, 0.0) * math.sqrt(grains - 3), (0, 0)))
        return found

    def nearest_beam(self, retrieved: Retrieved, terms: tuple[int, ...]) -> NearestBeam:
        """The beam, with a wavefront of some Zernike terms, that resembles a light most."""
        self._light.coefficients = retrieved.coefficients
        y, x = (
            torch.linspace(-half, half, _POINTS * count)
            for half, count in zip(self._light.half_sides, self._light.nodes, strict=True)
        )
        return nearest_beam(self._light.light_at(y, x), y, x, terms)

    def _judged(self, coefficients: Tensor, stroke: float) -> Retrieved:
        with torch.no_grad():
            predicted = self._predicted(coefficients, torch.tensor(stroke))
            parts = self._measure.fitted, self._measure.held_out
            fitted, held_out = (float(self._measure.correlation(predicted, pixels)) for pixels in parts)
        return Retrieved(coefficients, stroke, fitted, held_out)

    def _predicted(self, coefficients: Tensor, stroke: Tensor) -> Tensor:
        self._light.coefficients, self._light.stroke = coefficients, stroke
        self._calls += 1  # each call is another light, of which nothing is kept
        values = {self._light.id: {"on": float(self._calls)}}
        return self._predict(self._indices, values, grad=torch.is_grad_enabled()).signal


def nearest_beam(light: Tensor, y: Tensor, x: Tensor, terms: tuple[int, ...]) -> NearestBeam:
    """The beam that resembles a complex light (row, column) at rows y and columns x most.

    The shape has the largest overlap of amplitudes; the wavefront's differences between neighbouring points are those
    of the light in the sense of least squares, weighted by light and beam, so that its phase needn't be unwrapped.
    terms: Noll indices, of which 1 can't be told.
    """
    amplitude = light.abs().double().numpy()
    rows, columns = y.double().numpy()[:, None], x.double().numpy()[None, :]
    power = float((amplitude**2).sum())

    def missing(numbers: NDArray[np.float64]) -> float:
        shape = _beam_amplitude(rows, columns, numbers)
        return -float((amplitude * shape).sum()) / max(float(np.sqrt(power * (shape**2).sum())), 1e-30)

    brightest = amplitude**4 / (amplitude**4).sum()
    centre = float((brightest * rows).sum()), float((brightest * columns).sum())
    fits = [minimize(missing, (r, 2.0, *centre), method="L-BFGS-B", bounds=_BEAM_BOUNDS) for r in _BEAM_RADII]
    best = min(fits, key=lambda fit: float(fit.fun))
    radius, edge, centre_y, centre_x = (float(value) for value in best.x)
    shape = torch.from_numpy(_beam_amplitude(rows, columns, best.x))
    down, across = torch.meshgrid((y.double() - centre_y) / radius, (x.double() - centre_x) / radius, indexing="ij")
    waves = torch.stack([zernike(noll, torch.hypot(down, across), torch.atan2(down, across)) for noll in terms])
    matrices, phases = [], []
    for axis in (0, 1):
        count = light.shape[axis] - 1
        later, earlier = (light.narrow(axis, first, count).to(torch.complex128) for first in (1, 0))
        turn = later * earlier.conj()
        weight = (turn.abs() * shape.narrow(axis, 1, count)).sqrt()
        steps = waves.narrow(axis + 1, 1, count) - waves.narrow(axis + 1, 0, count)
        matrices.append((steps * weight).flatten(1).T)
        phases.append((turn.angle() * weight).flatten())
    solved = torch.linalg.lstsq(torch.cat(matrices), torch.cat(phases)[:, None]).solution[:, 0]
    found = {noll: float(value) for noll, value in zip(terms, solved, strict=True)}
    return NearestBeam(radius, edge, (centre_y, centre_x), found, -float(best.fun))


@dataclass(frozen=True)
class Brightness:
    """What the brightness of near fields tells.

    beam: on the modulator. explained: share of what even light leaves in held-out cells that this beam explains. stray:
    light that is the same everywhere, in the unit of what was measured. without_stray: what a beam beside a gain alone
    leaves in held-out cells, over what this beam beside stray light leaves.
    """

    beam: NearestBeam
    explained: float
    stray: float
    without_stray: float


def beam_of_brightness(
    measured: NDArray[np.float64], even: NDArray[np.float64], y: NDArray[np.float64], x: NDArray[np.float64]
) -> Brightness:
    """The beam that brings the brightness of a near field to its places, and how much it explains.

    A near field is as bright as the light on the modulator's part before it, times what the pattern does to even light.
    measured, even: mean brightness (picture, row, column) in cells, as measured and as predicted of even light; NaN
    where it isn't known. y, x: of the cells' centres, in half sides of the modulator. A gain and stray light, the same
    for all, are fitted beside the beam. Every fourth cell is held out of the fit.
    """
    rows, columns = y[:, None], x[None, :]
    known = np.isfinite(measured) & np.isfinite(even)
    held = np.broadcast_to((np.arange(len(y))[:, None] + 2 * np.arange(len(x))[None, :]) % 4 == 0, known.shape)

    def fitted(shape: NDArray[np.float64] | float, has_stray: bool = True) -> tuple[NDArray[np.float64], float, float]:
        """Gain and stray light, and what they leave in the cells of the fit and in the others."""
        predicted, used = even * shape, known & ~held
        model = np.stack([predicted[used], np.full(int(used.sum()), float(has_stray))], axis=1)
        numbers, _ = nnls(model, measured[used])
        rest = np.square(measured - numbers[0] * predicted - numbers[1] * has_stray)
        return numbers, float(rest[used].sum()), float(rest[known & held].sum())

    scale = max(fitted(1.0)[1], 1e-30)

    def best_from(starts: list[tuple[float, float, float, float]], has_stray: bool) -> NDArray[np.float64]:
        def missing(numbers: NDArray[np.float64]) -> float:
            return fitted(_beam_amplitude(rows, columns, numbers) ** 2, has_stray)[1] / scale

        fits = [minimize(missing, start, method="L-BFGS-B", bounds=_BEAM_BOUNDS) for start in starts]
        return np.asarray(min(fits, key=lambda fit: float(fit.fun)).x)

    best = best_from([(radius, 1.5, 0.0, 0.0) for radius in _BEAM_RADII], True)
    alone = best_from([tuple(best)], False)
    radius, edge, centre_y, centre_x = (float(value) for value in best)
    light = _beam_amplitude(rows, columns, best) ** 2
    (_, stray), _, left = fitted(light)
    _, _, without = fitted(_beam_amplitude(rows, columns, alone) ** 2, False)
    return Brightness(
        NearestBeam(radius, edge, (centre_y, centre_x), {}, 1.0),
        1 - left / max(fitted(1.0)[2], 1e-30),
        float(stray),
        without / max(left, 1e-30),
    )


def _beam_amplitude(
    rows: NDArray[np.float64], columns: NDArray[np.float64], numbers: NDArray[np.float64]
) -> NDArray[np.float64]:
    """exp(−(r/radius)^(2·edge)) of a beam's radius, edge and centre (y, x)."""
    radius, edge, centre_y, centre_x = numbers
    square = ((rows - centre_y) ** 2 + (columns - centre_x) ** 2) / radius**2
    return np.asarray(np.exp(-np.minimum((square + 1e-12) ** edge, 100.0)))
