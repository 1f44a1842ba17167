"""Capture files of a virtual bench by plain numpy: nothing here knows holoview, its sampling or its padding.

Every modulator pixel is `fine` × `fine` samples of one phase, fields lie in a window some times as large as the
modulators, everything is complex128, and a camera pixel integrates the samples that it covers. The file is written with
h5py, attribute by attribute, as a laboratory would from the format's description.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from tests.diagnose.independent_camera import CameraFaults
from tests.diagnose.independent_modulators import LightFaults, ModulatorFaults

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]

_POINTS = 16  # along each axis of a sample of a turned modulator: 4 leave χ²/n of 2.5 at the truth, 16 1.4
_FULL_WELL = 16000.0  # electrons
_READ_NOISE, _BLACK, _BITS = 3.0, 64.0, 12


@dataclass(frozen=True)
class Stop:
    """A relay's aperture, by direction sines: round, or square with sides along rows and columns.

    iris: radius. half_side: of a square. order_at_m: instead, a square as wide as the modulators' first order at this
    wavelength; 0: at every wavelength. centre: (y, x).
    """

    iris: float | None = None
    half_side: float | None = None
    order_at_m: float | None = None
    centre: tuple[float, float] = (0.0, 0.0)

    def passes(self, sine_y: Floats, sine_x: Floats, wavelength_m: float, pitch_m: float, fault: StopFault) -> Floats:
        """1 inside, 0 outside, for sines (rows, 1) and (1, columns). A square's edge, which blocks, is a hair inwards,
        so that rounding doesn't decide about frequencies on it."""
        y, x = (s - c - moved for s, c, moved in zip((sine_y, sine_x), self.centre, fault.moved, strict=True))
        inside = np.ones(np.broadcast_shapes(y.shape, x.shape))
        if self.iris is not None:
            inside = inside * (y**2 + x**2 <= (fault.size * self.iris) ** 2)
        half = self.half_side if self.order_at_m is None else (self.order_at_m or wavelength_m) / (2 * pitch_m)
        if half is not None:
            inside = inside * (np.maximum(abs(y), abs(x)) < fault.size * half * (1 - 1e-9))
        return inside

    def attributes(self, number: int) -> dict[str, object]:
        """What the file says of it."""
        found: dict[str, object] = {}
        if self.iris is not None:
            found[f"iris{number}_na"] = self.iris
        if self.half_side is not None:
            found[f"square{number}"] = self.half_side
        if self.order_at_m is not None:
            found[f"square{number}"] = "first order" + (f" at {self.order_at_m * 1e9:.0f} nm" * bool(self.order_at_m))
        if any(self.centre):
            found[f"centre{number}_na"] = self.centre
        return found


@dataclass(frozen=True)
class StopFault:
    """A stop so many times as large, and moved by direction sines (y, x)."""

    size: float = 1.0
    moved: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Faults:
    """What is wrong with the bench; SI units, modulator pixels for shifts. Everything zero: as the file says."""

    gap_m: float = 0.0
    distance_m: float = 0.0
    missed_m: tuple[float, ...] = ()  # by how much each of the laboratory's planes is further away
    stroke: float = 0.0  # relative, both modulators
    shift_px: tuple[float, float] = (0.0, 0.0)  # modulator 2, (y, x); multiples of 1/fine
    turn_rad: float = 0.0  # modulator 2, about its middle, from x towards y
    crosstalk_px: float = 0.0  # Gaussian σ of the optical paths
    tilt_rad: tuple[float, float] = (0.0, 0.0)
    stops: tuple[StopFault, StopFault] = (StopFault(), StopFault())
    black: float = 0.0  # counts
    modulators: ModulatorFaults = field(default_factory=ModulatorFaults)
    light: LightFaults = field(default_factory=LightFaults)
    camera: CameraFaults = field(default_factory=CameraFaults)
    frames_to_settle: float = 0.0  # time constant of the liquid crystals, in times from capture to capture
    vortex: float = 0.0  # a spiral phase on modulator 1, turns: no effect of the library


