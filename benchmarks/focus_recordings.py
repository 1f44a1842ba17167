"""Recordings of six kinds, made by a program of its own, and the distances that `holoview focus` finds in them.

    python -m benchmarks.focus_recordings --count 200 --seed 1 -o out/focus.jsonl
    python -m benchmarks.focus_recordings --count 6 --samples 96 -o out/smallest.jsonl     # the smallest size
    python -m benchmarks.focus_recordings --summary out/focus.jsonl

The light is computed with numpy and SciPy alone: exact transfer functions on twice finer samples over twice the side
of the camera, discs by their Bessel transform. The camera adds up the light over the area of its pixels and cuts the
pattern off at its window; photons are drawn, counts have 8 bits. Wavelengths are 400 to 800 nm, pitches 0.3 to 8 µm,
distances 0.1 mm to 1 m: from objects so near that their fringes are undersampled to those so far that the camera's side
limits the aperture. Nothing of holoview takes part but the search that is measured, over its own range.

A distance is right within a depth of focus λ/NA², NA the smaller of λ times the band (half a cycle a pixel; of an
off-axis order its radius) and side/(2z). Of objects at several depths all have to be listed, and nothing else. "Said"
is a recording of which the program says that no focus is clear, or that it has no off-axis order; "said in part" one of
which not all distances are listed, no wrong one is, and the program says that something else in the picture has no
clear focus, or how much of the structure is in focus at none of the distances. These sentences are needless where all
distances are right: a doubt.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy import fft
from scipy.ndimage import gaussian_filter
from scipy.special import j1

from benchmarks.common import append_line, count_of, lines_or_summary, markdown_table, read_lines
from holoview.holograms.fields.demodulation import field_of_recording
from holoview.holograms.fields.focus import default_range_m, find_focus
from holoview.holograms.fields.reading import Recording
from holoview.holograms.fields.wavefield import Wavefield
from holoview.util.errors import UserError

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

KINDS = ("large opaque", "particles", "several depths", "phase", "fine detail", "off-axis or complex")
VERDICTS = ("right", "said", "said in part", "wrong")
SAMPLES = 384
FINE, WIDE = 2, 2  # samples a pixel, and sides of the camera


@dataclass
class Scene:
    """A camera of n × n pixels, and the light that reaches it, on samples of half a pixel over twice its side.

    distance_m: of the nearest object. depths_m: of all objects. band: cycles a pixel that the recording keeps.
    """

    n: int
    pitch_m: float
    wavelength_m: float
    distance_m: float
    depths_m: list[float] = field(default_factory=list)
    band: float = 0.5

    @property
    def side_m(self) -> float:
        return self.n * self.pitch_m

    @property
    def samples(self) -> int:
        return self.n * FINE * WIDE

    @property
    def sample_m(self) -> float:
        return self.pitch_m / FINE

    def numerical_aperture(self, distance_m: float) -> float:
        return min(self.wavelength_m * self.band / self.pitch_m, self.side_m / (2 * distance_m), 1.0)

    def resolution_m(self, distance_m: float) -> float:
        return self.wavelength_m / (2 * self.numerical_aperture(distance_m))

    def depth_of_focus_m(self, distance_m: float) -> float:
        return self.wavelength_m / self.numerical_aperture(distance_m) ** 2

    def grid(self) -> tuple[Floats, Floats]:
        along = (np.arange(self.samples) - self.samples / 2) * self.sample_m
        return along[:, None], along[None, :]

    def frequencies(self) -> Floats:
        f = np.fft.fftfreq(self.samples, self.sample_m)
        return np.hypot(f[:, None], f[None, :])

    def transfer(self, distance_m: float) -> Complexes:
        """exp(2πi·z·(√(1/λ² − f²) − 1/λ)), without light that would come back over the edge of the period."""
        squared = 1 - (self.wavelength_m * self.frequencies()) ** 2
        phase = 2 * np.pi * distance_m / self.wavelength_m * (np.sqrt(np.maximum(squared, 0)) - 1)
        limit = 0.5 * (WIDE + 0.5) * self.side_m / np.hypot(distance_m, 0.5 * (WIDE + 0.5) * self.side_m)
        f = np.abs(np.fft.fftfreq(self.samples, self.sample_m)) * self.wavelength_m < limit
        return np.exp(1j * phase) * (squared > 0) * f[:, None] * f[None, :]

    def moved(self, light: Complexes, distance_m: float) -> Complexes:
        return fft.ifft2(fft.fft2(light) * self.transfer(distance_m))


# --- objects ----------------------------------------------------------------------------------------------------------


def _inside(distance_m: Floats, sample_m: float) -> Floats:
    """1 inside an edge (distances below 0), 0 outside, a sample wide between."""
    return np.clip(0.5 - distance_m / sample_m, 0, 1)


def _place(scene: Scene, rng: np.random.Generator, reach: float) -> tuple[float, float]:
    y, x = rng.uniform(-reach, reach, 2) * scene.side_m
    return float(y), float(x)


def _shape(scene: Scene, rng: np.random.Generator, radius_m: float, reach: float) -> Floats:
    """A disc, rectangle, ring, triangle or ellipse: 1 inside."""
    y, x = scene.grid()
    cy, cx = _place(scene, rng, reach)
    turned = rng.uniform(0, np.pi)
    v, u = (y - cy) * np.cos(turned) - (x - cx) * np.sin(turned), (y - cy) * np.sin(turned) + (x - cx) * np.cos(turned)
    name = rng.choice(["disc", "rectangle", "ring", "triangle", "ellipse"])
    if name == "rectangle":
        way = np.maximum(abs(v) - radius_m * rng.uniform(0.4, 1), abs(u) - radius_m)
    elif name == "ring":
        way = np.abs(np.hypot(v, u) - 0.75 * radius_m) - 0.25 * radius_m
    elif name == "triangle":
        way = np.maximum(np.maximum(-u, 0.5 * u + 0.87 * v), 0.5 * u - 0.87 * v) - 0.5 * radius_m
    elif name == "ellipse":
        way = np.hypot(v / rng.uniform(0.5, 0.9), u) - radius_m
    else:
        way = np.hypot(v, u) - radius_m
    return _inside(way, scene.sample_m)


def _bessel_disc(scene: Scene, rng: np.random.Generator, radius_m: float, distance_m: float) -> Complexes:
    """The light behind an opaque disc, by its spectrum a·J₁(2πaf)/f."""
    f = scene.frequencies()
    spectrum = radius_m * j1(2 * np.pi * radius_m * f) / np.maximum(f, 1e-9)
    spectrum[0, 0] = np.pi * radius_m**2
    cy, cx = _place(scene, rng, 0.3)
    fy = np.fft.fftfreq(scene.samples, scene.sample_m)
    tilt = np.exp(-2j * np.pi * fy * (cy + scene.samples / 2 * scene.sample_m))[:, None]
    tilt = tilt * np.exp(-2j * np.pi * fy * (cx + scene.samples / 2 * scene.sample_m))[None, :]
    return 1 - fft.ifft2(spectrum * scene.transfer(distance_m) * tilt) / scene.sample_m**2


def _particles(scene: Scene, rng: np.random.Generator, count: int, radius_m: tuple[float, float]) -> Complexes:
    light = np.ones((scene.samples, scene.samples))
    y, x = scene.grid()
    for _ in range(count):
        cy, cx = _place(scene, rng, 0.5)
        radius = rng.uniform(*radius_m)
        top, left = (np.searchsorted(a.ravel(), c - radius - 2 * scene.sample_m) for a, c in ((y, cy), (x, cx)))
        size = math.ceil(2 * (radius / scene.sample_m + 3))
        part = slice(top, top + size), slice(left, left + size)
        light[part] *= 1 - _inside(np.hypot(y[part[0]] - cy, x[:, part[1]] - cx) - radius, scene.sample_m)
    return light.astype(np.complex128)


def _bars(scene: Scene, rng: np.random.Generator, width_m: float) -> Floats:
    """Groups of three bars, upright and lying, of widths around this one: 1 inside."""
    found = np.zeros((scene.samples, scene.samples))
    y, x = scene.grid()
    for _ in range(int(rng.integers(3, 12))):
        cy, cx = _place(scene, rng, 0.35)
        width = width_m * 2 ** rng.uniform(0, 1.5)
        v, u = (y - cy, x - cx) if rng.random() < 0.5 else (x - cx, y - cy)
        for k in (-2, 0, 2):
            way = np.maximum(abs(v - k * width) - width / 2, abs(u) - 2.5 * width)
            found = np.maximum(found, _inside(way, scene.sample_m))
    return found


def _text(scene: Scene, rng: np.random.Generator, stroke_m: float) -> Floats:
    """Lines of letters with strokes of about this width: 1 inside."""
    size = max(12, round(8 * stroke_m / scene.sample_m))
    picture = Image.new("L", (scene.samples, scene.samples))
    pen = ImageDraw.Draw(picture)
    font = ImageFont.load_default(size)
    letters = "".join(rng.choice(list("ABEFHKLMNPRSTXZ2345678"), 60))
    first, last = int(0.3 * scene.samples), int(0.68 * scene.samples)
    for row in range(first, last, max(2 * size, (last - first) // 4)):
        pen.text((first, row), letters[: max(2, int(0.4 * scene.samples / size))], fill=255, font=font)
        letters = letters[5:]
    return np.asarray(picture, np.float64) / 255


# --- scenes of each kind ----------------------------------------------------------------------------------------------


def _scene(rng: np.random.Generator, n: int, least: float = 0.04, most: float = 6.0) -> Scene:
    """A camera and a distance, in the mean a part `least` to `most` of N·pitch²/λ and between 0.1 mm and 1 m."""
    while True:
        pitch_m, wavelength_m = 10 ** rng.uniform(math.log10(0.3e-6), math.log10(8e-6)), rng.uniform(400e-9, 800e-9)
        pitch_m = max(pitch_m, 0.55 * wavelength_m)
        distance_m = n * pitch_m**2 / wavelength_m * 10 ** rng.uniform(math.log10(least), math.log10(most))
        if 0.1e-3 <= distance_m <= 1:
            return Scene(n, pitch_m, wavelength_m, distance_m)


def _camera(scene: Scene, rng: np.random.Generator, intensity: Floats) -> NDArray[np.uint8]:
    """Counts of 8 bits: the area of each pixel, a beam that falls towards its rim, photons."""
    first = (scene.samples - scene.n * FINE) // 2
    cut = intensity[first : first + scene.n * FINE, first : first + scene.n * FINE]
    seen = cut.reshape(scene.n, FINE, scene.n, FINE).mean(axis=(1, 3))
    y, x = (np.linspace(-1, 1, scene.n) - rng.uniform(-0.3, 0.3) for _ in range(2))
    seen = seen * np.exp(-rng.uniform(0, 0.2) * (y[:, None] ** 2 + x[None, :] ** 2))
    photons = 10 ** rng.uniform(2.5, 4.2)
    counted = rng.poisson(np.maximum(seen, 0) * (photons / seen.mean()))
    return np.clip(np.rint(counted * (rng.uniform(50, 110) / photons)), 0, 255).astype(np.uint8)


def _large_opaque(rng: np.random.Generator, n: int) -> tuple[Scene, Complexes]:
    scene = _scene(rng, n)
    z = scene.distance_m
    least = max(0.04 * scene.side_m, 6 * scene.resolution_m(z), math.sqrt(scene.wavelength_m * z))
    radius_m = least * (max(0.25 * scene.side_m, 1.2 * least) / least) ** rng.random()
    if rng.random() < 0.5:
        return scene, _bessel_disc(scene, rng, radius_m, z)
    light = np.ones((scene.samples, scene.samples))
    for _ in range(int(rng.integers(1, 4))):
        light *= 1 - _shape(scene, rng, radius_m, 0.4)
    return scene, scene.moved(light.astype(np.complex128), z)


def _radii(scene: Scene, distance_m: float) -> tuple[float, float]:
    """Of small particles: one to three resolved lengths."""
    return 1.0 * scene.resolution_m(distance_m), 3.0 * scene.resolution_m(distance_m)


def _one_depth(rng: np.random.Generator, n: int) -> tuple[Scene, Complexes]:
    scene = _scene(rng, n)
    radii = _radii(scene, scene.distance_m)
    most = 0.05 * scene.side_m**2 / (math.pi * radii[1] ** 2)  # they cover a twentieth at most
    light = _particles(scene, rng, int(np.clip(rng.integers(10, 120), 3, max(3, most))), radii)
    return scene, scene.moved(light, scene.distance_m)


def _several(rng: np.random.Generator, n: int) -> tuple[Scene, Complexes]:
    scene = _scene(rng, n, 0.06, 2.0)
    depths, most_m = [scene.distance_m], 6 * scene.side_m * scene.pitch_m / scene.wavelength_m
    for _ in range(int(rng.integers(1, 3))):
        farther = depths[-1] * rng.uniform(1.25, 2.5)
        farther = max(farther, depths[-1] + 8 * scene.depth_of_focus_m(farther))
        depths += [farther] * (farther < most_m)
    light = np.ones((scene.samples, scene.samples), np.complex128)
    for z, towards in zip(depths[::-1], [*depths[-2::-1], 0.0], strict=True):
        if rng.random() < 0.3:
            least = max(0.03 * scene.side_m, math.sqrt(scene.wavelength_m * z) * 0.7)
            here = (1 - _shape(scene, rng, least * rng.uniform(1, 1.5), 0.35)).astype(np.complex128)
        else:
            here = _particles(scene, rng, int(rng.integers(4, 15)), _radii(scene, z))
        light = scene.moved(light * here, z - towards)
    scene.depths_m = depths
    return scene, light


def _phase(rng: np.random.Generator, n: int) -> tuple[Scene, Complexes]:
    scene = _scene(rng, n)
    z = scene.distance_m
    phase = np.zeros((scene.samples, scene.samples))
    for _ in range(int(rng.integers(2, 12))):
        radius_m = scene.resolution_m(z) * rng.uniform(3, 12)
        phase += _shape(scene, rng, min(radius_m, 0.2 * scene.side_m), 0.4) * rng.uniform(0.3, 3)
    soft_m = scene.resolution_m(z) * rng.uniform(0.2, 1.2)
    return scene, scene.moved(np.exp(1j * gaussian_filter(phase, soft_m / scene.sample_m)), z)


def _detail(rng: np.random.Generator, n: int) -> tuple[Scene, Complexes]:
    scene = _scene(rng, n)
    z = scene.distance_m
    width_m = scene.resolution_m(z) * rng.uniform(1.2, 3)
    drawn = _bars(scene, rng, width_m) if rng.random() < 0.5 else _text(scene, rng, width_m)
    light = 1 - rng.uniform(0.5, 1) * np.clip(drawn, 0, 1)
    return scene, scene.moved(light.astype(np.complex128), z)


DRAWN = {
    "large opaque": _large_opaque,
    "particles": _one_depth,
    "several depths": _several,
    "phase": _phase,
    "fine detail": _detail,
}


def _off_axis_or_complex(rng: np.random.Generator, n: int) -> tuple[Scene, Wavefield | NDArray[np.uint8]]:
    """A transparent, absorbing or diffuse object: an off-axis recording of it, or its field in two times 8 bits."""
    while True:
        scene = _scene(rng, n, 0.1, 1.5)
        if scene.pitch_m > 1.5 * scene.wavelength_m:
            break
    z, off_axis = scene.distance_m, rng.random() < 0.5
    scene.band = 0.11 if off_axis else 0.45
    width_m = scene.resolution_m(z) * rng.uniform(1, 3)
    drawn = np.clip(_bars(scene, rng, width_m) if rng.random() < 0.5 else _text(scene, rng, width_m), 0, 1)
    if rng.random() < 0.3:
        light = drawn * np.exp(2j * np.pi * rng.random(drawn.shape))
    else:
        light = 1 - drawn * (1 - rng.uniform(0, 0.7) * np.exp(1j * rng.uniform(0, 3)))
    f = np.fft.fftfreq(scene.samples, scene.pitch_m / FINE) * scene.pitch_m  # cycles a pixel
    kept = np.hypot(f[:, None], f[None, :]) < scene.band
    light = fft.ifft2(fft.fft2(light) * kept * scene.transfer(z))
    light /= np.sqrt((np.abs(light) ** 2).mean())
    if not off_axis:
        first = (scene.samples - scene.n * FINE) // 2
        cut = light[first : first + scene.n * FINE : FINE, first : first + scene.n * FINE : FINE]
        scale = 127 / max(abs(cut.real).max(), abs(cut.imag).max())
        coded = np.rint(cut.real * scale) + 1j * np.rint(cut.imag * scale)
        pitches = (scene.pitch_m, scene.pitch_m)
        return scene, Wavefield(coded[None, None].astype(np.complex64), pitches, np.array([scene.wavelength_m]))
    y, x = scene.grid()
    carrier = np.exp(2j * np.pi * (0.25 * y + 0.25 * x) / scene.pitch_m)
    return scene, _camera(scene, rng, np.abs(light + carrier * rng.uniform(1, 2)) ** 2)


def drawn_recording(kind: str, seed: int, n: int = SAMPLES) -> tuple[Scene, Wavefield]:
    """What a recording of a kind shows, and the field that holoview makes of it."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    if kind == KINDS[-1]:
        scene, seen = _off_axis_or_complex(rng, n)
        how = "off-axis"
    else:
        scene, light = DRAWN[kind](rng, n)
        seen, how = _camera(scene, rng, np.abs(light) ** 2), "in-line"
    scene.depths_m = scene.depths_m or [scene.distance_m]
    if isinstance(seen, Wavefield):
        return scene, seen
    pictures = seen[None, None].astype(np.float32)
    pitches = (scene.pitch_m, scene.pitch_m)
    recording = Recording(pictures, pitches, np.array([scene.wavelength_m]), 0.0, how, kind)
    return scene, field_of_recording(recording).field


