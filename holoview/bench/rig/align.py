"""From the first dot to the geometry of the bench.

find_geometry    the whole alignment
PictureTaker     takes its pictures: patterns in, light per second out
find_roughly     orientation and rough place of a modulator on the camera, from single dots, without prior knowledge
stage_settings   the stage's settings at which dots are measured
registration_of  the registration of the devices that follows from the geometry; sentences: the findings, for people
check_plan       a few captures, by which the registration is checked
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.dataset import (
    inverse_orientation,
    join_captures,
    nearest_orientation,
    orientation_matrix,
    oriented_shape,
    undone,
)
from holoview.bench.captures.patterns import BLUR_SIGMAS_PX
from holoview.bench.captures.records import RecordFindings, find_record_errors
from holoview.bench.captures.records.corrections import ORIENTATION_WORDS
from holoview.bench.rig.camera_pictures import take_exposed
from holoview.bench.rig.capture_plan import CapturePlan, default_plan
from holoview.bench.rig.description import RigDescription
from holoview.bench.rig.devices import DeviceError, Devices, Levels
from holoview.bench.rig.dots import (
    DOTS_ACROSS,
    FEWEST_PX,
    NAMES,
    BenchFacts,
    DotErrors,
    DotPicture,
    Geometry,
    Optics,
    Probes,
    brightest_dot,
    dot_bias,
    find_dots,
    fit_geometry,
    flat_levels,
    grating,
    lens_array,
    optics_of,
    patterns_around,
    predicted_px,
    single_lens,
    sought_of_second,
)
from holoview.bench.rig.measurement import Measurement
from holoview.bench.rig.rays import arms_beside, mask_in_the_light, way_to_camera
from holoview.bench.rig.registration import Registration, UncertainValue
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.progress import ProgressCallback
from holoview.util.units import format_rounded

_REACH = 0.45  # of the distance between dots
_LEAST_CONTRAST = 8.0  # over the noise; 4.5 is the highest of 10⁵ independent pixels of pure noise
_MOST_ROUNDS, _CONVERGED = 4, 1.0  # of simulated pictures; standard deviations between two of them
# Errors that dots share, of simulated beside measured pictures, on 36 hidden placements (benchmarks/rig_alignment.py).
# Those of a Fourier bench were measured while a rotated camera's picture was interpolated cubically: since then, values
# of 5 placements are off by a third of what is stated. The second number is the scatter of dots there, the largest but
# for one of 17 Fourier benches with 0.047.
_NEAR_FIELD_ERRORS, _FOURIER_ERRORS = DotErrors(0.005, 0.018), DotErrors(0.03, 0.036)
_FEWEST_DOTS = 3  # of a modulator at one setting
_CARRIERS = ((1, 0), (-1, 0), (0, 1), (0, -1))
_DIAGONALS = ((1, 1), (-1, 1), (1, -1), (-1, -1))
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FoundGeometry:
    """The geometry as found. Turns are those of `captures.dataset: ORIENTATIONS`, against the picture on modulator 1.

    slm2_turn: of the picture on modulator 2; None with one modulator. camera_turn: of the recorded picture. geometry:
    in the picture turned back. picture_shape: of that picture. wavelength_m: of the laser. settings_m: of the stage.
    excess_px: distance of dots from their places by the geometry, beyond that by noise (r.m.s. along an axis).
    """

    slm2_turn: str | None
    camera_turn: str
    geometry: Geometry
    picture_shape: tuple[int, int]
    wavelength_m: float
    settings_m: tuple[float, ...]
    excess_px: float = 0.0


def find_geometry(
    rig: RigDescription, devices: Devices, progress: ProgressCallback = lambda done, total, note: None
) -> FoundGeometry:
    """Finds where modulators and camera are. The caller closes the devices.

    rig: as described, without a registration. devices: its open devices. Raises DeviceError where dots aren't seen.
    """
    require_dots(rig)
    total = len(rig.dotted) * (SINGLE_DOTS + (1 + COUNT) * 4 * (1 + _is_fourier(rig)))
    return _Alignment(rig, devices, PictureTaker(rig, devices, total, progress)).run()


def require_dots(rig: RigDescription) -> None:
    """Raises UserError for a chain whose modulators make no dots that tell where they are."""
    if rig.bench.chain is None:
        return
    names, where = [rig.modulator_names[number] for number in rig.dotted], f"{rig.path}: chain"
    remedy = "`holoview diagnose` finds what is out of place from captures"
    if mask := mask_in_the_light(rig):
        raise UserError(where, mask, expected="dots that no speckle hides", remedy=remedy)
    if len(names) > 2:
        raise UserError(where, f"{', '.join(names)} make dots", expected="at most two modulators", remedy=remedy)
    found = [optics_of(rig, number, laser_for_alignment(rig)) for number in rig.dotted]
    if len({own.focal_length_m is None for own in found}) > 1:
        text = f"{' and '.join(names)} before and behind a Fourier element"
        raise UserError(where, text, expected="modulators that the camera sees alike", remedy=remedy)
    for name, own in zip(names, found, strict=True):
        if min(own.shape) < FEWEST_PX * DOTS_ACROSS:
            least = FEWEST_PX * DOTS_ACROSS
            raise UserError(where, f"{name} of {min(own.shape)} pixels", expected=f"{least} or more", remedy=remedy)
        if own.way.has_lens:
            raise UserError(where, f"a lens behind {name}", expected="spaces and Fourier elements", remedy=remedy)


def laser_for_alignment(rig: RigDescription) -> float:
    """The longest wavelength of which the modulators reach a whole wave; the shortest one where there is none."""
    strokes = (slm.opd_range_m for slm in rig.bench.slms if slm.opd_range_m or rig.bench.chain is None)
    stroke = min(strokes, default=math.inf)
    return max((λ for λ in rig.wavelengths_m if λ <= stroke), default=rig.wavelengths_m[0])


def _is_fourier(rig: RigDescription) -> bool:
    return way_to_camera(rig, rig.dotted[0], rig.wavelengths_m[0]).focal_length_m is not None


class _Alignment:
    def __init__(self, rig: RigDescription, devices: Devices, pictures: PictureTaker) -> None:
        self._rig, self._pictures = rig, pictures
        self._raw_shape = devices.camera.shape
        self._λ = laser_for_alignment(rig)
        self._optics = [optics_of(rig, number, self._λ) for number in rig.dotted]
        self._words = [rig.slm_words[number] for number in rig.dotted]
        ways = tuple(optics.way for optics in self._optics)
        self._facts = BenchFacts(self._λ, ways, second=sought_of_second(rig))
        self._camera_width_m = min(self._raw_shape) * rig.bench.camera.pitch_m

    def run(self) -> FoundGeometry:
        settings = stage_settings(self._rig, self._optics[-1])
        first = settings[len(settings) // 2] if _is_fourier(self._rig) else settings[-1]  # where dots are brightest
        self._pictures.light(self._λ)
        values = self._rough_values(first)
        values = self._fitted(values, self._shots_at(first, values), rounds=1).values
        shots = [shot for setting in settings for shot in self._shots_at(setting, values)]
        geometry = self._fitted(values, shots, _MOST_ROUNDS)
        return FoundGeometry(
            self._facts.slm2_turn if len(self._optics) == 2 else None,
            self._pictures.camera_turn,
            geometry,
            self._picture_shape,
            self._λ,
            tuple(settings),
            self._errors.excess_px(geometry.residual_px),
        )

    def _fitted(self, values: Floats, shots: Sequence[DotPicture], rounds: int) -> Geometry:
        """The geometry that explains the dots, where rays put them, then where the model of captures does."""
        before = geometry = fit_geometry(values, self._facts, [shot.dots() for shot in shots])
        for number in range(rounds):
            self._pictures.report(f"comparing with simulated pictures, {number + 1} of up to {rounds}")
            values, before = geometry.values, geometry
            biases = [dot_bias(self._rig, self._facts, values, self._picture_shape, shot) for shot in shots]
            dots = [shot.dots(bias) for shot, bias in zip(shots, biases, strict=True)]
            geometry = fit_geometry(values, self._facts, dots, self._errors)
            if geometry.is_near(before, _CONVERGED):
                break
        return geometry.uncertain_by(before)

    @property
    def _errors(self) -> DotErrors:
        return _FOURIER_ERRORS if _is_fourier(self._rig) else _NEAR_FIELD_ERRORS

    @property
    def _picture_shape(self) -> tuple[int, int]:
        """Shape of the picture turned back."""
        return oriented_shape(self._raw_shape, inverse_orientation(self._pictures.camera_turn))

    def _rough_values(self, setting: float) -> Floats:
        """Finds the turns; returns the first values of a fit."""
        setting = self._pictures.move_to(setting)
        first = self._find_roughly(0, setting)
        self._pictures.camera_turn = first.turn
        v = dict.fromkeys(NAMES, 0.0)
        centre = rectified_centre(first.centre_px, self._raw_shape, first.turn)
        v |= {"centre_y": centre[0], "centre_x": centre[1], "log_pitch": float(np.log(first.pitch_m))}
        if len(self._optics) == 2:
            second = self._find_roughly(1, setting)
            self._facts = replace(self._facts, slm2_turn=second.turn)
            shift = (second.centre_px - centre) * first.pitch_m
            v |= {"shift2_y": shift[0], "shift2_x": shift[1], "gap": self._facts.ways[0].gap_m}
        return np.array([v[name] for name in NAMES])

    def _find_roughly(self, number: int, setting: float) -> RoughPlace:
        return find_roughly(
            self._optics[number],
            self._words[number],
            setting,
            self._camera_width_m,
            lambda levels, note: self._picture(number, levels, note),
        )

    def _shots_at(self, setting: float, values: Floats) -> list[DotPicture]:
        """The dots of all modulators at one setting of the stage. values: where they are expected."""
        setting = self._pictures.move_to(setting)
        geometry = dict(zip(NAMES, values, strict=True))
        z = geometry["offset"] + (1 + geometry["scale"]) * setting
        found = []
        for number, optics in enumerate(self._optics):
            probes, beside = self._probes(optics, z, geometry["gap"]), self._light_beside(number)
            own = [self._shot(number, setting, p, values, beside) for p in probes]
            if sum(int(np.isfinite(d.position_px).all(axis=1).sum()) for d in own) < _FEWEST_DOTS:
                raise DeviceError(
                    "camera",
                    f"sees too few dots of {self._words[number]} with the stage at {setting * 1e3:.4g} mm",
                    remedy="look whether the camera sees the whole modulator there",
                )
            found += own
        return found

    def _probes(self, optics: Optics, distance_m: float, gap_m: float) -> list[Probes]:
        if optics.focal_length_m is None:
            seen_m = optics.seen_m(distance_m, gap_m)
            return [lens_array(optics, seen_m, (y * optics.carrier, x * optics.carrier)) for y, x in _CARRIERS]
        ν = fourier_carrier(optics, self._camera_width_m)
        whole = [grating(optics, (y * ν, x * ν)) for y, x in _DIAGONALS]
        return whole + [
            grating(optics, (y * ν, -x * ν), part) for part, (y, x) in zip(_CARRIERS, _DIAGONALS, strict=True)
        ]

    def _light_beside(self, number: int) -> Floats | float:
        """The light of other arms of an interferometer, which all dots stand on: half of that of flat arms."""
        if not arms_beside(self._rig, self._rig.modulator_names[self._rig.dotted[number]]):
            return 0.0
        return 0.5 * self._picture(number, flat_levels(self._optics[number]), f"{self._words[number]} flat")

    def _shot(self, number: int, setting: float, probes: Probes, values: Floats, beside: Floats | float) -> DotPicture:
        """Shows one pattern and finds its dots, without the light beside."""
        picture = self._picture(number, probes.levels, f"dots of {self._words[number]}") - beside
        facts, pitch = self._facts, float(np.exp(values[NAMES.index("log_pitch")]))
        expected = predicted_px(values, facts, number, setting, probes.centre_m, probes.frequency)
        apart, focal_length_m = probes.spacing_m, self._optics[number].focal_length_m
        if focal_length_m is not None:
            apart = float(np.hypot(*probes.frequency[0])) * facts.wavelength_m * abs(focal_length_m)
        found = find_dots(picture, expected, probes.width_m / pitch, _REACH * apart / pitch)
        position = np.where((found.contrast >= _LEAST_CONTRAST)[:, None], found.position_px, np.nan)
        return DotPicture(number, setting, probes, position, probes.width_m / pitch, _REACH * apart / pitch)

    def _picture(self, number: int, levels: Levels, note: str) -> Floats:
        """The picture of these levels on one modulator, while the others let all light through."""
        around = patterns_around(self._rig, number, levels, self._λ)
        return np.asarray(np.mean([self._pictures.take(patterns, note) for patterns in around], axis=0))


_FIRST_EXPOSURE_S = 1e-2
_BRIGHT_PIXELS = 3  # may saturate: hot ones


class PictureTaker:
    """Shows patterns and takes pictures with one laser. camera_turn: pictures are turned back by it.

    total: number of pictures in all, for the progress.
    """

    def __init__(self, rig: RigDescription, devices: Devices, total: int, progress: ProgressCallback) -> None:
        self._rig, self._devices, self._total = rig, devices, total
        self._progress, self._done, self._exposure_s = progress, 0, _FIRST_EXPOSURE_S
        self.camera_turn = "none"

    def light(self, wavelength_m: float) -> None:
        """Switches a laser on, at the highest power that is allowed, or its nominal one if that is less."""
        self._devices.lasers.switch_on(wavelength_m, min(self._rig.limits.power, 1.0))

    def move_to(self, stage_m: float) -> float:
        """Moves the stage; returns the setting that it reports."""
        return self._devices.stage.move_to(stage_m)

    def report(self, note: str) -> None:
        """Reports the next step."""
        self._progress(self._done, self._total, note)

    def take(self, levels: Sequence[Levels], note: str) -> NDArray[np.float64]:
        """The picture (y, x) of these patterns, one of each modulator, in counts per second above the black level."""
        self.report(note)
        for modulator, own in zip(self._devices.modulators, levels, strict=True):
            modulator.show(own)
        self._devices.clock.wait(max(modulator.settle_s for modulator in self._devices.modulators))
        camera, facts = self._devices.camera, self._rig.bench.camera
        quantile = 1 - _BRIGHT_PIXELS / (camera.shape[0] * camera.shape[1])
        counts, self._exposure_s = take_exposed(camera, facts, self._exposure_s, quantile)
        self._done += 1
        return undone((counts - facts.black_level) / self._exposure_s, self.camera_turn)


_PLACES = ((-0.28, -0.25), (-0.22, 0.27), (0.27, -0.2), (0.23, 0.28), (0.05, -0.03))  # shares of height and width
_FOURIER_REACH = 0.25  # share of the camera's width within which dots are put

_LARGEST_MISFIT = 0.15  # of the dots' extent, from a mirrored, turned and scaled copy of the pattern
SINGLE_DOTS = len(_PLACES) + 1
"""Pictures that it takes."""


TakePicture = Callable[[Levels, str], Floats]


@dataclass(frozen=True)
class RoughPlace:
    """turn: of the pattern in the picture. pitch_m: of the camera, seen from the modulator. centre_px: (y, x)."""

    turn: str
    pitch_m: float
    centre_px: Floats


def find_roughly(optics: Optics, words: str, distance_m: float, camera_width_m: float, take: TakePicture) -> RoughPlace:
    """Shows dots one by one on one modulator. take: the picture of its pattern, the other modulators being flat.

    words: for it, in messages. distance_m: of the camera, nominally. camera_width_m: of the shorter side.
    Raises DeviceError where the dots aren't seen, or not where any place of the camera could have them.
    """
    dark = take(flat_levels(optics), f"{words} flat")
    probes = _single_dots(optics, distance_m, camera_width_m)
    width_px = probes[0].width_m / (camera_width_m / min(dark.shape))
    found = [brightest_dot(take(p.levels, f"dot on {words}") - dark, width_px) for p in probes]
    seen = [k for k, (_, contrast) in enumerate(found) if contrast >= _LEAST_CONTRAST]
    if len(seen) < len(probes) - 1:
        raise DeviceError(
            "camera",
            f"sees {len(seen)} of the {len(probes)} dots that {words} showed",
            remedy="look whether the laser's light reaches the camera, whether the camera sees the whole modulator, "
            "and whether the modulator's table, [lasers] and [geometry] of rig.toml are as on the bench",
        )
    shown = np.concatenate([_nominal_point(p, optics, distance_m) for p in probes])[seen]
    return _place(shown, np.array([found[k][0] for k in seen]), words)


def _single_dots(optics: Optics, distance_m: float, camera_width_m: float) -> list[Probes]:
    if optics.focal_length_m is None:
        extent = np.array(optics.shape) * optics.slm.pitch_m
        seen_m = optics.seen_m(distance_m)
        return [single_lens(optics, (y * extent[0], x * extent[1]), seen_m) for y, x in _PLACES]
    reach = fourier_carrier(optics, camera_width_m) / max(abs(share) for place in _PLACES[:-1] for share in place)
    places = [*_PLACES[:-1], (0.0, 0.25)]
    return [grating(optics, (y * reach, x * reach)) for y, x in places]


def fourier_carrier(optics: Optics, camera_width_m: float) -> float:
    """Spatial frequency (1/m) whose dot lies well on the camera of a Fourier bench."""
    assert optics.focal_length_m is not None
    on_camera = _FOURIER_REACH * camera_width_m / (optics.wavelength_m * abs(optics.focal_length_m))
    return min(optics.carrier, on_camera)


def _nominal_point(probes: Probes, optics: Optics, distance_m: float) -> Floats:
    """Where the dots of a probe without a carrier, or on a Fourier bench, lie nominally (dot, 2), m."""
    if optics.focal_length_m is None:
        return optics.way.matrix(distance_m)[0] * (probes.centre_m + np.array(optics.way.offset_m))
    return optics.focal_length_m * optics.wavelength_m * probes.frequency


def _place(shown_m: Floats, seen_px: Floats, words: str) -> RoughPlace:
    """Turn, scale and shift from shown to seen places (dot, 2), without the worst dot if that helps."""
    best: tuple[float, Floats] | None = None
    for left_out in [None, *range(len(shown_m))] if len(shown_m) > 4 else [None]:
        kept = [k for k in range(len(shown_m)) if k != left_out]
        design = np.column_stack([shown_m[kept], np.ones(len(kept))])
        solution, *_ = np.linalg.lstsq(design, seen_px[kept], rcond=None)
        misfit = float(np.abs(design @ solution - seen_px[kept]).max())
        if best is None or misfit < 0.3 * best[0]:
            best = (misfit, np.asarray(solution, dtype=np.float64))
    assert best is not None
    misfit, solution = best
    matrix = solution[:2].T
    turn, extent = nearest_orientation(matrix), float(np.ptp(seen_px, axis=0).max())
    scale = float((orientation_matrix(turn) * matrix).sum()) / 2
    skew = float(np.abs(matrix - scale * orientation_matrix(turn)).max())
    if scale <= 0 or misfit > _LARGEST_MISFIT * extent or skew > 2 * _LARGEST_MISFIT * scale:
        raise DeviceError(
            "camera",
            f"sees the dots of {words} where no mirrored, turned or shifted picture of them has them",
            remedy="look for reflections and for other light, and whether the camera sees the whole modulator",
        )
    return RoughPlace(turn, 1 / scale, solution[2])


def rectified_centre(centre_px: Floats, raw_shape: Sequence[int], camera_turn: str) -> Floats:
    """A place (y, x) on the raw picture as one on the picture turned back."""
    middle = (np.array(raw_shape) - 1) / 2
    turned_back = orientation_matrix(camera_turn).T @ (centre_px - middle)
    shape = np.abs(orientation_matrix(camera_turn).T) @ np.array(raw_shape)
    return np.asarray(turned_back + (shape - 1) / 2)


COUNT = 3
_NEAREST = 0.35  # of the farthest plane
_DEPTHS_OF_FOCUS = 4.0


def stage_settings(rig: RigDescription, optics: Optics) -> list[float]:
    """Ascending settings, m: where lenslets of the last modulator make small dots, within the safety limits.

    On a Fourier bench they lie within a few depths of focus. One setting where the stage can't move.
    """
    low, high = rig.limits.stage_m
    if optics.focal_length_m is not None:
        extent = min(optics.shape) * optics.slm.pitch_m
        reach, focus = (
            _DEPTHS_OF_FOCUS * optics.wavelength_m * (optics.focal_length_m / extent) ** 2,
            optics.way.focus_m,
        )
        near, far = float(np.clip(focus - reach, low, high)), float(np.clip(focus + reach, low, high))
    else:
        slope, before = optics.sine, optics.seen_m(0.0)
        far = float(np.clip(min(optics.shape) / DOTS_ACROSS * optics.slm.pitch_m / slope - before, low, high))
        near = max(low, _NEAREST * (far + before) - before)
        least = FEWEST_PX * optics.slm.pitch_m / (2 * slope) - before
        if far < least:
            found, expected = (units.format_rounded(z, "mm", 3) for z in (far, least))
            raise UserError(
                "stage",
                f"goes no farther than {found}",
                expected=f"a distance of {expected}, at which lenslets of 6 pixels focus",
                remedy="move the stage, or change [limits] in rig.toml",
            )
        near = min(max(near, least), far)
    return sorted({round(float(z), 9) for z in np.linspace(near, far, COUNT)})


# --- registration and check -------------------------------------------------------------------------------------------


_LEAST_SHARE = 0.5  # of the modulator's height and width that the camera has to see
_COMMON_ERROR_PX = 0.03  # of all dots: pixels of unequal sensitivity, sampling of the picture
_SECOND = {
    "slm2_shift_y": "shift2_y",
    "slm2_shift_x": "shift2_x",
    "slm2_rotation": "rotation2",
    "slm2_magnification": "magnification2",
}


def registration_of(rig: RigDescription, found: FoundGeometry) -> Registration:
    """The registration of a rig's devices. Raises DeviceError where the camera sees too little of the modulator."""
    g, rig = found.geometry, rig.as_described
    pitch = math.exp(g["log_pitch"])
    offset, scale = (_unless_nominal(g, name) for name in ("offset", "scale"))
    middle_m = offset.value + (1 + scale.value) * sum(rig.stage_m) / 2
    first, shape, shift = [], [], []
    for axis, name in enumerate("yx"):
        centre = g[f"centre_{name}"]
        wanted = found.picture_shape[axis]
        if not _is_fourier(rig):
            chain = rig.bench.chain
            width_m = rig.slm_shape[axis] * rig.bench.slms[0].pitch_m
            width_m = width_m if chain is None else chain.way.shape[axis] * chain.way.sample_m
            wanted = round(width_m / pitch)
        begin, count = _crop(centre + g[f"walk_{name}"] * middle_m / pitch, found.picture_shape[axis], wanted)
        first.append(begin)
        shape.append(count)
        shift.append((centre - begin - (count - 1) / 2) * pitch)
    values = {
        "pitch": UncertainValue(pitch, pitch * g.uncertainty("log_pitch")),
        "rotation": _measured(g, "rotation"),
        **{f"shift_{n}": UncertainValue(own, _centre_error(g, n) * pitch) for n, own in zip("yx", shift, strict=True)},
        **{name: _measured(g, name) for name in ("walk_y", "walk_x")},
        "stage_offset": offset,
        "stage_scale": scale,
    }
    sought = sought_of_second(rig)
    values |= {name: _measured(g, own) for name, own in _SECOND.items() if own in sought}
    if "gap" in sought:
        nominal_m = way_to_camera(rig, rig.dotted[0], found.wavelength_m).gap_m
        values["gap_error"] = UncertainValue(g["gap"] - nominal_m, g.uncertainty("gap"))
    return Registration(
        found.camera_turn,
        found.slm2_turn,
        (first[0], first[1]),
        (shape[0], shape[1]),
        rig.slm_shape,
        rig.camera_shape,
        values,
        rig.aligned_elements,
    )


