"""Patterns that make dots whose places tell the geometry, and dots in pictures.

A probe is a block of pixels at r with the phase of a lens that focuses at the distance L and of a grating of spatial
frequency ν (the carrier). In the near field its dot lies at r + L·λν: its place tells where the modulator is, and its
movement with ν tells L. On a Fourier bench with focal length f and defocus z it lies at f·λν − (z/f)·r. The relation of
the modulator's phase to its levels changes only how bright the dot is, not its place.

Neighbouring dots, orders of the pixels and stops move the centroid of a dot by some tenths of a pixel. Simulating the
same pattern by the model of captures, on the bench as found, moves its dots by as much (`dot_bias`).

`predicted_px` gives the places of dots on the camera as a function of all unknowns; `fit_geometry` fits these, with
uncertainties.

    r' = (1 + m₂)·R(ρ₂)·T₂·r + d₂           place of a block of modulator 2, r in what it displays (modulator 1: r' = r)
    ν' = R(ρ₂)·T₂·ν / (1 + m₂)
    z  = offset + (1 + scale)·Z                              Z: the stage's setting
    q                                                    where the ray of place r' and sine λν' meets the camera at z,
                                                         through what stands between (`rays`)
    pixel           = R(ρ)·q / pitch + walk·z / pitch + centre

T₂ and the camera's turn are among `captures.dataset: ORIENTATIONS`, and known before the fit; pixels are those of the
picture turned back.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.optimize import least_squares

from holoview.bench.captures.dataset import Captures, SlmSpec, orientation_matrix, turned
from holoview.bench.captures.predictor import Predictor
from holoview.bench.rig.description import RigDescription
from holoview.bench.rig.devices import Levels
from holoview.bench.rig.rays import RayWay, settings_beside, way_to_camera
from holoview.light.model.effects.on_element import AT

Floats = NDArray[np.float64]
NAMES = (
    "centre_y", "centre_x", "log_pitch", "rotation", "offset", "scale", "walk_y", "walk_x",
    "shift2_y", "shift2_x", "rotation2", "magnification2", "gap",
)  # fmt: skip
"""All unknowns, in SI units; the centre in pixels."""

_UNITS = np.array([1, 1, 1e-3, 1e-3, 1e-4, 1e-2, 1e-3, 1e-3, 1e-6, 1e-6, 1e-3, 1e-3, 1e-4])
_COMMON_COUNT = 16
_OUTLIER = 4.0  # times the robust standard deviation
_MAD = 1.4826
# Of the error that dots share over the scatter beyond noise: blur, crosstalk, wrong strokes and look-up tables moved
# planes by one to four times the uncertainty that 1 states (benchmarks/rig_alignment.py --faults).
_SHARED_PER_EXCESS = 3.0


@dataclass(frozen=True)
class Dots:
    """Dots seen at one setting of the stage, made by one modulator.

    centre_m, frequency: (dot, 2), as in `Probes`. position_px: (dot, 2), in the picture turned back.
    """

    slm: int
    stage_m: float
    centre_m: Floats
    frequency: Floats
    position_px: Floats


@dataclass(frozen=True)
class BenchFacts:
    """Wavelength, the way from each modulator to the camera, how the second one is turned, and what is sought of it."""

    wavelength_m: float
    ways: tuple[RayWay, ...]
    slm2_turn: str = "none"
    second: tuple[str, ...] = ()

    @property
    def modulators(self) -> int:
        """How many there are."""
        return len(self.ways)


@dataclass(frozen=True)
class Geometry:
    """Values of `NAMES` with their covariance. used: dots fitted, of how many. residual_px: r.m.s. along an axis."""

    values: Floats
    covariance: Floats
    used: tuple[int, int] = (0, 0)
    residual_px: float = 0.0

    def __getitem__(self, name: str) -> float:
        return float(self.values[NAMES.index(name)])

    def uncertainty(self, name: str) -> float:
        """Standard deviation of one value; 0 for an unknown that wasn't fitted."""
        k = NAMES.index(name)
        return float(self.covariance[k, k] ** 0.5)

    def is_near(self, other: Geometry, deviations: float) -> bool:
        """Whether all values are within so many standard deviations of another geometry's."""
        return bool((np.abs(self.values - other.values) <= deviations * np.diag(self.covariance) ** 0.5).all())

    def uncertain_by(self, other: Geometry) -> Geometry:
        """The geometry, with its difference from another geometry as a further uncertainty."""
        step = np.diag((self.values - other.values) ** 2)
        return replace(self, covariance=self.covariance + step)


