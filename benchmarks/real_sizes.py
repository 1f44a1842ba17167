"""Two faults at once in captures of real size, made by a program of its own, and how `holoview diagnose` names them.

    python -m benchmarks.real_sizes make out/ --seed 71001 --count 10              # near field, 1024 × 768 pixels
    python -m benchmarks.real_sizes make out/ --seed 72001 --count 3 --bench fourier
    python -m benchmarks.real_sizes make out/ --hidden '{"gap": {"gap": 84e-6}, "stroke": {"stroke": 0.05}}'
    python -m benchmarks.real_sizes run out/*.h5 -o out/real_sizes.jsonl
    python -m benchmarks.real_sizes table out/real_sizes.jsonl

The bench is computed with numpy and SciPy alone, with numbers, padding and precision of its own; nothing of holoview
takes part but, in another process, the command that is measured. Each file has 32 captures at four wavelengths in one
plane. The near field has two modulators and a camera of 1600 × 1200 pixels of half a modulator pixel; the Fourier bench
one modulator and a camera in the focal plane of a lens. Pairs of faults, their sizes and the patterns are drawn from
the seed.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import resource
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.ndimage import fourier_gaussian, gaussian_filter, map_coordinates
from scipy.signal import CZT

from benchmarks.common import markdown_table, shape_of

Floats = NDArray[np.float64]
Complex = NDArray[np.complex64]

PITCH, LEVELS, STROKE, GAP, DISTANCE, NA = 8e-6, 16, 825e-9, 1e-3, 4e-3, 0.03
WAVELENGTHS, EACH = (450e-9, 520e-9, 580e-9, 638e-9), 8
SMOOTHNESS = (6.0, 4.0, 2.5, 1.5)  # pixels, of patterns in turn
FOCAL, FOURIER_CAMERA = 0.2, 4e-6
FULL_WELL, READ_NOISE, BLACK, BITS = 16000.0, 3.0, 64.0, 12
ELECTRONS = FULL_WELL / (2**BITS - 1 - BLACK)
FINE = 2  # samples a modulator pixel and axis
BEYOND = 96  # samples of darkness on each side: light walks off by 40


# --- faults -----------------------------------------------------------------------------------------------------------


@dataclass
class Faults:
    """What is wrong with the bench, in SI units or pixels; as it stands here nothing is."""

    gap: float = 0.0
    distance: float = 0.0
    stroke: float = 0.0  # relative
    wedge: tuple[float, float] = (0.0, 0.0)  # stroke of each modulator from its left to its right edge, relative
    bow: tuple[float, float] = (0.0, 0.0)  # optical path of each modulator's corners over its centre
    exponent: tuple[float, float] = (1.0, 1.0)  # of each modulator's response
    steeper: float = 0.0  # change of both exponents from the middle of the spectrum to either end
    shift: tuple[float, float] = (0.0, 0.0)  # modulator 2, pixels (y, x)
    turned: float = 0.0  # modulator 2
    tilt: tuple[float, float] = (0.0, 0.0)
    stop: tuple[float, float] = (1.0, 1.0)  # radii of both irises, relative
    astigmatism: tuple[float, float] = (0.0, 0.0)  # of both relays, r.m.s. path, axes along the diagonals
    coma: tuple[float, float] = (0.0, 0.0)
    leak: float = 0.0  # Gaussian standard deviation of the paths, pixels
    unmodulated: float = 0.0  # share of the amplitude
    across: float = 0.0  # share of the light in the other polarisation
    line: tuple[float, float] = (0.0, 0.0)  # share of a second line, and its wavelength over the first's
    beam: float = 0.0  # fall of the laser's amplitude to the corners
    black: float = 0.0
    blur: float = 0.0  # camera pixels
    motion: tuple[float, float] = (0.0, 0.0)
    shading: float = 0.0  # share of the light lost at the corners
    fringes: tuple[float, float, float] = (0.0, 30.0, 0.0)  # depth, period in camera pixels at 550 nm, direction
    room: float = 0.0  # of the full well in a second
    camera: tuple[float, float, float] = (0.0, 0.0, 0.0)  # camera pixels (y, x), and its enlargement


def _signed(rng: np.random.Generator, least: float, most: float) -> float:
    return float(rng.choice([-1, 1]) * rng.uniform(least, most))


def _one_of_two(rng: np.random.Generator, value: float, nothing: float = 0.0) -> tuple[float, float]:
    return (value, nothing) if rng.random() < 0.5 else (nothing, value)


Draw = Callable[[np.random.Generator], dict[str, Any]]
ANYWHERE: dict[str, Draw] = {
    "stroke": lambda r: {"stroke": _signed(r, 0.04, 0.12)},
    "stroke_map": lambda r: {"wedge": _one_of_two(r, _signed(r, 0.05, 0.12))},
    "slm_flatness": lambda r: {"bow": _one_of_two(r, _signed(r, 150e-9, 500e-9))},
    "lut": lambda r: {"exponent": _one_of_two(r, 1 + _signed(r, 0.1, 0.25), 1.0)},
    "lut_dispersion": lambda r: {"steeper": _signed(r, 0.07, 0.15)},
    "tilt": lambda r: {"tilt": (_signed(r, 0.5e-3, 2e-3), _signed(r, 0.5e-3, 2e-3))},
    "crosstalk": lambda r: {"leak": r.uniform(0.35, 0.6)},
    "undiffracted": lambda r: {"unmodulated": r.uniform(0.04, 0.15)},
    "polarisation": lambda r: {"across": r.uniform(0.02, 0.12)},
    "second_line": lambda r: {"line": (r.uniform(0.1, 0.3), _signed(r, 2e-9, 5e-9))},
    "source_profile": lambda r: {"beam": r.uniform(0.15, 0.4)},
    "camera_black": lambda r: {"black": r.uniform(8.0, 40.0)},
    "camera_blur": lambda r: {"blur": r.uniform(0.5, 1.2)},
    "motion_blur": lambda r: {"motion": (r.uniform(0.8, 2.5), _signed(r, 0.8, 2.5))},
    "vignetting": lambda r: {"shading": r.uniform(0.15, 0.4)},
    "camera_fringes": lambda r: {"fringes": (r.uniform(0.02, 0.06), r.uniform(12.0, 60.0), r.uniform(0.0, np.pi))},
    "ambient": lambda r: {"room": r.uniform(0.05, 0.3)},
    "camera_alignment": lambda r: {"camera": (_signed(r, 0.4, 2.0), _signed(r, 0.4, 2.0), _signed(r, 0.0005, 0.003))},
}
NEAR: dict[str, Draw] = ANYWHERE | {
    "gap": lambda r: {"gap": _signed(r, 60e-6, 200e-6)},
    "distance": lambda r: {"distance": _signed(r, 80e-6, 250e-6)},
    "slm_alignment": lambda r: {
        "shift": (_signed(r, 0.2, 0.8), _signed(r, 0.2, 0.8)),
        "turned": r.choice([0.0, 1.0]) * _signed(r, 0.5e-3, 2e-3),
    },
    "iris1": lambda r: {"stop": (1 + _signed(r, 0.1, 0.25), 1.0)},
    "iris2": lambda r: {"stop": (1.0, 1 + _signed(r, 0.1, 0.25))},
    "aberration1": lambda r: {"astigmatism": (_signed(r, 50e-9, 150e-9), 0.0), "coma": (_signed(r, 0.0, 100e-9), 0.0)},
    "aberration2": lambda r: {"astigmatism": (0.0, _signed(r, 50e-9, 150e-9)), "coma": (0.0, _signed(r, 0.0, 100e-9))},
}
"""By the effect that holoview should name: fields of `Faults` of moderate size."""
FOURIER = {name: draw for name, draw in ANYWHERE.items() if name not in ("source_profile", "lut_dispersion")}


# --- the bench --------------------------------------------------------------------------------------------------------


@dataclass
class Bench:
    """One bench with its faults. shape, camera: (rows, columns) of modulators and camera."""

    shape: tuple[int, int]
    camera: tuple[int, int]
    is_fourier: bool
    faults: Faults
    _phase: dict[Any, Complex] = field(default_factory=dict)

    def picture(self, levels: NDArray[np.uint8], wavelength: float) -> Floats:
        """Mean light of each camera pixel (y, x) for levels (modulator, y, x)."""
        f, (share, longer) = self.faults, self.faults.line
        light = np.zeros(self.camera)
        for power, line in (((1 - share), wavelength), (share, wavelength + longer)):
            for part, is_modulated in ((1 - f.across, True), (f.across, False)):
                if power * part:
                    light += power * part * self._light([a * is_modulated for a in levels], line)
        return self._seen(light, wavelength)

    def _light(self, levels: list[NDArray[np.uint8]], wavelength: float) -> Floats:
        return (self._far_field if self.is_fourier else self._near_field)(levels, wavelength)

    def _modulated(self, levels: NDArray[np.uint8], number: int, wavelength: float) -> Complex:
        """The transmission of a modulator's pixels."""
        f, (rows, columns) = self.faults, self.shape
        y, x = _centred(rows)[:, None], _centred(columns)[None, :]
        exponent = f.exponent[number] + f.steeper * (wavelength - 550e-9) / 100e-9
        path = STROKE * (1 + f.stroke) * (1 + f.wedge[number] * x / columns) * (levels / (LEVELS - 1)) ** exponent
        path = path + f.bow[number] * (x**2 + y**2) / ((rows / 2) ** 2 + (columns / 2) ** 2)
        path = gaussian_filter(path, f.leak, mode="nearest", truncate=6.0) if f.leak else path
        light = (1 - f.unmodulated) * np.exp(2j * np.pi * path / wavelength) + f.unmodulated
        if number == 0:
            light = light * (1 - f.beam * (x**2 + y**2) / ((rows / 2) ** 2 + (columns / 2) ** 2))
            sines = np.sin(f.tilt)
            light = light * np.exp(2j * np.pi * PITCH / wavelength * (sines[0] * y + sines[1] * x))
        return light.astype(np.complex64)

    def _near_field(self, levels: list[NDArray[np.uint8]], wavelength: float) -> Floats:
        f = self.faults
        first = self._tilted_samples(self._modulated(levels[0], 0, wavelength), wavelength)
        light = self._travelled(self._framed(first), 0, wavelength, GAP + f.gap)
        second = self._moved(self._modulated(levels[1], 1, wavelength))
        light *= self._framed(second)
        light = self._travelled(light, 1, wavelength, DISTANCE + f.distance)
        seen = np.square(light.real) + np.square(light.imag)
        inner = seen[BEYOND : BEYOND + self.shape[0] * FINE, BEYOND : BEYOND + self.shape[1] * FINE]
        if not any(f.camera):
            return np.asarray(_middle(inner, self.camera), dtype=np.float64)
        return _resampled(light, self.camera, [n * FINE / 2 + BEYOND - 0.5 for n in self.shape], f.camera)

    def _tilted_samples(self, pixels: Complex, wavelength: float) -> Complex:
        """Samples of the first modulator: within a pixel, tilted light goes on."""
        samples = _fine(pixels)
        for axis, sine in enumerate(np.sin(self.faults.tilt)):
            within = np.tile((np.arange(FINE) - (FINE - 1) / 2) * PITCH / FINE, self.shape[axis])
            wave = np.exp(2j * np.pi / wavelength * sine * within).astype(np.complex64)
            samples = samples * (wave[:, None] if axis == 0 else wave[None, :])
        return samples

    def _moved(self, pixels: Complex) -> Complex:
        """Samples of the second modulator, displaced; between samples linear, the mean of displaced squares."""
        f, samples = self.faults, _fine(pixels)
        if not (any(f.shift) or f.turned):
            return samples
        y, x = (_centred(n) - moved * FINE for n, moved in zip(samples.shape, f.shift, strict=True))
        cos, sin = np.cos(f.turned), np.sin(f.turned)
        source = [cos * y[:, None] - sin * x[None, :], sin * y[:, None] + cos * x[None, :]]
        at = [one + (n - 1) / 2 for one, n in zip(source, samples.shape, strict=True)]
        return np.asarray(map_coordinates(samples, at, order=1), dtype=np.complex64)

    def _framed(self, inner: Complex) -> Complex:
        return np.pad(inner, BEYOND)

    def _travelled(self, light: Complex, relay: int, wavelength: float, distance: float) -> Complex:
        """Through the iris of a relay with its aberrations, and over a distance."""
        key = (relay, wavelength)
        if key not in self._phase:
            v, u = (wavelength * fft.fftfreq(n, PITCH / FINE) for n in light.shape)
            v, u = v[:, None], u[None, :]
            radius2 = (v**2 + u**2) / NA**2
            astigmatism = np.sqrt(6) * 2 * v * u / NA**2 * self.faults.astigmatism[relay]
            coma = np.sqrt(8) * (3 * radius2 - 2) * v / NA * self.faults.coma[relay]
            path = distance * np.sqrt(np.maximum(1 - v**2 - u**2, 0)) + astigmatism + coma
            cell = wavelength * np.sqrt(np.mean([(FINE / PITCH / n) ** 2 for n in light.shape]))  # coverage at the edge
            passes = np.clip((self.faults.stop[relay] * NA - NA * np.sqrt(radius2)) / cell + 0.5, 0, 1)
            self._phase[key] = (passes * np.exp(2j * np.pi / wavelength * path)).astype(np.complex64)
        spectrum = fft.fft2(light, workers=1, overwrite_x=True)
        spectrum *= self._phase[key]
        return np.asarray(fft.ifft2(spectrum, workers=1, overwrite_x=True))

    def _far_field(self, levels: list[NDArray[np.uint8]], wavelength: float) -> Floats:
        """|Σ t·exp(−2πi·x·r/(λf))·sinc|² at the camera's pixels, by a chirp z-transform along each axis."""
        f, light = self.faults, self._modulated(levels[0], 0, wavelength).astype(np.complex128)
        for axis, n in enumerate(self.camera):
            at = (_centred(n) * (1 / (1 + f.camera[2])) - f.camera[axis] / (1 + f.camera[2])) * FOURIER_CAMERA
            cycles = at * PITCH / (wavelength * FOCAL)
            step = cycles[1] - cycles[0]
            czt = CZT(light.shape[axis], n, np.exp(-2j * np.pi * step), np.exp(2j * np.pi * cycles[0]))
            shape = [1, 1]
            shape[axis] = n
            light = czt(light, axis=axis) * np.sinc(cycles).reshape(shape) / np.sqrt(self.shape[axis])
        return np.asarray(np.abs(light) ** 2, dtype=np.float64)

    def _seen(self, light: Floats, wavelength: float) -> Floats:
        """The light as the camera's optics pass it."""
        f = self.faults
        if f.blur or any(f.motion):
            margin = 24
            spectrum = np.fft.fft2(np.pad(light, margin, mode="edge"))
            v, u = (np.fft.fftfreq(n) for n in spectrum.shape)
            spectrum = fourier_gaussian(spectrum, f.blur) if f.blur else spectrum
            spectrum = spectrum * np.sinc(v[:, None] * f.motion[0] + u[None, :] * f.motion[1])
            light = np.maximum(np.fft.ifft2(spectrum).real, 0)[margin:-margin, margin:-margin]
        y, x = _centred(self.camera[0])[:, None], _centred(self.camera[1])[None, :]
        light = light * (1 - f.shading * (x**2 + y**2) / ((self.camera[0] / 2) ** 2 + (self.camera[1] / 2) ** 2))
        depth, period, towards = f.fringes
        if depth:
            turns = 1.1e-3 / wavelength + (np.cos(towards) * x + np.sin(towards) * y) / (period * wavelength / 550e-9)
            light = light * (1 + depth * np.cos(2 * np.pi * turns))
        return np.asarray(light, dtype=np.float64)


