"""System → Plan: every number that an executor needs, derived once in float64.

Neither executor derives physics itself, so they can't disagree about it, only about arithmetic.

Symbols: λ wavelength, dx simulation pitch, N field samples, P padded samples, k signed frequency index, df = 1/(P·dx),
A = (λ·df_y·k_y)² + (λ·df_x·k_x)² = |λu|² the squared direction sine. Phases are in turns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from holoview.colour import observer_weights
from holoview.model.bench_parts import Relay, Sampling
from holoview.model.effects.active_effects import ActiveEffects
from holoview.model.system import PLANE_DISTANCES, System
from holoview.numerics.fft_grid import frequency_indices, is_fast_length, next_fast_length
from holoview.util.errors import UserError

RowsColumns = tuple[int, int]

_COMPACT_GUARD = 16  # samples beyond the geometric walk-off, for the tails of the band-limited kernel


@dataclass(frozen=True)
class Grid:
    """The simulated field of `shape` (y, x) samples, and where it lies in the `padded` grid that is transformed."""

    shape: RowsColumns
    padded: RowsColumns
    offset: RowsColumns
    pitch_m: float
    upsample: int

    @property
    def inside(self) -> tuple[slice, slice]:
        """Slices that cut the field out of the padded grid."""
        (oy, ox), (ny, nx) = self.offset, self.shape
        return slice(oy, oy + ny), slice(ox, ox + nx)

    @property
    def frequency_step(self) -> tuple[float, float]:
        """Distance between spatial frequencies (y, x), 1/m."""
        return 1.0 / (self.padded[0] * self.pitch_m), 1.0 / (self.padded[1] * self.pitch_m)


@dataclass(frozen=True)
class Transfer:
    """Free-space propagation of one wavelength over one distance, with what the relay's stops let through.

    H = exp(−2πi·(z/λ)·A/(1+√(1−A))) where the support passes, 0 elsewhere; the carrier exp(2πi·z/λ) is dropped.

    support: (P_y, 2) int32, for each row of frequencies (`fftfreq` order) the smallest and largest |k_x| that passes;
    the largest is −1 where nothing does.
    """

    distance_m: float
    wavelength_m: float
    step: tuple[float, float]
    support: NDArray[np.int32]

    @property
    def waves(self) -> float:
        """Distance in wavelengths, z/λ."""
        return self.distance_m / self.wavelength_m

    @property
    def sine_step(self) -> tuple[float, float]:
        """Direction sine between neighbouring frequencies (y, x): λ·df."""
        return self.wavelength_m * self.step[0], self.wavelength_m * self.step[1]

    def paraxial_words(self) -> NDArray[np.uint32]:
        """(2, 2) words [axis y/x][high, low] of frac(z·λ/2·df²) in fixed point: 32 bits of a turn and 16 guard bits.

        k² times this, in wrapping 32-bit arithmetic, is the paraxial phase modulo one turn exactly: float32 alone loses
        it, since z·λ/2·df²·k² reaches hundreds of turns.
        """
        return np.stack(
            [turns_to_fixed_point(0.5 * self.distance_m * self.wavelength_m * step * step) for step in self.step]
        )


@dataclass(frozen=True)
class Plan:
    """Derived numbers of a system for a choice of focal planes.

    system: the bench with its effects on distances, angles, wavelengths, apertures and powers; nominal: as described.
    moments: factors of the optical paths that each exposure averages over; frame f·M + m of `system` is moment m of
    the drive's frame f.
    weights (frame, wavelength): what multiplies |field|²: amplitude / (frames × sources).
    slopes (source, wavelength, 2): phase slope of the illumination (y, x), turns a sample.
    colour_weights (wavelength, 3): XYZ of unit intensity.
    """

    system: System
    planes_m: NDArray[np.float64]
    grid: Grid
    weights: NDArray[np.float64]
    slopes: NDArray[np.float64]
    colour_weights: NDArray[np.float64]
    nominal: System
    moments: tuple[float, ...] = (1.0,)
    _transfers: dict[tuple[float, int, int], Transfer] = field(default_factory=dict, repr=False, compare=False)

    @property
    def relays(self) -> tuple[Relay, Relay]:
        """What lies behind the first modulator of two, and behind the last."""
        return self.system.relay1, self.system.relay2

    def transfer(self, relay: int, wavelength: int, distance_m: float) -> Transfer:
        """Propagation through relay 0 (the gap) or 1 (to a plane) at the wavelength of that index, derived once."""
        key = (distance_m, relay, wavelength)
        if key not in self._transfers:
            λ = float(self.system.wavelengths_m[wavelength])
            support = _passband_rows(self.grid, self.relays[relay], λ, distance_m, self.system.sampling.propagation)
            self._transfers[key] = Transfer(distance_m, λ, self.grid.frequency_step, support)
        return self._transfers[key]

    def lit(self, wavelength: int) -> list[int]:
        """Frames in which the laser of that index is on."""
        return [int(frame) for frame in np.flatnonzero(self.weights[:, wavelength])]


def make_plan(system: System, planes: Sequence[float | str] | NDArray[np.float64] | None = None) -> Plan:
    """The plan of a system at `planes` (SI numbers or people's text; the system's own when None).

    Raises UserError for a plane behind the modulator.
    """
    nominal: System = system
    moments: tuple[float, ...] = (1.0,)
    planes_m = system.planes_m if planes is None else parse_planes(planes)
    if system.effects:
        system, moments = _as_built(system.edit({"planes": planes_m}))
        planes_m = system.planes_m
    sources = len(system.source.directions_rad)
    return Plan(
        system=system,
        planes_m=planes_m,
        grid=_grid(system, float(planes_m.max())),
        weights=system.amplitudes / (system.frames * sources),
        slopes=_slopes(system),
        colour_weights=observer_weights(system.observer, system.wavelengths_m),
        nominal=nominal,
        moments=moments,
    )


def _as_built(system: System) -> tuple[System, tuple[float, ...]]:
    """The bench with its effects, and the moments of an exposure."""
    switched = ActiveEffects(system.effect_values)
    return switched.as_built(system), tuple(factor for _, factor in switched.exposure_samples())


def turns_to_fixed_point(turns: float) -> NDArray[np.uint32]:
    """A phase modulo one turn in fixed point: [the high 32 bits, 16 guard bits]."""
    scaled = round(math.fmod(turns, 1.0) * 2.0**48) % (1 << 48)
    return np.array([scaled >> 16, scaled & 0xFFFF], dtype=np.uint32)


def walk_off(system: System, relay: Relay, distance_m: float) -> float:
    """How far (samples) the steepest ray of the sampled spectrum moves sideways over `distance_m`."""
    dx = system.modulators[0].pitch_m / system.sampling.upsample
    longest = float(system.wavelengths_m.max())
    sine = min(longest / (2 * dx), 1.0 if relay.iris_na is None else relay.iris_na, 0.999)
    return distance_m * sine / math.sqrt(1 - sine * sine) / dx


def band_limit(padded: int, pitch_m: float, wavelength_m: float, distance_m: float) -> float:
    """Highest spatial frequency (1/m) whose transfer function is sampled without aliasing.

    Matsushima & Shimobaba, Opt. Express 17, 19662 (2009), eq. 13: 1/(λ·√((2·Δu·z)² + 1)) with Δu = 1/(P·dx).
    """
    return 1.0 / (wavelength_m * math.hypot(2 * distance_m / (padded * pitch_m), 1.0))


def parse_planes(planes: Sequence[float | str] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Distances of planes, m. Raises UserError for an empty list, and for one behind the modulator."""
    read = PLANE_DISTANCES.parse(planes, "planes")
    if read is None or len(read) == 0:
        raise UserError("planes", "an empty list", expected="at least one distance")
    return read


