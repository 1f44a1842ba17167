"""Feeds holoview hostile inputs and counts how each ends, by family: `make fuzz`.

    python -m benchmarks.fuzz --cases 20000 --seed 1
    python -m benchmarks.fuzz --minutes 60 --families "MATLAB elements" TIFF
    python -m benchmarks.fuzz --corpus

Half of the cases are files that somebody wrote to do harm (`tests/fuzz/hostile_files`), a quarter each numbers that are
measured of what doesn't fit (`tests/fuzz/measured`), and valid files with damage and values of options
(`tests/fuzz/mutations`).

Each case runs in a process of its own with limits of time and memory (`tests/fuzz`). It must end "clear", refused in
one line, or "worked", with finite results; a case that ends otherwise is printed with what it takes to run it again.
"""

from __future__ import annotations

import argparse
import math
import os
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

from holoview.util.memory_limit import VARIABLE
from tests.fuzz import corpus, corpus_binary
from tests.fuzz.field_files import hostile_fields
from tests.fuzz.hostile_files import FAMILIES as HOSTILE
from tests.fuzz.hostile_files import hostile_cases
from tests.fuzz.measured import MAKERS as MEASURED
from tests.fuzz.measured import measured_cases
from tests.fuzz.mutations import random_cases
from tests.fuzz.trial import ACCEPTABLE, VERDICTS, Case, Limits, Outcome, preload, run_case

Counts = dict[str, Counter[str]]
"""By family how many cases ended how, and how long they took: all of them and the longest, ms."""
_ALL_MS, _LONGEST_MS = "ms of all", "ms of the longest"


def run_cases(cases: Iterable[Case], limits: Limits, verbose: bool = True) -> tuple[Counts, list[tuple[Case, Outcome]]]:
    """The number of cases by family and verdict, and those that ended badly."""
    counts: Counts = {}
    bad = []
    for case in cases:
        with TemporaryDirectory() as name:
            outcome = run_case(case, Path(name), limits)
        count = counts.setdefault(case.family, Counter())
        count[outcome.verdict] += 1
        count[_ALL_MS] += round(1e3 * outcome.seconds)
        count[_LONGEST_MS] = max(count[_LONGEST_MS], round(1e3 * outcome.seconds))
        if outcome.verdict not in ACCEPTABLE:
            bad.append((case, outcome))
            if verbose:
                last = outcome.errors.strip().splitlines()[-1:] or [""]
                print(
                    f"{outcome.verdict}: {case.family}: {case.name}: {last[0][:200]} "
                    f"[{outcome.peak / 1e6:.0f} MB, {outcome.seconds:.1f} s, code {outcome.code}]",
                    flush=True,
                )
    return counts, bad


def table(counts: Counts) -> str:
    """The counts as a table, with the mean and the greatest time of a case in seconds."""
    lines = [f"{'family':<26}{'tried':>8}" + "".join(f"{v:>12}" for v in VERDICTS) + f"{'mean s':>9}{'most s':>9}"]
    for family, count in counts.items():
        tried = sum(count[verdict] for verdict in VERDICTS)
        times = f"{count[_ALL_MS] / 1e3 / tried:>9.2f}{count[_LONGEST_MS] / 1e3:>9.2f}"
        lines.append(f"{family:<26}{tried:>8}" + "".join(f"{count[v]:>12}" for v in VERDICTS) + times)
    total = sum(count[verdict] for count in counts.values() for verdict in VERDICTS)
    return "\n".join([*lines, f"{'all':<26}{total:>8}"])


# --- which cases ---


MEMORY = "1500MB"
"""What holoview may take; a case that takes as much more than the process that it is forked from has gone too far."""


def whole_corpus() -> Iterator[Case]:
    """Every input that is kept."""
    yield from corpus.presets()
    yield from corpus.special_files()
    yield from corpus.options()
    yield from corpus_binary.pictures()
    yield from corpus_binary.captures()
    yield from corpus_binary.tensors()
    yield from hostile_fields()


def sample(seed: int, count: int) -> list[Case]:
    """So many cases of the corpus, spread over it, and as many random ones."""
    kept = list(whole_corpus())
    step = max(len(kept) // count, 1)
    return [*kept[seed % step :: step][:count], *islice(all_random_cases(seed), count)]


def all_random_cases(seed: int, families: Sequence[str] | None = None) -> Iterator[Case]:
    """Cases without end: two hostile files, a measured number, a damaged file or an option. families: only these."""
    asked = None if families is None else set(families)
    hostile = hostile_cases(seed, families) if asked is None or asked & set(HOSTILE) else iter(())
    measured = measured_cases(seed, families) if asked is None or asked & set(MEASURED) else iter(())
    damaged = random_cases(seed, families) if asked is None or asked - set(HOSTILE) - set(MEASURED) else iter(())
    while True:
        yield from islice(hostile, 2)
        yield from islice(measured, 1)
        yield from islice(damaged, 1)


def for_minutes(cases: Iterable[Case], minutes: float) -> Iterator[Case]:
    """The cases that begin within a time."""
    end = time.monotonic() + 60 * minutes
    for case in cases:
        if time.monotonic() > end:
            return
        yield case


def main() -> None:
    """Runs the corpus or random cases and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=math.inf, help="at most so long")
    parser.add_argument("--cases", type=int, default=20_000, help="so many of random cases (20000)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--families", nargs="+", metavar="NAME", help="of random cases; all if absent")
    parser.add_argument("--corpus", action="store_true", help="all inputs that are kept, however long that takes")
    args = parser.parse_args()
    os.environ[VARIABLE] = MEMORY
    preload()
    drawn = islice(all_random_cases(args.seed, args.families), args.cases)
    counts, bad = run_cases(whole_corpus() if args.corpus else for_minutes(drawn, args.minutes), Limits())
    print(table(counts))
    raise SystemExit(1 if bad else 0)


if __name__ == "__main__":
    main()
