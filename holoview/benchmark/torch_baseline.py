"""A whole frame as the fastest loop that torch allows: what the shaders are compared with.

It has every advantage that a program for one bench may take: transfer functions are built before, in float64, for all
wavelengths; fields are complex64 and changed in place; a periodic grid; one on-axis source and one frame.
"""

from __future__ import annotations

import math

import numpy as np
import torch

from holoview.model.plan import Plan
from holoview.numerics.resample import upsample_nearest
from holoview.optics.frame_inputs import FrameInputs
from holoview.optics.propagate import relay_transfer_function


class TorchBaseline:
    """XYZ of one plane, (3, y, x) float32, by torch on the CPU: a wavelength after the other, or all in one batch.

    Raises ValueError for a bench with padding, tilted light, several frames or sources.
    """

    def __init__(self, plan: Plan, inputs: FrameInputs, *, batched: bool) -> None:
        if (
            plan.grid.padded != plan.grid.shape
            or plan.slopes.any()
            or plan.weights.shape[0] > 1
            or len(plan.slopes) > 1
        ):
            raise ValueError("expected a periodic grid, one frame and one source on the axis")
        system = plan.system
        wavelengths = range(len(system.wavelengths_m))
        self._batched = batched
        self._paths = [upsample_nearest(opd, plan.grid.upsample).float() * 1e9 for opd in inputs.opd_m[0]]
        self._radians = [2 * math.pi / (float(λ) * 1e9) for λ in system.wavelengths_m]
        gap = [] if system.gap_m is None else [_responses(plan, inputs, 0, system.gap_m)]
        self._responses = [*gap, _responses(plan, inputs, 1, float(plan.planes_m[0]))]
        mix = plan.weights[0][:, None] * plan.colour_weights
        self._mix = torch.from_numpy(np.ascontiguousarray(mix)).float()
        self._ones = torch.ones(plan.grid.shape)
        self._wavelengths = wavelengths

    def __call__(self) -> torch.Tensor:
        """The frame."""
        return self._together() if self._batched else self._in_turn()

    def _in_turn(self) -> torch.Tensor:
        seen = torch.zeros(3, *self._ones.shape)
        for wavelength in self._wavelengths:
            field: torch.Tensor | None = None
            for path, responses in zip(self._paths, self._responses, strict=True):
                phasor = torch.polar(self._ones, path * self._radians[wavelength])
                field = phasor if field is None else field.mul_(phasor)
                field = torch.fft.ifft2(torch.fft.fft2(field).mul_(responses[wavelength]))
            assert field is not None
            intensity = field.real.square().add_(field.imag.square())
            for channel in range(3):
                seen[channel].add_(intensity, alpha=float(self._mix[wavelength, channel]))
        return seen

    def _together(self) -> torch.Tensor:
        radians = torch.tensor(self._radians)[:, None, None]
        field: torch.Tensor | None = None
        for path, responses in zip(self._paths, self._responses, strict=True):
            phase = path * radians
            phasor = torch.polar(torch.ones(1).expand_as(phase), phase)
            field = phasor if field is None else field.mul_(phasor)
            field = torch.fft.ifft2(torch.fft.fft2(field).mul_(responses))
        assert field is not None
        intensity = field.real.square().add_(field.imag.square())
        return torch.einsum("wyx,wc->cyx", intensity, self._mix)


def _responses(plan: Plan, slots: FrameInputs, relay: int, distance_m: float) -> torch.Tensor:
    """H × pupil (wavelength, y, x) complex64."""
    cpu = torch.device("cpu")
    return torch.stack(
        [
            relay_transfer_function(
                plan.transfer(relay, w, distance_m), plan.grid, slots.pupils[relay][w], torch.complex64, cpu
            )
            for w in range(len(plan.system.wavelengths_m))
        ]
    )
