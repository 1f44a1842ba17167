"""The elements of a chain in torch: what each multiplies light by, sample by sample, and the kernel of a Fourier plane.

A Fourier element of focal length f is a sum over the samples, at samples of the same pitch dx, α = dx²/(λf):

    u(k) ▸ −i·α·Σ_j u(j)·exp(−2πi·α_y·j_y·k_y − 2πi·α_x·j_x·k_x)

By 2jk = j² + k² − (k − j)² it is a chirp, a convolution with one, which FFTs of the padded grid compute, and a chirp
(Rabiner, Schafer and Rader, Bell Syst. Tech. J. 48, 1249 (1969)), so that executors need no stage of their own for it.
"""

from __future__ import annotations

from typing import Any

import torch

from holoview.light.model.chain import pixel_shape
from holoview.light.model.elements import (
    AmplitudeModulator,
    ComplexModulator,
    Element,
    Fourier,
    Lens,
    Mask,
    PhaseModulator,
    Pixels,
)
from holoview.light.model.masks import mask_values
from holoview.light.model.plan import Grid, Plan
from holoview.light.numerics.fourier import phasor_of_turns
from holoview.light.numerics.resample import centred_indices, upsample_nearest
from holoview.light.optics.slm import nearest_level, phasor

Tensor = torch.Tensor


class ChainTransmissions:
    """What the elements of a chain multiply light by. drives: patterns (frame, y, x) by the names of elements."""

    def __init__(self, plan: Plan, drives: dict[str, Any]) -> None:
        self._plan, self._drives = plan, drives
        names = zip(plan.system.elements, plan.system.element_names, strict=True)
        self._names = {id(element): name for element, name in names}
        self._static: dict[tuple[int, int], Tensor] = {}

    def show(self, drives: dict[str, Any]) -> None:
        """Takes other patterns from now on."""
        self._drives = drives

    def is_sampled(self, number: int) -> bool:
        """Always."""
        return True

    def sampled_transmission(self, frame: int, number: int, wavelength: int) -> Tensor:
        """The transmission (y, x) complex128 of the samples at a step of the way."""
        of = self._plan.way.transmissions[number]
        if isinstance(of.element, Pixels) and of.element.is_driven:
            drive = self._drive(of.element)
            return self.driven(of.element, drive[frame if len(drive) > 1 else 0], wavelength)
        key = (number, wavelength)
        if key not in self._static:
            self._static[key] = self._of_static(of.element, of.place, wavelength)
        return self._static[key]

    def driven(self, element: Pixels, drive: Tensor, wavelength: int) -> Tensor:
        """The transmission (y, x) of the samples of an element that shows a pattern (rows, columns)."""
        pixels = pixel_transmission(element, drive, float(self._plan.system.wavelengths_m[wavelength]))
        return placed(self._plan, element, pixels)

    def _drive(self, element: Element) -> Tensor:
        drive = self._drives[self._names[id(element)]]
        return drive if isinstance(drive, Tensor) else torch.from_numpy(drive.copy())

    def _of_static(self, element: Element, place: str, wavelength: int) -> Tensor:
        λ, grid = float(self._plan.system.wavelengths_m[wavelength]), self._plan.grid
        if isinstance(element, Mask):
            return placed(self._plan, element, mask_transmission(element, λ))
        if isinstance(element, Lens):
            return _quadratic(grid, grid.pitch_m**2 / (λ * element.focal_length_m))
        assert isinstance(element, Fourier)
        rate = grid.pitch_m**2 / (λ * element.focal_length_m)
        chirp = _quadratic(grid, rate)
        return chirp if place == "before" else -1j * rate * chirp


def pixel_transmission(element: Pixels, drive: Tensor, wavelength_m: float) -> Tensor:
    """The transmission (rows, columns) complex128 of a modulator's pixels for its drive."""
    if isinstance(element, PhaseModulator):
        path_m = nearest_level(drive.double(), element) * element.stroke_m
        return phasor(path_m, wavelength_m, torch.complex128)
    if isinstance(element, AmplitudeModulator):
        return nearest_level(drive.double(), element).to(torch.complex128)
    assert isinstance(element, ComplexModulator)
    values = drive.to(torch.complex128)
    if element.stroke_m is None:
        return values
    turns = torch.remainder(torch.angle(values) / (2 * torch.pi), 1.0)
    return values.abs() * phasor_of_turns(turns * (element.stroke_m / wavelength_m))


def mask_transmission(mask: Mask, wavelength_m: float) -> Tensor:
    """The transmission (rows, columns) complex128 of a mask."""
    values = mask_values(mask)
    transmission = torch.ones(values.shape, dtype=torch.complex128)
    if values.amplitude is not None:
        transmission = transmission * torch.from_numpy(values.amplitude)
    if values.path_m is not None:
        transmission = transmission * phasor(torch.from_numpy(values.path_m), wavelength_m, torch.complex128)
    return transmission


def placed(plan: Plan, element: Pixels, pixels: Tensor) -> Tensor:
    """The pixels (rows, columns) of an element at the samples (y, x) of the field, which are 0 beside it."""
    grid, size = plan.grid, round(element.pitch_m / plan.grid.pitch_m)
    samples = pixels if size == 1 else upsample_nearest(pixels, size)
    shape = pixel_shape(element)
    starts = [
        round((n - m * size) / 2 + off / grid.pitch_m)
        for n, m, off in zip(grid.shape, shape, element.offset_m, strict=True)
    ]
    if samples.shape == grid.shape:
        return samples
    edges = [starts[1], grid.shape[1] - starts[1] - samples.shape[1]]
    edges += [starts[0], grid.shape[0] - starts[0] - samples.shape[0]]
    return torch.nn.functional.pad(samples, edges)


def _quadratic(grid: Grid, rate: float) -> Tensor:
    """exp(−iπ·rate·(j_y² + j_x²)) (y, x) complex128 at the samples, counted from the middle of the field."""
    y, x = (
        phasor_of_turns(-0.5 * rate * centred_indices(n, torch.float64, torch.device("cpu")).square())
        for n in grid.shape
    )
    return y[:, None] * x[None, :]


def fourier_kernel(plan: Plan, element: Fourier, wavelength: int) -> Tensor:
    """The spectrum (P_y, P_x) complex128 of exp(iπα·d²) for lags |d| < N, in `fftfreq` order."""
    grid, λ = plan.grid, float(plan.system.wavelengths_m[wavelength])
    rate, lines = grid.pitch_m**2 / (λ * element.focal_length_m), []
    for n, padded in zip(grid.shape, grid.padded, strict=True):
        lags = torch.arange(padded, dtype=torch.float64)
        lags = torch.minimum(lags, padded - lags)
        chirp = phasor_of_turns(0.5 * rate * lags.square())
        lines.append(torch.fft.fft(torch.where(lags < n, chirp, torch.zeros_like(chirp))))
    return lines[0][:, None] * lines[1][None, :]
