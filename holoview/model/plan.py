"""Derives every number of a simulation (grid, transfer functions, weights, colours) from a System, in float64.

Both executors evaluate a `Plan` and derive no physics of their own, so that they can differ by rounding only.

Symbols: λ wavelength, dx simulation pitch, N field samples, P padded samples, k signed frequency index, df = 1/(P·dx)
frequency step, u spatial frequency, A = (λ·df_y·k_y)² + (λ·df_x·k_x)² = |λu|² squared direction sine. Phases are in
turns of 2π.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from holoview.colour import observer_weights
from holoview.model.bench_parts import Relay, Sampling
from holoview.model.effects.registry import ActiveEffects
from holoview.model.eye import Eye
from holoview.model.focus import eyes_at, focus_shift, focused_planes, parse_planes
from holoview.model.passband import (
    Band,
    Transfer,
    band_limit,
    band_of_rows,
    check_eye_sampled,
    rows_in_disc,
    stop_rows,
    stop_weights,
)
from holoview.model.system import System
from holoview.numerics.sampling import is_fast_length, next_fast_length

RowsColumns = tuple[int, int]

_COMPACT_MARGIN = 16  # samples beyond the geometric walk-off, for the tails of the band-limited kernel
_STEEPEST_SINE = 0.999  # at a sine of 1 the walk-off would be infinite


@dataclass(frozen=True)
class Grid:
    """The sampled field and the padded grid on which it is Fourier transformed.

    shape: (y, x) samples of the field, which covers the modulators.
    padded: (y, x) samples of the padded grid.
    offset: (y, x) index of the field's first sample in the padded grid.
    pitch_m: distance between samples.
    upsample: samples along each side of a modulator pixel.
    """

    shape: RowsColumns
    padded: RowsColumns
    offset: RowsColumns
    pitch_m: float
    upsample: int

    @property
    def inside(self) -> tuple[slice, slice]:
        """Slices (y, x) that cut the field out of the padded grid."""
        (oy, ox), (ny, nx) = self.offset, self.shape
        return slice(oy, oy + ny), slice(ox, ox + nx)

    @property
    def frequency_step(self) -> tuple[float, float]:
        """Distance between spatial frequencies (y, x), 1/m."""
        return 1.0 / (self.padded[0] * self.pitch_m), 1.0 / (self.padded[1] * self.pitch_m)


@dataclass(frozen=True)
class Plan:
    """The numbers that both executors use, derived from a system for a choice of focal planes. Made by `make_plan`.

    system: the system with the effects that change distances, angles, wavelengths, apertures and powers applied.
    planes_m: (plane,) distances of the focal planes, with effects. With an eye, those on which it is focused at its
    reference wavelength.
    grid: `Grid` of the field and of its padded transform.
    weights: (frame, wavelength) factors of |field|²: amplitude / (frames · sources).
    slopes: (source, wavelength, 2) phase slope (y, x) of the illumination, turns a sample.
    colour_weights: (wavelength, 3) XYZ of unit intensity.
    nominal: the system as it was given.
    focus_shift_m: (wavelength,) how much larger z is on which an eye is focused at each wavelength; 0 without an eye.
    eyes: (plane,) the eye that sees each plane, with its pupil at its place; empty without an eye.
    moments: M factors of the optical paths that each exposure averages over, (1.0,) without such effects. Frame
    f·M + m of `system` shows frame f of the drive with factor m.
    has_weighted_stops: whether frequencies on the edge of a relay's stop pass in part, as pupils say then.

    >>> import holoview as hv
    >>> plan = hv.make_plan(hv.load("holochrome-8").with_(shape=[48, 64]), ["5 mm"])
    >>> plan.grid.shape, plan.grid.padded, plan.weights.shape, plan.colour_weights.shape
    ((96, 128), (192, 256), (1, 8), (8, 3))
    """

    system: System
    planes_m: NDArray[np.float64]
    grid: Grid
    weights: NDArray[np.float64]
    slopes: NDArray[np.float64]
    colour_weights: NDArray[np.float64]
    nominal: System
    focus_shift_m: NDArray[np.float64]
    eyes: tuple[Eye, ...] = ()
    moments: tuple[float, ...] = (1.0,)
    has_weighted_stops: bool = False
    _transfers: dict[tuple[float, int, int, Eye | None], Transfer] = field(
        default_factory=dict, repr=False, compare=False
    )

    @property
    def distances_m(self) -> NDArray[np.float64]:
        """Distances from the last modulator that are computed, (plane, wavelength): without an eye equal along a row.

        >>> import holoview as hv
        >>> plan = hv.make_plan(hv.load("holochrome-8").with_(eye={"chromatic": False}), ["5 mm"])
        >>> plan.distances_m.shape, float(plan.distances_m.max())
        ((1, 8), 0.005)
        """
        distances: NDArray[np.float64] = self.planes_m[:, None] + self.focus_shift_m[None, :]
        return distances

    @property
    def relays(self) -> tuple[Relay, Relay]:
        """The relays between the modulators and behind the last one.

        >>> import holoview as hv
        >>> gap, last = hv.make_plan(hv.load("holochrome-8")).relays
        >>> gap.square == last.square
        True
        """
        return self.system.relay1, self.system.relay2

    def eye_at(self, plane: int) -> Eye | None:
        """The eye that sees the plane of an index; None without an eye.

        >>> import holoview as hv
        >>> hv.make_plan(hv.load("holochrome-8")).eye_at(0) is None
        True
        """
        return self.eyes[plane] if self.eyes else None

    def seen_from(self, places_m: Sequence[tuple[float, float]]) -> Plan:
        """The plan with its planes seen from other places of the eye's pupil.

        places_m: (y, x), as many as before, m. Raises UserError without an eye.

        >>> import holoview as hv
        >>> plan = hv.make_plan(hv.load("holochrome-8").with_(eye={}), ["10 mm"])
        >>> plan.seen_from([(0.0, 1e-3)]).eye_at(0).pupil_x_m
        0.001
        """
        eyes = eyes_at(self.nominal, len(self.planes_m) // len(places_m), places_m)
        return replace(self, eyes=eyes, _transfers={})

    def transfer(self, relay: int, wavelength: int, distance_m: float, eye: Eye | None = None) -> Transfer:
        """The propagation over a distance through a relay; derived at the first call and kept.

        relay: 0 for the gap between the modulators, 1 for the way from the last modulator to a plane.
        wavelength: index of the wavelength in `system`.
        distance_m: distance in metres; negative before the plane of a field. With an eye, that of the plane on which it
        is focused at its reference wavelength: at others it is focused elsewhere, and the `Transfer` leads there.
        eye: of the plane; the eye of `nominal` when None.

        Returns a `Transfer`. `holoview.optics.propagate.transfer_function` evaluates it.

        >>> import holoview as hv
        >>> plan = hv.make_plan(hv.load("holochrome-8").with_(shape=[48, 64]))
        >>> transfer = plan.transfer(1, 0, 5e-3)
        >>> round(transfer.waves), transfer.support.shape
        (10870, (192, 3))
        """
        eye = (eye or self.nominal.eye) if relay == 1 else None
        key = (distance_m, relay, wavelength, eye)
        if key not in self._transfers:
            λ, grid = float(self.system.wavelengths_m[wavelength]), self.grid
            limits, shift_m = None, (0.0, 0.0)
            if eye is not None:
                focus_shift_m = float(self.focus_shift_m[wavelength])
                distance_m, shift_m = distance_m + focus_shift_m, eye.image_shift_m(focus_shift_m)
            if self.system.sampling.propagation != "periodic":
                highest = [
                    math.floor(band_limit(p, grid.pitch_m, λ, distance_m) / step)
                    for p, step in zip(grid.padded, grid.frequency_step, strict=True)
                ]
                limits = (highest[0], highest[1])
            support = self._passing_rows(relay, wavelength, limits)
            if eye is not None:
                support = self._seen_rows(eye, support, λ)
            self._transfers[key] = Transfer(distance_m, λ, grid.frequency_step, support, shift_m)
        return self._transfers[key]

    def band(self, relay: int) -> Band:
        """The smallest rectangle of frequencies that holds all that the stops of a relay pass at any wavelength.

        relay: 0 for the gap between the modulators, 1 for the way from the last modulator to the planes.

        It doesn't depend on the distance, nor on the pupil of an eye. Without stops it holds the whole grid, or all
        waves that propagate.

        >>> import holoview as hv
        >>> system = hv.load("holochrome-8").edit({"shape": [48, 64], "relay2.square": "first order"})
        >>> hv.make_plan(system).band(1)
        Band(lowest=(-47, -63), highest=(47, 63))
        """
        return band_of_rows([self.stop_rows(relay, i) for i in range(len(self.system.wavelengths_m))])

    def _seen_rows(self, eye: Eye, support: NDArray[np.int32], λ: float) -> NDArray[np.int32]:
        """The frequencies of a support that the pupil of an eye passes."""
        (rows, columns), na = self.grid.frequency_step, eye.pupil_na(self.nominal.field_m)
        return rows_in_disc(support, self.grid.padded[1], na, eye.pupil_centre_na, (λ * rows, λ * columns))

    def stop_rows(self, relay: int, wavelength: int) -> NDArray[np.int32]:
        """The frequencies that the stops of a relay pass of light that propagates, as `Transfer.support` has them.

        relay: 0 for the gap, 1 for the way to the planes. wavelength: index of the wavelength in `system`.

        >>> import holoview as hv
        >>> hv.make_plan(hv.load("holochrome-8").with_(shape=[48, 64])).stop_rows(1, 0).shape
        (192, 3)
        """
        return self._passing_rows(relay, wavelength)

    def _passing_rows(self, relay: int, wavelength: int, limits: tuple[int, int] | None = None) -> NDArray[np.int32]:
        """The frequencies that the stops of a relay pass, up to the highest |k_y| and |k_x| of `limits`."""
        λ, pitch_m = float(self.system.wavelengths_m[wavelength]), self.system.modulators[0].pitch_m
        grid, is_weighted = self.grid, self.has_weighted_stops
        return stop_rows(grid.padded, grid.upsample, pitch_m, self.relays[relay], λ, limits, is_weighted=is_weighted)

    def stop_weights(self, relay: int, wavelength: int) -> NDArray[np.float64] | None:
        """The share of each frequency's cell that passes the stops of a relay, (P_y, P_x) in `fftfreq` order.

        relay: 0 for the gap, 1 for the way to the planes. wavelength: index of the wavelength in `system`. None where
        frequencies pass whole or not at all.

        >>> import holoview as hv
        >>> system = hv.load("holochrome-8").edit({"shape": [48, 64], "relay2.iris_na": 0.02})
        >>> weights = hv.make_plan(system, has_weighted_stops=True).stop_weights(1, 0)
        >>> weights.shape, float(weights.max()), float(weights.min())
        ((192, 256), 1.0, 0.0)
        """
        if not self.has_weighted_stops:
            return None
        λ, pitch_m = float(self.system.wavelengths_m[wavelength]), self.system.modulators[0].pitch_m
        return stop_weights(self.grid.padded, self.grid.upsample, pitch_m, self.relays[relay], λ)

    def lit(self, wavelength: int) -> list[int]:
        """Indices of the frames of `system` in which a laser is on.

        wavelength: index of the laser in `system.wavelengths_m`.

        >>> import holoview as hv
        >>> hv.make_plan(hv.load("holochrome-8").with_(frames=3)).lit(0)
        [0, 1, 2]
        """
        return [int(frame) for frame in np.flatnonzero(self.weights[:, wavelength])]


def make_plan(
    system: System,
    planes: Sequence[float | str] | NDArray[np.float64] | None = None,
    places_m: Sequence[tuple[float, float]] = (),
    *,
    has_weighted_stops: bool = False,
) -> Plan:
    """The numbers of a simulation, derived from a system.

    system: the display.
    planes: distances of the focal planes from the last modulator, metres or text such as "10 mm"; those of the system
    when None, or with an eye those on which it is focused. Distances of a field may be negative: before its plane.
    places_m: places (y, x) of the eye's pupil, from each of which all planes are seen, in this order; its own place
    when empty.
    has_weighted_stops: let frequencies on the edge of a relay's stop pass in proportion to the share of their cell that
    is within, which is nearer to continuous light; otherwise they pass whole or not at all. An eye's pupil is sharp.

    Returns a `Plan`. `holoview.model.validity` tells whether the model is true of it; a plan that leaves nothing to see
    is refused where it is rendered. Raises UserError for an empty list of planes, for a distance out of range (0 to
    1 m, of a field -2 m to 2 m), for an eye that is focused at such a distance at any wavelength, or so far away that
    the grid holds none of its light, for places without an eye, and for effects that such a system can't have.

    >>> import holoview as hv
    >>> hv.make_plan(hv.load("holochrome-8"), ["5 mm", 0.01]).planes_m.tolist()
    [0.005, 0.01]
    """
    nominal: System = system
    moments: tuple[float, ...] = (1.0,)
    planes_m = focused_planes(system) if planes is None else parse_planes(system, planes)
    if system.effects:
        system, moments = _as_built(system.edit({"planes": planes_m}))
        planes_m = system.planes_m
    sources = len(system.source.directions_rad)
    shift_m, eyes = focus_shift(nominal, planes_m, system.wavelengths_m), eyes_at(nominal, len(planes_m), places_m)
    behind_m, before_m = planes_m.max() + max(shift_m.max(), 0.0), planes_m.min() + min(shift_m.min(), 0.0)
    farthest_m = float(max(behind_m, -before_m))
    grid, planes_m = _grid(system, farthest_m), np.tile(planes_m, max(len(places_m), 1))
    if eyes and nominal.sampling.propagation != "periodic":
        check_eye_sampled(grid.padded, grid.pitch_m, float(nominal.wavelengths_m.max()), farthest_m)
    return Plan(
        system=system,
        planes_m=planes_m,
        grid=grid,
        weights=system.amplitudes / (system.frames * sources),
        slopes=_slopes(system),
        colour_weights=observer_weights(system.observer, system.wavelengths_m),
        nominal=nominal,
        focus_shift_m=shift_m,
        eyes=eyes,
        moments=moments,
        has_weighted_stops=has_weighted_stops,
    )


def _as_built(system: System) -> tuple[System, tuple[float, ...]]:
    """The system with its effects, and the factors of the optical paths that an exposure averages over."""
    active = ActiveEffects(system.effect_values)
    return active.as_built(system), tuple(factor for _, factor in active.exposure_samples())


def walk_off(system: System, relay: Relay, distance_m: float) -> float:
    """How many samples the steepest ray moves sideways over a distance, z·tan θ / dx.

    The steepest ray is that of the highest sampled frequency at the longest wavelength, or of the relay's stops.
    Distances before a field count as those behind it.
    """
    pitch_m = system.modulators[0].pitch_m
    dx = pitch_m / system.sampling.upsample
    longest = float(system.wavelengths_m.max())
    sine = min(longest / (2 * dx), relay.axis_sine(longest, pitch_m), _STEEPEST_SINE)
    return abs(distance_m) * sine / math.sqrt(1 - sine * sine) / dx


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
    """The padded length of a side of n samples, over which light may walk off by `reach` samples."""
    whole = _largest_fast_divisor(sampling.upsample)
    if sampling.propagation == "periodic":
        return n if is_fast_length(n) else next_fast_length(n, whole)
    if sampling.propagation == "linear":
        return next_fast_length(sampling.padding * n, whole)
    return next_fast_length(min(2 * n, n + math.ceil(reach) + _COMPACT_MARGIN), whole)


def _largest_fast_divisor(upsample: int) -> int:
    """The largest divisor of `upsample` that a fast FFT length can have."""
    return max(d for d in range(1, upsample + 1) if upsample % d == 0 and next_fast_length(d) == d)


def source_sines(system: System) -> NDArray[np.float64]:
    """Sines (source, wavelength, 2) of the angles (y, x) at which light falls on the first modulator."""
    angles = np.repeat(system.source.directions_rad[:, None], len(system.wavelengths_m), axis=1)
    if system.source.tilts_rad is not None:
        angles = angles + system.source.tilts_rad[None]
    return np.sin(angles)


def _slopes(system: System) -> NDArray[np.float64]:
    """Phase slope (source, wavelength, 2) in turns a sample: sin(angle)·dx/λ."""
    dx = system.modulators[0].pitch_m / system.sampling.upsample
    return source_sines(system) * dx / system.wavelengths_m[None, :, None]