@dataclass(frozen=True)
class Mishaps:
    """What went wrong with single captures, by index, while all others are as recorded.

    exchanged: pairs whose pictures were stored under each other's name. other_pattern: the modulators showed patterns
    that were never recorded. dark: a closed shutter. overexposed: so many times too long. moved: the camera by (y, x)
    modulator pixels, multiples of 1/fine. defocused: the camera by so many metres. noisy: more read noise, counts.
    repeated: the picture of another capture once more, {capture: of which}; with `whole`, its record too.
    """

    exchanged: tuple[tuple[int, int], ...] = ()
    other_pattern: tuple[int, ...] = ()
    dark: tuple[int, ...] = ()
    overexposed: Mapping[int, float] = field(default_factory=dict)
    moved: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    defocused: Mapping[int, float] = field(default_factory=dict)
    noisy: Mapping[int, float] = field(default_factory=dict)
    repeated: Mapping[int, int] = field(default_factory=dict)
    whole: bool = False


@dataclass(frozen=True)
class Laboratory:
    """The bench as the file describes it. camera: pixels of the camera a modulator pixel and axis."""

    shape: tuple[int, int] = (32, 40)
    pitch_m: float = 8e-6
    levels: int = 16
    opd_m: float = 825e-9
    gap_m: float = 1e-3
    distance_m: float = 4e-3
    planes_m: tuple[float, ...] = ()  # distances that captures take in turn, instead
    exposure_s: float = 0.0  # of all captures; 0: of each as long as its light allows
    stops: tuple[Stop, Stop] = (Stop(iris=0.03), Stop(iris=0.03))
    wavelengths_m: tuple[float, ...] = (450e-9, 600e-9)
    each: int = 6
    smoothness_px: tuple[float, ...] = (4.0, 2.5, 1.5, 0.8)
    fine: int = 4
    window: int = 3  # sides of the fields' window over those of the modulators, odd: another padding than the model's
    camera: int = 2
    seed: int = 0
    faults: Faults = field(default_factory=Faults)
    mishaps: Mishaps = field(default_factory=Mishaps)


def write_session(path: Path, lab: Laboratory) -> Path:
    """Measures the bench and writes the capture file."""
    rng = np.random.default_rng(lab.seed)
    wavelength = np.repeat(lab.wavelengths_m, lab.each)
    count = len(wavelength)
    levels = np.stack([[_pattern(rng, lab, k) for _ in range(2)] for k in range(count)]).astype(np.uint8)
    power = rng.choice([0.5, 0.7, 1.0], count)
    scale = {λ: rng.uniform(0.6, 1.4) for λ in lab.wavelengths_m}
    distance = np.resize(lab.planes_m or (lab.distance_m,), count)
    images, exposure = [], []
    for k, λ in enumerate(wavelength):
        shown = _settled(levels[k], levels[max(k - 1, 0)], lab.faults.frames_to_settle)
        shown = lab.faults.modulators.shown(shown, levels[0], levels[max(k - 1, 0)])
        stop = distance[k] + np.resize(lab.faults.missed_m or (0.0,), count)[k]
        signal = scale[λ] * power[k] * _light_of_capture(replace(lab, distance_m=stop), shown, float(λ), k)
        exposure.append(lab.exposure_s or float(f"{0.8 / np.quantile(signal, 0.999):.3g}"))
        light = signal * exposure[-1] * (k not in lab.mishaps.dark) * lab.mishaps.overexposed.get(k, 1.0)
        light = light + exposure[-1] * lab.faults.camera.room.light(light.shape)
        images.append(_counts(rng, light, lab.faults.black, lab.mishaps.noisy.get(k, 0.0)))
    for a, b in lab.mishaps.exchanged:
        images[a], images[b] = images[b], images[a]
    for k, of in lab.mishaps.repeated.items():
        images[k] = images[of]
        if lab.mishaps.whole:
            levels[k], wavelength[k], power[k], exposure[k] = levels[of], wavelength[of], power[of], exposure[of]
            distance[k] = distance[of]
    _write(path, lab, levels, np.stack(images), wavelength, distance, power, np.array(exposure))
    return path


def _settled(levels: NDArray[np.uint8], before: NDArray[np.uint8], time_constant: float) -> Floats:
    """What modulators show one frame after they were told to go from `before` to `levels`, in levels."""
    left = np.exp(-1 / time_constant) if time_constant else 0.0
    return levels + left * (before.astype(float) - levels)