def _crop(centre: float, whole: int, wanted: int) -> tuple[int, int]:
    """First pixel and number of pixels of the part around a centre, as much of the wanted ones as there are."""
    count = min(wanted, math.floor(2 * min(centre + 0.5, whole - 0.5 - centre)))
    if count < _LEAST_SHARE * min(wanted, whole):
        found = f"has the middle of the modulators at pixel {centre:.0f} of {whole}"
        raise DeviceError("camera", found, remedy="move the camera until it sees the whole modulator")
    return int(np.clip(round(centre - (count - 1) / 2), 0, whole - count)), count


def _measured(g: Geometry, name: str) -> UncertainValue:
    return UncertainValue(g[name], g.uncertainty(name))


def _unless_nominal(g: Geometry, name: str) -> UncertainValue:
    """A measured value; zero, its nominal value, with the same uncertainty where it doesn't differ significantly."""
    found = _measured(g, name)
    return found if found.is_significant else UncertainValue(0.0, found.uncertainty)


def _centre_error(g: Geometry, axis: str) -> float:
    """Pixels."""
    return math.hypot(g.uncertainty(f"centre_{axis}"), _COMMON_ERROR_PX)


def misfit_warning(found: FoundGeometry) -> str | None:
    """A sentence where dots show that modulators or camera aren't as described."""
    if found.excess_px == 0:
        return None
    return (
        f"Dots lie {found.geometry.residual_px:.2g} pixels from where they should (r.m.s.), more than noise makes: "
        "modulators or camera aren't what rig.toml says, which makes distances less certain. A diagnosis tells more."
    )


