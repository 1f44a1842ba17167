"""Whether a diagnosis answers the same on a busy computer, on one core, and with any number of processes.

    python -m benchmarks.busy_diagnosis -o out/busy_diagnosis.jsonl
    python -m benchmarks.busy_diagnosis --conditions "4 busy loops" --files nothing pair
    python -m benchmarks.busy_diagnosis --summary out/busy_diagnosis.jsonl

Files of 16 captures of 40 × 32 modulator pixels, drawn as those of `benchmarks.diagnosis`, are diagnosed by a process
for each condition. The JSON of each diagnosis but for its seconds is compared, in all digits. The output has a line for
each file and condition; the summary is a table of the verdicts, with the seconds that passed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from benchmarks.busy_machine import busy_loops
from benchmarks.common import append_line, lines_or_summary, read_lines
from benchmarks.diagnosis import cases, measure
from holoview.bench.diagnose.config import BudgetConfig, SearchConfig
from holoview.bench.diagnose.pipeline import diagnose
from holoview.light.model.effects.registry import listed_effects

_SEED = 82101
FEW = ("gap", "crosstalk", "tilt", "undiffracted", "camera_blur", "vignetting", "iris1", "ambient", "slm_alignment")
FILES: dict[str, tuple[str, str, list[str], int]] = {
    "nothing": ("nothing", "-", [], 32_000),
    "gap": ("singles", "medium", ["gap"], 32_000),
    "fringes": ("singles", "small", ["slm1_fringes"], 32_000),
    "pair": ("pairs", "medium", ["gap", "crosstalk"], 32_000),
    "pair, 400 fields": ("pairs", "large", ["tilt", "undiffracted"], 400),
    "not a candidate, 400 fields": ("deleted", "medium", ["crosstalk"], 400),
}
"""Name: family, size, effects, and the budget in fields, by default 32 000. The last three have `FEW` candidates."""
CONDITIONS: dict[str, tuple[list[str], int, int]] = {
    "alone": ([], 0, 2),
    "4 busy loops": ([], 4, 2),
    "one core": (["taskset", "-c", "0"], 0, 2),
    "nice 19": (["nice", "-n", "19"], 0, 2),
    "1 process": ([], 0, 1),
    "8 processes": ([], 0, 8),
}
"""Name: what the command begins with, busy loops beside it, and processes of the diagnosis."""


def diagnosed(name: str, workers: int) -> dict[str, Any]:
    """The diagnosis of a file."""
    family, size, only, fields = FILES[name]
    drawn = {"families": [family], "sizes": [size], "only": only, "repeats": 1, "seed": _SEED, "shape": [96, 128]}
    case = next(cases(argparse.Namespace(**drawn)))
    among = FEW if len(only) > 1 or family == "deleted" else listed_effects()
    library = [listed_effects()[key] for key in among if family != "deleted" or key not in case.truth]
    config = SearchConfig(budget=BudgetConfig(max_fields=fields))
    return diagnose(measure(case, 4, [32, 40]), library, workers=workers, config=config).as_json()


def run_beside(condition: str, files: list[str]) -> list[dict[str, Any]]:
    """The diagnoses of files under a condition, by a process of its own."""
    prefix, loops, workers = CONDITIONS[condition]
    command = [sys.executable, "-m", "benchmarks.busy_diagnosis", "--workers", str(workers), "--solve", *files]
    with busy_loops(loops):
        done = subprocess.run([*prefix, *command], check=True, stdout=subprocess.PIPE, text=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


def _compared(answer: dict[str, Any], first: dict[str, Any]) -> str:
    """Whether they are equal but for the seconds that they took."""
    one, other = (a | {"seconds": 0, "records": a["records"] | {"seconds": 0}} for a in (answer, first))
    return "equal" if one == other else "DIFFERENT"


def summarise(file: Path) -> None:
    """Prints a table: the answer to each file that was diagnosed alone, and whether its others are equal."""
    found = {(row["file"], row["condition"]): row["diagnosis"] for row in read_lines(file)}
    print(f"| file | verdict and causes | {' | '.join(CONDITIONS)} |\n{'| --- ' * (2 + len(CONDITIONS))}|")
    for name in FILES:
        first = found.get((name, next(iter(CONDITIONS))))
        if first is None:
            continue
        answers = [found.get((name, condition)) for condition in CONDITIONS]
        cells = ["" if a is None else f"{_compared(a, first)}, {a['seconds']:.0f} s" for a in answers]
        named = ", ".join(cause["effect"] for cause in first["causes"])
        print(f"| {name} | `{first['verdict']}` {named} | {' | '.join(cells)} |")


def main() -> None:
    """Diagnoses, or prints a summary of what was diagnosed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", nargs="+", choices=FILES, default=list(FILES))
    parser.add_argument("--conditions", nargs="+", choices=CONDITIONS, default=list(CONDITIONS))
    parser.add_argument("--solve", nargs="+", choices=FILES, help="print the diagnoses of files as lines of JSON")
    parser.add_argument("--workers", type=int, default=2, help="processes, with --solve")
    args = lines_or_summary(parser, "busy_diagnosis", summarise)
    if args.solve is not None:
        for name in args.solve:
            print(json.dumps(diagnosed(name, args.workers)), flush=True)
        return
    for condition in args.conditions:
        for name, diagnosis in zip(args.files, run_beside(condition, args.files), strict=True):
            append_line(args.output, {"file": name, "condition": condition, "diagnosis": diagnosis})
    summarise(args.output)


if __name__ == "__main__":
    main()
