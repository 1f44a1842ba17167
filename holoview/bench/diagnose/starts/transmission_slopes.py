"""Derivatives of χ² by the complex transmission of every pixel of the modulators, by adjoint passes of the model.

They give the fall of χ², to first order, if a pixel kept to a level, for all pixels at once. With G = ∂χ²/∂Re t +
i·∂χ²/∂Im t by the transmission t of a pixel: a pixel that shows the share s of the stroke has the transmission
exp(2πi·s·stroke/λ), so that its replacement changes χ² by Re[G*·(exp(2πi·s·stroke/λ) − t)], to first order in the light
of the pixel, whatever the change of its phase. A pixel of an amplitude modulator has the amplitude of s.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Captures
from holoview.bench.diagnose.fit import FittedValues
from holoview.bench.diagnose.likelihood import Comparison
from holoview.bench.diagnose.search_context import SearchContext
from holoview.light.model.effects.effect import Effect, Parameter, Values
from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.light.model.elements import AmplitudeModulator

Complex = NDArray[np.complexfloating]
Tensor = torch.Tensor


def modulator_of(effect: Effect, captures: Captures) -> int | None:
    """The number of the modulator that an effect acts on, 0 for the first, of a chain among the elements that show
    patterns; None where it acts on something else."""
    names = captures.slm_names
    return names.index(effect.acts_on[0]) if effect.acts_on[0] in names else None


@dataclass(frozen=True, eq=False)
class TransmissionSlope:
    """Derivatives by the samples of a modulator from one capture of a comparison, at a position in its indices.

    number: as of `modulator_of`. slope (y, x): ∂χ²/∂Re t + i·∂χ²/∂Im t by the transmission t (y, x) of a sample.
    """

    position: int
    number: int
    modulator: ModulatorContext
    slope: Complex
    transmission: Complex

    def of_pixels(self, samples: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """The sums of samples (y, x) over each pixel."""
        rows, columns = self.modulator.shape
        return np.asarray(samples.reshape(rows, samples.shape[0] // rows, columns, -1).sum(axis=(1, 3)))


class _TransmissionProbe(Effect):
    """Adds zeros to the transmission of every modulator, by which derivatives are taken.

    elements: of a chain, the names of those that show patterns.
    """

    id = "free_transmission"
    cause = "Something changes a modulator's transmission."
    finding = "Derivatives are asked for."
    parameters = (Parameter("on", "1: on."),)
    acts_on = ("modulator 1", "modulator 2")
    order = -1

    def __init__(self, elements: Sequence[str] = ()) -> None:
        self.elements, self.on_all_elements = elements, bool(elements)  # type: ignore[misc]
        self.seen: list[tuple[Tensor, Tensor, ModulatorContext]] = []

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        if self.elements and context.element not in self.elements:
            return transmission
        zero = torch.zeros_like(transmission, requires_grad=True)
        self.seen.append((zero, transmission.detach(), context))
        return transmission + zero


def transmission_slopes(
    context: SearchContext, base: FittedValues, comparison: Comparison
) -> Iterator[TransmissionSlope]:
    """The slopes of every modulator at every capture of a comparison, with the causes of a base; a pass for each."""
    names = () if context.data.captures.chain is None else context.data.captures.slm_names
    probe = _TransmissionProbe(names)
    probed = comparison.with_predictor(context.predictor.create(extra_effects=[probe]))
    values: FittedValues = {**base, probe.id: {"on": 1.0}}
    for position in range(len(comparison.indices)):
        probe.seen.clear()
        squares = squared_residuals(probed, values, position)
        slopes = torch.autograd.grad(squares, [zero for zero, _, _ in probe.seen])
        for slope, (_, transmission, modulator) in zip(slopes, probe.seen, strict=True):
            number = names.index(modulator.element) if names else modulator.number
            yield TransmissionSlope(position, number, modulator, slope.numpy(), transmission.numpy())


def squared_residuals(comparison: Comparison, values: FittedValues, position: int) -> Tensor:
    """Σ residual² of one capture of a comparison, with its best gain, as a tensor with gradients."""
    weight, light = (torch.from_numpy(a[position]) for a in (comparison.weight, comparison.light))
    prediction = comparison.predictor(comparison.indices[position : position + 1], values, grad=True)
    model = weight * prediction.signal[0]
    dark = np.asarray(prediction.counts_without_lasers(comparison.data.camera.black_level))
    data = weight * (light - torch.from_numpy(dark))
    gain = (data * model).sum() / (model * model).sum().clamp_min(1e-30)
    return (data - gain.detach() * model).square().sum(dtype=torch.float64)


Floats = NDArray[np.float64]
_LEAST_LIT = 8
"""[1] Gains whose median and deviation tell something. Evidence: derivation: the deviation of so many is known within a
third."""


def replacement_gains(
    context: SearchContext, base: FittedValues, comparison: Comparison, levels: Floats, *, earlier: bool = False
) -> dict[int, Floats]:
    """The fall of χ² for each level and pixel, (level, y, x), of every modulator by its number, 0 for the first.

    levels (level,): shares of the stroke, of an amplitude modulator of its range. earlier: adds two rows, for pixels
    that show the first pattern of all captures and for pixels that show the pattern of the capture before.
    """
    gains: dict[int, Floats] = {}
    chain = context.data.captures.chain
    for found in transmission_slopes(context, base, comparison):
        shares, modulator, number = levels[:, None, None], found.modulator, found.number
        if earlier:
            patterns = _earlier_patterns(comparison, found)
            shares = np.concatenate([np.broadcast_to(shares, (len(levels), *modulator.shape)), patterns])
        element = None if chain is None else chain.elements[chain.part(modulator.element)]
        light = element.amplitude_of(shares) if isinstance(element, AmplitudeModulator) else _phasors(modulator, shares)
        gains[number] = gains.get(number, 0.0) + _gain_of_light(found, light)
    return gains


def line_gains(gains: Floats, axis: int, segments: int) -> Floats:
    """The gain of whole lines along an axis of (level, y, x), robust against a few parts that gain alone."""
    parts = _segment_gains(gains, axis, segments)
    return np.asarray(len(parts) * np.median(parts, axis=0))


def line_significance(gains: Floats, axis: int, segments: int, least: int) -> Floats:
    """How far lines stand out, (level, line): whole, or in parts of `least` segments and more from one edge on."""
    parts = _segment_gains(gains, axis, segments)
    spans = [parts, *(half for n in range(least, len(parts)) for half in (parts[:n], parts[-n:]))]
    of_spans = significance(np.concatenate([len(span) * np.median(span, axis=0) for span in spans]))
    return np.asarray(of_spans.reshape(len(spans), *parts.shape[1:]).max(axis=0))


def _segment_gains(gains: Floats, axis: int, segments: int) -> Floats:
    """The gain of each part of a line, (segment, level, line); of a line of fewer pixels of each pixel."""
    count = min(segments, gains.shape[axis])
    return np.stack([part.sum(axis=axis) for part in np.array_split(gains, count, axis=axis)])


def significance(gains: Floats) -> Floats:
    """How far each gain is above the median of its level (first axis), in robust standard deviations.

    Where most of a level gets no light, median and deviation are those of what does: more than a hundredth of the 99th
    percentile of its gains. None stands out among fewer than `_LEAST_LIT` of these.
    """
    flat = gains.reshape(len(gains), -1)
    middle, scale = _middle_and_deviation(flat)
    large = np.quantile(np.abs(flat), 0.99, axis=1)
    for level in np.flatnonzero(scale < 1e-3 * large):
        lit = flat[level, np.abs(flat[level]) > 1e-2 * large[level]]
        middle[level], scale[level] = _middle_and_deviation(lit) if len(lit) >= _LEAST_LIT else (0.0, np.inf)
    return np.asarray((flat - middle[:, None]) / np.maximum(scale, 1e-30)[:, None]).reshape(gains.shape)


def _middle_and_deviation(values: Floats) -> tuple[Floats, Floats]:
    """The median along the last axis, and the standard deviation by that of the distances from it."""
    middle = np.asarray(np.median(values, axis=-1))
    return middle, np.asarray(1.4826 * np.median(np.abs(values - middle[..., None]), axis=-1))


def _earlier_patterns(comparison: Comparison, of: TransmissionSlope) -> Floats:
    """The first pattern of all captures, and the pattern before a capture, as shares of the stroke (pattern, y, x)."""
    captures, (rows, columns) = comparison.data.captures, of.modulator.shape
    before = captures.drive_before(int(comparison.indices[of.position]))
    return np.stack([captures.first_drive[of.number], before[of.number]])[:, :rows, :columns]


def _phasors(of: ModulatorContext, shares: Floats) -> Complex:
    """The transmission of pixels of a phase modulator that show shares of the stroke."""
    return np.asarray(np.exp(2j * np.pi * of.stroke_m / of.wavelength_m * shares))


def _gain_of_light(found: TransmissionSlope, light: NDArray[np.inexact]) -> Floats:
    """−Re[G*·(t' − t)] of each transmission t' (share, y, x) of pixels; samples of a pixel are summed."""
    conjugate = found.slope.conj()
    own, towards = (found.of_pixels(a) for a in ((conjugate * found.transmission).real, conjugate))
    return np.asarray(own - (towards * light).real, dtype=np.float64)