# --- what is found ----------------------------------------------------------------------------------------------------


def measure(kind: str, seed: int, n: int) -> dict[str, Any]:
    """One recording: what is in it, what was found, and in how many depths of focus it is off."""
    try:
        scene, seen = drawn_recording(kind, seed, n)
    except UserError as error:  # an off-axis recording whose order drowns: the reader refuses it
        return {"kind": kind, "seed": seed, "samples": n, "refused": str(error), "unclear": 0, "verdict": "said"}
    started = time.perf_counter()
    found = find_focus(seen, *default_range_m(seen))
    took_s = time.perf_counter() - started
    listed = [abs(focus.distance_m) for focus in found.objects]
    off = [min((abs(z - at) for at in listed), default=math.inf) / scene.depth_of_focus_m(z) for z in scene.depths_m]
    first_off = min(
        (abs(z - listed[0]) / scene.depth_of_focus_m(z) for z in scene.depths_m if listed), default=math.inf
    )
    beside = [at for at in listed if min(abs(z - at) / scene.depth_of_focus_m(z) for z in scene.depths_m) > 1]
    verdict = "right" if found.clear and max(off) <= 1 and not beside else "wrong"
    if not found.clear or (verdict == "wrong" and not beside and (found.unclear or found.is_incomplete)):
        verdict = "said in part" if found.clear else "said"
    return {
        "kind": kind,
        "seed": seed,
        "pitch_m": scene.pitch_m,
        "wavelength_m": scene.wavelength_m,
        "samples": n,
        "depths_m": scene.depths_m,
        "found_m": listed,
        "off": off,
        "first_off": first_off,
        "unclear": len(found.unclear),
        "unexplained": found.unexplained,
        "incomplete": found.is_incomplete,
        "verdict": verdict,
        "seconds": took_s,
    }


