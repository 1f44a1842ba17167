"""The command line: what it returned, what it printed, an empty folder to work in; run here, or interrupted."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageCms

from holoview.commands.cli import main
from tests.child_process import child_process
from tests.patience import PATIENCE_S
from tests.rig.conftest import bench_here

__all__ = ["bench_here"]

SHAPE = (24, 32)

# The real program, with a progress line at every step to wait for rather than one every ten seconds.
PROGRAM = "import sys; from holoview.commands import console; console.LINE_INTERVAL_S = 0.0; from holoview import cli; "
PROGRAM += "sys.exit(cli.main())"


@dataclass(frozen=True)
class Outcome:
    """Exit code, standard output and standard error."""

    code: int
    out: str
    err: str


@pytest.fixture
def holoview(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Outcome]:
    """`holoview("info", "holochrome-8")` runs the command in an empty folder, tmp_path."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: object) -> Outcome:
        capsys.readouterr()
        code = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Outcome(code, captured.out, captured.err)

    return run


class _SignallingStream:
    """Standard error that raises a signal, once, after a line that begins with `line`."""

    def __init__(self, stream: Any, line: str, number: int) -> None:
        self._stream, self._line, self._number, self._written = stream, line, number, ""

    def write(self, text: str) -> int:
        self._stream.write(text)
        *ended, self._written = (self._written + text).split("\n")
        if self._line and any(line.startswith(self._line) for line in ended):
            self._line = ""
            signal.raise_signal(self._number)
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@pytest.fixture
def interrupted(holoview: Callable[..., Outcome], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Outcome]:
    """`interrupted("rendering: 1/", "render", …)` runs the command, which gets SIGINT after a line that begins so."""

    def run(line: str, *arguments: object, number: int = signal.SIGINT) -> Outcome:
        monkeypatch.setattr("holoview.commands.console.LINE_INTERVAL_S", 0.0)  # a line at every step
        stderr = _SignallingStream(sys.stderr, line, number)
        with monkeypatch.context() as patch:
            patch.setattr(sys, "stderr", stderr)
            outcome = holoview(*arguments)
        assert not stderr._line, f"ended without the line {line!r}"
        return outcome

    return run


@pytest.fixture
def interrupted_program(tmp_path: Path) -> Callable[..., Outcome]:
    """The same with the real program in a process of its own."""

    def run(line: str, *arguments: object, number: int = signal.SIGINT) -> Outcome:
        command = [sys.executable, "-c", PROGRAM, *(str(argument) for argument in arguments)]
        pipe = subprocess.PIPE
        with child_process(command, cwd=tmp_path, stdout=pipe, stderr=pipe, text=True) as process:
            assert process.stderr is not None
            seen = ""
            while not seen.startswith(line):
                seen = process.stderr.readline()
                assert seen, f"ended without the line {line!r}"
            process.send_signal(number)
            out, err = process.communicate(timeout=PATIENCE_S)
        return Outcome(process.returncode, out, err)

    return run


SRGB = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
"""A profile with which pictures state their colour space, so that no note tells that it is assumed."""


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    """A small colour picture, brighter to the right, that states sRGB."""
    ramp = np.linspace(40, 220, 2 * SHAPE[1])
    pixels = np.stack(np.broadcast_arrays(ramp, ramp[::-1], np.linspace(60, 200, 2 * SHAPE[0])[:, None]), axis=-1)
    path = tmp_path / "picture.png"
    Image.fromarray(pixels.astype(np.uint8)).save(path, icc_profile=SRGB)
    return path
