"""Runs cases and counts how they end, by family."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.fuzz.trial import ACCEPTABLE, VERDICTS, Case, Limits, Outcome, run_case

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
