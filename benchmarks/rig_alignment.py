"""Measures how well `rig align` finds placements that virtual benches hide.

    python -m benchmarks.rig_alignment --each 12 -o out/rig-alignment.md
    python -m benchmarks.rig_alignment --each 10 --kinds two --faults      # modulators or camera aren't as described

Each bench has any turn of every part, and errors drawn from its seed (`tests/rig/align/hidden_bench.py`): a third has
two modulators, a third one, a third is a Fourier bench. The table states what was hidden, what was found, and the
difference in standard deviations as stated.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import numpy as np

from holoview.bench.rig.align import find_geometry, registration_of
from holoview.util.errors import UserError
from tests.rig.align.hidden_bench import Hidden, devices_of, draw, found_values

UNITS = {"pitch": 1e-6, "rotation": 1e-3, "stage_offset": 1e-3, "walk_y": 1e-3, "walk_x": 1e-3, "slm2_shift_y": 1e-6}
UNITS |= {"slm2_shift_x": 1e-6, "slm2_rotation": 1e-3, "gap_error": 1e-3}
FAULTS: tuple[dict[str, dict[str, float]], ...] = (
    {"crosstalk": {"sigma": 0.2}},
    {"crosstalk": {"sigma": 0.5}},
    {"stroke": {"stroke_error": 0.02}},
    {"stroke": {"stroke_error": 0.07}},
    {"lut": {"gamma1": 1.2, "gamma2": 1.2}},
    {"undiffracted": {"share": 0.1}},
    {"bandwidth": {"sigma": 2e-9}},
    {"aberration2": {"z5": 100e-9}},
    {"camera_blur": {"sigma": 1.0}},
    {"vignetting": {"fall_y": 0.3}},
)
KINDS = {"two": (64, 80), "one": (64, 64), "fourier": (64, 80)}


def align(hidden: Hidden) -> tuple[str, dict[str, tuple[float, float, float]]]:
    """What was found of the turns, "right" or what else; and {name: (hidden, found, uncertainty)}."""
    with tempfile.TemporaryDirectory() as folder:
        rig = hidden.write(Path(folder))
        devices, _ = devices_of(rig)
        try:
            geometry = find_geometry(rig, devices)
        except UserError as error:
            return f"failed: {error}", {}
    registration = registration_of(rig, geometry)
    turns = registration.camera_turn, registration.slm2_turn
    expected = hidden.expected_values()
    rows = {name: (expected[name], *own) for name, own in found_values(registration).items()}
    return "right" if turns == hidden.expected_turns() else f"wrong: {turns}", rows


def main() -> None:
    """Runs the benches and writes the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--each", type=int, default=12, help="benches of each kind")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--faults", action="store_true", help="with a fault in each, by turns")
    parser.add_argument("-o", "--output", type=Path)
    args = parser.parse_args()
    lines = ["| bench | turns: slm1, slm2, camera | found | hidden → found ± stated |", "| --- | --- | --- | --- |"]
    pulls: dict[tuple[str, str], list[tuple[float, float]]] = defaultdict(list)
    began = time.process_time()
    for kind in args.kinds:
        for seed in range(args.each):
            hidden = draw(kind, seed, KINDS[kind])
            fault = FAULTS[seed % len(FAULTS)] if args.faults else {}
            hidden = dataclasses.replace(hidden, faults=fault)
            verdict, rows = align(hidden)
            cells = []
            for name, (true, found, error) in rows.items():
                pulls[kind, name].append((found - true, (found - true) / max(error, 1e-30)))
                unit = UNITS.get(name, 1.0)
                cells.append(f"{name} {true / unit:.4g} → {found / unit:.4g} ± {error / unit:.1g}")
            turns = f"{hidden.slm1}, {hidden.slm2 if kind == 'two' else '–'}, {hidden.camera}"
            lines.append(f"| {kind} {seed} {' '.join(fault)} | {turns} | {verdict} | {'; '.join(cells)} |")
            print(lines[-1], flush=True)
    lines += ["", "| bench | value | error r.m.s. | largest | in stated deviations r.m.s. | largest |"]
    lines.append("| --- | --- | --- | --- | --- | --- |")
    for (kind, name), own in pulls.items():
        error, pull = np.array(own).T / np.array([[UNITS.get(name, 1.0)], [1.0]])
        worst = f"{np.abs(error).max():.2g} | {np.sqrt((pull**2).mean()):.2f} | {np.abs(pull).max():.1f}"
        lines.append(f"| {kind} | {name} | {np.sqrt((error**2).mean()):.2g} | {worst} |")
    lines.append(
        f"\n{(time.process_time() - began) / max(args.each * len(args.kinds), 1):.1f} processor seconds a bench"
    )
    print("\n".join(lines[-len(pulls) - 4 :]))
    if args.output is not None:
        args.output.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
