"""How often a contrast is withheld beside the right target and beside wrong ones, over scenes, patterns and seeds.

    python -m benchmarks.target_rates --seeds 20
    python -m benchmarks.target_rates --seeds 6 --scenes drawn
    python -m benchmarks.target_rates --seeds 2 --holograms

Each picture is a scene times speckle of a known contrast, sharp or blurred, measured as the viewer and `holoview
contrast` do. `--scenes drawn`: other kinds of scenes, other ones for each seed, with which no limit was chosen; so are
those of `--holograms`, which are optimised for three planes each. README.md explains the columns.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy.ndimage import gaussian_filter

import holoview as hv
from holoview.holograms.metrics.likeness import NO_OTHERS, OtherPlanes, luminance_contrast
from holoview.light.colour import SRGB_TO_XYZ, srgb_decode, srgb_encode

Floats = NDArray[np.float64]

SCENES = ("still-life", "night", "bright")
PATTERNS, BLURS = (1, 4, 16, 64), (0.0, 2.0)
SHAPE, GRAIN = (144, 192), 4
BENCHES = ("simultaneous", "holochrome-8-1slm")
_ASSETS = Path(__file__).resolve().parents[1] / "assets"


def _clouds(rng: np.random.Generator) -> Floats:
    """Brightness of a spectrum that falls as that of photographs."""
    frequency = np.hypot(*np.meshgrid(*(np.fft.fftfreq(n) * n for n in SHAPE), indexing="ij"))
    field = np.fft.ifft2(np.fft.fft2(rng.normal(size=SHAPE)) / np.maximum(frequency, 1) ** 1.3).real
    return np.asarray(np.exp(field / field.std()))


def _letters(rng: np.random.Generator) -> Floats:
    page = Image.new("L", SHAPE[::-1], 230)
    draw = ImageDraw.Draw(page)
    for row in range(0, SHAPE[0], 16):
        draw.text((4, row), "".join(chr(int(c)) for c in rng.integers(65, 91, 40)), fill=25, font_size=14)
    return np.asarray(srgb_decode(np.asarray(page) / 255.0))


def _discs(rng: np.random.Generator) -> Floats:
    """Shaded balls before a gradient."""
    y, x = np.indices(SHAPE)
    scene = 0.05 + 0.3 * x / SHAPE[1]
    for _ in range(25):
        radius, cy, cx = rng.uniform(6, 30), rng.uniform(0, SHAPE[0]), rng.uniform(0, SHAPE[1])
        height = 1 - ((y - cy) ** 2 + (x - cx) ** 2) / radius**2
        scene = np.where(height > 0, rng.uniform(0.05, 1) * (0.2 + 0.8 * np.sqrt(np.maximum(height, 0))), scene)
    return np.asarray(scene)


def _stripes(rng: np.random.Generator) -> Floats:
    """Gratings that become finer, each in a place of its own."""
    y, x = np.indices(SHAPE)
    scene = np.full(SHAPE, 0.4)
    for _ in range(12):
        cy, cx = (int(rng.integers(0, n - 40)) for n in SHAPE)
        angle, period = rng.uniform(0, np.pi), rng.uniform(6, 24)
        wave = 0.5 + 0.45 * np.cos(2 * np.pi * (x * np.cos(angle) + y * np.sin(angle)) / period)
        scene[cy : cy + 40, cx : cx + 40] = wave[cy : cy + 40, cx : cx + 40]
    return scene


def _dusk(rng: np.random.Generator) -> Floats:
    """Few lamps in the dark."""
    y, x = np.indices(SHAPE)
    scene = np.full(SHAPE, 0.02)
    for _ in range(30):
        width, cy, cx = rng.uniform(2, 8), rng.uniform(0, SHAPE[0]), rng.uniform(0, SHAPE[1])
        scene += rng.uniform(0.1, 1) * np.exp(-((y - cy) ** 2 + (x - cx) ** 2) / (2 * width**2))
    return scene


DRAWN: dict[str, Callable[[np.random.Generator], Floats]] = {
    "clouds": _clouds,
    "letters": _letters,
    "discs": _discs,
    "stripes": _stripes,
    "dusk": _dusk,
}


def _scene(name: str, seed: int = 0) -> Floats:
    """The luminance (y, x) of a picture of assets/, of drawn boxes named by a number, or of a kind of `DRAWN`."""
    if name in DRAWN:
        return DRAWN[name](np.random.default_rng([7, seed, list(DRAWN).index(name)]))
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


def rates(seeds: Sequence[int], names: Sequence[str] = (*SCENES, "1", "2")) -> dict[str, list[float]]:
    """Of each target the ratios of the contrast stated to the known one; NaN where it is withheld."""
    found: dict[str, list[float]] = {name: [] for name in (*WRONG, "another picture")}
    rows, columns = SHAPE
    region = (columns // 4, rows // 4, columns // 2, rows // 2)
    for seed in seeds:
        scenes = {name: _scene(name, seed) for name in names}
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


def hologram_rates(seeds: Sequence[int]) -> dict[str, list[float]]:
    """Of each target of holograms of drawn scenes the ratios of the contrast stated to that of the right one."""
    found: dict[str, list[float]] = {name: [] for name in (*WRONG, "another picture", "another plane")}
    rows, columns = (n // 2 for n in SHAPE)
    region = (columns // 4, rows // 4, columns // 2, rows // 2)
    for seed, preset, (number, name) in itertools.product(seeds, BENCHES, enumerate(DRAWN)):
        iterations, begin = ((20, "random"), (60, "smooth"), (150, "random"))[(seed + number) % 3]
        system = hv.load(preset).with_(shape=[rows, columns])
        stacks = [_stack(system, other, seed) for other in (name, list(DRAWN)[(number + 1) % len(DRAWN)])]
        *_, state = hv.iterate(system, stacks[0], hv.Settings(iterations=iterations, begin=begin, seed=seed))
        luminance = hv.simulate(state.best.system, state.best.drive, backend="torch").xyz[..., 1]
        for plane in range(len(luminance)):
            for kind, target, others in _hologram_targets(stacks, plane):
                of = luminance_contrast(luminance[plane], region, target, others=others)
                if kind == "the right one":
                    known = of.estimate.contrast
                    if of.withheld:
                        print(f"{preset}, {name}, seed {seed}, plane {plane}: {of.withheld}", file=sys.stderr)
                found[kind].append(np.nan if of.withheld else of.estimate.contrast / known)
    return found


def _stack(system: hv.System, name: str, seed: int) -> NDArray[np.float32]:
    """The focal stack of a drawn scene whose left is near, with a depth of blobs."""
    scene, depth = _scene(name, seed), gaussian_filter(np.random.default_rng([8, seed]).normal(size=SHAPE), 12)
    with tempfile.TemporaryDirectory() as folder:
        for file, values in (("scene", srgb_encode(scene / scene.max())), ("depth", depth > 0)):
            Image.fromarray((255 * np.asarray(values)).astype(np.uint8)).save(f"{folder}/{file}.png")
        return hv.target_for(system, f"{folder}/scene.png", hv.Placement(depth=f"{folder}/depth.png")).stack


def _by_channel(make: Callable[[Floats], Floats], picture: NDArray[np.floating]) -> NDArray[np.floating]:
    return np.stack([make(np.asarray(channel)) for channel in np.moveaxis(picture, -1, 0)], axis=-1)


def _hologram_targets(
    stacks: Sequence[NDArray[np.float32]], plane: int
) -> Iterator[tuple[str, NDArray[np.floating], OtherPlanes]]:
    """Each kind of target beside a plane: its name, it, and those of the other planes as they go with it.

    They were made for their planes, but for that of another plane, as of a focal stack out of order.
    """
    own = {f"at plane {k}": picture for k, picture in enumerate(stacks[0])}
    rest = {k: v for k, v in own.items() if k != f"at plane {plane}"}
    for kind, make in WRONG.items():
        yield (
            kind,
            _by_channel(make, stacks[0][plane]),
            OtherPlanes({k: _by_channel(make, v) for k, v in rest.items()}, are_mistakable=False),
        )
    yield "another picture", stacks[1][plane], NO_OTHERS
    far = 0 if plane else len(stacks[0]) - 1
    yield "another plane", stacks[0][far], OtherPlanes({k: v for k, v in own.items() if k != f"at plane {far}"})


def main(arguments: list[str] | None = None) -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20, help="number of them")
    parser.add_argument("--first", type=int, default=0, help="the first of them; those below 20 were looked at")
    parser.add_argument("--scenes", choices=("known", "drawn"), default="known")
    parser.add_argument("--holograms", action="store_true", help="of drawn scenes, in place of scenes times speckle")
    args = parser.parse_args(arguments)
    names = tuple(DRAWN) if args.scenes == "drawn" else (*SCENES, "1", "2")
    seeds = range(args.first, args.first + args.seeds)
    found = hologram_rates(seeds) if args.holograms else rates(seeds, names)
    print(
        "| target | pictures | withheld | stated, within 10 % | stated, more than 10 % too high | too low | largest |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for name, values in found.items():
        ratio = np.array(values)
        stated = ratio[np.isfinite(ratio)]
        high, low = int((stated > 1.1).sum()), int((stated < 0.9).sum())
        largest = f"{stated.max():.2f}" if stated.size else "–"
        shares = (ratio.size - stated.size, stated.size - high - low, high, low)
        print(f"| {name} | {ratio.size} | " + " | ".join(f"{of / ratio.size:.1%}" for of in shares) + f" | {largest} |")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
