"""Every program in `benchmarks/` runs at its smallest size, ends with 0 and prints its table."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.chromium import needs_chromium

ROOT = Path(__file__).resolve().parents[2]
STARTED_BY_OTHERS = {"lossy_viewer": "device_loss", "optimiser_memory": "optimiser"}
"""Programs that another one starts, and that one."""
LONGEST_S = 600.0
"""The longest takes 20 s on an idle core."""

PICTURE = "assets/still-life.png"
SMALLEST: dict[str, tuple[str, ...]] = {
    "bad_captures": ("--sessions 1 --known",),
    "busy_diagnosis": ("--files gap --conditions alone -o {out}/busy.jsonl", "--summary {out}/busy.jsonl"),
    "busy_machine": ("--rounds 1 --iterations 1 --loops 1 --shape 24 32",),
    "capture_bound": (
        "--benches 1 --derivatives {out}/derivatives.npz -o {out}/bound.jsonl",
        "--summary {out}/bound.jsonl",
    ),
    "card": (
        "--dry-run --minutes 0.4 -o {out}/card",
        "--dry-run --question --minutes 0.25 -o {out}/card",
    ),
    "chain_passes": ("--presets michelson-complex --rounds 1",),
    "conformance_peers": ("",),
    "device_loss": ("--runs 1 --shape 24 32",),
    "diagnosis": ("--families singles --only gap --sizes large --shape 24 32 --each 2 --workers 1",),
    "effect_consumers": ("--effects gap",),
    "eye_costs": ("--size 64x48 --repeats 1",),
    "fault_free": (
        "--benches 1 --size 24 -o {out}/fault-free.jsonl",
        "--summary {out}/fault-free.jsonl",
    ),
    "feedback": ("--rounds 1 --shape 48x32 --states opened",),
    "fft_time": ("--sizes 64x48 --repeats 1",),
    "focus_recordings": ("--count 6 --samples 96 -o {out}/focus.jsonl", "--summary {out}/focus.jsonl"),
    "frame_time": ("--size 64x48 --repeats 1",),
    "fuzz": ("--minutes 0.01",),
    "gallery": ("--only gamut --docs {out} -o {out}/jobs",),
    "install_size": ("--no-times",),
    "kills": ("--kills 1 --only export",),
    "optimiser": (
        "--size 48 64 --repeats 1 --threads 1 --seeds 0 --adam-steps 0.1 --rounds 1 --long 2 --convergence-size 48 64"
        " --convergence open --scenes still-life --curves {out}/curves.png --json {out}/optimiser.json",
    ),
    "padding_errors": ("--size 64x48 --reference 2",),
    "perceptual_scores": (f"--flip {PICTURE} {PICTURE}" + (f" --vdp {PICTURE}" if find_spec("pycvvdp") else ""),),
    "propagation_precision": ("",),
    "ratios": ("--size 256x192 --rounds 1 --runs 1 --file {out}/ratios.json --keep",),
    "real_benches": (
        "make {out} --families none --kinds near --size 16",
        "run {out}/none-near-1.json -o {out}/runs.jsonl --options --time 1s --workers 1 --no-display",
        "table {out}/runs.jsonl",
    ),
    "real_sizes": (
        "make {out} --shape 32x24 --only gap",
        "run {out}/near-1.h5 -o {out}/runs.jsonl --options --time 1s --workers 1",
        "table {out}/runs.jsonl",
    ),
    "records": ("--families clean --every 100",),
    "rig_adaptive": (
        "--count 1 --planners fixed --captures 2 -o {out}/adaptive.jsonl",
        "--summary {out}/adaptive.jsonl",
    ),
    "rig_alignment": ("--each 1 --kinds one",),
    "rig_camera_loop": ("--bench gap --iterations 1 --without-diagnosis",),
    "rig_faults": ("--runs 1",),
    "rig_placed_diagnosis": ("--benches 1 --seconds 1",),
    "soak": ("--minutes 0.05",),
    "viewer": ("--size 320x200 --shape 48x32 --events 2",),
    "target_rates": ("--seeds 1",),
}
"""The arguments of each program at its smallest size, of several calls where one reads what the other writes."""
ON_A_DEVICE = {
    "card",
    "conformance_peers",
    "device_loss",
    "effect_consumers",
    "fft_time",
    "frame_time",
    "soak",
    "viewer",
}
needs_xvfb = pytest.mark.skipif(shutil.which("Xvfb") is None, reason="needs Xvfb (apt install xvfb)")
MARKS = {
    **dict.fromkeys(ON_A_DEVICE, (pytest.mark.gpu,)),
    "effect_consumers": (pytest.mark.gpu, needs_chromium),
    "feedback": (pytest.mark.gpu, needs_xvfb),
}


def test_every_program_is_run() -> None:
    programs = {
        path.stem for path in (ROOT / "benchmarks").glob("*.py") if "__main__" in path.read_text(encoding="utf-8")
    }
    assert set(SMALLEST) | set(STARTED_BY_OTHERS) == programs
    assert set(STARTED_BY_OTHERS.values()) <= set(SMALLEST)


@pytest.mark.explores
@pytest.mark.parametrize("name", [pytest.param(name, marks=MARKS.get(name, ())) for name in SMALLEST])
def test_a_program_runs_at_its_smallest_size(name: str, tmp_path: Path) -> None:
    for arguments in SMALLEST[name]:
        done = subprocess.run(
            [sys.executable, "-m", f"benchmarks.{name}", *arguments.format(out=tmp_path).split()],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "XDG_STATE_HOME": str(tmp_path)},
            capture_output=True,
            text=True,
            timeout=LONGEST_S,
            check=False,
        )
        assert done.returncode == 0, f"{arguments}\n{done.stdout}\n{done.stderr}"
        assert done.stdout.strip() and "nan" not in done.stdout.split(), done.stdout
