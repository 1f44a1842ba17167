"""Feeds holoview hostile inputs for a while and counts how each ends, by family: `make fuzz`.

    python -m benchmarks.fuzz --minutes 60 --seed 1
    python -m benchmarks.fuzz --corpus

Each case runs in a process of its own with limits of time and memory (`tests/fuzz`). It must end "clear", refused in
one line, or "worked", with finite results; a case that ends otherwise is printed with what it takes to run it again.
"""

from __future__ import annotations

import argparse
import os
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

from holoview.util.memory_limit import VARIABLE
from tests.fuzz import corpus, corpus_binary
from tests.fuzz.field_files import hostile_fields
from tests.fuzz.mutations import random_cases
from tests.fuzz.trial import ACCEPTABLE, VERDICTS, Case, Limits, Outcome, preload, run_case

Counts = dict[str, Counter[str]]


def run_cases(cases: Iterable[Case], limits: Limits, verbose: bool = True) -> tuple[Counts, list[tuple[Case, Outcome]]]:
    """The number of cases by family and verdict, and those that ended badly."""
    counts: Counts = {}
    bad = []
    for case in cases:
        with TemporaryDirectory() as name:
            outcome = run_case(case, Path(name), limits)
        counts.setdefault(case.family, Counter())[outcome.verdict] += 1
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
    """The counts as a table."""
    lines = [f"{'family':<24}{'tried':>8}" + "".join(f"{v:>12}" for v in VERDICTS)]
    for family, count in counts.items():
        lines.append(f"{family:<24}{count.total():>8}" + "".join(f"{count[v]:>12}" for v in VERDICTS))
    return "\n".join(lines)


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
    return [*kept[seed % step :: step][:count], *islice(random_cases(seed), count)]


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
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--families", nargs="+", metavar="NAME", help="of random cases; all if absent")
    parser.add_argument("--corpus", action="store_true", help="all inputs that are kept, however long that takes")
    args = parser.parse_args()
    os.environ[VARIABLE] = MEMORY
    preload()
    cases = whole_corpus() if args.corpus else for_minutes(random_cases(args.seed, args.families), args.minutes)
    counts, bad = run_cases(cases, Limits())
    print(table(counts))
    raise SystemExit(1 if bad else 0)


if __name__ == "__main__":
    main()
