"""Measures how often `holoview diagnose` finds something in captures of benches without a fault.

    python -m benchmarks.fault_free --benches 200 -o out/fault-free.jsonl
    python -m benchmarks.fault_free --benches 3 --size 24 --seed 7     # the smallest: three benches, a few seconds
    python -m benchmarks.fault_free --summary out/fault-free.jsonl

Every bench is drawn from a seed: one or two modulators in the near field, or one on a Fourier bench; focal length or
distance 20 to 400 mm, 1 to 5 lasers, rough, smooth and mixed patterns, irises or none, cameras of 8 to 16 bits. The
captures are holoview's own, with shot noise, read noise and digitisation; all effects are candidates. Right is: no
capture and no record is blamed, no cause is named, the verdict is `consistent`.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.common import append_line, count_of, lines_or_summary, markdown_table, read_lines
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.pipeline import diagnose
from holoview.light.model.bench_parts import Modulator, Relay
from holoview.light.model.effects.effect import Effect
from holoview.light.model.system import System

ARRANGEMENTS = ("near field, one modulator", "near field, two modulators", "Fourier bench")
BLURS_PX = {"smooth": (6.0, 4.0, 3.0), "rough": (0.0, 0.5), "mixed": (6.0, 3.0, 1.5, 0.0)}
PITCHES_M = (3.74e-6, 6.4e-6, 8e-6, 12.5e-6, 20e-6, 36e-6)
BITS = (8, 10, 12, 14, 16)
LEVELS = (2, 16, 256, 1024)
SMALLEST, LARGEST = 24, 96  # modulator pixels along a side
DISTANCES_M = (0.02, 0.4)
WAVELENGTHS_M = (405e-9, 850e-9)
MAX_CAPTURES = 24
MOST_SPREAD = 9.0  # modulator widths by which light may spread sideways: with 10 a capture file is refused


@dataclass
class Bench:
    """What was drawn, and what the diagnosis said. excess: χ²/n − 1 of held-out captures, in σ of chance."""

    seed: int
    arrangement: str
    patterns: str
    drawn: dict[str, object]
    captures: int = 0
    verdict: str = ""
    blamed: dict[int, str] = field(default_factory=dict)
    causes: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    chi2: float = 0.0
    seconds: float = 0.0

    @property
    def is_right(self) -> bool:
        """Whether nothing is found."""
        return self.verdict == "consistent" and not self.blamed and not self.causes


def draw(seed: int, largest: int = LARGEST) -> tuple[Bench, System, AcquisitionSettings]:
    """A bench and a session of captures. largest: modulator pixels along a side."""
    rng = np.random.default_rng(seed)
    arrangement, patterns = ARRANGEMENTS[seed % 3], list(BLURS_PX)[seed // 3 % 3]
    count, is_fourier = 1 + (seed % 3 == 1), seed % 3 == 2
    shape = tuple(int(n) for n in rng.integers(SMALLEST, largest + 1, 2))
    pitch_m, lasers = float(rng.choice(PITCHES_M)), int(rng.integers(1, 6))
    wavelengths = np.sort(rng.uniform(*WAVELENGTHS_M, lasers).round(10))
    sine = float(wavelengths.min()) / (2 * pitch_m)
    iris_na = round(float(rng.uniform(0.3, 1.2)) * sine, 5) if rng.random() < 0.5 and not is_fourier else None
    reach_m = MOST_SPREAD * max(shape) * pitch_m / min(sine, iris_na or sine)
    # Beyond it the band limit of a grid of twice the size leaves no frequency beside zero at the longest wavelength.
    farthest_m = 0.9 * (2 * max(shape) * pitch_m) ** 2 / (2 * float(wavelengths.max()))
    length_m = _log_uniform(
        rng, DISTANCES_M[0], DISTANCES_M[1] if is_fourier else min(DISTANCES_M[1], reach_m, farthest_m)
    )
    gap_m = _log_uniform(rng, 0.2e-3, min(20e-3, reach_m))
    levels, bits = int(rng.choice(LEVELS)), int(rng.choice(BITS))
    planes = (1.0,) if rng.random() < 0.7 or lasers > 3 else (1.0, float(rng.uniform(0.8, 0.95)))
    depth_m = float(wavelengths.min()) * (length_m / (max(shape) * pitch_m)) ** 2
    panel = Modulator(
        pitch_m=pitch_m, shape=shape, stroke_m=float(rng.uniform(0.9, 1.2) * wavelengths.max()), levels=levels
    )
    system = System(
        wavelengths_m=wavelengths,
        amplitudes=np.ones((1, lasers)),
        modulators=(panel,) * count,
        gap_m=gap_m if count == 2 else None,
        planes_m=np.array([0.0]) if is_fourier else length_m * np.array(planes),
        relay1=Relay(iris_na=iris_na if count == 2 else None),
        relay2=Relay(iris_na=iris_na),
        observer="mono",
    )
    conditions = lasers * len(planes)
    black = float(rng.choice([0.01, 0.02, 0.05])) * 2**bits
    settings = AcquisitionSettings(
        captures_per_condition=max(3 if conditions > 2 else 6, min(12, MAX_CAPTURES // conditions)),
        blur_sigmas_px=BLURS_PX[patterns],
        power_range=(0.5, 1.0) if rng.random() < 0.7 else (1.0, 1.0),
        camera_pitch_m=None
        if rng.random() < 0.5
        else float(rng.choice([2.4e-6, 3.45e-6, 5.5e-6]))
        if is_fourier
        else pitch_m,
        camera_shape=None if rng.random() < 0.5 else (shape[0] + 8, shape[1] + 8),
        bit_depth=bits,
        full_well=_log_uniform(rng, 2e3, 5e4),
        read_noise=float(rng.uniform(1.0, 6.0)),
        black_level=float(np.rint(black)),
        focal_length_m=length_m if is_fourier else None,
        planes_m=tuple((p - 1) * min(10 * depth_m, 2 * length_m) for p in planes) if is_fourier else None,
        seed=seed,
    )
    drawn: dict[str, object] = {
        "shape": shape,
        "pitch_um": pitch_m * 1e6,
        "lasers": lasers,
        "length_mm": length_m * 1e3,
    }
    drawn |= {"gap_mm": gap_m * 1e3} if count == 2 else {}
    drawn |= {"iris_na": iris_na, "levels": levels, "bits": bits, "planes": len(planes)}
    drawn |= {"full_well": settings.full_well, "read_noise": settings.read_noise, "camera": settings.camera_shape}
    return Bench(seed, arrangement, patterns, drawn), system, settings


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(min(low, high)), np.log(high))))


def solve(seed: int, largest: int = LARGEST, among: Sequence[Effect] | None = None) -> Bench:
    """A drawn bench, measured and diagnosed. among: the candidates; None: all effects."""
    bench, system, settings = draw(seed, largest)
    captures = make_captures(system, {}, settings)
    began = time.process_time()
    found = diagnose(captures, among, workers=1, free_maps=False)
    bench.seconds = time.process_time() - began
    bench.captures, bench.verdict = len(captures), str(found.verdict)
    bench.blamed = {bad.index: bad.why for bad in found.bad_captures}
    bench.causes = [cause.effect for cause in found.causes]
    bench.notes = [note for note in found.notes if "can't be" not in note and "With one" not in note]
    bench.chi2 = found.after.chi2_per_pixel
    return bench


def summary(benches: Sequence[Bench]) -> str:
    """A table by kind, and the benches in which something was found."""
    rows = []
    for arrangement in ARRANGEMENTS:
        for patterns in BLURS_PX:
            some = [b for b in benches if (b.arrangement, b.patterns) == (arrangement, patterns)]
            if some:
                rows.append([f"{arrangement}, {patterns} patterns", *_cells(some)])
    header = ["kind", "benches", "captures", "blamed", "causes named", "`consistent`", "seconds: median (most)"]
    table = markdown_table(header, [*rows, ["all", *_cells(benches)]])
    wrong = [json.dumps(asdict(b)) for b in benches if not b.is_right]
    return "\n".join([table, *wrong])


def _cells(benches: Sequence[Bench]) -> list[str]:
    seconds = [b.seconds for b in benches]
    verdicts = Counter(b.verdict for b in benches)
    counts = (
        len(benches),
        sum(b.captures for b in benches),
        sum(len(b.blamed) for b in benches),
        sum(len(b.causes) for b in benches),
        verdicts["consistent"],
    )
    return [*map(str, counts), f"{np.median(seconds):.1f} ({max(seconds):.0f})"]


def _print_summary(path: Path) -> None:
    print(summary([Bench(**row) for row in read_lines(path)]))


def main() -> None:
    """Draws and diagnoses the benches, or summarises their results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--benches", type=count_of, default=200)
    parser.add_argument("--seed", type=int, default=0, help="of the first bench")
    parser.add_argument(
        "--size", type=count_of, default=LARGEST, help=f"most modulator pixels along a side, from {SMALLEST}"
    )
    args = lines_or_summary(parser, "fault-free", _print_summary)
    if args.size < SMALLEST:
        parser.error(f"--size {args.size}: from {SMALLEST}")
    done = []
    for seed in range(args.seed, args.seed + args.benches):
        done.append(solve(seed, args.size))
        append_line(args.output, asdict(done[-1]))
        print(json.dumps(asdict(done[-1])), flush=True)
    print(summary(done))


if __name__ == "__main__":
    main()
