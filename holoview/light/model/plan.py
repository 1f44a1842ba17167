"""Derives every number of a simulation (grid, transfer functions, weights, colours) from a System, in float64.

Both executors evaluate a `Plan` and derive no physics of their own, so that they can differ by rounding only.

Symbols: λ wavelength, dx simulation pitch, N field samples, P padded samples, k signed frequency index, df = 1/(P·dx)
frequency step, u spatial frequency, A = (λ·df_y·k_y)² + (λ·df_x·k_x)² = |λu|² squared direction sine. Phases are in
turns of 2π.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from holoview.light.colour import observer_weights
from holoview.light.model.bench_parts import Relay, Sampling
from holoview.light.model.chain import Way
from holoview.light.model.effects.registry import ActiveEffects
from holoview.light.model.eye import Eye
from holoview.light.model.focus import eyes_at, focus_shift, focused_planes, parse_planes
from holoview.light.model.passband import (
    Band,
    Transfer,
    all_rows,
    band_limit,
    band_of_rows,
    check_eye_sampled,
    rows_in_disc,
    stop_rows,
    stop_weights,
)
from holoview.light.model.system import System
from holoview.light.numerics.sampling import is_fast_length, next_fast_length
from holoview.util import units
from holoview.util.errors import UserError

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
class SeenPlane:
    """A focal plane: where it was asked for, and where it is.

    nominal_m: the distance from the last modulator that was asked for, m; with an eye, that of the plane on which it is
    focused at its reference wavelength.
    accommodation_dpt: the vergence of the nominal plane, dioptres; None without an eye.
    true_m: the distance with the effects that move planes.
    distances_m: (wavelength,) the distances of its pictures. They are `true_m`; an eye is focused elsewhere at each
    wavelength.
    eye: the eye that sees the plane, with its pupil at its place; None without an eye.
    """

    nominal_m: float
    accommodation_dpt: float | None
    true_m: float
    distances_m: tuple[float, ...]
    eye: Eye | None = None


@dataclass(frozen=True)
class Samples:
    """The samples of a laser, a direction or a frame of the nominal system, whose light adds in intensity.

    indices: in the plan; one without the effects that split light.
    central: the index of the nominal sample, or of that nearest to it.
    """

    indices: tuple[int, ...]
    central: int


@dataclass(frozen=True)
class Beam:
    """The coherent light of one wavelength, frame and source of a plan. weight: of its |field|² in the intensity."""

    wavelength: int
    frame: int
    source: int
    weight: float


@dataclass(frozen=True)
class Plan:
    """The numbers that both executors use, derived from a system for a choice of focal planes. Made by `make_plan`.

    What is seen and what shines are known by their indices: those of `planes`, and the wavelengths, frames and sources
    of `system`. Effects may split a laser of the nominal system into several wavelengths (spectral lines), a direction
    into several sources (points) and a frame into several frames (samples of its exposure).

    system: the system with the effects that change distances, angles, wavelengths, apertures and powers applied.
    planes: the focal planes, seen from each place of the pupil in turn.
    grid: `Grid` of the field and of its padded transform.
    weights: (frame, wavelength) factors of |field|²: amplitude / (frames · sources).
    slopes: (source, wavelength, 2) phase slope (y, x) of the illumination, turns a sample.
    colour_weights: (wavelength, 3) XYZ of unit intensity.
    nominal: the system as it was given.
    focus_shift_m: (wavelength,) how much larger z is on which an eye is focused at each wavelength; 0 without an eye.
    lasers, directions, frames: of the nominal system, with their `Samples`: indices of wavelengths, sources and frames.
    moments: the M factors of all optical paths over which each exposure is averaged, because an effect lets the phase
    ripple during the exposure; (1.0,) if no effect does. Frame f·M + m of `system` shows frame f of the drive, with
    factor m.
    has_weighted_stops: whether frequencies on the edge of a relay's stop pass in part, as pupils say then.

    >>> import holoview as hv
    >>> plan = hv.make_plan(hv.load("holochrome-8").with_(shape=[48, 64]), ["5 mm"])
    >>> plan.grid.shape, plan.grid.padded, plan.weights.shape, plan.colour_weights.shape
    ((96, 128), (192, 256), (1, 8), (8, 3))
    """

    system: System
    planes: tuple[SeenPlane, ...]
    grid: Grid
    weights: NDArray[np.float64]
    slopes: NDArray[np.float64]
    colour_weights: NDArray[np.float64]
    nominal: System
    focus_shift_m: NDArray[np.float64]
    lasers: tuple[Samples, ...]
    directions: tuple[Samples, ...]
    frames: tuple[Samples, ...]
    moments: tuple[float, ...] = (1.0,)
    has_weighted_stops: bool = False
    _transfers: dict[tuple[float, int, int, Eye | None], Transfer] = field(
        default_factory=dict, repr=False, compare=False
    )

    @property
    def planes_m(self) -> NDArray[np.float64]:
        """The true distances (plane,) of the focal planes, m; of an eye at its reference wavelength.

        >>> import holoview as hv
        >>> system = hv.load("holochrome-8").edit({"effects": {"distance": {"distance_error": "1 mm"}}})
        >>> plan = hv.make_plan(system, ["5 mm"])
        >>> plan.planes[0].nominal_m, plan.planes_m.tolist()
        (0.005, [0.006])
        """
        return np.array([plane.true_m for plane in self.planes])

    @property
    def distances_m(self) -> NDArray[np.float64]:
        """Distances from the last modulator that are computed, (plane, wavelength): without an eye equal along a row.

        >>> import holoview as hv
        >>> plan = hv.make_plan(hv.load("holochrome-8").with_(eye={"chromatic": False}), ["5 mm"])
        >>> plan.distances_m.shape, float(plan.distances_m.max())
        ((1, 8), 0.005)
        """
        return np.array([plane.distances_m for plane in self.planes])

    @property
    def relays(self) -> tuple[Relay, ...]:
        """The relays of the way, which are known by their indices: 0 of the gap, 1 behind the last modulator.

        Of a chain those of its spaces, in order, and of its Fourier elements; the last leads to the planes.

        >>> import holoview as hv
        >>> gap, last = hv.make_plan(hv.load("holochrome-8")).relays
        >>> gap.square == last.square
        True
        """
        return self.way.relays

    @property
    def way(self) -> Way:
        """What light does from the source to the last element.

        >>> import holoview as hv
        >>> hv.make_plan(hv.load("holochrome-8")).way.last
        1
        """
        return self.system.way

    def order_m(self, relay: int) -> float:
        """The pitch whose first order the stops of a relay name, m.

        >>> import holoview as hv
        >>> hv.make_plan(hv.load("holochrome-8")).order_m(1)
        8e-06
        """
        return self.way.orders_m[relay]

    def seen_from(self, places_m: Sequence[tuple[float, float]]) -> Plan:
        """The plan with its planes seen from other places of the eye's pupil.

        places_m: (y, x), as many as before, m. Raises UserError without an eye.

        >>> import holoview as hv
        >>> plan = hv.make_plan(hv.load("holochrome-8").with_(eye={}), ["10 mm"])
        >>> plan.seen_from([(0.0, 1e-3)]).planes[0].eye.pupil_x_m
        0.001
        """
        eyes = eyes_at(self.nominal, len(self.planes) // len(places_m), places_m)
        planes = tuple(replace(plane, eye=eye) for plane, eye in zip(self.planes, eyes, strict=True))
        return replace(self, planes=planes, _transfers={})

    def transfer(self, relay: int, wavelength: int, plane: int = 0) -> Transfer:
        """The propagation through a relay, over the gap or to a focal plane; derived at the first call and kept.

        relay: index in `relays`: 0 for the gap between the modulators, 1 for the way from the last one to a plane.
        wavelength: index of the wavelength in `system`.
        plane: index in `planes`; of no matter but for the last relay. An eye is focused elsewhere at each wavelength:
        the `Transfer` leads there.

        Returns a `Transfer`. `holoview.light.optics.propagate.transfer_function` evaluates it.

        >>> import holoview as hv
        >>> plan = hv.make_plan(hv.load("holochrome-8").with_(shape=[48, 64]), ["5 mm"])
        >>> transfer = plan.transfer(1, 0, 0)
        >>> round(transfer.waves), transfer.support.shape
        (10870, (192, 3))
        """
        if relay != self.way.last:
            return self._propagation(relay, wavelength, self.way.distances_m[relay], None)
        seen = self.planes[plane]
        return self._propagation(relay, wavelength, seen.distances_m[wavelength], seen.eye)

    def stops(self, relay: int, wavelength: int) -> Transfer:
        """The way through the stops of a relay alone, over no distance and without an eye.

        relay, wavelength: as of `transfer`.

        >>> import holoview as hv
        >>> hv.make_plan(hv.load("holochrome-8").with_(shape=[48, 64])).stops(1, 0).waves
        0.0
        """
        return self._propagation(relay, wavelength, 0.0, None)

    def passing(self, wavelength: int, ky: NDArray[np.integer], kx: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Which frequencies pass the last relay's stops and the pupil of an eye, (A, B).

        wavelength: its index. ky, kx: signed indices of the rows (A,) and of the columns (B,).

        >>> import holoview as hv, numpy as np
        >>> plan = hv.make_plan(hv.load("holochrome-8").with_(shape=[48, 64]))
        >>> plan.passing(0, np.array([0]), np.array([0, 127])).tolist()
        [[True, False]]
        """
        support, eye = self.stops(self.way.last, wavelength).support, self.planes[0].eye
        if eye is not None:
            support = self._seen_rows(eye, support, float(self.system.wavelengths_m[wavelength]))
        smallest, lowest, highest = support[ky % len(support)].T[..., None]
        passes: NDArray[np.bool_] = (np.abs(kx) >= smallest) & (kx >= lowest) & (kx <= highest)
        return passes

    def _propagation(self, relay: int, wavelength: int, distance_m: float, eye: Eye | None) -> Transfer:
        key = (distance_m, relay, wavelength, eye)
        if key not in self._transfers:
            λ, grid = float(self.system.wavelengths_m[wavelength]), self.grid
            limits, shift_m = None, (0.0, 0.0)
            if self.system.sampling.propagation != "periodic":
                highest = [
                    math.floor(band_limit(p, grid.pitch_m, λ, distance_m) / step)
                    for p, step in zip(grid.padded, grid.frequency_step, strict=True)
                ]
                limits = (highest[0], highest[1])
            support = self._passing_rows(relay, wavelength, limits)
            if eye is not None:
                shift_m = eye.image_shift_m(float(self.focus_shift_m[wavelength]))
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
        λ, (upsample, pitch_m) = float(self.system.wavelengths_m[wavelength]), self._order(relay)
        padded, is_weighted = self.grid.padded, self.has_weighted_stops
        if self.way.kernel(relay) is not None:
            return all_rows(padded)
        return stop_rows(padded, upsample, pitch_m, self.relays[relay], λ, limits, is_weighted=is_weighted)

    def _order(self, relay: int) -> tuple[int, float]:
        """The pitch whose first order the stops of a relay name, in samples and in metres."""
        pitch_m = self.way.orders_m[relay]
        return (round(pitch_m / self.grid.pitch_m) if self.way.is_chain else self.grid.upsample), pitch_m

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
        λ, (upsample, pitch_m) = float(self.system.wavelengths_m[wavelength]), self._order(relay)
        return stop_weights(self.grid.padded, upsample, pitch_m, self.relays[relay], λ)

    def lit(self, wavelength: int) -> list[int]:
        """Indices of the frames of `system` in which a laser is on.

        wavelength: index of the laser in `system.wavelengths_m`.

        >>> import holoview as hv
        >>> hv.make_plan(hv.load("holochrome-8").with_(frames=3)).lit(0)
        [0, 1, 2]
        """
        return [int(frame) for frame in np.flatnonzero(self.weights[:, wavelength])]

    def laser_of(self, wavelength: int) -> int:
        """The laser of the nominal system that emits a wavelength of `system`, by their indices.

        >>> import holoview as hv
        >>> effects = {"second_line": {"share": 0.25, "offset": "6 nm"}}
        >>> plan = hv.make_plan(hv.load("holochrome-8").edit({"effects": effects}))
        >>> [plan.laser_of(wavelength) for wavelength in range(4)]
        [0, 0, 1, 1]
        """
        return wavelength // len(self.lasers[0].indices)

    def beams(self, lasers: Sequence[int]) -> list[Beam]:
        """All beams of some lasers whose |field|² add up to the intensity, by wavelength.

        lasers: indices in `lasers`.

        >>> import holoview as hv
        >>> len(hv.make_plan(hv.load("holochrome-8").with_(frames=3)).beams([0, 4]))
        6
        """
        return [
            Beam(wavelength, frame, source, float(self.weights[frame, wavelength]))
            for laser in sorted(set(lasers))
            for wavelength in self.lasers[laser].indices
            for frame in self.lit(wavelength)
            for source in range(len(self.slopes))
        ]

    def central_beam(self, laser: int, frame: int, direction: int) -> tuple[Beam, float]:
        """The nominal beam of a laser, frame and direction, or that nearest to it, and its share of their light.

        laser, frame, direction: indices in `lasers`, `frames` and `directions`. The share is 1 where effects don't
        split light; that of lasers that are off is their lines', points' and exposure samples' if they were equal.

        >>> import holoview as hv
        >>> effects = {"second_line": {"share": 0.25, "offset": "6 nm"}}
        >>> plan = hv.make_plan(hv.load("holochrome-8").edit({"effects": effects}))
        >>> beam, share = plan.central_beam(1, 0, 0)
        >>> beam.wavelength, share
        (2, 0.75)
        """
        lines, samples, points = self.lasers[laser], self.frames[frame], self.directions[direction]
        own = float(self.weights[samples.central, lines.central])
        weights = self.weights[np.ix_(samples.indices, lines.indices)]
        total = float(weights.sum())
        share = own / total if total else 1 / weights.size
        return Beam(lines.central, samples.central, points.central, own), share / len(points.indices)


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

    Returns a `Plan`. `holoview.light.model.validity` tells whether the model is true of it; a plan that leaves nothing
    to see is refused where it is rendered. Raises UserError for an empty list of planes, for a distance out of range (0
    to 1 m, of a field -2 m to 2 m), for an eye that is focused at such a distance at any wavelength, or so far away
    that the grid holds none of its light, for places without an eye, and for effects that such a system can't have.

    >>> import holoview as hv
    >>> hv.make_plan(hv.load("holochrome-8"), ["5 mm", 0.01]).planes_m.tolist()
    [0.005, 0.01]
    """
    nominal: System = system
    moments: tuple[float, ...] = (1.0,)
    nominal_m = focused_planes(system) if planes is None else parse_planes(system, planes)
    planes_m = nominal_m
    if system.effects:
        system, moments = _as_built(system.edit({"planes": nominal_m}))
        planes_m = system.planes_m
    if system.way.behind_m:
        planes_m = _from_last_element(planes_m, system.way.behind_m)
    sources = len(system.source.directions_rad)
    shift_m = focus_shift(nominal, planes_m, system.wavelengths_m)
    behind_m, before_m = planes_m.max() + max(shift_m.max(), 0.0), planes_m.min() + min(shift_m.min(), 0.0)
    farthest_m = float(max(behind_m, -before_m))
    grid = _grid(system, farthest_m)
    if nominal.eye is not None and nominal.sampling.propagation != "periodic":
        check_eye_sampled(grid.padded, grid.pitch_m, float(nominal.wavelengths_m.max()), farthest_m)
    return Plan(
        system=system,
        planes=_seen_planes(nominal, nominal_m, planes_m, shift_m, places_m),
        grid=grid,
        weights=system.amplitudes / (system.frames * sources),
        slopes=_slopes(system),
        colour_weights=observer_weights(system.observer, system.wavelengths_m),
        nominal=nominal,
        focus_shift_m=shift_m,
        lasers=_lines(nominal, system),
        directions=_points(nominal, system),
        frames=_exposures(nominal, moments),
        moments=moments,
        has_weighted_stops=has_weighted_stops,
    )


def _from_last_element(planes_m: NDArray[np.float64], behind_m: float) -> NDArray[np.float64]:
    """Distances of planes from the last element, where they are told from one that lies before it."""
    found = planes_m - behind_m
    if found.min() < 0:
        raise UserError(
            "planes",
            f"{units.format_rounded(float(planes_m.min()), 'mm')}, before the last element",
            expected=f"{units.format_rounded(behind_m, 'mm')} or more from the element of planes_from",
        )
    return found


def _as_built(system: System) -> tuple[System, tuple[float, ...]]:
    """The system with its effects, and the factors of the optical paths that an exposure averages over."""
    active = ActiveEffects(system.effect_values)
    return active.as_built(system), tuple(factor for _, factor in active.exposure_samples())


def _seen_planes(
    system: System,
    nominal_m: NDArray[np.float64],
    true_m: NDArray[np.float64],
    shift_m: NDArray[np.float64],
    places_m: Sequence[tuple[float, float]],
) -> tuple[SeenPlane, ...]:
    """The planes of a nominal system (plane,) as they are seen from each place of the pupil, (place · plane,)."""
    if len(true_m) != len(nominal_m):
        raise UserError("effects", f"{len(true_m)} planes of {len(nominal_m)}", expected="effects that keep each plane")
    eyes = eyes_at(system, len(nominal_m), places_m) or (None,) * len(nominal_m)
    return tuple(
        SeenPlane(
            nominal_m=float(asked_m),
            accommodation_dpt=None if eye is None else float(eye.dioptres(asked_m, system.planes_m)),
            true_m=float(actual_m),
            distances_m=tuple((actual_m + shift_m).tolist()),
            eye=eye,
        )
        for eye, asked_m, actual_m in zip(eyes, itertools.cycle(nominal_m), itertools.cycle(true_m), strict=False)
    )


def _split(count: int, before: int, what: str) -> NDArray[np.intp]:
    """Indices (before, samples): those of each laser, direction or frame are neighbours."""
    if count % before:
        raise UserError("effects", f"{count} {what} of {before}", expected="as many for each")
    return np.arange(count).reshape(before, -1)


def _lines(nominal: System, system: System) -> tuple[Samples, ...]:
    """The spectral lines of each laser. The strongest is the central one; of equal ones, that nearest to the laser."""
    indices = _split(len(system.wavelengths_m), len(nominal.wavelengths_m), "wavelengths")
    power = system.amplitudes.sum(axis=0)
    away_m = np.abs(system.wavelengths_m[indices] - nominal.wavelengths_m[:, None])
    return tuple(
        Samples(tuple(lines.tolist()), int(lines[np.lexsort((away, -power[lines]))[0]]))
        for lines, away in zip(indices, away_m, strict=True)
    )


def _points(nominal: System, system: System) -> tuple[Samples, ...]:
    """The points of each direction of the source. The central one is the nearest to their middle."""
    directions_rad = system.source.directions_rad
    groups = _split(len(directions_rad), len(nominal.source.directions_rad), "directions").tolist()
    away = [np.hypot(*(directions_rad[points] - directions_rad[points].mean(axis=0)).T) for points in groups]
    return tuple(
        Samples(tuple(points), points[int(np.argmin(a.round(12)))]) for points, a in zip(groups, away, strict=True)
    )


def _exposures(nominal: System, moments: tuple[float, ...]) -> tuple[Samples, ...]:
    """The samples of each frame's exposure. The central one has the optical paths that are nearest to the nominal."""
    central = int(np.argmin(np.abs(np.array(moments) - 1)))
    starts = range(0, nominal.frames * len(moments), len(moments))
    return tuple(Samples(tuple(range(start, start + len(moments))), start + central) for start in starts)