def _light_of_capture(lab: Laboratory, levels: Floats, wavelength_m: float, k: int) -> Floats:
    """The light of a capture whose camera and modulators did what happened to them in it."""
    if k in lab.mishaps.other_pattern:
        rng = np.random.default_rng((lab.seed, k, 1))
        levels = np.stack([_pattern(rng, lab, k) for _ in range(2)]).astype(float)
    moved = replace(lab.faults, distance_m=lab.faults.distance_m + lab.mishaps.defocused.get(k, 0.0))
    light = intensity(replace(lab, faults=moved), levels, wavelength_m, lab.mishaps.moved.get(k, (0.0, 0.0)))
    return lab.faults.camera.picture(light, wavelength_m, (min(lab.wavelengths_m), max(lab.wavelengths_m)))


def intensity(
    lab: Laboratory, levels: Floats, wavelength_m: float, camera_px: tuple[float, float] = (0.0, 0.0)
) -> Floats:
    """Mean light of each camera pixel for levels (modulator, y, x); the picture is moved by `camera_px` modulator
    pixels (y, x)."""
    rows, columns, side = *lab.shape, lab.fine // lab.camera
    distance_m = lab.distance_m * lab.faults.camera.rail.travel + lab.faults.distance_m
    y, x = (np.arange(n * lab.fine) + lab.window // 2 * n * lab.fine for n in lab.shape)
    seen, directions = 0.0, lab.faults.light.directions()
    for (power, line_m, is_modulated), tilt in product(lab.faults.light.components(wavelength_m), directions):
        own = tuple(a + b for a, b in zip(lab.faults.tilt_rad, tilt, strict=True))
        tilted = replace(lab, faults=replace(lab.faults, tilt_rad=own))
        field = _field(tilted, levels * is_modulated, line_m, distance_m, camera_px)
        seen = seen + power / len(directions) * lab.faults.camera.light(field, y, x, distance_m)
    return seen.reshape(rows * lab.camera, side, columns * lab.camera, side).mean(axis=(1, 3))


def _field(
    lab: Laboratory,
    levels: Floats,
    wavelength_m: float,
    distance_m: float,
    camera_px: tuple[float, float],
) -> Complex:
    """The field on the camera, in the whole window, with samples as fine as the modulators'."""
    rows, columns = (n * lab.fine for n in lab.shape)
    y, x = ((np.arange(n) - (n - 1) / 2) * lab.pitch_m / lab.fine for n in (rows, columns))
    sine_y, sine_x = (np.sin(a) for a in lab.faults.tilt_rad)
    wave = np.exp(2j * np.pi / wavelength_m * (sine_y * y[:, None] + sine_x * x[None, :]))
    spiral = np.exp(1j * lab.faults.vortex * np.arctan2(y[:, None], x[None, :]))
    first = _framed(wave * spiral * _modulated(lab, levels[0], wavelength_m, 0), lab.window)
    field = _travelled(first, lab, 0, wavelength_m, lab.gap_m + lab.faults.gap_m)
    second = _turned(_framed(_modulated(lab, levels[1], wavelength_m, 1), lab.window), lab.faults.turn_rad)
    by = tuple(round(s * lab.fine) for s in lab.faults.shift_px)
    field = field * np.roll(second, by, (0, 1))
    field = _travelled(field, lab, 1, wavelength_m, distance_m)
    return np.roll(field, tuple(round(s * lab.fine) for s in camera_px), (0, 1))


def _modulated(lab: Laboratory, levels: Floats, wavelength_m: float, number: int) -> Complex:
    full = lab.opd_m * (1 + lab.faults.stroke)
    path = lab.faults.modulators.path(number, levels / (lab.levels - 1), full, wavelength_m)
    if lab.faults.crosstalk_px:
        path = gaussian_filter(path, lab.faults.crosstalk_px, mode="nearest", truncate=6.0)
    glass = lab.faults.modulators.glass[number]
    passed = 1.0 if glass is None else glass.transmission(lab.shape, wavelength_m)
    return np.kron(passed * np.exp(2j * np.pi * path / wavelength_m), np.ones((lab.fine, lab.fine)))


def _turned(window: Complex, angle_rad: float) -> Complex:
    """Squares in the middle of a window turned about its middle, each sample the mean over itself: of so many
    points along each axis."""
    if not angle_rad:
        return window
    cosine, sine, result = np.cos(angle_rad), np.sin(angle_rad), np.zeros_like(window)
    rows, columns = (np.arange(n // 4, n - n // 4) for n in window.shape)
    middle = [n / 2 for n in window.shape]
    for within in np.ndindex(_POINTS, _POINTS):
        y, x = (i + (k + 0.5) / _POINTS - m for i, k, m in zip((rows, columns), within, middle, strict=True))
        at_y = cosine * y[:, None] - sine * x[None, :] + middle[0]
        at_x = sine * y[:, None] + cosine * x[None, :] + middle[1]
        result[np.ix_(rows, columns)] += window[at_y.astype(int), at_x.astype(int)] / _POINTS**2
    return result


def _framed(inner: Complex, window: int) -> Complex:
    """In the middle of a dark window so many times as large."""
    (rows, columns), first = inner.shape, window // 2
    field = np.zeros((window * rows, window * columns), complex)
    field[first * rows : (first + 1) * rows, first * columns : (first + 1) * columns] = inner
    return field


def _travelled(field: Complex, lab: Laboratory, relay: int, wavelength_m: float, distance_m: float) -> Complex:
    """Through the stop of a relay, then over a distance: the angular spectrum."""
    fy, fx = (np.fft.fftfreq(n, lab.pitch_m / lab.fine) for n in field.shape)
    sine_y, sine_x = wavelength_m * fy[:, None], wavelength_m * fx[None, :]
    cosine = np.sqrt(np.maximum(1 - sine_y**2 - sine_x**2, 0))
    passes = lab.stops[relay].passes(sine_y, sine_x, wavelength_m, lab.pitch_m, lab.faults.stops[relay])
    transfer = passes * np.exp(2j * np.pi * distance_m / wavelength_m * cosine)
    return np.fft.ifft2(np.fft.fft2(field) * transfer)


def _pattern(rng: np.random.Generator, lab: Laboratory, k: int) -> Floats:
    """Random levels of equal frequency, smooth over some pixels."""
    smooth = gaussian_filter(rng.standard_normal(lab.shape), lab.smoothness_px[k % len(lab.smoothness_px)])
    rank = smooth.ravel().argsort().argsort().reshape(lab.shape)
    return rank * lab.levels // rank.size


def _counts(rng: np.random.Generator, signal: Floats, black: float, more_noise: float = 0.0) -> NDArray[np.uint16]:
    """signal: 1 fills the well. more_noise: counts r.m.s. beyond the camera's own."""
    a_count = _FULL_WELL / (2**_BITS - 1 - _BLACK)
    electrons = rng.poisson(_FULL_WELL * signal) + _READ_NOISE * rng.standard_normal(signal.shape)
    if more_noise:
        electrons = electrons + a_count * more_noise * rng.standard_normal(signal.shape)
    return np.clip(np.rint(electrons / a_count + _BLACK + black), 0, 2**_BITS - 1).astype(np.uint16)


def _write(
    path: Path,
    lab: Laboratory,
    levels: NDArray[np.uint8],
    images: NDArray[np.uint16],
    wavelength: Floats,
    distance: Floats,
    power: Floats,
    exposure: Floats,
) -> None:
    with h5py.File(path, "w") as h5:
        h5.attrs.update(format="holoview-captures", version=1)
        for number in (0, 1):
            slm = h5.create_group(f"slm{number + 1}")
            slm["levels"] = levels[:, number]
            slm.attrs.update(pitch=lab.pitch_m, num_levels=lab.levels, opd_range=lab.opd_m)
        h5["camera/images"] = images
        h5["camera"].attrs.update(
            pitch=lab.pitch_m / lab.camera,
            bit_depth=_BITS,
            electrons_per_count=_FULL_WELL / (2**_BITS - 1 - _BLACK),
            read_noise=_READ_NOISE,
            black_level=_BLACK,
        )
        h5["wavelength"], h5["distance"] = wavelength, distance
        h5["power"], h5["exposure"] = power, exposure
        h5.create_group("geometry").attrs.update(gap=lab.gap_m)
        for number, stop in enumerate(lab.stops, start=1):
            h5["geometry"].attrs.update(stop.attributes(number))
