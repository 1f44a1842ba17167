"""The propagation of one wavelength over one distance, as numbers in float64 from which both executors evaluate it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.model.passband import RowsColumns, band_limit
from holoview.util import units
from holoview.util.errors import UserError


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


# --- light beyond the band limit --------------------------------------------------------------------------------------


def frequencies_left(padded: RowsColumns, pitch_m: float, wavelength_m: float, distance_m: float) -> float:
    """How many frequencies beside zero the band limit leaves on each side of an axis, the larger of the two axes.

    padded, pitch_m: samples (y, x) of the grid and their distance. Below 1, only light that goes straight on is left,
    and the picture is uniform. Where 2z is large beside the side P·dx of the grid it is (P·dx)²/(2λz).
    """
    return max(n * pitch_m * band_limit(n, pitch_m, wavelength_m, distance_m) for n in padded)


def nothing_left(padded: RowsColumns, pitch_m: float, distance_m: float) -> str:
    """The words which say that a grid holds nothing of the light at a distance."""
    return (
        f"at {units.format_rounded(distance_m, 'mm')}, of which the grid of {padded[1]} x {padded[0]} samples of "
        f"{units.format_rounded(pitch_m, 'um')} holds nothing but light that goes straight on"
    )


def check_eye_sampled(padded: RowsColumns, pitch_m: float, wavelength_m: float, distance_m: float) -> None:
    """Raises UserError if an eye is focused so far away that the band limit leaves only light that goes straight on.

    wavelength_m: the longest one. distance_m: the largest one of all wavelengths.
    """
    if frequencies_left(padded, pitch_m, wavelength_m, distance_m) >= 1.0:
        return
    raise UserError(
        "eye",
        f"it sees a plane {nothing_left(padded, pitch_m, distance_m)}",
        expected="a plane within the band limit",
        remedy="change eye.accommodation, eye.infinity or eye.eyepiece, or raise padding",
    )