def predicted_px(
    values: Floats, facts: BenchFacts, slm: int, stage_m: float, centre_m: Floats, frequency: Floats
) -> Floats:
    """Places (dot, 2) on the camera of dots of one modulator."""
    v = dict(zip(NAMES, values, strict=True))
    place, ν = centre_m, frequency
    if slm == 1:
        turn = rotation_matrix(v["rotation2"]) @ orientation_matrix(facts.slm2_turn)
        scale = 1 + v["magnification2"]
        place = scale * place @ turn.T + np.array([v["shift2_y"], v["shift2_x"]])
        ν = ν @ turn.T / scale
    z = v["offset"] + (1 + v["scale"]) * stage_m
    point = facts.ways[slm].traced(place, facts.wavelength_m * ν, z, v["gap"])
    point = point @ rotation_matrix(v["rotation"]).T + z * np.array([v["walk_y"], v["walk_x"]])
    return np.asarray(point / np.exp(v["log_pitch"]) + np.array([v["centre_y"], v["centre_x"]]))


@dataclass(frozen=True)
class DotErrors:
    """The accuracy of the places of dots, standard deviations in pixels.

    common_px: of an error that neighbouring dots share, which more dots don't average out: the error counts as if only
    16 coordinates had been measured. noise_px: the scatter, by noise and unequal pixels, of dots that look as in the
    model. More scatter means that modulators or camera aren't as described, which moves dots together by several times
    their scatter.
    """

    common_px: float = 0.0
    noise_px: float = float("inf")

    def shared_px(self, residual_px: float) -> float:
        """The shared error of dots with this residual (r.m.s. along an axis)."""
        return float(np.hypot(self.common_px, _SHARED_PER_EXCESS * self.excess_px(residual_px)))

    def excess_px(self, residual_px: float) -> float:
        """The part of a residual that noise doesn't explain."""
        return max(residual_px - self.noise_px, 0.0)


def fit_geometry(start: Floats, facts: BenchFacts, dots: Sequence[Dots], errors: DotErrors | None = None) -> Geometry:
    """The geometry that explains dots best, without outliers. start: values of `NAMES`. errors: none without them.

    Values that the dots can't tell stay: walk and the stage's scale at one setting, modulator 2 where there is none.
    """
    free = _free(facts, dots)
    seen = np.concatenate([d.position_px for d in dots])
    kept = np.isfinite(seen).all(axis=1)
    values = start.copy()

    def residuals(x: Floats) -> Floats:
        every = values.copy()
        every[free] = x * _UNITS[free]
        parts = [predicted_px(every, facts, d.slm, d.stage_m, d.centre_m, d.frequency) for d in dots]
        return np.asarray(np.concatenate(parts) - seen)

    x = values[free] / _UNITS[free]
    for loss in ("soft_l1", "linear", "linear"):
        x = least_squares(lambda x, kept=kept: residuals(x)[kept].ravel(), x, loss=loss).x
        off = np.abs(residuals(x)).max(axis=1)
        limit = _OUTLIER * max(_MAD * float(np.median(np.abs(residuals(x)[kept]))), 0.01)
        kept = np.isfinite(off) & (off < limit)
    solved = least_squares(lambda x: residuals(x)[kept].ravel(), x)
    freedom = max(2 * int(kept.sum()) - len(x), 1)
    variance = float(2 * solved.cost) / freedom
    shared_px = (errors or DotErrors()).shared_px(variance**0.5)
    stated = variance + shared_px**2 * max(2 * int(kept.sum()) / _COMMON_COUNT, 1.0)
    covariance = np.zeros((len(NAMES), len(NAMES)))
    covariance[np.ix_(free, free)] = (
        stated * np.linalg.pinv(solved.jac.T @ solved.jac) * np.outer(_UNITS[free], _UNITS[free])
    )
    values[free] = solved.x * _UNITS[free]
    return Geometry(values, covariance, (int(kept.sum()), len(kept)), variance**0.5)


def _free(facts: BenchFacts, dots: Sequence[Dots]) -> NDArray[np.intp]:
    """Which of `NAMES` these dots can tell."""
    names = set(NAMES[:5])
    if len({d.stage_m for d in dots}) > 1:
        names |= {"scale", "walk_y", "walk_x"}
    names |= set(facts.second)
    return np.array([k for k, name in enumerate(NAMES) if name in names])


