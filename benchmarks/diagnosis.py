"""Measures how often `holoview diagnose` names the right cause, for hidden effects of all kinds and sizes.

    python -m benchmarks.diagnosis --families singles pairs nothing --repeats 1 -o out/diagnosis.jsonl
    python -m benchmarks.diagnosis --summary out/diagnosis.jsonl

Each case is drawn from a seed, measured on a virtual bench with noise, and diagnosed without knowledge of the truth.
Families: one effect (singles), two (pairs), none (nothing), none but jitter of the measurement (nuisances), one that
the library lacks (deleted), and none in data from samples twice as fine as the model's (sampling). The output has one
line of JSON for each case; the summary prints rates and the confusion matrix.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, Nuisances, make_captures
from holoview.bench.diagnose.pipeline import diagnose
from holoview.light.model.bench_parts import Modulator, Relay
from holoview.light.model.effects.registry import listed_effects
from holoview.light.model.system import System
from holoview.util.errors import UserError
from tests.diagnose.effect_sampling import sample_effect

UNSEEN = 1.02  # χ²/n below which a hidden effect can't be told from nothing
SIZES = {"small": 0.15, "medium": 0.45, "large": 0.9}
PLANES = (4e-3, 6e-3)  # where a hidden effect needs more than one
PLANES_OF_THEIR_OWN = (3e-3, 4e-3, 5e-3, 6e-3)  # where each has its own error
FAMILIES = ("singles", "pairs", "nothing", "nuisances", "deleted", "sampling")


@dataclass
class Case:
    """The hidden effects of a case, and the diagnosis."""

    family: str
    size: str
    seed: int
    truth: dict[str, dict[str, float]]
    named: list[str] = field(default_factory=list)
    verdict: str = ""
    values: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    chi2: list[float] = field(default_factory=list)
    rivals: list[list[str]] = field(default_factory=list)
    confounded: dict[str, list[str]] = field(default_factory=dict)
    lives_in: list[str] = field(default_factory=list)
    seconds: float = 0.0
    cpu_seconds: float = 0.0


def bench(rows: int = 96, columns: int = 128) -> System:
    """Two modulators of 16 levels, four wavelengths, one plane."""
    stroke = 825e-9
    modulator = Modulator(pitch_m=8e-6, shape=(rows, columns), stroke_m=stroke, levels=np.linspace(0.0, 1.0, 16))
    return System(
        wavelengths_m=np.array([450e-9, 520e-9, 580e-9, 638e-9]),
        amplitudes=np.ones((1, 4)),
        modulators=(modulator, modulator),
        gap_m=1e-3,
        planes_m=np.array([4e-3]),
        relay1=Relay(iris_na=0.03),
        relay2=Relay(iris_na=0.03),
        observer="mono",
    )


def cases(args: argparse.Namespace) -> Iterator[Case]:
    """The cases, in an order in which all effects come early."""
    names = [n for n in listed_effects() if not args.only or n in args.only]
    system, sizes = bench(*args.shape), args.sizes
    for repeat in range(args.repeats):
        for family in args.families:
            for size in sizes if family in ("singles", "pairs", "deleted") else ["-"]:
                for k, name in enumerate(names if family in ("singles", "deleted") else range(_count(family, names))):
                    seed = args.seed + 1000 * repeat + 37 * k + 7 * (list(SIZES).index(size) if size in SIZES else 3)
                    rng = np.random.default_rng(seed)
                    hidden = _hidden(family, name, names, rng)
                    facts = replace(system, planes_m=np.array(_planes(hidden) or system.planes_m))
                    truth = {n: sample_effect(listed_effects()[n], facts, SIZES.get(size, 0.3), rng) for n in hidden}
                    yield Case(family, size, seed, truth)


def _planes(hidden: Iterable[str]) -> tuple[float, ...] | None:
    """The planes of a session with these effects; None where the bench's are enough."""
    if "plane_errors" in hidden:
        return PLANES_OF_THEIR_OWN
    return PLANES if any(listed_effects()[name].needs.planes > 1 for name in hidden) else None


