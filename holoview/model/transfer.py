"""The propagation of one wavelength over one distance, as numbers in float64 from which both executors evaluate it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Transfer:
    """Propagation of one wavelength over one distance, and the frequencies that pass the relay's stops.

    H = exp(−2πi·[(z/λ)·A/(1 + √(1 − A)) + u·d]) where the support passes, 0 elsewhere; without carrier, exp(2πi·z/λ).
    Goodman, Introduction to Fourier Optics, 3rd ed., eq. 3-74, in a form without cancellation at small A.

    distance_m: z.
    wavelength_m: λ.
    step: distance between spatial frequencies (y, x), 1/m.
    support: (P_y, 3) int32, for each row of frequencies in `fftfreq` order the smallest |k_x|, the lowest k_x and the
    highest k_x that pass; the lowest lies above the highest where nothing passes.
    shift_m: displacement d of the picture (y, x).
    """

    distance_m: float
    wavelength_m: float
    step: tuple[float, float]
    support: NDArray[np.int32]
    shift_m: tuple[float, float] = (0.0, 0.0)

    @property
    def waves(self) -> float:
        """Distance in wavelengths, z/λ."""
        return self.distance_m / self.wavelength_m

    @property
    def sine_step(self) -> tuple[float, float]:
        """Direction sine between neighbouring frequencies (y, x): λ·df."""
        return self.wavelength_m * self.step[0], self.wavelength_m * self.step[1]

    @property
    def shift_turns(self) -> tuple[float, float]:
        """Phase of the displacement between neighbouring frequencies (y, x), turns."""
        return self.step[0] * self.shift_m[0], self.step[1] * self.shift_m[1]

    def has_stops_of(self, other: Transfer) -> bool:
        """Whether the same frequencies pass as in another transfer, with the same displacement."""
        return self.shift_m == other.shift_m and np.array_equal(self.support, other.support)

    def paraxial_words(self) -> NDArray[np.uint32]:
        """The paraxial phase at k = 1, frac(z·λ/2·df²) turns, in fixed point: (2, 2) uint32 [axis y/x][high, low].

        The high word holds 32 bits of a turn, the low one 16 guard bits. Multiplied by k² in wrapping 32-bit
        arithmetic it is the paraxial phase modulo one turn exactly, which float32 can't hold: z·λ/2·df²·k² reaches
        hundreds of turns.
        """
        return np.stack(
            [turns_to_fixed_point(0.5 * self.distance_m * self.wavelength_m * step * step) for step in self.step]
        )


def turns_to_fixed_point(turns: float) -> NDArray[np.uint32]:
    """A phase in turns, modulo one turn, in fixed point: uint32 [high 32 bits, 16 guard bits]."""
    scaled = round(math.fmod(turns, 1.0) * 2.0**48) % (1 << 48)
    return np.array([scaled >> 16, scaled & 0xFFFF], dtype=np.uint32)