def rotation_matrix(angle_rad: float) -> Floats:
    """R for positions (y, x): positive from +x towards +y."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, s], [-s, c]])


# --- dots -------------------------------------------------------------------------------------------------------------


Points = NDArray[np.float64]
_LENS_SHARE, _CARRIER_SHARE = 0.45, 0.3  # of the steepest direction that passes; together below 1
_SPOTS_APART = 2.5  # spacing of dots in widths of a dot
FEWEST_PX, DOTS_ACROSS, _MOST_ACROSS = 6, 4, 16


@dataclass(frozen=True)
class Probes:
    """A pattern and the dots that it makes.

    levels: (y, x), as displayed. centre_m: (dot, 2), r of each dot's block. frequency: (dot, 2), its ν in 1/m.
    width_m: of a dot. spacing_m: between neighbouring dots; infinite for a single one.
    """

    levels: Levels
    centre_m: Points
    frequency: Points
    width_m: float
    spacing_m: float = math.inf


@dataclass(frozen=True)
class Optics:
    """The bench as the probes of one modulator need it. sine: of the steepest direction that passes. All in m."""

    slm: SlmSpec
    shape: tuple[int, int]
    wavelength_m: float
    sine: float
    focal_length_m: float | None
    way: RayWay

    def seen_m(self, distance_m: float, gap_m: float | None = None) -> float:
        """How far behind the modulator stands what the camera sees at a stated distance; not in a Fourier plane."""
        a, b = self.way.matrix(distance_m, gap_m)
        return b / a

    @property
    def carrier(self) -> float:
        """Spatial frequency (1/m) of the gratings."""
        return _CARRIER_SHARE * self.sine / self.wavelength_m

    def lens_px(self, distance_m: float) -> int:
        """Pixels across a lenslet that focuses at a distance."""
        widest = 2 * _LENS_SHARE * self.sine * distance_m / self.slm.pitch_m
        return int(np.clip(widest, FEWEST_PX, max(min(self.shape) // DOTS_ACROSS, FEWEST_PX)))

    def dot_m(self, distance_m: float) -> float:
        """Width of the dot of a lenslet."""
        return self.wavelength_m * distance_m / (self.lens_px(distance_m) * self.slm.pitch_m)


def optics_of(rig: RigDescription, number: int, wavelength_m: float) -> Optics:
    """The optics of the modulator of a number of a rig, nominally."""
    slm, bench, way = rig.bench.slms[number], rig.bench, way_to_camera(rig, number, wavelength_m)
    relays = (bench.relay1, bench.relay2) if number + 1 < len(bench.slms) else (bench.relay2,)
    stops = [(relay, slm.pitch_m) for relay in relays]
    if (chain := bench.chain) is not None:
        place, every = chain.part(rig.modulator_names[number]), chain.way
        named = zip(every.relay_names, every.relays, every.orders_m, strict=True)
        stops = [(relay, order_m) for names, relay, order_m in named if all(chain.part(n) > place for n in names)]
    sines = [wavelength_m / (2 * slm.pitch_m), *(relay.axis_sine(wavelength_m, order) for relay, order in stops)]
    return Optics(slm, rig.slm_shapes[number], wavelength_m, min(sines), way.focal_length_m, way)


def flat_levels(optics: Optics) -> Levels:
    """A pattern without any phase."""
    return np.zeros(optics.shape, _levels_type(optics))


def single_lens(optics: Optics, at: tuple[float, float], distance_m: float) -> Probes:
    """One lenslet at `at` (y, x), m, as wide as the directions allow, on a flat modulator."""
    y, x = _pixels(optics)
    lens = -np.pi / (optics.wavelength_m * distance_m) * ((y - at[0]) ** 2 + (x - at[1]) ** 2)
    half = optics.lens_px(distance_m) / 2 * optics.slm.pitch_m
    inside = (np.abs(y - at[0]) < half) & (np.abs(x - at[1]) < half)
    levels = _levels(lens, inside, optics)
    return Probes(levels, np.array([at]), np.zeros((1, 2)), optics.dot_m(distance_m))


def lens_array(optics: Optics, distance_m: float, carrier: tuple[float, float]) -> Probes:
    """Lenslets side by side over the modulator, all with the same carrier (y, x) in 1/m."""
    pitch, aperture = optics.slm.pitch_m, optics.lens_px(distance_m)
    apart = max(aperture, math.ceil(_SPOTS_APART * optics.dot_m(distance_m) / pitch))
    apart = max(apart, math.ceil(max(optics.shape) / _MOST_ACROSS))
    counts = [max(n // apart, 1) for n in optics.shape]
    places = [(np.arange(count) - (count - 1) / 2) * apart * pitch for count in counts]
    offset = [np.abs(axis[..., None] - own) for axis, own in zip(_pixels(optics), places, strict=True)]
    nearest = [own[distance.argmin(axis=-1)] for own, distance in zip(places, offset, strict=True)]
    y, x = (axis - own for axis, own in zip(_pixels(optics), nearest, strict=True))
    phase = -np.pi / (optics.wavelength_m * distance_m) * (y**2 + x**2)
    inside = (np.abs(y) <= aperture / 2 * pitch) & (np.abs(x) <= aperture / 2 * pitch)
    levels = _levels(phase + _tilt(carrier, optics), inside, optics)
    centres = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1).reshape(-1, 2)
    return Probes(
        levels, centres, np.tile(np.array(carrier), (len(centres), 1)), optics.dot_m(distance_m), apart * pitch
    )


def grating(optics: Optics, carrier: tuple[float, float], part: tuple[int, int] = (0, 0)) -> Probes:
    """A grating for a Fourier bench, over the modulator, or the half of it on one side, with the rest flat.

    carrier: (y, x) in 1/m. part: (±1, 0) for the half with the higher or lower rows, (0, ±1) for that of columns.
    """
    assert optics.focal_length_m is not None
    axes, extent = _pixels(optics), np.array(optics.shape) * optics.slm.pitch_m
    inside = np.ones(optics.shape, bool)
    for side, axis in zip(part, axes, strict=True):
        inside &= (side * axis > 0) if side else True
    phase = _tilt(carrier, optics)
    width = extent / (1 + np.abs(part))
    spot_m = optics.wavelength_m * abs(optics.focal_length_m) / float(width.min())
    centre = np.array(part) * extent / 4
    return Probes(_levels(phase, inside, optics), centre[None], np.array([carrier]), spot_m)


def _tilt(carrier: tuple[float, float], optics: Optics) -> Points:
    """The phase (y, x) of a grating of spatial frequency (y, x) in 1/m."""
    y, x = _pixels(optics)
    return np.asarray(2 * np.pi * (carrier[0] * y + carrier[1] * x))


def _pixels(optics: Optics) -> tuple[Points, Points]:
    """Positions (y, 1) and (1, x) of the pixels from the modulator's centre, m."""
    y, x = (np.asarray((np.arange(n) - (n - 1) / 2) * optics.slm.pitch_m, dtype=np.float64) for n in optics.shape)
    return y[:, None], x[None, :]


