"""Ctrl-C: exit code 130, no traceback, no half or temporary file; the optimiser keeps its best so far."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from holoview import cli
from holoview.io.hologram import load_hologram

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")


def test_the_optimiser_keeps_its_best_so_far(interrupted: Callable[..., Any], tmp_path: Path, picture: Path) -> None:
    arguments = ("--set", "shape=[48,64]", "--iterations", "100000", "-o", "best.safetensors")
    done = interrupted("optimising simultaneous: 3/", "optimise", "simultaneous", picture, *arguments)
    assert done.code == 130
    assert done.out == ""
    assert "Traceback" not in done.err
    assert done.err.splitlines()[-1].startswith("interrupted after iteration ")
    assert done.err.endswith("the best so far is kept in best.safetensors\n")
    assert {path.name for path in tmp_path.iterdir()} == {picture.name, "best.safetensors"}
    assert load_hologram(tmp_path / "best.safetensors").drive.shape == (1, 2, 48, 64)


def test_rendering_leaves_nothing_behind(interrupted: Callable[..., Any], tmp_path: Path) -> None:
    slow = ("--set", "shape=[192,256]", "--set", "frames=3", "--plane", "all", "--backend", "torch", "-o", "seen.png")
    done = interrupted("rendering: 1/", "render", "holochrome-8", *slow)
    assert done.code == 130
    assert done.out == ""
    assert done.err.splitlines()[-1] == "holoview: interrupted"
    assert "Traceback" not in done.err
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