def summarise(path: Path) -> None:
    """Prints the table by kind."""
    lines = read_lines(path)
    rows = []
    for kind in (*KINDS, "all"):
        mine = [line for line in lines if kind in (line["kind"], "all")]
        counts = [sum(line["verdict"] == verdict for line in mine) for verdict in VERDICTS]
        if mine:
            needless = sum(line["verdict"] == "right" and (line["unclear"] > 0 or line["incomplete"]) for line in mine)
            shares = [f"{sum(counts[:3]) / len(mine):.0%}"]
            rows.append([kind, str(len(mine)), *map(str, [*counts, needless]), *shares])
    header = [
        "kind",
        "recordings",
        "all right",
        "said",
        "said in part",
        "wrong",
        "right, doubted",
        "right or said",
    ]
    print(markdown_table(header, rows))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=count_of, default=200, help="recordings, of the six kinds in turn")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--samples", type=count_of, default=SAMPLES, help="rows and columns of the camera")
    parser.add_argument("--kind", choices=KINDS, help="of one kind alone")
    args = lines_or_summary(parser, "focus", summarise)
    args.output.unlink(missing_ok=True)
    for index in range(args.count):
        kind = args.kind or KINDS[index % len(KINDS)]
        append_line(args.output, measure(kind, 10_000 * args.seed + index, args.samples))
    summarise(args.output)


if __name__ == "__main__":
    main()
