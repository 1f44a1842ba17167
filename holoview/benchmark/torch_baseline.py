"""A frame as the fastest loop in PyTorch, with which the shaders are compared.

It has every advantage that a program for one fixed bench can have: transfer functions are computed in advance, in
float64, for all wavelengths; fields are complex64 and modified in place; the grid is periodic; there are one on-axis
source and one frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import torch

from holoview.model.plan import Plan
from holoview.numerics.resample import upsample_nearest
from holoview.optics.frame_inputs import FrameInputs
from holoview.optics.propagate import relay_transfer_function


class TorchBaseline:
    """Computes XYZ of one plane, (3, y, x) float32, in PyTorch.

    batched: all wavelengths at once instead of one after the other. device: of torch.
    Raises ValueError for a bench with padding, tilted light, several frames or several sources.
    """

    def __init__(self, plan: Plan, inputs: FrameInputs, *, batched: bool, device: str = "cpu") -> None:
        check_simple_bench(plan)
        system = plan.system
        wavelengths = range(len(system.wavelengths_m))
        self._batched = batched
        self._device = torch.device(device)
        paths_m = [upsample_nearest(opd, plan.grid.upsample) for opd in inputs.opd_m[0]]
        self._paths_nm = [path_m.float().to(self._device) * 1e9 for path_m in paths_m]
        self._radians_per_nm = [2 * math.pi / (float(λ) * 1e9) for λ in system.wavelengths_m]
        gap = [] if system.gap_m is None else [_transfer_functions(plan, inputs, 0, system.gap_m)]
        transfers = [*gap, _transfer_functions(plan, inputs, 1, float(plan.planes_m[0]))]
        self._transfers = [transfer.to(self._device) for transfer in transfers]
        weights = plan.weights[0][:, None] * plan.colour_weights
        self._weights = weights.tolist()
        self._xyz_weights = torch.from_numpy(np.ascontiguousarray(weights)).float().to(self._device)
        self._ones = torch.ones(plan.grid.shape, device=self._device)
        self._wavelengths = wavelengths

    def __call__(self) -> torch.Tensor:
        """Compute the frame."""
        return self._all_wavelengths() if self._batched else self._one_by_one()

    def _one_by_one(self) -> torch.Tensor:
        xyz = torch.zeros(3, *self._ones.shape, device=self._device)
        for wavelength in self._wavelengths:
            field: torch.Tensor | None = None
            for path, transfers in zip(self._paths_nm, self._transfers, strict=True):
                phasor = torch.polar(self._ones, path * self._radians_per_nm[wavelength])
                field = phasor if field is None else field.mul_(phasor)
                field = torch.fft.ifft2(torch.fft.fft2(field).mul_(transfers[wavelength]))
            assert field is not None
            intensity = field.real.square().add_(field.imag.square())
            for channel in range(3):
                xyz[channel].add_(intensity, alpha=self._weights[wavelength][channel])
        return xyz

    def _all_wavelengths(self) -> torch.Tensor:
        radians_per_nm = torch.tensor(self._radians_per_nm, device=self._device)[:, None, None]
        field: torch.Tensor | None = None
        for path, transfers in zip(self._paths_nm, self._transfers, strict=True):
            phase = path * radians_per_nm
            phasor = torch.polar(torch.ones(1, device=self._device).expand_as(phase), phase)
            field = phasor if field is None else field.mul_(phasor)
            field = torch.fft.ifft2(torch.fft.fft2(field).mul_(transfers))
        assert field is not None
        intensity = field.real.square().add_(field.imag.square())
        return torch.einsum("wyx,wc->cyx", intensity, self._xyz_weights)


def check_simple_bench(plan: Plan) -> None:
    """Raises ValueError for a bench with padding, tilted light, several frames or several sources."""
    is_padded = plan.grid.padded != plan.grid.shape
    if is_padded or plan.slopes.any() or plan.weights.shape[0] > 1 or len(plan.slopes) > 1:
        raise ValueError("expected a periodic grid, one frame and one source on the axis")


def _transfer_functions(plan: Plan, inputs: FrameInputs, relay: int, distance_m: float) -> torch.Tensor:
    """Transfer function × pupil of a relay, (wavelength, y, x) complex64."""
    cpu = torch.device("cpu")
    return torch.stack(
        [
            relay_transfer_function(
                plan.transfer(relay, w, distance_m), plan.grid, inputs.pupils[relay][w], torch.complex64, cpu
            )
            for w in range(len(plan.system.wavelengths_m))
        ]
    )


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Use `count` threads of PyTorch inside the block."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
