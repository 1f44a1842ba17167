"""A real `holoview optimise` that is killed goes on from its checkpoint and ends where it would have."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from holoview.io.hologram import load_hologram
from tests.patience import PATIENCE_S


def _command(picture: Path, output: Path, *more: object) -> list[str]:
    bench = ["--set", "shape=[24,32]", "--set", "planes=['1 mm']", "--set", "gap='0.5 mm'", "--iterations", "400"]
    words = [sys.executable, "-m", "holoview.cli", "optimise", "simultaneous", picture, *bench, "-o", output, *more]
    return [str(word) for word in words]


@pytest.mark.explores
def test_after_kill_9_it_resumes_and_ends_the_same(picture: Path, tmp_path: Path) -> None:
    checkpoint = tmp_path / "c.safetensors"
    expected, found = tmp_path / "expected.safetensors", tmp_path / "found.safetensors"
    subprocess.run(_command(picture, expected), check=True, capture_output=True, timeout=PATIENCE_S)

    killed = subprocess.Popen(_command(picture, found, "--checkpoint", checkpoint, "--checkpoint-every", "0.01"))
    deadline = time.monotonic() + PATIENCE_S
    while not checkpoint.exists() and killed.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    assert checkpoint.exists()
    assert not found.exists()

    subprocess.run(
        _command(picture, found, "--resume", checkpoint), check=True, capture_output=True, timeout=PATIENCE_S
    )
    np.testing.assert_array_equal(load_hologram(found).drive, load_hologram(expected).drive)


def test_it_stops_when_it_is_good_enough(picture: Path, tmp_path: Path) -> None:
    output = tmp_path / "o.safetensors"
    done = subprocess.run(
        _command(picture, output, "--until-psnr", "1", "--json"), check=True, capture_output=True, timeout=PATIENCE_S
    )
    assert b'"iterations": 0' in done.stdout
