"""Prints how far fields at a distance are from float64 references: the table in docs/physics-evidence.md.

    python benchmarks/propagation_precision.py

A Gaussian beam (waist 0.8 mm, 1024 × 1024 samples of 8 µm, 473 nm) against its closed form; and a field that fills its
48 × 48 samples of 4 µm with random phases, up to its edges and in every direction that the samples hold, against
Rayleigh and Sommerfeld's integral over its samples as points.
"""

from __future__ import annotations

import math

import numpy as np

from holoview.holograms.fields.propagation import Method, propagate_field
from holoview.holograms.fields.wavefield import Wavefield
from holoview.light.numerics.sampling import positions
from holoview.light.optics.free_space import SampleWindow
from holoview.util import units
from holoview.util.errors import UserError

DISTANCES_M = (1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3, 1.0, 2.0)
WAVELENGTH_M, WAIST_M = 473e-9, 0.8e-3


def _wavefield(values: np.ndarray, pitch_m: float) -> Wavefield:
    return Wavefield(values.astype(np.complex64)[None, None], (pitch_m, pitch_m), np.array([WAVELENGTH_M]))


def _beam(x: np.ndarray, distance_m: float) -> np.ndarray:
    q = 1 + 1j * distance_m * WAVELENGTH_M / (math.pi * WAIST_M**2)
    return np.exp(-(x[:, None] ** 2 + x[None, :] ** 2) / (WAIST_M**2 * q)) / q


def _direct_sum(values: np.ndarray, pitch_m: float, window: SampleWindow, distance_m: float) -> np.ndarray:
    y, x = (positions(n, pitch_m) for n in values.shape)
    found = np.empty(window.shape, complex)
    for row, column in np.ndindex(window.shape):
        squared = (window.positions_m(0)[row] - y[:, None]) ** 2 + (window.positions_m(1)[column] - x[None, :]) ** 2
        r = np.sqrt(squared + distance_m**2)
        phase = 2 * math.pi / WAVELENGTH_M * squared / (r + distance_m)
        h = distance_m / r**2 * (1 / (2 * math.pi * r) - 1j / WAVELENGTH_M) * np.exp(1j * phase)
        found[row, column] = (values * h).sum() * pitch_m**2
    return found


def _error(field: Wavefield, distance_m: float, method: Method, window: SampleWindow, expected: np.ndarray) -> str:
    """Relative L2 error, and the largest error of the phase where the intensity is above a thousandth of its peak."""
    try:
        found = propagate_field(field, distance_m, method, window).values[0, 0].numpy()
    except UserError:
        return "refused"
    bright = np.abs(expected) ** 2 > 1e-3 * (np.abs(expected) ** 2).max()
    phase = np.abs(np.angle(found[bright] / expected[bright])).max()
    return f"{np.linalg.norm(found - expected) / np.linalg.norm(expected):.1e}, {phase:.1e} rad"


def main() -> None:
    """Prints the table."""
    side = SampleWindow((1024, 1024), (8e-6, 8e-6))
    beam = _wavefield(_beam(side.positions_m(0), 0.0), 8e-6)
    values = np.exp(2j * math.pi * np.random.default_rng(0).random((48, 48)))
    hard, small = _wavefield(values, 4e-6), SampleWindow((16, 16), (12e-6, 12e-6))
    print(
        "| distance | beam, asm | beam, fresnel | hard edges, asm | hard edges, fresnel |", "| --- " * 5 + "|", sep="\n"
    )
    for distance_m in DISTANCES_M:
        expected, direct = _beam(side.positions_m(0), distance_m), _direct_sum(values, 4e-6, small, distance_m)
        cells = [_error(beam, distance_m, method, side, expected) for method in ("asm", "fresnel")]
        cells += [_error(hard, distance_m, method, small, direct) for method in ("asm", "fresnel")]
        print(f"| {units.format_rounded(distance_m, 'mm')} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
