"""Peak memory of a few iterations of the optimiser and of its baselines, each in a process of its own.

The memory that is resident after loading the libraries, the target and the first drive is subtracted. On Linux the peak
is reset at this moment; on other systems it is the highest value since the start of the process.

    python -m benchmarks.optimiser_memory "autograd, cached H" 768 1024
"""

from __future__ import annotations

import contextlib
import json
import resource
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.baselines import Textbook
from benchmarks.common import markdown_table
from benchmarks.optimiser_speed import CACHED, OWN, SOLVING, TEXTBOOK
from benchmarks.optimiser_work import colour_work, ours
from holoview.evidence.benchmark.autograd_loop import StoredLoop, Work

VARIANTS = (OWN, SOLVING, TEXTBOOK, CACHED)
_ITERATIONS = 3


def measure(size: Sequence[int]) -> dict[str, dict[str, float]]:
    """Peak (MB) of each variant, and the ratio of the optimiser's peak to it."""
    peaks = {name: _in_process(name, size) for name in VARIANTS}
    return {name: {"peak_mb": peak, "ratio": peaks[OWN] / peak} for name, peak in peaks.items()}


def report(result: dict[str, dict[str, float]]) -> str:
    """The results as a table."""
    rows = [[name, f"{row['peak_mb']:.0f}", f"{row['ratio']:.3f}"] for name, row in result.items()]
    return markdown_table(["peak memory", "MB", "holoview ÷ it"], rows)


def peak_mb(variant: str, work: Work) -> float:
    """Peak of this process (MB) while a variant is built and iterates, above what was resident before."""
    base = reset_peak()
    if variant in (OWN, SOLVING):
        settings: dict[str, Any] = {} if variant == OWN else {"free": ("patterns", "amplitudes"), "amplitudes_every": 1}
        states = ours(work, **settings)
        for _ in range(_ITERATIONS):
            next(states)
    else:
        baseline = (Textbook if variant == TEXTBOOK else StoredLoop)(work)
        for _ in range(_ITERATIONS):
            baseline.step()
    return highest_mb() - base


def _in_process(variant: str, size: Sequence[int]) -> float:
    command = [sys.executable, "-m", "benchmarks.optimiser_memory", variant, *map(str, size)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return float(json.loads(done.stdout)["peak_mb"])


def reset_peak() -> float:
    """Reset the peak to the resident memory, if the system allows it, and return it (MB)."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="utf-8")
    return highest_mb()


def highest_mb() -> float:
    status = Path("/proc/self/status")
    if status.exists():
        line = next(line for line in status.read_text(encoding="utf-8").splitlines() if line.startswith("VmHWM"))
        return float(line.split()[1]) / 1024
    highest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return highest / (1 << 20 if sys.platform == "darwin" else 1 << 10)


if __name__ == "__main__":
    print(json.dumps({"peak_mb": peak_mb(sys.argv[1], colour_work([int(n) for n in sys.argv[2:4]]))}))