def _count(family: str, names: list[str]) -> int:
    return {"pairs": 10, "nothing": 10, "nuisances": 10, "sampling": 4}[family]


def _hidden(family: str, name: Any, names: list[str], rng: np.random.Generator) -> list[str]:
    if family in ("singles", "deleted"):
        return [name]
    if family != "pairs":
        return []
    while True:
        pair = sorted(rng.choice(names, 2, replace=False))
        if (
            pair[1] not in listed_effects()[pair[0]].degenerate_with
            and pair[0] not in listed_effects()[pair[1]].degenerate_with
        ):
            return [str(p) for p in pair]


def measure(case: Case, each: int, shape: list[int]) -> Captures:
    """The captures of a case."""
    jitter = Nuisances(0.003, 0.01, 0.5e-6, 0.05e-9) if case.family == "nuisances" else Nuisances()
    planes = _planes(case.truth)
    finer = 2 if case.family == "sampling" else 1
    return make_captures(
        bench(*shape),
        case.truth,
        AcquisitionSettings(
            captures_per_condition=each // len(planes or (1,)),
            seed=case.seed,
            nuisances=jitter,
            finer=finer,
            planes_m=planes,
        ),
    )


def solve(case: Case, args: argparse.Namespace) -> Case:
    """Diagnose a case and store the result in it."""
    captures = measure(case, args.each, args.shape)
    library = [e for e in listed_effects().values() if case.family != "deleted" or e.id not in _with_equals(case)]
    began, cpu = time.monotonic(), time.process_time()
    free_maps = case.family == "deleted"
    found = diagnose(captures, library, workers=args.workers, free_maps=free_maps, thorough=args.thorough)
    case.seconds, case.cpu_seconds = time.monotonic() - began, time.process_time() - cpu
    case.verdict, case.named = str(found.verdict), [c.effect for c in found.causes]
    case.values = {
        c.effect: {n: [i.value, i.sigma, i.half_width] for n, i in c.intervals.items()} for c in found.causes
    }
    case.chi2, case.rivals = [found.before.chi2_per_pixel, found.after.chi2_per_pixel], [list(r) for r in found.rivals]
    case.confounded = {c.effect: list(c.confounded_with) for c in found.causes}
    case.lives_in = list(found.lives_in)
    return case


def _with_equals(case: Case) -> set[str]:
    deleted = set(case.truth)
    for name, effect in listed_effects().items():
        if deleted & {name} or deleted & set(effect.degenerate_with):
            deleted |= {name, *effect.degenerate_with} if name in case.truth else {name}
    return deleted


def is_right(case: Case) -> bool:
    """Whether the verdict is right; a cause that is degenerate with the true one counts as right."""
    if case.family in ("nothing", "nuisances"):
        return case.verdict == "consistent" and not case.named
    if case.family == "sampling":
        return not case.named or case.verdict not in ("explained", "ambiguous")
    if case.family == "deleted":
        unseen = case.verdict == "consistent" and case.chi2[0] < UNSEEN
        return unseen or case.verdict in ("unexplained", "partly-explained")
    named = case.named[: max(len(case.truth), 1)]
    return all(any(_same(t, n) for n in named) for t in case.truth)


def is_covered(case: Case) -> list[bool]:
    """For each parameter of a named cause, whether its 95 % interval contains the true value."""
    inside = []
    for effect, values in case.truth.items():
        for name, true in values.items():
            found = case.values.get(effect, {}).get(name)
            if found is not None:
                inside.append(
                    abs(abs(found[0]) - abs(true)) <= found[2]
                    if _is_even(effect, name)
                    else abs(found[0] - true) <= found[2]
                )
    return inside


def _is_even(effect: str, name: str) -> bool:
    return next(p for p in listed_effects()[effect].parameters if p.name == name).even_symmetric


