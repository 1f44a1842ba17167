"""The demonstration writes what it names, and ends with what to open."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

import pytest

from holoview.commands import cli
from holoview.holograms.hologram import load_hologram


def test_it_ends_with_the_picture_and_the_viewers_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pycvvdp", None)
    arguments = ["--shape", "16", "24", "--iterations", "1", "--backend", "torch"]
    assert cli.main(["demo", "-o", str(tmp_path / "out"), *arguments]) == 0
    lines = capsys.readouterr().out.splitlines()
    planes = lines[lines.index("all focal planes:") + 1 : lines.index("try next:") - 1]
    assert len(planes) == 12 and all(Path(line.strip()).is_file() for line in planes), "five and one, of two displays"
    titles, *rows = (line.split() for line in lines[:3])
    assert titles[-1] == "FLIP" and "MS-SSIM" in titles and all(0 < float(row[-1]) < 1 for row in rows)
    picture, command = (line.partition(":")[2].split() for line in lines[-2:])
    assert Path(*picture).is_file() and Path(*picture).suffix == ".png"
    *_, verb, file = shlex.split(" ".join(command))
    assert verb == "view" and load_hologram(file).system.name == "holochrome-8"
