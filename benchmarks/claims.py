"""The paper's comparisons of schemes, repeated: dB between two schemes at equal settings, with the eyebox beside it.

python -m benchmarks.claims                     96 x 128 modulator pixels (256 x 192 samples), three seeds, two targets
python -m benchmarks.claims --size full         384 x 512 pixels (1024 x 768 samples), one seed, the main comparisons

Small ones live on a periodic grid, optimised and scored alike; full ones are optimised on the compact grid and scored
on the linear one. PSNR of linear sRGB clipped to 0…1 at fixed brightness, mean over five planes, or the planes between.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import holoview as hv
from holoview.files import data_dir
from holoview.optimise.memory import on_compact_grid
from holoview.scheme import with_scheme
from holoview.score import eyebox_of, halfway, score
from holoview.system import System
from holoview.targets.build import Placement

SHAPES = {"small": (96, 128), "full": (384, 512)}
TARGETS = ("still-life", "resolution")


@dataclass(frozen=True)
class Claim:
    """`better` against `worse`: names of schemes, with settings that both are given."""

    what: str
    paper: str
    better: str
    worse: str
    settings: dict[str, Any] = field(default_factory=dict)
    free_wavelengths: bool = False  # of the better one
    full: bool = False  # also at full size


CLAIMS = (
    Claim("8 wavelengths, 1 frame, against simultaneous", "+3.6", "holochrome-8", "simultaneous", full=True),
    Claim("16 wavelengths, 1 frame, against simultaneous", "+4.3", "holochrome-16", "simultaneous", full=True),
    Claim("8 wavelengths, 3 frames, against multiplexed", "+3.5", "holochrome-8x3", "multiplexed", full=True),
    Claim("8 wavelengths, 3 frames, against simultaneous", "+6.7", "holochrome-8x3", "simultaneous", full=True),
    Claim("8 wavelengths, 3 frames, against time-sequential", "> 6", "holochrome-8x3", "time-sequential", full=True),
    Claim("two modulators against one, 8 wavelengths", "+5.3", "holochrome-8", "holochrome-8+1slm", full=True),
    Claim(
        "the same, eyebox evened out", "+5.3", "holochrome-8", "holochrome-8+1slm", settings={"eyebox": 0.03}, full=True
    ),
    Claim("two modulators against one, simultaneous", "", "simultaneous", "simultaneous+1slm"),
    Claim("9 wavelengths, 3 frames, against 3 x 3 sources", "0", "holochrome-9x3", "time-sequential+multisource-3x3"),
    Claim("8 free wavelengths against fixed ones", "1 … 2", "holochrome-8", "holochrome-8", free_wavelengths=True),
)


@dataclass(frozen=True)
class Result:
    """Of one optimisation: PSNR (dB) at its planes and between them, eyebox variation, seconds."""

    psnr_db: float
    held_out_db: float
    eyebox: float
    seconds: float


@dataclass(frozen=True)
class Bench:
    """What all optimisations of a run share."""

    size: str
    iterations: int
    seeds: tuple[int, ...]
    targets: tuple[str, ...]

    def system(self, scheme: str) -> System:
        base = hv.load("holochrome-8").with_(shape=SHAPES[self.size])
        return with_scheme(base.with_(propagation="periodic") if self.size == "small" else base, scheme)


@cache
def optimised(bench: Bench, scheme: str, target: str, seed: int, settings: tuple[tuple[str, Any], ...]) -> Result:
    """One optimisation and its scores; repeated ones are looked up."""
    system = bench.system(scheme)
    planes = np.concatenate([system.planes_m, halfway(system.planes_m)])
    depth = data_dir("assets") / "still-life-depth.png" if target == "still-life" else None
    picture = data_dir("assets") / f"{target}.png"
    wanted = hv.target_for(system, picture, Placement(depth=depth), planes=planes).stack
    count = len(system.planes_m)
    started = time.perf_counter()
    options = hv.Settings(iterations=bench.iterations, seed=seed, **dict(settings))
    *_, state = hv.iterate(on_compact_grid(system), wanted[:count], options)
    seconds = time.perf_counter() - started
    best = state.best.system.edit({"propagation": system.sampling.propagation})
    hologram = hv.Hologram(state.best.drive, best)
    view = hv.simulate(best, hologram.drive, planes, backend="torch")
    psnrs = score(view, wanted).psnr.planes_db
    spread = eyebox_of(hologram).coefficient_of_variation
    return Result(float(np.mean(psnrs[:count])), float(np.mean(psnrs[count:])), spread, seconds)


def compare(bench: Bench, claim: Claim) -> dict[str, Any]:
    """Mean over targets and seeds of the difference, and its spread over seeds."""
    shared = tuple(sorted(claim.settings.items()))
    free = (("free", ("patterns", "amplitudes", "wavelengths")),) if claim.free_wavelengths else ()
    gains, between, boxes = [], [], []
    for target in bench.targets:
        pairs = [
            (
                optimised(bench, claim.better, target, seed, shared + free),
                optimised(bench, claim.worse, target, seed, shared),
            )
            for seed in bench.seeds
        ]
        gains.append([a.psnr_db - b.psnr_db for a, b in pairs])
        between.append([a.held_out_db - b.held_out_db for a, b in pairs])
        boxes.append([(a.eyebox, b.eyebox) for a, b in pairs])
    return {
        "claim": claim.what,
        "paper_db": claim.paper,
        "gain_db": {t: round(float(np.mean(g)), 2) for t, g in zip(bench.targets, gains, strict=True)},
        "seed_spread_db": round(float(np.max(np.ptp(gains, axis=1))), 2),
        "held_out_gain_db": round(float(np.mean(between)), 2),
        "eyebox_variation": np.mean(boxes, axis=(0, 1)).round(2).tolist(),
    }


def table(rows: Iterable[dict[str, Any]]) -> list[str]:
    """Rows as a Markdown table."""
    lines = [
        "| comparison | paper (dB) | here, by target (dB) | seeds ± | between planes | eyebox variation |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for row in rows:
        here = ", ".join(f"{target} {gain:+.2f}" for target, gain in row["gain_db"].items())
        boxes = " / ".join(f"{value:.2f}" for value in row["eyebox_variation"])
        lines.append(
            f"| {row['claim']} | {row['paper_db']} | {here} | {row['seed_spread_db']:.2f} "
            f"| {row['held_out_gain_db']:+.2f} | {boxes} |"
        )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", choices=tuple(SHAPES), default="small")
    parser.add_argument("--iterations", type=int)
    parser.add_argument("--seeds", type=int)
    parser.add_argument("--json", metavar="FILE", type=Path)
    args = parser.parse_args()
    full = args.size == "full"
    seeds = tuple(range(args.seeds or (1 if full else 3)))
    bench = Bench(args.size, args.iterations or (60 if full else 150), seeds, TARGETS[:1] if full else TARGETS)
    rows = []
    for claim in CLAIMS:
        if claim.full or not full:
            rows.append(compare(bench, claim))
            print(table(rows)[-1], flush=True)
    print("\n".join(["", *table(rows)]))
    if args.json:
        args.json.write_text(json.dumps({"iterations": bench.iterations, "seeds": len(seeds), "rows": rows}, indent=2))


if __name__ == "__main__":
    main()
