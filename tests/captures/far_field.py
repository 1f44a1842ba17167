"""Pictures of a Fourier bench with large faults, by numpy's own sum over the modulator's pixels; shares no code with
the product: a disc of light with coma, a wrong stroke, stray light, shot noise, 8 bits and a saturated zero order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

PITCH_M, CAMERA_PITCH_M, WAVELENGTH_M = 36e-6, 12e-6, 532e-9


@dataclass(frozen=True)
class FarField:
    """The faults. radius: of the disc, pixels. coma, defocus: rad at its edge. axis: (y, x) of the zero order, px.
    unmodulated: amplitude of light beside the modulated one."""

    radius: float = 40.0
    coma: float = -2.0
    defocus: float = 0.8
    stroke: float = 0.6
    unmodulated: complex = 0.0
    focal_length_m: float = 0.25
    axis: tuple[float, float] = (118.0, 163.0)
    shape: tuple[int, int] = (240, 320)


def spread_pattern(seed: int, shape: tuple[int, int] = (96, 128)) -> NDArray[np.uint8]:
    """A pattern whose spectrum fills a few soft-edged blobs away from the axis: Gerchberg & Saxton's, in 20 steps."""
    rng = np.random.default_rng(seed)
    y, x = (np.fft.fftfreq(n)[:, None] if axis == 0 else np.fft.fftfreq(n) for axis, n in enumerate(shape))
    target = sum(
        np.exp(-((y - cy) ** 2 + (x - cx) ** 2) / 0.06**2)
        for cy, cx in ((-0.2, 0.22), (0.22, 0.15), (0.1, -0.25), (-0.12, -0.12))
    )
    field = np.fft.ifft2(np.sqrt(target) * np.exp(2j * np.pi * rng.random(shape)))
    for _ in range(20):
        spectrum = np.fft.fft2(np.exp(1j * np.angle(field)))
        field = np.fft.ifft2(np.sqrt(target) * np.exp(1j * np.angle(spectrum)))
    return np.round(np.angle(field) / (2 * np.pi) % 1 * 255).astype(np.uint8)


def photograph(pattern: NDArray[np.uint8], bench: FarField, seed: int) -> NDArray[np.uint8]:
    """The camera's picture (y, x), 8 bits."""
    rng = np.random.default_rng(seed)
    v, u = (np.arange(n) - (n - 1) / 2 for n in pattern.shape)
    y, x = v[:, None] / bench.radius, u / bench.radius
    square = y**2 + x**2
    phase = bench.coma * (3 * square - 2) * x + bench.defocus * (2 * square - 1)
    share = 1 - abs(bench.unmodulated)
    modulated = share * np.exp(2j * np.pi * bench.stroke * pattern / 255) + bench.unmodulated
    light = np.exp(-(square**4)) * np.exp(1j * phase) * modulated
    scale = WAVELENGTH_M * bench.focal_length_m / (PITCH_M * CAMERA_PITCH_M)  # camera pixels to a period
    ky, kx = ((np.arange(n) - at) / scale for n, at in zip(bench.shape, bench.axis, strict=True))
    waves = (
        np.exp(-2j * np.pi * ky[:, None] * v) * np.sinc(ky)[:, None],
        np.exp(-2j * np.pi * u[:, None] * kx) * np.sinc(kx),
    )
    intensity = np.abs(waves[0] @ light @ waves[1]) ** 2
    intensity *= 200 / np.quantile(intensity, 0.99)
    electrons = rng.poisson(np.minimum((intensity + 4) * 8, 1e5))  # stray light of 4 counts
    return np.clip(np.round(electrons / 8 + rng.normal(0, 1, bench.shape)), 0, 255).astype(np.uint8)