def _centred(n: int) -> Floats:
    return np.asarray(np.arange(n) - (n - 1) / 2, dtype=np.float64)


def _fine(pixels: Complex) -> Complex:
    return np.repeat(np.repeat(pixels, FINE, axis=0), FINE, axis=1)


def _middle(image: Floats, shape: tuple[int, int]) -> Floats:
    y, x = ((n - kept) // 2 for n, kept in zip(image.shape, shape, strict=True))
    return image[y : y + shape[0], x : x + shape[1]]


def _resampled(
    light: Complex, shape: tuple[int, int], centre: list[float], moved: tuple[float, float, float]
) -> Floats:
    """The light where a camera sees it whose picture is shifted (y, x) and enlarged: the sum of the field's waves."""
    spectrum = fft.fft2(light.astype(np.complex128))
    for axis, n in enumerate(shape):
        size = 1 + moved[2]
        at = centre[axis] + (_centred(n) - moved[axis]) / size
        count = light.shape[axis]
        first, step = at[0], 1 / size
        low = -(count // 2)
        ordered = fft.fftshift(spectrum, axes=axis)
        czt = CZT(count, n, np.exp(2j * np.pi * step / count), np.exp(-2j * np.pi * first / count))
        edge = [1, 1]
        edge[axis] = n
        spectrum = czt(ordered, axis=axis) * np.exp(2j * np.pi * low * at / count).reshape(edge) / count
    return np.abs(spectrum) ** 2


# --- files ------------------------------------------------------------------------------------------------------------


def drawn(rng: np.random.Generator, is_fourier: bool, only: list[str]) -> dict[str, dict[str, Any]]:
    """Two faults, or those of `only`: by effect, fields of `Faults`."""
    draws = FOURIER if is_fourier else NEAR
    names = sorted(only or (str(n) for n in rng.choice(sorted(draws), 2, replace=False)))
    return {name: draws[name](rng) for name in names}


def measure(
    path: Path, rng: np.random.Generator, shape: tuple[int, int], is_fourier: bool, values: dict[str, dict[str, Any]]
) -> None:
    """Measures the bench with the faults (by effect) and writes the capture file, with the truth beside it."""
    faults = Faults(**{key: value for own in values.values() for key, value in own.items()})
    camera = shape if is_fourier else tuple(int(n * FINE * 1600 / 2048) // 2 * 2 for n in shape)
    bench = Bench(shape, (camera[0], camera[1]), is_fourier, faults)
    wavelength = np.repeat(WAVELENGTHS, EACH)
    count, modulators = len(wavelength), 1 if is_fourier else 2
    smooth = [SMOOTHNESS[k % len(SMOOTHNESS)] * (0.25 if is_fourier else 1.0) for k in range(count)]
    levels = np.stack([[_pattern(rng, shape, s) for _ in range(modulators)] for s in smooth])
    power, scale = rng.choice([0.5, 0.7, 1.0], count), {λ: rng.uniform(0.6, 1.4) for λ in WAVELENGTHS}
    images, exposure = np.empty((count, *bench.camera), np.uint16), []
    for k, λ in enumerate(wavelength):
        signal = scale[float(λ)] * power[k] * bench.picture(levels[k], float(λ))
        exposure.append(float(f"{0.8 / np.quantile(signal, 0.999):.3g}"))
        light = signal * exposure[-1] + faults.room * exposure[-1]
        electrons = rng.poisson(FULL_WELL * light) + READ_NOISE * rng.standard_normal(light.shape)
        images[k] = np.clip(np.rint(electrons / ELECTRONS + BLACK + faults.black), 0, 2**BITS - 1)
    _write(path, is_fourier, levels, images, wavelength, power, np.array(exposure))
    path.with_suffix(".json").write_text(json.dumps({"bench": path.stem, "hidden": values}))


def _pattern(rng: np.random.Generator, shape: tuple[int, int], smooth: float) -> NDArray[np.uint8]:
    """Random levels of equal frequency, smooth over some pixels."""
    noise = gaussian_filter(rng.standard_normal(shape), smooth)
    rank = noise.ravel().argsort().argsort().reshape(shape)
    return (rank * LEVELS // rank.size).astype(np.uint8)


def _write(
    path: Path,
    is_fourier: bool,
    levels: NDArray[np.uint8],
    images: NDArray[np.uint16],
    wavelength: Floats,
    power: Floats,
    exposure: Floats,
) -> None:
    with h5py.File(path, "w") as h5:
        h5.attrs.update(format="holoview-captures", version=1)
        for number in range(levels.shape[1]):
            slm = h5.create_group(f"slm{number + 1}")
            slm["levels"] = levels[:, number]
            slm.attrs.update(pitch=PITCH, num_levels=LEVELS, opd_range=STROKE)
        h5["camera/images"] = images
        camera_pitch = FOURIER_CAMERA if is_fourier else PITCH / FINE
        h5["camera"].attrs.update(
            pitch=camera_pitch, bit_depth=BITS, electrons_per_count=ELECTRONS, read_noise=READ_NOISE, black_level=BLACK
        )
        h5["wavelength"], h5["power"], h5["exposure"] = wavelength, power, exposure
        h5["distance"] = np.full(len(wavelength), 0.0 if is_fourier else DISTANCE)
        geometry = {"focal_length": FOCAL} if is_fourier else {"gap": GAP, "iris1_na": NA, "iris2_na": NA}
        h5.create_group("geometry").attrs.update(geometry)


# --- runs -------------------------------------------------------------------------------------------------------------

SAME = {"gap": "aberration1", "distance": "aberration2", "stroke": "stroke_map"}
"""Effects with more numbers that contain the same physics."""


def run(path: Path, options: list[str], limit_s: float = math.inf) -> dict[str, Any]:
    """One diagnosis by the command line: what it said when, its verdict, processor seconds, and memory.

    limit_s: it is stopped after so long, without a verdict.
    """
    found = path.with_suffix(".found.json")
    found.unlink(missing_ok=True)
    command = [sys.executable, "-m", "holoview", "diagnose", str(path), "--json", str(found), *options]
    began, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    memory = _Memory(process.pid)
    stop = threading.Timer(min(limit_s, threading.TIMEOUT_MAX), process.kill)
    stop.start()
    said = []
    for line in process.stderr or ():
        for text in re.findall(r"so far: ([^(\r\n]+)", line):
            seconds = time.monotonic() - began, sum(map(_processor_seconds, _family(process.pid)))
            said.append((*(round(one, 1) for one in seconds), text.strip().split(" and ")))
    code = process.wait()
    stop.cancel()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    truth = json.loads(path.with_suffix(".json").read_text())
    result: dict[str, Any] = {"file": str(path), **truth, "said": said, "code": code, "pss_gb": memory.most() / 1e9}
    result["seconds"] = time.monotonic() - began
    result["cpu_seconds"] = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    if code == 0:
        told = json.loads(found.read_text())
        result["verdict"], result["named"] = told["verdict"], [c["effect"] for c in told["causes"]]
        result["chi2"] = [told["before"]["chi2_per_pixel"], told["after"]["chi2_per_pixel"]]
        result["notes"], result["lives_in"] = told["notes"], told["unexplained"]["lives_in"]
        result["values"] = {c["effect"]: {p: v["value"] for p, v in c["parameters"].items()} for c in told["causes"]}
    return result


class _Memory:
    """The most memory that a process and its children had at once, shared pages counted once."""

    def __init__(self, pid: int) -> None:
        self._pid, self._most, self._is_over = pid, 0, threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def most(self) -> int:
        """Bytes."""
        self._is_over.set()
        self._thread.join()
        return self._most

    def _watch(self) -> None:
        while not self._is_over.wait(5.0):  # adding up the pages of large processes takes a tenth of a second
            self._most = max(self._most, sum(_pss(pid) for pid in _family(self._pid)))


def _family(pid: int) -> Iterator[int]:
    yield pid
    try:
        children = [int(c) for f in Path(f"/proc/{pid}/task").glob("*/children") for c in f.read_text().split()]
    except OSError:
        return
    for child in children:
        yield from _family(child)


def _pss(pid: int) -> int:
    try:
        rollup = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii")
    except OSError:
        return 0
    found = re.search(r"^Pss:\s+(\d+) kB", rollup, re.M)
    return int(found[1]) * 1024 if found else 0


def _processor_seconds(pid: int) -> float:
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
    except OSError:
        return 0.0
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")  # its own, and of children that have ended


def has_named(hidden: list[str], named: list[str]) -> bool:
    """Whether all hidden faults are among the named ones."""
    return all(name in named or SAME.get(name) in named for name in hidden)


def table(lines: list[dict[str, Any]]) -> str:
    """The runs as a Markdown table."""
    rows = []
    for r in lines:
        hidden = list(r["hidden"])
        first = next((s for *s, named in r["said"] if any(has_named([h], named) for h in hidden)), None)
        both = next((s for *s, named in r["said"] if has_named(hidden, named)), None)
        mark = "" if has_named(hidden, r.get("named", [])) else f" {', '.join(r.get('named', []))}"
        chi2 = " → ".join(f"{c:.4g}" for c in r.get("chi2", []))
        seconds = ["–" if s is None else f"{s[0]:.0f} ({s[1]:.0f})" for s in (first, both)]
        whole = f"{r['seconds']:.0f} ({r['cpu_seconds']:.0f})"
        rows.append(
            [
                f"{' + '.join(hidden)}",
                *seconds,
                f"{r.get('verdict', 'failed')}{mark}",
                chi2,
                whole,
                f"{r['pss_gb']:.1f}",
            ]
        )
    header = ["hidden", "first cause, s (of processor)", "both", "verdict", "χ²/n", "in all", "GB"]
    return markdown_table(header, rows)


def main() -> None:
    """Make files, diagnose them, or print a table of the runs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parts = parser.add_subparsers(dest="part", required=True)
    make = parts.add_parser("make")
    make.add_argument("folder", type=Path)
    make.add_argument("--seed", type=int, default=1)
    make.add_argument("--count", type=int, default=1)
    make.add_argument("--bench", choices=["near", "fourier"], default="near")
    make.add_argument("--shape", type=shape_of, default=(768, 1024), help="columns x rows, such as 1024x768")
    make.add_argument("--only", nargs="+", default=[], help="faults to hide, instead of two that are drawn")
    make.add_argument("--hidden", type=json.loads, help="faults with their values, instead of drawn ones; as JSON")
    do = parts.add_parser("run")
    do.add_argument("files", type=Path, nargs="+")
    do.add_argument("-o", "--output", type=Path, required=True)
    do.add_argument("--limit", type=float, default=math.inf, help="seconds after which a diagnosis is stopped")
    do.add_argument("--options", nargs=argparse.REMAINDER, default=[], help="of holoview diagnose; the last argument")
    show = parts.add_parser("table")
    show.add_argument("files", type=Path, nargs="+")
    args = parser.parse_args()
    if args.part == "make":
        args.folder.mkdir(parents=True, exist_ok=True)
        for seed in range(args.seed, args.seed + args.count):
            path, is_fourier = args.folder / f"{args.bench}-{seed}.h5", args.bench == "fourier"
            rng = np.random.default_rng(seed)
            values = args.hidden or drawn(rng, is_fourier, args.only)
            measure(path, rng, args.shape, is_fourier, values)
            print(path, flush=True)
    elif args.part == "run":
        for path in args.files:
            result = run(path, args.options, args.limit)
            with args.output.open("a") as file:
                file.write(json.dumps(result) + "\n")
            print(table([result]).splitlines()[-1], flush=True)
    else:
        print(table([json.loads(line) for path in args.files for line in path.read_text().splitlines()]))


if __name__ == "__main__":
    main()
