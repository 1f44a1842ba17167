"""`holoview conformance`: checks holoview on 102 cases of propagating light with known answers, or writes the cases."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
import torch

from holoview.commands.console import print_json, progress_bar
from holoview.commands.output_files import add_output_folder
from holoview.evidence.conformance.cases import Case, all_cases, describe_case, write_cases
from holoview.evidence.conformance.score import error_of
from holoview.holograms.fields.propagation import propagate_field
from holoview.holograms.fields.wavefield import Wavefield
from holoview.util.errors import UserError, suggest_matches
from holoview.util.file_writer import make_folder


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_output_folder(
        parser, "-o", "--output", metavar="DIR", help="write the cases there, as .npy and TOML, with a program to score"
    )
    parser.add_argument(
        "--family", metavar="NAME", action="append", help="only cases of this kind, e.g. lens; repeatable"
    )
    parser.add_argument("--json", action="store_true", help="machine-readable output")


def run(args: argparse.Namespace) -> int:
    """Writes the cases, or computes them and prints the errors; 1 if an error is beyond its tolerance."""
    cases = _chosen(args.family)
    if args.output is not None:
        make_folder(args.output)
        with progress_bar("cases") as progress:
            write_cases(args.output, cases, progress)
        print(
            f"{len(cases)} cases in {args.output}; score results with python {args.output / 'score.py'} CASES RESULTS"
        )
        return 0
    errors = []
    with progress_bar("cases") as progress:
        for number, case in enumerate(cases, start=1):
            errors.append(error_of(propagated(case), case.answer, case.indices))
            progress(number, len(cases), case.name)
    passed = sum(error <= case.tolerance for case, error in zip(cases, errors, strict=True))
    if args.json:
        rows = [
            {"name": case.name, "error": error, "passed": error <= case.tolerance} | describe_case(case)
            for case, error in zip(cases, errors, strict=True)
        ]
        print_json({"passed": passed, "cases": rows})
    else:
        print("\n".join(_format(cases, errors)))
    return 0 if passed == len(cases) else 1


def propagated(case: Case) -> np.ndarray[Any, Any]:
    """The field of a case at its distance, on its own samples, by holoview in single precision."""
    pitch_m = (case.pitch_m, case.pitch_m)
    field = Wavefield(case.field[None, None].astype(np.complex64), pitch_m, np.array([case.wavelength_m]))
    with torch.inference_mode():
        return propagate_field(field, case.distance_m, "asm").values[0, 0].numpy()


def _chosen(families: list[str] | None) -> list[Case]:
    """The cases of some families, all of them without any. Raises UserError for a family that there isn't."""
    cases = all_cases()
    known = list(dict.fromkeys(case.family for case in cases))
    for name in families or ():
        if name not in known:
            raise UserError("--family", f'"{name}"', expected=", ".join(known), remedy=suggest_matches(name, known))
    return [case for case in cases if not families or case.family in families]


def _format(cases: list[Case], errors: list[float]) -> list[str]:
    """A line for each family: how many passed, the distances, and the largest error and its tolerance."""
    lines = [f"{'cases':<16}{'passed':>9}  largest error  in its tolerance"]
    for family in dict.fromkeys(case.family for case in cases):
        pairs = [(e, c.tolerance) for c, e in zip(cases, errors, strict=True) if c.family == family]
        worst = max(pairs, key=lambda pair: pair[0] / pair[1])
        passed = f"{sum(e <= t for e, t in pairs)}/{len(pairs)}"
        lines.append(f"{family:<16}{passed:>9}  {worst[0]:<13.2g}  {worst[0] / worst[1]:.0%}")
    passed_all = sum(e <= c.tolerance for c, e in zip(cases, errors, strict=True))
    return [*lines, f"{passed_all} of {len(cases)} passed"]
