"""The command line in this process: what it returned, what it printed, and an empty folder to work in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from holoview.cli import main

SHAPE = (24, 32)


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


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    """A small colour picture, brighter to the right."""
    ramp = np.linspace(40, 220, 2 * SHAPE[1])
    pixels = np.stack(np.broadcast_arrays(ramp, ramp[::-1], np.linspace(60, 200, 2 * SHAPE[0])[:, None]), axis=-1)
    path = tmp_path / "picture.png"
    Image.fromarray(pixels.astype(np.uint8)).save(path)
    return path
