"""Measures what correcting an alignment's errors does for the diagnosis of captures that a rig took.

    python -m benchmarks.rig_placed_diagnosis -o out/placed-diagnosis.md

Each bench is the virtual rig of `holoview rig new` with a gap that is 0.08 mm too long, a turned and displaced camera,
a mirrored modulator 2, and a fault. It is aligned and measured (24 captures) by the commands, and diagnosed twice: with
the placement as it was found, and with its errors corrected within their uncertainties.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path

import tomli_w

from benchmarks.common import count_of
from holoview.bench.captures import Captures, read_captures
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.rig.registration import read_registration

FAULTS: tuple[dict[str, dict[str, float]], ...] = (
    {},
    {"stroke": {"stroke_error": -0.03}},
    {"lut": {"gamma1": 1.05, "gamma2": 1.05}},
    {"crosstalk": {"sigma": 0.2}},
    {"camera_blur": {"sigma": 0.6}},
    {"vignetting": {"fall_y": 0.15, "fall_x": 0.27}},  # round, on pictures that are wider than high
    {"bandwidth": {"sigma": 1.5e-9}},
    {"undiffracted": {"share": 0.03}},
    {"source_profile": {"fall": 0.2}},
    {"tilt": {"tilt_y": 2e-4}},
)
PLAN = 'each = 4\ndistances = ["2 mm", "7 mm"]\n'


def measure(folder: Path, fault: dict[str, dict[str, float]]) -> Captures:
    """Aligns and measures a new rig with a fault."""
    run("rig", "new", folder)
    hidden = tomllib.loads((folder / "hidden.toml").read_text(encoding="utf-8"))
    del hidden["effects"]["stroke"]
    hidden["effects"] |= fault
    (folder / "hidden.toml").write_text(tomli_w.dumps(hidden), encoding="utf-8")
    (folder / "plan.toml").write_text(PLAN, encoding="utf-8")
    run("rig", "align", folder / "rig.toml", "--no-check")
    run("measure", folder / "rig.toml", "--plan", folder / "plan.toml", "-o", folder / "s.h5")
    return read_captures(folder / "s.h5")


def run(*arguments: object) -> None:
    """A command of holoview, which has to succeed."""
    command = [sys.executable, "-m", "holoview", *map(str, arguments)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def diagnosed(captures: Captures, folder: Path, is_corrected: bool, seconds: float) -> str:
    """The verdict, its causes and the processor time."""
    registration = read_registration(folder / "rig.placement.toml")
    uncertain = registration.uncertain_effects() if is_corrected else {}
    began = time.process_time()
    found = diagnose(captures, known=registration.known_effects(), uncertain=uncertain, time_s=seconds, thorough=True)
    names = " and ".join(cause.effect for cause in found.causes) or "–"
    return f"{found.verdict}: {names}; χ²/n {found.after.chi2_per_pixel:.3f}; {time.process_time() - began:.0f} s"


def main() -> None:
    """Runs the benches and writes the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=240.0, help="most for one diagnosis")
    parser.add_argument("--benches", type=count_of, default=len(FAULTS), help="the first so many (all)")
    parser.add_argument("-o", "--output", type=Path)
    args = parser.parse_args()
    lines = ["| hidden | as aligned | corrected |", "| --- | --- | --- |"]
    for fault in FAULTS[: args.benches]:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name) / "rig"
            captures = measure(folder, fault)
            cells = [diagnosed(captures, folder, is_corrected, args.seconds) for is_corrected in (False, True)]
        lines.append(f"| {' '.join(fault) or 'nothing'} | {cells[0]} | {cells[1]} |")
        print(lines[-1], flush=True)
    if args.output is not None:
        args.output.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