def _levels(phase: Points, inside: NDArray[np.bool_], optics: Optics) -> Levels:
    """The levels nearest to a phase in radians, nominally, and flat outside; a modulator of less than a wave uses all
    that it has, one of amplitude shows (1 + cos phase)/2, whose first order has that phase."""
    slm = optics.slm
    if slm.opd_range_m:
        waves = np.remainder(np.where(inside, phase, 0.0) / (2 * np.pi), 1.0)
        steps = waves * min(optics.wavelength_m / slm.opd_range_m, 1.0)
    else:
        steps = np.where(inside, 0.5 + 0.5 * np.cos(phase), 0.0)
    return slm.levels_of(steps).astype(_levels_type(optics))


def _levels_type(optics: Optics) -> type[np.unsignedinteger]:
    return np.uint8 if optics.slm.num_levels <= 256 else np.uint16


Image = NDArray[np.float64]


# --- dots in pictures ---


_SIGMA_OF_WIDTH = 0.4  # of the Gaussian that is most like the core of a diffraction-limited dot
_ROUNDS = 4


@dataclass(frozen=True)
class FoundDots:
    """position_px: (dot, 2), NaN where there is none. contrast: height over the noise of the background."""

    position_px: NDArray[np.float64]
    contrast: NDArray[np.float64]


def brightest_dot(change: Image, width_px: float) -> tuple[NDArray[np.float64], float]:
    """Place (y, x) of the brightest dot in a picture less one without it, and its height over the noise."""
    smooth = gaussian_filter(change, max(_SIGMA_OF_WIDTH * width_px, 0.5))
    peak = np.array(np.unravel_index(int(smooth.argmax()), smooth.shape), dtype=np.float64)
    above = smooth - np.median(smooth)
    noise = _MAD * float(np.median(np.abs(above)))
    return peak, float(above.max() / max(noise, 1e-30))