def sentences(registration: Registration) -> list[str]:
    """A registration in sentences."""
    p, second = registration, registration.slm2_turn
    (row, column), (one, other) = p.first, p.words
    result = [
        f"The camera's picture is {_turned(p.camera_turn)}.",
        f"Turned back, rows {row} … {row + p.shape[0] - 1} and columns {column} … {column + p.shape[1] - 1} of it are "
        f"centred on {one}, up to {_pm(p, 'shift_y', 'um')} (y) and {_pm(p, 'shift_x', 'um')} (x).",
        f"A pixel of the camera is {_pm(p, 'pitch', 'um')} wide in the modulator's plane; the picture is turned by "
        f"{_pm(p, 'rotation', 'mrad')}.",
        f"Where the stage says 0, the camera is {_pm(p, 'stage_offset', 'mm')} behind the last modulator, and it moves "
        f"by {1 + p['stage_scale']:.5f} ± {p.values['stage_scale'].uncertainty:.1g} of what is set.",
        f"Its rail is {_pm(p, 'walk_y', 'mrad')} (y) and {_pm(p, 'walk_x', 'mrad')} (x) from the axis.",
    ]
    if second is not None:
        moved = (
            f"It is shifted by {_pm(p, 'slm2_shift_y', 'um')} (y) and {_pm(p, 'slm2_shift_x', 'um')} (x), turned by "
        )
        moved += _pm(p, "slm2_rotation", "mrad")
        if "slm2_magnification" in p.values:
            size = p.values["slm2_magnification"]
            moved += f" and magnified by {100 * size.value:.3g} ± {100 * size.uncertainty:.1g} %"
        result += [f"What {other} displays is {_turned(second)}, against {one}.", f"{moved}."]
        if "gap_error" in p.values:
            result.append(f"The gap between the modulators is {_pm(p, 'gap_error', 'mm')} longer than stated.")
    return result


