"""A real `holoview optimise` that is killed goes on from its checkpoint and ends where it would have."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from holoview.holograms.hologram import load_hologram
from tests.patience import PATIENCE_S


def _command(picture: Path, output: Path, *more: object) -> list[str]:
    bench = ["--set", "shape=[24,32]", "--set", "planes=['1 mm']", "--set", "gap='0.5 mm'", "--iterations", "400"]
    return [str(word) for word in ("optimise", "simultaneous", picture, *bench, "-o", output, *more)]


PROGRAM = (sys.executable, "-m", "holoview.commands.cli")


@pytest.mark.explores
def test_after_kill_9_it_resumes_and_ends_the_same(picture: Path, tmp_path: Path) -> None:
    checkpoint = tmp_path / "c.safetensors"
    expected, found = tmp_path / "expected.safetensors", tmp_path / "found.safetensors"
    subprocess.run([*PROGRAM, *_command(picture, expected)], check=True, capture_output=True, timeout=PATIENCE_S)

    often = ("--checkpoint", checkpoint, "--checkpoint-every", "0.01")
    killed = subprocess.Popen([*PROGRAM, *_command(picture, found, *often)])
    deadline = time.monotonic() + PATIENCE_S
    while not checkpoint.exists() and killed.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    assert checkpoint.exists()
    assert not found.exists()

    subprocess.run(
        [*PROGRAM, *_command(picture, found, "--resume", checkpoint)],
        check=True,
        capture_output=True,
        timeout=PATIENCE_S,
    )
    np.testing.assert_array_equal(load_hologram(found).drive, load_hologram(expected).drive)


def test_it_stops_when_it_is_good_enough(holoview: Callable[..., Any], picture: Path, tmp_path: Path) -> None:
    outcome = holoview(*_command(picture, tmp_path / "o.safetensors", "--until-psnr", "1", "--json"))
    assert outcome.code == 0 and '"iterations": 0' in outcome.out