def find_dots(picture: Image, expected_px: NDArray[np.float64], width_px: float, reach_px: float) -> FoundDots:
    """Dots near expected places (dot, 2), each by its centroid, weighted by a Gaussian of the dot's size.

    width_px: of a dot. reach_px: how far a dot may be from where it is expected. A dot that reaches the edge of the
    picture or of its reach isn't found.
    """
    sigma = max(_SIGMA_OF_WIDTH * width_px, 0.7)
    smooth = gaussian_filter(picture, sigma)
    median = float(np.median(picture))
    noise = _MAD * float(np.median(np.abs(smooth - median))) + 1e-30
    found = [_find_dot(picture, smooth, place, sigma, reach_px) for place in expected_px]
    heights = [smooth[tuple(np.rint(p).astype(int))] - median if np.isfinite(p).all() else 0.0 for p in found]
    return FoundDots(np.array(found).reshape(-1, 2), np.array(heights) / noise)


def _find_dot(
    picture: Image, smooth: Image, place: NDArray[np.float64], sigma: float, reach_px: float
) -> NDArray[np.float64]:
    """The place (y, x) of one dot, NaN if there is none."""
    nothing, shape = np.full(2, np.nan), np.array(picture.shape)
    margin = 3 * sigma
    low = np.maximum(np.ceil(place - reach_px), 0).astype(int)
    high = np.minimum(np.floor(place + reach_px), shape - 1).astype(int)
    if (high - low < 2).any():
        return nothing
    window = smooth[low[0] : high[0] + 1, low[1] : high[1] + 1]
    place = np.array(np.unravel_index(int(window.argmax()), window.shape), dtype=np.float64) + low
    if (place <= low).any() or (place >= high).any():
        return nothing
    for _ in range(_ROUNDS):
        if (place < margin).any() or (place > shape - 1 - margin).any():
            return nothing
        place = _centroid(picture, place, sigma, margin)
    return place


def _centroid(picture: Image, place: NDArray[np.float64], sigma: float, margin: float) -> NDArray[np.float64]:
    """One step of the weighted centroid.

    Of a Gaussian dot of the weight's own size the step goes half of the way, so that it is doubled.
    """
    low, high = (np.rint(place + side * margin).astype(int) for side in (-1, 1))
    part = picture[low[0] : high[0] + 1, low[1] : high[1] + 1]
    y, x = (np.arange(a, b + 1) - p for a, b, p in zip(low, high, place, strict=True))
    edge = np.concatenate([part[0], part[-1], part[:, 0], part[:, -1]])
    weight = np.exp(-(y[:, None] ** 2 + x[None, :] ** 2) / (2 * sigma**2)) * np.maximum(part - np.median(edge), 0.0)
    total = float(weight.sum())
    if total <= 0:
        return np.full(2, np.nan)
    step = np.array([(weight.sum(axis=1) * y).sum(), (weight.sum(axis=0) * x).sum()]) / total
    return np.asarray(place + 2 * np.clip(step, -sigma, sigma))


@dataclass(frozen=True)
class DotPicture:
    """A pattern of modulator `slm` (0 or 1) that was shown, and its dots as they were seen.

    stage_m: the stage's setting. position_px: (dot, 2), NaN where there is none. width_px, reach_px: as of `find_dots`.
    """

    slm: int
    stage_m: float
    probes: Probes
    position_px: Floats
    width_px: float
    reach_px: float

    def dots(self, bias_px: Floats | None = None) -> Dots:
        """The data of a fit. bias_px: (dot, 2), from the places that rays predict to the places of the seen dots."""
        seen = self.position_px if bias_px is None else self.position_px - bias_px
        return Dots(self.slm, self.stage_m, self.probes.centre_m, self.probes.frequency, seen)


