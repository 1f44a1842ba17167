"""How often a contrast is withheld beside the right target and beside wrong ones, over scenes, patterns and seeds.

    python -m benchmarks.target_rates --seeds 20

Each picture is a scene times speckle of a known contrast, sharp or blurred, measured as the viewer and `holoview
contrast` do. README.md explains the columns.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import gaussian_filter

from holoview.holograms.metrics.likeness import luminance_contrast
from holoview.light.colour import SRGB_TO_XYZ, srgb_decode

Floats = NDArray[np.float64]

SCENES = ("still-life", "night", "bright")
PATTERNS, BLURS = (1, 4, 16, 64), (0.0, 2.0)
SHAPE, GRAIN = (144, 192), 4
_ASSETS = Path(__file__).resolve().parents[1] / "assets"


def _scene(name: str) -> Floats:
    """The luminance (y, x) of a picture of assets/, or of drawn boxes named by a number."""
    if not name.isdigit():
        picture = Image.open(_ASSETS / f"{name}.png").convert("RGB").resize(SHAPE[::-1], Image.Resampling.BOX)
        return np.asarray(srgb_decode(np.asarray(picture) / 255.0) @ SRGB_TO_XYZ[1])
    rng, scene = np.random.default_rng(int(name)), np.full(SHAPE, 0.3)
    for _ in range(40):
        y, x = (int(rng.integers(0, n - 12)) for n in SHAPE)
        scene[y : y + int(rng.integers(8, 40)), x : x + int(rng.integers(8, 40))] = 10 ** rng.uniform(-1.2, 0)
    return scene


def _speckle(rng: np.random.Generator, patterns: int) -> Floats:
    """The mean of independent patterns behind a square pupil, each of mean 1: contrast 1/√N."""
    rows, columns = (n // GRAIN for n in SHAPE)
    found = np.zeros(SHAPE)
    for _ in range(patterns):
        spectrum = np.zeros(SHAPE, complex)
        spectrum[:rows, :columns] = rng.normal(size=(rows, columns)) + 1j * rng.normal(size=(rows, columns))
        found += np.abs(np.fft.ifft2(spectrum)) ** 2
    return found / found.mean()


def _object_removed(scene: Floats) -> Floats:
    changed, (rows, columns) = scene.copy(), scene.shape
    changed[rows // 3 : rows // 2, columns // 3 : columns // 2] = np.median(scene)
    return changed


WRONG: dict[str, Callable[[Floats], Floats]] = {
    "the right one": lambda scene: scene,
    **{f"displaced by {n}": lambda scene, n=n: np.roll(scene, n, axis=1) for n in (1, 2, 4, 8)},  # type: ignore[misc]
    "mirrored": lambda scene: scene[:, ::-1],
    "upside down": lambda scene: scene[::-1],
    "signal taken as light": lambda scene: (scene / scene.max()) ** (1 / 2.2),
    "light taken as signal": lambda scene: (scene / scene.max()) ** 2.2,
    "an object removed": _object_removed,
}


def rates(seeds: int) -> dict[str, list[float]]:
    """Of each target the ratios of the contrast stated to the known one; NaN where it is withheld."""
    found: dict[str, list[float]] = {name: [] for name in (*WRONG, "another picture")}
    scenes = {name: _scene(name) for name in (*SCENES, "1", "2")}
    rows, columns = SHAPE
    region = (columns // 4, rows // 4, columns // 2, rows // 2)
    for seed in range(seeds):
        for patterns in PATTERNS:
            speckle = _speckle(np.random.default_rng([seed, patterns]), patterns)
            known = luminance_contrast(speckle, region).estimate.contrast
            for number, scene in enumerate(scenes.values()):
                other = list(scenes.values())[(number + 1) % len(scenes)]
                for blur in BLURS:
                    picture = (gaussian_filter(scene, blur, mode="nearest") if blur else scene) * speckle
                    for kind, target in {
                        **{k: make(scene) for k, make in WRONG.items()},
                        "another picture": other,
                    }.items():
                        of = luminance_contrast(picture, region, np.repeat(target[..., None], 3, axis=-1))
                        found[kind].append(np.nan if of.withheld else of.estimate.contrast / known)
    return found


def main(arguments: list[str] | None = None) -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    args = parser.parse_args(arguments)
    print(
        "| target | pictures | withheld | stated, within 10 % | stated, more than 10 % too high | too low | largest |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for name, values in rates(args.seeds).items():
        ratio = np.array(values)
        stated = ratio[np.isfinite(ratio)]
        high, low = int((stated > 1.1).sum()), int((stated < 0.9).sum())
        largest = f"{stated.max():.2f}" if stated.size else "–"
        shares = (ratio.size - stated.size, stated.size - high - low, high, low)
        print(f"| {name} | {ratio.size} | " + " | ".join(f"{of / ratio.size:.1%}" for of in shares) + f" | {largest} |")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
