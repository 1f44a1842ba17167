"""From the first dot to the geometry of the bench."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.captures.orientations import inverse_orientation, oriented_shape
from holoview.rig.align.dot_bias import Shot, dot_bias
from holoview.rig.align.dots import find_dots
from holoview.rig.align.geometry import NAMES, BenchFacts, DotErrors, Geometry, fit_geometry, predicted_px
from holoview.rig.align.pictures import AlignmentCancelled, PictureTaker
from holoview.rig.align.planes import COUNT, stage_settings
from holoview.rig.align.probes import Optics, Probes, flat_levels, grating, lens_array, optics_of
from holoview.rig.align.rough import SINGLE_DOTS, RoughPlace, find_roughly, fourier_carrier, rectified_centre
from holoview.rig.description import RigDescription
from holoview.rig.devices import DeviceError, Devices, Levels
from holoview.util.progress import ProgressCallback

_REACH = 0.45  # of the distance between dots
_LEAST_CONTRAST = 8.0  # over the noise
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
    """Where everything is. Turns are those of `captures.orientations`, against what modulator 1 displays.

    slm2_turn: of what modulator 2 displays; None with one modulator. camera_turn: of the recorded picture. geometry: in
    the picture turned back. picture_shape: of that picture. wavelength_m: of the laser. settings_m: of the stage.
    excess_px: how far dots lie from where the geometry puts them, beyond what noise explains (r.m.s. along an axis).
    """

    slm2_turn: str | None
    camera_turn: str
    geometry: Geometry
    picture_shape: tuple[int, int]
    wavelength_m: float
    settings_m: tuple[float, ...]
    excess_px: float = 0.0


def find_geometry(
    rig: RigDescription,
    devices: Devices,
    progress: ProgressCallback = lambda done, total, note: None,
    is_asked_to_end: Callable[[], bool] = lambda: False,
) -> FoundGeometry | None:
    """Finds where modulators and camera are; None if asked to end. The caller closes the devices.

    rig: as described, without a placement. devices: those of it, as they are. Raises DeviceError where dots aren't
    seen.
    """
    total = len(rig.bench.slms) * (SINGLE_DOTS + (1 + COUNT) * 4 * (1 + _is_fourier(rig)))
    try:
        return _Alignment(rig, devices, PictureTaker(rig, devices, total, progress, is_asked_to_end)).run()
    except AlignmentCancelled:
        return None


def laser_for_alignment(rig: RigDescription) -> float:
    """The longest wavelength of which the modulators reach a whole wave; the shortest one where there is none."""
    stroke = min(slm.opd_range_m for slm in rig.bench.slms)
    return max((λ for λ in rig.wavelengths_m if λ <= stroke), default=rig.wavelengths_m[0])


def _is_fourier(rig: RigDescription) -> bool:
    return rig.bench.focal_length_m is not None


class _Alignment:
    def __init__(self, rig: RigDescription, devices: Devices, pictures: PictureTaker) -> None:
        self._rig, self._pictures = rig, pictures
        self._raw_shape = devices.camera.shape
        self._λ = laser_for_alignment(rig)
        self._optics = [optics_of(rig, k, self._λ) for k in range(len(rig.bench.slms))]
        self._facts = BenchFacts(self._λ, rig.bench.focal_length_m, len(self._optics))
        self._camera_width_m = min(self._raw_shape) * rig.bench.camera.pitch_m

    def run(self) -> FoundGeometry:
        settings = stage_settings(self._rig, self._optics[-1])
        first = settings[len(settings) // 2] if self._facts.focal_length_m else settings[-1]  # where dots are brightest
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

    def _fitted(self, values: Floats, shots: Sequence[Shot], rounds: int) -> Geometry:
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
        """Of the picture turned back."""
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
            self._facts = BenchFacts(self._λ, None, 2, second.turn)
            shift = (second.centre_px - centre) * first.pitch_m
            v |= {"shift2_y": shift[0], "shift2_x": shift[1], "gap": self._rig.bench.gap_m or 0.0}
        return np.array([v[name] for name in NAMES])

    def _find_roughly(self, number: int, setting: float) -> RoughPlace:
        return find_roughly(
            self._optics[number],
            number + 1,
            setting + self._gap_behind(number),
            self._camera_width_m,
            lambda levels, note: self._pictures.take(self._patterns(number, levels), note),
        )

    def _shots_at(self, setting: float, values: Floats) -> list[Shot]:
        """The dots of all modulators at one setting of the stage. values: where they are expected."""
        setting = self._pictures.move_to(setting)
        geometry = dict(zip(NAMES, values, strict=True))
        z = geometry["offset"] + (1 + geometry["scale"]) * setting
        found = []
        for number, optics in enumerate(self._optics):
            distance = z + (geometry["gap"] if number + 1 < len(self._optics) else 0.0)
            own = [self._shot(number, setting, p, values) for p in self._probes(optics, distance)]
            if sum(int(np.isfinite(d.position_px).all(axis=1).sum()) for d in own) < _FEWEST_DOTS:
                raise DeviceError(
                    "camera",
                    f"sees too few dots of modulator {number + 1} with the stage at {setting * 1e3:.4g} mm",
                    remedy="look whether the camera sees the whole modulator there",
                )
            found += own
        return found

    def _probes(self, optics: Optics, distance_m: float) -> list[Probes]:
        if optics.focal_length_m is None:
            return [lens_array(optics, distance_m, (y * optics.carrier, x * optics.carrier)) for y, x in _CARRIERS]
        ν = fourier_carrier(optics, self._camera_width_m)
        whole = [grating(optics, (y * ν, x * ν)) for y, x in _DIAGONALS]
        return whole + [
            grating(optics, (y * ν, -x * ν), part) for part, (y, x) in zip(_CARRIERS, _DIAGONALS, strict=True)
        ]

    def _shot(self, number: int, setting: float, probes: Probes, values: Floats) -> Shot:
        """Shows one pattern and finds its dots."""
        picture = self._pictures.take(self._patterns(number, probes.levels), f"dots of modulator {number + 1}")
        facts, pitch = self._facts, float(np.exp(values[NAMES.index("log_pitch")]))
        expected = predicted_px(values, facts, number, setting, probes.centre_m, probes.frequency)
        apart = probes.spacing_m
        if facts.focal_length_m is not None:
            apart = float(np.hypot(*probes.frequency[0])) * facts.wavelength_m * facts.focal_length_m
        found = find_dots(picture, expected, probes.width_m / pitch, _REACH * apart / pitch)
        position = np.where((found.contrast >= _LEAST_CONTRAST)[:, None], found.position_px, np.nan)
        return Shot(number, setting, probes, position, probes.width_m / pitch, _REACH * apart / pitch)

    def _patterns(self, number: int, levels: Levels) -> list[Levels]:
        """One modulator shows these, the other one nothing."""
        return [levels if k == number else flat_levels(optics) for k, optics in enumerate(self._optics)]

    def _gap_behind(self, number: int) -> float:
        return (self._rig.bench.gap_m or 0.0) if number + 1 < len(self._optics) else 0.0
