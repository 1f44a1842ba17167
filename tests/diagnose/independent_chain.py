"""Captures of chains with hidden faults by plain numpy, which shares no code with the predictor of captures.

    python -m tests.diagnose.independent_chain 20 1     draws so many benches with a mask (0: an amplitude modulator;
                                                        2: stuck parts of the modulators)

A simulation has samples and a width of its own, usually finer and wider than those of a prediction; free space is the
exact transfer function of all waves that propagate. A misplaced element is drawn at its place, as means over the areas
of samples. Camera pixels have the mean light over their area, or the light at their middle.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from holoview.bench.captures.dataset import Camera, Captures, SlmSpec
from holoview.bench.diagnose.pipeline import diagnose
from holoview.light.model.system import System

Floats = NDArray[np.float64]

UM, MM, NM = 1e-6, 1e-3, 1e-9
PIXELS, PITCH_M = 32, 8 * UM  # of the phase modulator
PLACES = 128  # along each side of a pixel of a turned element
STROKE_M, MASK_STROKE_M = 800 * NM, 500 * NM
LASERS_M, PLANES_M = (532 * NM, 600 * NM), (3 * MM, 5 * MM)
COARSE = 4  # pixels of the phase modulator for each of the amplitude modulator
WAY_M = 2 * MM
EACH = 4  # captures of a laser and a plane
MASK_SEED = 5


@dataclass(frozen=True)
class Simulation:
    """Samples each way of a modulator pixel, an even number, widths of the modulators on which light travels, and what
    is known of the camera's pixels: whether they integrate, None where the captures don't state that they do."""

    fine: int = 4
    wider: int = 4
    integrates: bool | None = True

    @property
    def sample_m(self) -> float:
        """The pitch of the samples."""
        return PITCH_M / self.fine

    @property
    def inside(self) -> slice:
        """The samples of the modulators, along each axis, among those on which light travels."""
        n = PIXELS * self.fine
        return slice((self.wider - 1) * n // 2, (self.wider + 1) * n // 2)


USUAL = Simulation()


@dataclass(frozen=True)
class Fault:
    """A hidden fault: the effect that names it, and its values, SI."""

    effect: str
    values: dict[str, Any]


def draw_fault(rng: np.random.Generator, kind: str) -> Fault:
    """A fault of a kind, of a size that shows plainly."""
    sign = rng.choice([-1.0, 1.0])
    if kind == "leakage":
        return Fault("leakage@second", {"amplitude": rng.uniform(0.05, 0.3)})
    if kind == "gamma":
        return Fault("amplitude_gamma@second", {"gamma": float(np.exp(sign * rng.uniform(0.15, 0.7)))})
    if kind == "depth":
        return Fault("mask_depth@second", {"error": sign * rng.uniform(0.05, 0.3)})
    if kind == "far":
        return Fault("misplaced@second", {"shift_z": sign * rng.uniform(0.05, 0.4) * MM})
    if kind == "turned":
        return Fault("misplaced@second", {"rotation": sign * rng.uniform(3e-3, 20e-3)})
    if kind == "column":
        return Fault("slm_stuck@first", {"columns": (int(rng.integers(6, 26)),), "column_levels": (rng.random(),)})
    if kind == "pixel":
        y, x = (int(rng.integers(2, PIXELS // COARSE - 2)) for _ in "yx")
        level = float(rng.integers(2))  # as a pixel that keeps dark or bright
        return Fault("slm_stuck@second", {"pixel_rows": (y,), "pixel_columns": (x,), "pixel_levels": (level,)})
    y, x = rng.uniform(1 * UM, 8 * UM, 2) * rng.choice([-1.0, 1.0], 2)
    return Fault("misplaced@second", {"shift_y": y, "shift_x": x})


OF_AMPLITUDE, OF_MASK = ("leakage", "gamma", "shifted", "far"), ("shifted", "far", "turned", "depth")
STUCK = ("column", "pixel")
"""A column of the phase modulator, and a pixel of the amplitude modulator."""


def nominal(is_mask: bool) -> System:
    """The bench that the laboratory believes in: a phase modulator, and a coarse amplitude modulator or a mask."""
    size = PIXELS // COARSE
    second: dict[str, Any] = {"kind": "amplitude", "pitch": COARSE * PITCH_M, "shape": (size, size)}
    if is_mask:
        second = {"kind": "mask", "pitch": PITCH_M, "shape": (PIXELS, PIXELS), "pattern": "random", "seed": MASK_SEED}
        second["stroke"] = MASK_STROKE_M
    first = {"kind": "phase", "name": "first", "pitch": PITCH_M, "shape": (PIXELS, PIXELS), "stroke": STROKE_M}
    way = {"kind": "space", "name": "way", "distance": WAY_M, "iris_na": 0.05}
    elements = [first, way, second | {"name": "second"}, {"kind": "space", "name": "last", "iris_na": 0.03}]
    ones = np.ones((1, len(LASERS_M)))
    return System(LASERS_M, ones, elements=elements, planes_m=list(PLANES_M), observer="mono")


def captures_with(fault: Fault | None, is_mask: bool, rng: np.random.Generator, by: Simulation = USUAL) -> Captures:
    """Captures of a bench with a fault, or without one."""
    count = len(LASERS_M) * len(PLANES_M) * EACH
    λs, zs = np.repeat(LASERS_M, len(PLANES_M) * EACH), np.tile(np.repeat(PLANES_M, EACH), len(LASERS_M))
    number = 1 if is_mask else 2
    levels = np.zeros((count, number, PIXELS, PIXELS), np.uint8)
    power, size = rng.uniform(0.5, 1.0, count).round(2), PIXELS // COARSE
    images = np.empty((count, 2 * PIXELS, 2 * PIXELS))
    for k in range(count):
        levels[k, 0] = _smooth_levels(rng, PIXELS)
        if not is_mask:
            levels[k, 1, :size, :size] = rng.integers(0, 256, (size, size))
        second = None if is_mask else levels[k, 1, :size, :size] / 255
        images[k] = power[k] * _seen(levels[k, 0] / 255, second, float(λs[k]), float(zs[k]), fault, by)
    for λ in LASERS_M:  # one gain for each laser, which a diagnosis has to find
        images[λs == λ] *= rng.uniform(0.7, 1.3)
    camera = Camera(PITCH_M / 2, 12, 4.0, 3.0, 64.0, integrates=by.integrates)
    return _measured(images, levels, λs, zs, power, nominal(is_mask), camera, rng)


def _smooth_levels(rng: np.random.Generator, n: int) -> NDArray[np.uint8]:
    """Random levels, some of them blurred."""
    values = rng.random((n, n))
    for _ in range(int(rng.integers(0, 3))):
        values = sum(np.roll(values, s, a) for s in (-1, 0, 1) for a in (0, 1))
    values = (values - values.min()) / (values.max() - values.min())
    return np.rint(255 * values).astype(np.uint8)


def _seen(drive: Floats, second: Floats | None, λ: float, z: float, fault: Fault | None, by: Simulation) -> Floats:
    """The intensity (y, x) on camera pixels of half a modulator pixel, of unit power."""
    effect, v = (fault.effect.split("@")[0], fault.values) if fault else ("", {})
    fine = np.repeat(np.repeat(drive, by.fine, 0), by.fine, 1)
    shift_z = v.get("shift_z", 0.0)
    fine = fine.copy()
    for column, level in zip(v.get("columns", ()), v.get("column_levels", ()), strict=True):
        fine[:, column * by.fine : (column + 1) * by.fine] = level
    light = _through(np.exp(2j * np.pi * STROKE_M / λ * fine), λ, WAY_M + shift_z, 0.05, by)[by.inside, by.inside]
    if second is None:
        path = np.random.default_rng(MASK_SEED).random((PIXELS, PIXELS)) * MASK_STROKE_M * (1 + v.get("error", 0.0))
        pixels, pitch = np.exp(2j * np.pi * path / λ), by.fine
    else:
        amplitude = second ** v.get("gamma", 1.0)
        if effect == "slm_stuck" and "pixel_levels" in v:
            amplitude[v["pixel_rows"], v["pixel_columns"]] = v["pixel_levels"]
        leak = v.get("amplitude", 0.0) if effect == "leakage" else 0.0
        pixels, pitch = (amplitude + (1 - amplitude) * leak).astype(complex), by.fine * COARSE
    sampled = _turned(pixels, pitch, by, v["rotation"]) if "rotation" in v else _shifted(pixels, pitch, by, v)
    return on_camera(_through(light * sampled, λ, z - shift_z, 0.03, by), by)


def on_camera(whole: NDArray[np.complex128], by: Simulation) -> Floats:
    """The intensity at the middle of camera pixels, or its exact mean over their area.

    The iris passes so little that samples hold every frequency of the intensity; its mean over a width w has
    sin(πkw)/(πkw) of the contrast at frequency k.
    """
    k, width = np.fft.fftfreq(len(whole)), by.fine // 2  # of a camera pixel, in samples
    to_middle = np.exp(1j * np.pi * k * (width - 1))  # of a pixel, from its first sample
    along = to_middle if by.integrates is False else to_middle * np.sinc(k * width)
    intensity = np.fft.ifft2(np.fft.fft2(np.abs(whole) ** 2) * along[:, None] * along).real
    inside = slice((by.wider - 1) * PIXELS, (by.wider + 1) * PIXELS)
    return np.asarray(intensity[::width, ::width][inside, inside])


def _shifted(pixels: NDArray[np.complex128], pitch: int, by: Simulation, v: dict[str, float]) -> NDArray[np.complex128]:
    """Means over the samples (n, n) of an element whose pixels, `pitch` samples wide, are shifted: by overlaps."""
    edges = np.arange(PIXELS * by.fine + 1.0)
    matrices = []
    for axis in "yx":
        low = pitch * np.arange(len(pixels)) + v.get(f"shift_{axis}", 0.0) / by.sample_m
        within = np.minimum(edges[1:, None], low + pitch) - np.maximum(edges[:-1, None], low)
        matrices.append(np.maximum(within, 0.0))
    return np.asarray(matrices[0] @ pixels @ matrices[1].T)


def _turned(pixels: NDArray[np.complex128], pitch: int, by: Simulation, rotation: float) -> NDArray[np.complex128]:
    """Means over the samples (n, n) of a turned element: at `PLACES` squared places in each pixel."""
    n = PIXELS * by.fine
    return np.asarray((_shares(len(pixels), pitch, n, PLACES // by.fine, rotation) @ pixels.ravel()).reshape(n, n))


@lru_cache(maxsize=2)
def _shares(count: int, pitch: int, n: int, places: int, rotation: float) -> sparse.csr_matrix:
    """The share of each sample (rows) that each of count × count pixels (columns) of a turned element takes."""
    total = sparse.csr_matrix((n * n, count * count))
    x = ((np.arange(n * places) + 0.5) / places - n / 2)[None, :]
    for line in range(n):
        y = (line + (np.arange(places)[:, None] + 0.5) / places) - n / 2
        row = np.floor((np.cos(rotation) * y - np.sin(rotation) * x + n / 2) / pitch).astype(int)
        column = np.floor((np.sin(rotation) * y + np.cos(rotation) * x + n / 2) / pitch).astype(int)
        within = (row >= 0) & (row < count) & (column >= 0) & (column < count)
        sample = np.broadcast_to(line * n + np.arange(n * places) // places, row.shape)
        found = (np.full(int(within.sum()), 1 / places**2), (sample[within], (row * count + column)[within]))
        total = total + sparse.csr_matrix(found, shape=total.shape)
    return total


def _through(field: NDArray[np.complex128], λ: float, z: float, na: float, by: Simulation) -> NDArray[np.complex128]:
    """Free space over z behind a field, on a wider one, through a round stop of direction sine na."""
    n = len(field)
    before, whole = (by.wider - 1) * n // 2, by.wider * n
    sine = λ * np.fft.fftfreq(whole, by.sample_m)
    square = sine[:, None] ** 2 + sine[None, :] ** 2
    kernel = np.exp(2j * np.pi * z / λ * (np.sqrt(np.maximum(1 - square, 0)) - 1)) * (square <= min(na, 1.0) ** 2)
    return np.asarray(np.fft.ifft2(np.fft.fft2(np.pad(field, before, constant_values=0)) * kernel))


def _measured(
    images: Floats, levels: Any, λs: Floats, zs: Floats, power: Floats, chain: System, camera: Camera, rng: Any
) -> Captures:
    """Counts of a camera with shot noise, read noise and 12 bits."""
    exposure = np.array([0.8 * (camera.saturation - 64) / np.quantile(image, 0.999) for image in images])
    scale = float(np.median(exposure)) / 0.02
    electrons = rng.poisson(images * exposure[:, None, None] * 4.0) + 3.0 * rng.standard_normal(images.shape)
    counts = np.clip(np.rint(electrons / 4.0 + 64.0), 0, camera.saturation).astype(np.uint16)
    shown = [(PITCH_M, STROKE_M), (COARSE * PITCH_M, 0.0)][: levels.shape[1]]
    slms = tuple(SlmSpec(pitch_m, 256, stroke_m) for pitch_m, stroke_m in shown)
    return Captures(levels, counts, λs, zs, power, exposure / scale, slms, camera, chain=chain)


def main(count: int, is_mask: int = 0, seed: int = 0, fine: int = 4, wider: int = 4) -> None:
    """Draws faults of the amplitude modulator or of the mask, diagnoses each, and prints whether it alone explains
    them; every fifth bench, of stuck parts every third, has none."""
    named, by, kinds = 0, Simulation(fine, wider), (OF_AMPLITUDE, OF_MASK, STUCK)[is_mask]
    for number in range(count):
        rng = np.random.default_rng([seed, is_mask, number])
        kind = (*kinds, "")[number % (len(kinds) + 1)]
        fault = draw_fault(rng, kind) if kind else None
        began = time.process_time()
        found = diagnose(captures_with(fault, is_mask == 1, rng, by))
        causes = {c.effect: c.lists | {p: i.value for p, i in c.intervals.items()} for c in found.causes}
        expected = ("explained", {fault.effect}) if fault else ("consistent", set())
        is_named = (found.verdict, {*causes}) == expected
        named += is_named
        seconds = time.process_time() - began
        print(
            number, "named" if is_named else "NOT NAMED", fault, found.verdict, causes, f"{seconds:.0f} s", flush=True
        )
    print(f"{named} of {count}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