def walk_off(system: System, relay: int, distance_m: float) -> float:
    """How many samples the steepest ray moves sideways over a distance, z·tan θ / dx.

    The steepest ray is that of the highest sampled frequency at the longest wavelength, or of the relay's stops.
    Distances before a field count as those behind it.
    """
    way = system.way
    dx = way.sample_m
    longest = float(system.wavelengths_m.max())
    sine = min(longest / (2 * dx), way.relays[relay].axis_sine(longest, way.orders_m[relay]), _STEEPEST_SINE)
    return abs(distance_m) * sine / math.sqrt(1 - sine * sine) / dx


def _grid(system: System, farthest_m: float) -> Grid:
    sampling, way = system.sampling, system.way
    ways_m = [farthest_m if relay == way.last else distance for relay, distance in enumerate(way.distances_m)]
    reach = max(walk_off(system, relay, distance_m) for relay, distance_m in enumerate(ways_m))
    padded = tuple(_padded(n, sampling, way.upsample, reach) for n in way.shape)
    offset = tuple((p - n) // (2 * way.upsample) * way.upsample for p, n in zip(padded, way.shape, strict=True))
    return Grid(way.shape, (padded[0], padded[1]), (offset[0], offset[1]), way.sample_m, way.upsample)


def _padded(n: int, sampling: Sampling, upsample: int, reach: float) -> int:
    """The padded length of a side of n samples, over which light may walk off by `reach` samples."""
    whole = _largest_fast_divisor(upsample)
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
    return source_sines(system) * system.way.sample_m / system.wavelengths_m[None, :, None]
