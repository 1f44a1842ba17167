"""`benchmarks.rig_faults` in small: interruptions at random moments lose nothing and leave no laser on."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.rig_faults import WAYS
from tests.patience import PATIENCE_S

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.explores
@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks the program")
def test_interrupted_sessions_are_those_that_nothing_interrupted() -> None:
    """One for each way in which a session is interrupted first."""
    command = [sys.executable, "-m", "benchmarks.rig_faults", "--runs", str(len(WAYS)), "--seed", "1"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "wrong: 0\n" in done.stdout and done.stdout.startswith(f"{len(WAYS)} runs, ")
    for way in WAYS:
        assert f"{way} " in done.stdout
