"""Makes the pictures of holograms, fields and captures in the manual: `python -m docs._hooks.figures [NAME…]`, minutes.

The tutorials, the viewer's tour (`docs._hooks.pictures`) and the gallery make their pictures themselves.
"""

from __future__ import annotations

import io
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import sync_playwright

import holoview as hv
from docs._hooks.repository import ROOT

IMAGES = ROOT / "docs" / "images"
_ASSETS = ROOT / "assets"
_STILL_LIFE = _ASSETS / "still-life.safetensors"
_GAP = 6
"""Pixels of white between two pictures of a row."""
_QUALITY = 80


def optimising() -> Image.Image:
    """The target, and what a display shows of it at the start and after 5, 20 and 60 iterations."""
    system = hv.load("holochrome-8").with_(shape=[144, 192])
    target = hv.target_for(system, _ASSETS / "still-life.png", hv.Placement(depth=_ASSETS / "still-life-depth.png"))
    drives = [hv.Hologram(hv.random_drive(system, 0), system)]
    for state in hv.iterate(system, target.stack, hv.Settings(iterations=60)):
        if state.iteration in (5, 20, 60):
            drives.append(state.best)
    wanted = Image.open(_ASSETS / "still-life.png").convert("RGB")
    return _row([wanted, *(_seen(hologram) for hologram in drives)], 300)


def chains() -> Image.Image:
    """A photograph on three displays that are chains of elements, after 20 iterations."""
    pictures = []
    for name in ("high-contrast", "dynamic-fourier", "binary-amplitude"):
        system = hv.load(name)
        target = hv.target_for(system, _ASSETS / "coffee.jpg")
        *_, last = hv.iterate(system, target.stack, hv.Settings(iterations=20))
        pictures.append(_seen(last.best))
    return _row(pictures, 300)


def effects() -> Image.Image:
    """A part of the still life on benches that differ from the one for which its hologram was made."""
    hologram = hv.load_hologram(_STILL_LIFE)
    causes: tuple[dict[str, Any], ...] = (
        {},
        {"gap": {"gap_error": "0.2 mm"}},
        {"stroke": {"stroke_error": -0.1}},
        {"slm_alignment": {"shift_x": "2 um"}},
        {"crosstalk": {"sigma": 0.3}},
        {"undiffracted": {"share": 0.15}},
        {"slm1_stuck": {"columns": [180, 181, 182, 290], "column_levels": [0.5]}},
        {"source_profile": {"fall": 0.8}},
    )
    seen = [_seen(hv.Hologram(hologram.drive, hologram.system.edit({"effects": cause}))) for cause in causes]
    parts = [picture.crop((230, 200, 790, 620)) for picture in seen]
    return _column([_row(parts[:4], 300), _row(parts[4:], 300)])


def observers() -> Image.Image:
    """One hologram, seen by a standard eye, an eye of 75 years, and a camera."""
    hologram = hv.load_hologram(_STILL_LIFE)
    people = ("eye", "age 75, field 2", "mono")
    return _row([_seen(hv.Hologram(hologram.drive, hologram.system.with_(observer=who))) for who in people], 420)


def fields() -> Image.Image:
    """The phase of a complex field, and its image in focus and on the other side."""
    commands = (
        ("export", str(_STILL_LIFE), "--field", "field.safetensors"),
        ("render", "field.safetensors", "--show", "phase", "--stage", "field", "--laser", "4", "-o", "0.png"),
        ("render", "field.safetensors", "--plane", "10mm", "-o", "1.png"),
        ("render", "field.safetensors", "--plane=-10mm", "-o", "2.png"),
    )
    return _row(_made(commands, ("0.png", "1.png", "2.png")), 420)


def recordings() -> Image.Image:
    """An off-axis recording, the spectrum of its numbers, and the image that it holds."""
    size, pitch_m, wavelength_m, distance_m = 512, 4e-6, 633e-9, 0.025
    y, x = np.indices((size, size))
    fy, fx = np.meshgrid(*2 * [np.fft.fftfreq(size, pitch_m)], indexing="ij")
    scene = Image.open(_ASSETS / "still-life.png").convert("L").resize((288, 216))
    object_wave = np.pad(np.asarray(scene, np.float64) / 255, ((148, 148), (112, 112)))
    root = np.sqrt(wavelength_m**-2 - fy**2 - fx**2)
    transfer = (np.hypot(fy, fx) < 0.1 / pitch_m) * np.exp(2j * np.pi * distance_m * (root - 1 / wavelength_m))
    wave = np.fft.ifft2(np.fft.fft2(object_wave) * transfer)
    counts = np.abs(wave + np.exp(-2j * np.pi * (0.27 * x + 0.2 * y))) ** 2
    spectrum = np.log(np.abs(np.fft.fftshift(np.fft.fft2(counts - counts.mean()))) + 1)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "recording.png"
        Image.fromarray(np.round(counts / counts.max() * 255).astype(np.uint8)).save(file)
        command = ("render", str(file), "--pitch", "4um", "--wavelength", "633nm", "--recording", "off-axis")
        (seen,) = _made([(*command, "--plane=-25mm", "-o", "seen.png")], ("seen.png",))
        return _row([Image.open(file).convert("RGB"), _grey(spectrum), seen], 420)