def _same(a: str, b: str) -> bool:
    """Whether two causes are the same, or the same physics; b may be a wrong record, which is no effect."""
    effects = listed_effects()
    return a == b or (b in effects and (b in effects[a].degenerate_with or a in effects[b].degenerate_with))


def summary(lines: list[Case]) -> str:
    """Rates by family, coverage, seconds, and the confusion matrix of single effects."""
    out = []
    groups: dict[tuple[str, str], list[Case]] = defaultdict(list)
    for case in lines:
        groups[case.family, case.size].append(case)
    for (family, size), some in sorted(groups.items()):
        right = sum(map(is_right, some))
        verdicts = ", ".join(f"{k} {v}" for k, v in Counter(c.verdict for c in some).most_common())
        open_ones = sum(c.verdict == "ambiguous" for c in some) if family == "deleted" else 0
        apart = f" ({open_ones} ambiguous, neither right nor a confident name)" if open_ones else ""
        cpu = np.median([c.cpu_seconds for c in some])
        out.append(
            f"{family:10s} {size:7s} {right}/{len(some)} right{apart}; {verdicts}; median {cpu:.1f} s of processor time"
        )
    inside = [flag for c in lines if c.family in ("singles", "pairs") and is_right(c) for flag in is_covered(c)]
    if inside:
        out.append(f"true value inside its 95 % interval: {sum(inside)}/{len(inside)}")
    out += ["", *confusion(lines), ""]
    for case in lines:
        if case.family in ("singles", "deleted", "pairs") and (
            not is_right(case) or (case.family != "deleted" and case.verdict != "explained")
        ):
            truth, named = " + ".join(case.truth), " + ".join(case.named) or "–"
            out.append(
                f"{case.family} {case.size} {truth} (seed {case.seed}): {case.verdict} {named}, "
                f"χ² {case.chi2[0]:.4g} → {case.chi2[1]:.4g}"
            )
    return "\n".join(out)


def confusion(lines: list[Case]) -> list[str]:
    """A row of the confusion matrix for each single hidden effect: how often each cause was named first; no zeros."""
    rows: dict[str, Counter[str]] = defaultdict(Counter)
    for case in lines:
        if case.family == "singles":
            rows[" + ".join(case.truth)][case.named[0] if case.named else "–"] += 1
    return [f"{true:18s} {', '.join(f'{k} {v}' for k, v in row.most_common())}" for true, row in sorted(rows.items())]


def main() -> None:
    """Run the cases, or summarise files of results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--families", nargs="+", choices=FAMILIES, default=["singles"])
    parser.add_argument("--sizes", nargs="+", choices=list(SIZES), default=list(SIZES))
    parser.add_argument("--only", nargs="+", default=[], help="effects")
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--each", type=int, default=8, help="captures a wavelength")
    parser.add_argument("--shape", type=int, nargs=2, default=[96, 128], help="rows and columns of the modulators")
    parser.add_argument("--thorough", action="store_true", help="without a limit of fields")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--summary", type=Path, nargs="+")
    args = parser.parse_args()
    if args.summary:
        print(summary([Case(**json.loads(line)) for path in args.summary for line in path.read_text().splitlines()]))
        return
    done = []
    for case in cases(args):
        try:
            done.append(solve(case, args))
        except UserError as error:
            print(f"{case.family} {case.size} {case.truth}: can't be measured: {error}", flush=True)
            continue
        line = json.dumps(asdict(done[-1]))
        if args.output:
            with args.output.open("a") as file:
                file.write(line + "\n")
        mark = "right" if is_right(case) else "WRONG"
        print(
            f"{mark} {case.family} {case.size} {'+'.join(case.truth)} → {case.verdict} {'+'.join(case.named)} "
            f"{case.chi2[0]:.3f} → {case.chi2[1]:.3f} {case.seconds:.0f} s, {case.cpu_seconds:.0f} cpu",
            flush=True,
        )
    print(summary(done))


if __name__ == "__main__":
    main()
