"""Ctrl-C: exit code 130, no traceback, no half or temporary file; the optimiser keeps its best so far."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from holoview import cli
from holoview.hologram import load_hologram

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")

# The real program, with a progress line at every step to wait for rather than one every ten seconds.
PROGRAM = "import sys; from holoview.commands import common; common._SECONDS_A_LINE = 0.0; from holoview import cli; "
PROGRAM += "sys.exit(cli.main())"


def _interrupted(folder: Path, line: str, *arguments: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of the program that got SIGINT when it had written a line that starts so."""
    command = [sys.executable, "-c", PROGRAM, *arguments]
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, cwd=folder, **pipes) as process:
        assert process.stderr is not None
        seen = ""
        while not seen.startswith(line):
            seen = process.stderr.readline()
            assert seen, f"ended without the line {line!r}"
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    return process.returncode, out, err


def test_the_optimiser_keeps_its_best_so_far(tmp_path: Path, picture: Path) -> None:
    arguments = ("--set", "shape=[48,64]", "--iterations", "100000", "-o", "best.safetensors")
    code, out, err = _interrupted(
        tmp_path, "optimising simultaneous: 3/", "optimise", "simultaneous", str(picture), *arguments
    )
    assert code == 130
    assert out == ""
    assert "Traceback" not in err
    assert err.splitlines()[-1].startswith("interrupted after iteration ")
    assert err.endswith("the best so far is kept in best.safetensors\n")
    assert {path.name for path in tmp_path.iterdir()} == {picture.name, "best.safetensors"}
    assert load_hologram(tmp_path / "best.safetensors").drive.shape == (1, 2, 48, 64)


def test_rendering_leaves_nothing_behind(tmp_path: Path) -> None:
    slow = ("--set", "shape=[192,256]", "--set", "frames=3", "--plane", "all", "--backend", "torch", "-o", "seen.png")
    code, out, err = _interrupted(tmp_path, "rendering: 1/", "render", "holochrome-8", *slow)
    assert code == 130
    assert out == ""
    assert err.splitlines()[-1] == "holoview: interrupted"
    assert "Traceback" not in err
    assert not list(tmp_path.iterdir())


def test_an_interrupt_while_modules_load_is_quiet_too(
    holoview: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(name: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "import_module", interrupt)
    outcome = holoview("render", "holochrome-8")
    assert (outcome.code, outcome.out, outcome.err) == (130, "", "holoview: interrupted\n")


def test_an_interrupt_before_the_first_iteration_writes_nothing(
    holoview: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, picture: Path
) -> None:
    def interrupt(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("holoview.commands.optimise.iterate", interrupt)
    outcome = holoview("optimise", "simultaneous", picture, "--set", "shape=[24,32]", "-o", "h.safetensors")
    assert outcome.code == 130
    assert outcome.err == "holoview: interrupted\n"
    assert [path.name for path in tmp_path.iterdir()] == [picture.name]