def dot_bias(
    rig: RigDescription, facts: BenchFacts, values: Floats, picture_shape: tuple[int, int], shot: DotPicture
) -> Floats:
    """Places of a shot's dots in its simulated picture less where rays say (dot, 2), px; NaN where none is found.

    values: of `geometry.NAMES`. picture_shape: of the picture turned back. The simulated camera isn't rotated, because
    a model of captures interpolates there; the result is.
    """
    straight = values.copy()
    straight[NAMES.index("rotation")] = 0.0
    capture, effects = simulated_capture(rig, facts, straight, picture_shape, shot)
    picture = Predictor(capture)(range(len(capture)), effects).signal.double().mean(dim=0).numpy()
    rays = predicted_px(straight, facts, shot.slm, shot.stage_m, shot.probes.centre_m, shot.probes.frequency)
    found: FoundDots = find_dots(picture, rays, shot.width_px, shot.reach_px)
    return np.asarray((found.position_px - rays) @ rotation_matrix(values[NAMES.index("rotation")]).T)


def simulated_capture(
    rig: RigDescription, facts: BenchFacts, values: Floats, picture_shape: tuple[int, int], shot: DotPicture
) -> tuple[Captures, dict[str, dict[str, float]]]:
    """Captures without pictures, whose mean the picture of a shot is, on the bench with the measured pitch; and their
    effects."""
    v = dict(zip(NAMES, values, strict=True))
    shown = turned(shot.probes.levels, facts.slm2_turn if shot.slm else "none")
    around = patterns_around(rig, shot.slm, shown, facts.wavelength_m)
    count = len(around)
    z = v["offset"] + (1 + v["scale"]) * shot.stage_m
    fields: dict[str, Any] = rig.bench.as_fields()
    fields["camera"] = replace(rig.bench.camera, pitch_m=float(np.exp(v["log_pitch"])))
    capture = Captures(
        levels=np.stack([rig.together(patterns) for patterns in around]),
        images=np.zeros((count, *picture_shape), np.uint16),
        wavelength_m=np.full(count, facts.wavelength_m),
        distance_m=np.full(count, z),
        power=np.ones(count),
        exposure_s=np.ones(count),
        lasers_m=rig.wavelengths_m,
        **fields,
    )
    return capture, geometry_effects(rig, v, [(n - 1) / 2 for n in picture_shape])


def patterns_around(rig: RigDescription, number: int, levels: Levels, wavelength_m: float) -> list[list[Levels]]:
    """Patterns of all modulators with these levels on the one that makes dots, whose pictures' mean is evaluated.

    number: of it among `RigDescription.dotted`.
    """
    around = settings_beside(rig, rig.dotted[number], wavelength_m)
    for patterns in around:
        patterns[rig.dotted[number]] = levels
    return around


def geometry_effects(
    rig: RigDescription, v: dict[str, float], middle_px: Sequence[float]
) -> dict[str, dict[str, float]]:
    """The effects of a geometry whose pitch and distances are the nominal ones. middle_px: (y, x) of the picture."""
    pitch = float(np.exp(v["log_pitch"]))
    effects = {
        "camera_alignment": {
            "shift_y": (v["centre_y"] - middle_px[0]) * pitch,
            "shift_x": (v["centre_x"] - middle_px[1]) * pitch,
            "rotation": v["rotation"],
        },
        "stage": {"walk_y": v["walk_y"], "walk_x": v["walk_x"]},
    }
    found = {"gap": v["gap"] - way_to_camera(rig, rig.dotted[0], rig.wavelengths_m[0]).gap_m}
    for name in sought_of_second(rig):
        effect, parameter = second_effect(rig, name)
        effects.setdefault(effect, {})[parameter] = found.get(name, v[name])
    return effects


_OF_SECOND = {"shift2_y": "shift_y", "shift2_x": "shift_x", "rotation2": "rotation", "magnification2": "magnification"}


def sought_of_second(rig: RigDescription) -> tuple[str, ...]:
    """Which of `NAMES` an alignment seeks of the second modulator that makes dots.

    An element of a chain isn't magnified; one beside another has no gap from it.
    """
    if len(rig.dotted) < 2:
        return ()
    if rig.bench.chain is None:
        return (*_OF_SECOND, "gap")
    return ("shift2_y", "shift2_x", "rotation2", *(["gap"] if rig.gap_space else []))


def second_effect(rig: RigDescription, name: str) -> tuple[str, str]:
    """The effect and its parameter that one of `sought_of_second` is."""
    if rig.bench.chain is None:
        return ("gap", "gap_error") if name == "gap" else ("slm_alignment", _OF_SECOND[name])
    if name == "gap":
        return f"gap{AT}{rig.gap_space}", "gap_error"
    return f"misplaced{AT}{rig.modulator_names[rig.dotted[1]]}", _OF_SECOND[name]
