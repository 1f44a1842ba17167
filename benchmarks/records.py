"""Measures how often wrong records of captures are named, and how often right ones are blamed.

    python -m benchmarks.records --families singles pairs effects clean faulty --repeats 1 -o out/records.jsonl
    python -m benchmarks.records --summary out/records.jsonl

Each case is drawn from a seed: 32 captures of a virtual bench with noise, whose records are then spoiled by plain
numpy. Families: one mistake (singles), two of different kinds (pairs), one beside an effect of the bench (effects),
none (clean), none but an effect (faulty; the larger it is, the more tempting). A case is right if exactly the mistakes
are named, or if a rival, which predicts the same, names them. The output has one line of JSON for each case.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.common import count_of, markdown_table
from holoview.bench.captures.records import find_record_errors
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.light.model.bench_parts import Modulator, Relay
from holoview.light.model.effects.registry import listed_effects
from holoview.light.model.system import System
from holoview.util.errors import UserError
from tests.captures.records.mistakes import Name, all_mistakes, spoiled
from tests.diagnose.effect_sampling import sample_effect

FAMILIES = ("singles", "pairs", "effects", "clean", "faulty")
EFFECT_SIZES = {"effects": (0.45,), "faulty": (0.15, 0.45, 0.9)}
WAVELENGTHS_M = (450e-9, 520e-9, 580e-9, 638e-9)
PLANES_M = ((4e-3,), (3e-3, 4e-3), (3e-3, 4e-3, 5e-3, 6e-3))


@dataclass
class Case:
    """What was wrong, and what was named."""

    family: str
    seed: int
    truth: list[Name]
    effect: str = ""
    size: float = 0.0
    named: list[Name] = field(default_factory=list)
    rivals: list[list[Name]] = field(default_factory=list)
    correlation: tuple[float, float] = (0.0, 0.0)
    seconds: float = 0.0
    cpu_seconds: float = 0.0

    @property
    def right(self) -> bool:
        """Whether the mistakes are named, or can't be told from those that are."""
        truth = sorted(map(tuple, self.truth))
        return any(sorted(map(tuple, names)) == truth for names in (self.named, *self.rivals))

    @property
    def exact(self) -> bool:
        """Whether the mistakes are named."""
        return sorted(map(tuple, self.truth)) == sorted(map(tuple, self.named))


def bench(planes: int, rows: int = 96, columns: int = 128) -> System:
    """Two modulators of 16 levels, four wavelengths."""
    modulator = Modulator(pitch_m=8e-6, shape=(rows, columns), stroke_m=825e-9, levels=np.linspace(0.0, 1.0, 16))
    return System(
        wavelengths_m=np.array(WAVELENGTHS_M),
        amplitudes=np.ones((1, len(WAVELENGTHS_M))),
        modulators=(modulator, modulator),
        gap_m=1e-3,
        planes_m=np.array(PLANES_M[planes]),
        relay1=Relay(iris_na=0.03),
        relay2=Relay(iris_na=0.03),
        observer="mono",
    )


def cases(families: list[str], repeats: int, first_seed: int) -> Iterator[Case]:
    """The cases, in an order in which all kinds come early."""
    for repeat in range(repeats):
        seed = first_seed + 1000 * repeat
        for family in families:
            rng = np.random.default_rng([seed, FAMILIES.index(family)])
            every = _mistakes(seed)
            effects = [name for name in listed_effects() if name != "laser_power"]
            if family == "singles":
                yield from (Case(family, seed, [name]) for name in every)
            elif family == "pairs":
                yield from (Case(family, seed + k, _pair(rng, _mistakes(seed + k))) for k in range(len(every)))
            elif family == "clean":
                yield from (Case(family, seed + k, []) for k in range(20))
            else:
                for size in EFFECT_SIZES[family]:
                    for name in effects:
                        truth = [every[rng.integers(len(every))]] if family == "effects" else []
                        yield Case(family, seed, truth, name, size)


def _mistakes(seed: int) -> list[Name]:
    return list(all_mistakes(len(WAVELENGTHS_M), len(PLANES_M[seed % len(PLANES_M)])))


def _pair(rng: np.random.Generator, every: list[Name]) -> list[Name]:
    while True:
        first, second = (every[k] for k in rng.choice(len(every), 2, replace=False))
        if first[0] != second[0]:
            return sorted([first, second], key=every.index)


def run(case: Case) -> Case | None:
    """The case with what was named; None where an effect can't be measured."""
    planes = case.seed % len(PLANES_M)
    system = bench(planes)
    rng = np.random.default_rng([case.seed, *map(ord, case.effect)])
    values = {case.effect: sample_effect(listed_effects()[case.effect], system, case.size, rng)} if case.effect else {}
    each = 32 // (len(WAVELENGTHS_M) * len(PLANES_M[planes]))
    try:
        captures = make_captures(system, values, AcquisitionSettings(captures_per_condition=each, seed=case.seed))
    except UserError:
        return None
    known = all_mistakes(len(WAVELENGTHS_M), len(PLANES_M[planes]))
    wrong = spoiled(captures, *(known[name] for name in case.truth))
    began = time.process_time()
    found = find_record_errors(wrong)
    case.cpu_seconds = time.process_time() - began
    case.named = [(c.effect, c.choice) for c in found.corrections]
    case.rivals = [[(c.effect, c.choice) for c in rival] for rival in found.rivals]
    case.correlation, case.seconds = found.correlation, found.seconds
    return case


def summary(done: list[Case]) -> str:
    """Rates by family, and of single mistakes by id."""
    rows = []
    groups: dict[str, list[Case]] = defaultdict(list)
    for case in done:
        groups[case.family].append(case)
        if case.family == "singles":
            groups[f"singles: {case.truth[0][0]}"].append(case)
        if case.family == "faulty":
            groups[f"faulty, size {case.size:g}"].append(case)
    for name, group in groups.items():
        seconds = np.array([case.cpu_seconds for case in group])
        right, exact = (sum(getattr(case, what) for case in group) for what in ("right", "exact"))
        rows.append([name, f"{right} of {len(group)}", f"{exact}", f"{np.median(seconds):.1f} ({seconds.max():.1f})"])
    misses = [
        f"- {c.family} {c.seed} {c.effect} {c.size:g}: {c.truth} → {c.named}, {c.correlation[0]:.3f} → "
        f"{c.correlation[1]:.3f}"
        for c in done
        if not c.right
    ]
    header = ("cases", "right", "named exactly", "processor seconds, median (most)")
    return "\n".join([markdown_table(header, rows), *misses])


def main() -> None:
    """Runs or summarises."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--families", nargs="+", choices=FAMILIES, default=list(FAMILIES))
    parser.add_argument("--repeats", type=count_of, default=1)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--every", type=count_of, default=1, help="take only every so many-th case")
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--summary", type=Path)
    args = parser.parse_args()
    if args.summary is not None:
        lines = args.summary.read_text(encoding="utf-8").splitlines()
        print(summary([Case(**json.loads(line)) for line in lines]))
        return
    done = []
    for number, case in enumerate(cases(args.families, args.repeats, args.first_seed)):
        if number % args.every or (finished := run(case)) is None:
            continue
        done.append(finished)
        if args.output is not None:
            with args.output.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(finished)) + "\n")
    print(summary(done))


if __name__ == "__main__":
    main()