def _turned(turn: str) -> str:
    return ORIENTATION_WORDS.get(turn, "the right way up")


def _pm(registration: Registration, name: str, unit: str) -> str:
    found = registration.values[name]
    number, _ = format_rounded(found.value, unit, 5).split()
    return f"{number} ± {format_rounded(found.uncertainty, unit, 2)}"


_OF_EACH = 2  # captures of each laser and plane


def check_plan(rig: RigDescription) -> CapturePlan:
    """The smoothest captures of each laser and plane of the default plan."""
    smoothest = np.sort(BLUR_SIGMAS_PX)[-_OF_EACH:]
    count: dict[tuple[float, float], int] = {}
    requests = []
    for request in default_plan(rig).requests:
        condition = request.wavelength_m, request.distance_m
        if request.sigma_px in smoothest and count.get(condition, 0) < _OF_EACH:
            count[condition] = count.get(condition, 0) + 1
            requests.append(request)
    return CapturePlan(tuple(requests))


def check_rig_records(
    rig: RigDescription, devices: Devices, progress: ProgressCallback = lambda done, total, note: None
) -> RecordFindings:
    """Takes two captures of every laser and plane, and checks their records.

    rig: with its registration. devices: its open ones, registered.
    """
    measurement, requests, taken = Measurement(rig, devices), check_plan(rig).requests, []
    for done, request in enumerate(requests):
        progress(done, len(requests), f"{request.wavelength_m * 1e9:.0f} nm, {request.distance_m * 1e3:.3g} mm")
        taken.append(measurement.take(request, request.levels(rig)))
    progress(len(requests), len(requests), "")
    known = {} if rig.registration is None else rig.registration.known_effects()
    return find_record_errors(join_captures(taken), known)
