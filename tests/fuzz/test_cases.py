"""A few hostile inputs, in processes of their own: refused in one line, or a finite result."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

_PROGRAM = """
import sys
from benchmarks.fuzz import run_cases, sample, table
from tests.fuzz.trial import Limits, preload
preload()
counts, bad = run_cases(sample(int(sys.argv[1]), int(sys.argv[2])), Limits())
print(table(counts))
sys.exit(1 if bad else 0)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="cases are forked")
@pytest.mark.parametrize(
    ("seed", "count"),
    [pytest.param(1, 12, marks=pytest.mark.explores), pytest.param(2, 400, marks=pytest.mark.slow)],
)
def test_hostile_inputs_are_refused_in_one_line_or_give_finite_results(seed: int, count: int) -> None:
    """So many cases of the corpus, spread over it, and as many random ones; `make fuzz` runs more."""
    root = Path(__file__).parents[2]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "HOLOVIEW_MEMORY": "1500MB", "PYTHONPATH": str(root)}
    command = [sys.executable, "-c", _PROGRAM, str(seed), str(count)]
    done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
