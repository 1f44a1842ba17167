"""Derivatives of χ² by the complex transmission of every pixel of the modulators, by adjoint passes of the model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.diagnose.comparison import Comparison
from holoview.diagnose.free_parameters import FittedValues
from holoview.diagnose.search_context import SearchContext
from holoview.model.effects.effect import Effect
from holoview.model.effects.hook_contexts import ModulatorContext
from holoview.model.effects.parameter import Parameter, Values

Complex = NDArray[np.complexfloating]
Tensor = torch.Tensor


@dataclass(frozen=True, eq=False)
class TransmissionSlope:
    """What a capture of a comparison, at a position in its indices, says of the samples of a modulator.

    slope (y, x): ∂χ²/∂Re t + i·∂χ²/∂Im t by the transmission t (y, x) of a sample.
    """

    position: int
    modulator: ModulatorContext
    slope: Complex
    transmission: Complex

    def of_pixels(self, samples: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """The sums of samples (y, x) over each pixel."""
        rows, columns = self.modulator.shape
        return np.asarray(samples.reshape(rows, samples.shape[0] // rows, columns, -1).sum(axis=(1, 3)))


class _TransmissionProbe(Effect):
    """Adds a zero to every transmission, of which the derivative is asked for."""

    id = "free_transmission"
    cause = "Something changes a modulator's transmission."
    finding = "Derivatives are asked for."
    parameters = (Parameter("on", "1: on."),)
    acts_on = ("modulator 1", "modulator 2")
    order = -1

    def __init__(self) -> None:
        self.seen: list[tuple[Tensor, Tensor, ModulatorContext]] = []

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        zero = torch.zeros_like(transmission, requires_grad=True)
        self.seen.append((zero, transmission.detach(), context))
        return transmission + zero


def transmission_slopes(
    context: SearchContext, base: FittedValues, comparison: Comparison
) -> Iterator[TransmissionSlope]:
    """The slopes of every modulator at every capture of a comparison, with the causes of a base; one pass a capture."""
    probe = _TransmissionProbe()
    probed = comparison.with_predictor(context.predictor.create(extra_effects=[probe]))
    values: FittedValues = {**base, probe.id: {"on": 1.0}}
    for position in range(len(comparison.indices)):
        probe.seen.clear()
        squares = squared_residuals(probed, values, position)
        slopes = torch.autograd.grad(squares, [zero for zero, _, _ in probe.seen])
        for slope, (_, transmission, modulator) in zip(slopes, probe.seen, strict=True):
            yield TransmissionSlope(position, modulator, slope.numpy(), transmission.numpy())


def squared_residuals(comparison: Comparison, values: FittedValues, position: int) -> Tensor:
    """Σ residual² of one capture of a comparison, with its best gain, as a tensor with gradients."""
    weight, light = (torch.from_numpy(a[position]) for a in (comparison.weight, comparison.light))
    prediction = comparison.predictor(comparison.indices[position : position + 1], values, grad=True)
    model = weight * prediction.signal[0]
    dark = np.asarray(prediction.counts_without_lasers(comparison.data.camera.black_level))
    data = weight * (light - torch.from_numpy(dark))
    gain = (data * model).sum() / (model * model).sum().clamp_min(1e-30)
    return (data - gain.detach() * model).square().sum(dtype=torch.float64)
