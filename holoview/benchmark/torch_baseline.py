"""A frame as the fastest loops in PyTorch, with which the shaders are compared.

`TorchBaseline` has every advantage that a program for one fixed bench can have: transfer functions are computed in
advance, in float64, for all wavelengths; fields are complex64 and modified in place; the grid is periodic; there are
one on-axis source and one frame. `PrunedTorchBaseline` computes, moreover, only what stops of the first order pass.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

import numpy as np
import torch

from holoview.model.plan import Plan
from holoview.numerics.resample import upsample_nearest
from holoview.numerics.sampling import frequency_indices
from holoview.optics.bench import relay_response
from holoview.optics.frame_inputs import FrameInputs
from holoview.optics.slm import pixel_spectrum


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
    ky, kx = (torch.from_numpy(frequency_indices(n)) for n in plan.grid.padded)
    return torch.stack(
        [
            relay_response(plan.transfer(relay, w, distance_m), ky, kx, inputs.pupils[relay][w], torch.complex64)
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


# --- only what stops of the first order pass ---
#
# With u samples along a side of a pixel, P/u frequencies along an axis pass at most, so that transforms have P/u points
# at most. Two ways of computing the samples of a field are offered, since which one is faster depends on the processor:
#
#     pixel parts   the u × u samples of a pixel one after the other: sample (r, s) of all pixels is an inverse FFT of
#                   P/u points of the spectrum times exp(2πi·(k_y·r + k_x·s)/P), which the transfer function includes
#     lines         only the columns of the band are transformed along y, and only their zero-padded rows along x


Way = Literal["pixel parts", "lines"]
WAYS: tuple[Way, ...] = ("pixel parts", "lines")


def can_prune(plan: Plan) -> bool:
    """Whether the stops of a bench with two modulators pass at most P/u frequencies along either axis."""
    u = plan.grid.upsample
    narrow = [
        -padded // (2 * u) <= low and high < padded / (2 * u)
        for relay in (0, 1)
        for padded, low, high in zip(plan.grid.padded, plan.band(relay).lowest, plan.band(relay).highest, strict=True)
    ]
    is_even = all(padded % (2 * u) == 0 for padded in plan.grid.padded)
    return plan.system.gap_m is not None and u > 1 and is_even and all(narrow)


class PrunedTorchBaseline:
    """Computes XYZ of one plane, (3, y, x) float32, in PyTorch.

    Raises ValueError as `TorchBaseline` does, and for a bench for which `can_prune` is False.
    """

    def __init__(self, plan: Plan, inputs: FrameInputs, way: Way) -> None:
        check_simple_bench(plan)
        if not can_prune(plan):
            raise ValueError("expected two modulators and stops within the first order in both relays")
        self._plan, self._way, u = plan, way, plan.grid.upsample
        self._upsample, self._pixels = u, (plan.grid.padded[0] // u, plan.grid.padded[1] // u)
        self._paths_nm = [opd.float() * 1e9 for opd in inputs.opd_m[0]]
        self._radians_per_nm = [2 * math.pi / (float(λ) * 1e9) for λ in plan.system.wavelengths_m]
        self._weights = (plan.weights[0][:, None] * plan.colour_weights).tolist()
        self._ones = torch.ones(self._pixels)
        ky, kx = (torch.from_numpy(frequency_indices(n)) for n in self._pixels)
        parts = self._part_phasors(ky, kx)
        gap_m, plane_m = plan.system.gap_m, float(plan.planes_m[0])
        assert gap_m is not None
        self._first, self._last = [], []
        for wavelength in range(len(plan.system.wavelengths_m)):
            self._first.append(self._transfer(inputs, 0, wavelength, gap_m, ky, kx) * self._one_pixel(ky, kx))
            self._last.append(self._transfer(inputs, 1, wavelength, plane_m, ky, kx))
        if way == "pixel parts":
            scale = 1 / u**2  # of an inverse FFT of P points
            self._first = [(h * parts * scale).to(torch.complex64) for h in self._first]
            self._last = [(h * parts * scale).to(torch.complex64) for h in self._last]
            self._gather = parts.conj().to(torch.complex64)
        else:
            self._first, self._last = ([h.to(torch.complex64) for h in group] for group in (self._first, self._last))
            self._columns = torch.zeros(plan.grid.padded[0], self._pixels[1], dtype=torch.complex64)
            self._rows = torch.zeros(plan.grid.padded, dtype=torch.complex64)

    def __call__(self) -> torch.Tensor:
        """Compute the frame."""
        by_parts = self._way == "pixel parts"
        u, shape = self._upsample, self._plan.grid.padded
        xyz = torch.zeros(3, *((u * u, *self._pixels) if by_parts else shape))
        for wavelength, weights in enumerate(self._weights):
            first, second = (
                torch.polar(self._ones, path * self._radians_per_nm[wavelength]) for path in self._paths_nm
            )
            spectrum, transfers = torch.fft.fft2(first), (self._first[wavelength], self._last[wavelength])
            field = (
                self._by_parts(spectrum, second, *transfers)
                if by_parts
                else self._by_lines(spectrum, second, *transfers)
            )
            intensity = field.real.square().add_(field.imag.square())
            for channel in range(3):
                xyz[channel].add_(intensity, alpha=weights[channel])
        if not by_parts:
            return xyz
        return xyz.view(3, u, u, *self._pixels).permute(0, 3, 1, 4, 2).reshape(3, *shape)

    def _by_parts(
        self, spectrum: torch.Tensor, second: torch.Tensor, gap: torch.Tensor, last: torch.Tensor
    ) -> torch.Tensor:
        """The samples of the field at the plane, (u·u, P_y/u, P_x/u)."""
        behind_gap = torch.fft.ifft2(gap * spectrum).mul_(second)
        return torch.fft.ifft2(last * torch.fft.fft2(behind_gap).mul_(self._gather).sum(dim=0))

    def _by_lines(
        self, spectrum: torch.Tensor, second: torch.Tensor, gap: torch.Tensor, last: torch.Tensor
    ) -> torch.Tensor:
        """The samples of the field at the plane, (P_y, P_x)."""
        (rows, columns), u = self._pixels, self._upsample
        field = self._field(spectrum.mul_(gap))
        field.view(rows, u, columns, u).mul_(second[:, None, :, None])
        along_x = torch.fft.fft(field, dim=1)
        along_x = torch.cat([along_x[:, : columns // 2], along_x[:, -(columns // 2) :]], dim=1)
        along_y = torch.fft.fft(along_x, dim=0)
        return self._field(torch.cat([along_y[: rows // 2], along_y[-(rows // 2) :]]).mul_(last))

    def _field(self, spectrum: torch.Tensor) -> torch.Tensor:
        """The field of a spectrum of P/u rows and columns; it overwrites the padded copies of the one before."""
        for padded, narrow, dim in ((self._columns, spectrum, 0), (self._rows, None, 1)):
            given = torch.fft.ifft(self._columns, dim=0) if narrow is None else narrow
            half = self._pixels[dim] // 2
            padded.narrow(dim, 0, half).copy_(given.narrow(dim, 0, half))
            padded.narrow(dim, padded.shape[dim] - half, half).copy_(given.narrow(dim, half, half))
        return torch.fft.ifft(self._rows, dim=1)

    def _transfer(
        self,
        inputs: FrameInputs,
        relay: int,
        wavelength: int,
        distance_m: float,
        ky: torch.Tensor,
        kx: torch.Tensor,
    ) -> torch.Tensor:
        """Transfer function × pupil, (P_y/u, P_x/u) complex128."""
        transfer = self._plan.transfer(relay, wavelength, distance_m)
        return relay_response(transfer, ky, kx, inputs.pupils[relay][wavelength], torch.complex128)

    def _one_pixel(self, ky: torch.Tensor, kx: torch.Tensor) -> torch.Tensor:
        y, x = (pixel_spectrum(n, self._upsample, 0.0) for n in self._plan.grid.padded)
        return y[ky][:, None] * x[kx]

    def _part_phasors(self, ky: torch.Tensor, kx: torch.Tensor) -> torch.Tensor:
        """exp(2πi·(k_y·r + k_x·s)/P) of sample (r, s) of a pixel, (u·u, P_y/u, P_x/u) complex128."""
        (rows, columns), u = self._plan.grid.padded, self._upsample
        turns = [ky[:, None] * (r / rows) + kx * (s / columns) for r, s in np.ndindex(u, u)]
        return torch.exp(2j * math.pi * torch.stack(turns))