def captures() -> Image.Image:
    """Patterns that were sent to a bench, and the camera's pictures of them."""
    bench = (
        "--set",
        "shape=[96,128]",
        "--set",
        'wavelengths=["450 nm","520 nm","638 nm"]',
        "--set",
        "amplitudes=white",
    )
    commands = (
        ("captures", "make", "holochrome-8", *bench, "--each", "2", "--seed", "1", "-o", "c.h5"),
        ("captures", "show", "c.h5", "--most", "2", "-o", "0.png"),
    )
    (sheet,) = _made(commands, ("0.png",))
    return sheet


def live() -> Image.Image:
    """A page with a live hologram in Chromium, computed by its software device."""
    hologram = hv.load_hologram(_ASSETS / "live" / "holochrome-8.safetensors")
    depth = hv.Placement(depth=_ASSETS / "still-life-depth.png")
    target = hv.target_for(hologram.system, _ASSETS / "still-life.png", depth)
    webgpu = ["--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader", "--no-sandbox"]
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as player:
        page = Path(folder) / "page.html"
        hv.export_html(page, {"8 wavelengths": hologram}, target=target, title="A still life, live")
        browser = player.chromium.launch(executable_path=shutil.which("chromium"), args=webgpu)
        shown = browser.new_page(viewport={"width": 1100, "height": 800})
        shown.goto(page.as_uri())
        shown.evaluate("window.holoview.set({})")
        return Image.open(io.BytesIO(shown.screenshot())).convert("RGB")


FIGURES: dict[str, Callable[[], Image.Image]] = {
    figure.__name__: figure for figure in (optimising, chains, effects, observers, fields, recordings, captures, live)
}


def _seen(hologram: hv.Hologram) -> Image.Image:
    """What an observer sees of a hologram in its middle plane."""
    middle = hologram.system.planes_m[len(hologram.system.planes_m) // 2]
    return Image.fromarray(hv.simulate(hologram, planes=[float(middle)], backend="torch").srgb8[0])


def _made(commands: Sequence[Sequence[str]], pictures: Sequence[str]) -> list[Image.Image]:
    """The pictures that commands of holoview write in a folder of their own."""
    with tempfile.TemporaryDirectory() as folder:
        for command in commands:
            subprocess.run([sys.executable, "-m", "holoview", *command], cwd=folder, check=True)
        return [Image.open(Path(folder) / name).convert("RGB") for name in pictures]


def _grey(values: NDArray[np.float64]) -> Image.Image:
    """Numbers as grey, from their median to their largest."""
    low, high = np.median(values), values.max()
    return Image.fromarray(np.round(np.clip((values - low) / (high - low), 0, 1) * 255).astype(np.uint8)).convert("RGB")


def _row(pictures: Sequence[Image.Image], width: int) -> Image.Image:
    """Pictures beside each other, each so many pixels wide, on white."""
    sized = [one.resize((width, round(width * one.height / one.width)), Image.Resampling.LANCZOS) for one in pictures]
    row = Image.new("RGB", ((width + _GAP) * len(sized) - _GAP, max(one.height for one in sized)), "white")
    for place, one in enumerate(sized):
        row.paste(one, (place * (width + _GAP), 0))
    return row


def _column(pictures: Sequence[Image.Image]) -> Image.Image:
    """Pictures of one width below each other, on white."""
    column = Image.new("RGB", (pictures[0].width, sum(one.height + _GAP for one in pictures) - _GAP), "white")
    top = 0
    for one in pictures:
        column.paste(one, (0, top))
        top += one.height + _GAP
    return column


def main(names: Sequence[str]) -> None:
    """Makes these figures; all of them if no name is given."""
    for name in names or FIGURES:
        target = IMAGES / f"{name}.jpg"
        FIGURES[name]().save(target, quality=_QUALITY, optimize=True)
        print(target)


if __name__ == "__main__":
    main(sys.argv[1:])