def _grid(system: System, farthest_m: float) -> Grid:
    sampling, upsample = system.sampling, system.sampling.upsample
    rows, columns = system.modulators[0].shape
    shape = (rows * upsample, columns * upsample)
    reach = max(walk_off(system, system.relay2, farthest_m), walk_off(system, system.relay1, system.gap_m or 0.0))
    padded = tuple(_padded(n, sampling, reach) for n in shape)
    offset = tuple((p - n) // (2 * upsample) * upsample for p, n in zip(padded, shape, strict=True))
    pitch_m = system.modulators[0].pitch_m / upsample
    return Grid(shape, (padded[0], padded[1]), (offset[0], offset[1]), pitch_m, upsample)


def _padded(n: int, sampling: Sampling, reach: float) -> int:
    whole = _largest_fast_divisor(sampling.upsample)
    if sampling.propagation == "periodic":
        return n if is_fast_length(n) else next_fast_length(n, whole)
    if sampling.propagation == "linear":
        return next_fast_length(sampling.padding * n, whole)
    return next_fast_length(min(2 * n, n + math.ceil(reach) + _COMPACT_GUARD), whole)


def _largest_fast_divisor(upsample: int) -> int:
    """The largest divisor of `upsample` that a good size can have."""
    return max(d for d in range(1, upsample + 1) if upsample % d == 0 and next_fast_length(d) == d)


def _slopes(system: System) -> NDArray[np.float64]:
    """Phase slope (source, wavelength, 2) in turns a sample: sin(angle)·dx/λ."""
    dx = system.modulators[0].pitch_m / system.sampling.upsample
    angles = np.repeat(system.source.directions_rad[:, None], len(system.wavelengths_m), axis=1)
    if system.source.tilts_rad is not None:
        angles = angles + system.source.tilts_rad[None]
    return np.sin(angles) * dx / system.wavelengths_m[None, :, None]


def _passband_rows(grid: Grid, relay: Relay, λ: float, distance_m: float, propagation: str) -> NDArray[np.int32]:
    """Rows of (smallest, largest) |k_x|: propagating waves inside the band limit and the iris, outside the DC block."""
    (py, px), (dfy, dfx) = grid.padded, grid.frequency_step
    ky = np.abs(frequency_indices(py))
    reachable = np.arange(px // 2 + 1)
    sine_y2, sine_x2 = (λ * dfy * ky) ** 2, (λ * dfx * reachable) ** 2
    largest = np.searchsorted(sine_x2, 1.0 - sine_y2, side="left") - 1  # A < 1: evanescent waves are lost
    if relay.iris_na is not None:
        largest = np.minimum(largest, np.searchsorted(sine_x2, relay.iris_na**2 - sine_y2, side="right") - 1)
    if propagation != "periodic":
        limit_y, limit_x = (band_limit(p, grid.pitch_m, λ, distance_m) for p in (py, px))
        largest = np.where(ky * dfy <= limit_y, np.minimum(largest, math.floor(limit_x / dfx)), -1)
    smallest = np.zeros_like(largest)
    if relay.dc_block_na is not None:
        smallest = np.searchsorted(sine_x2, relay.dc_block_na**2 - sine_y2, side="right")
    return np.stack([smallest, largest], axis=1).astype(np.int32)
