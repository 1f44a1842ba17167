"""`holoview rig` on a virtual bench in a process of its own."""

from __future__ import annotations

from pathlib import Path

import pytest

from holoview.bench.rig import read_rig
from holoview.commands.cli import main
from tests.rig.align.hidden_bench import Hidden


def test_align_writes_where_things_are_and_show_says_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hidden = Hidden("one", (40, 40), camera="flip_y", magnification=0.03, offset_m=0.2e-3)
    path = str(hidden.write(tmp_path).path)
    assert main(["rig", "show", path]) == 0
    assert "nominal places" in capsys.readouterr().out
    assert main(["rig", "align", path]) == 0
    said = capsys.readouterr().out
    assert "upside down" in said and "records: nothing found that is recorded wrongly" in said
    rig = read_rig(path)
    assert rig.registration is not None and abs(rig.bench.camera.pitch_m - 4e-6 / 1.03) < 2e-9
    assert main(["rig", "show", path]) == 0
    assert "upside down" in capsys.readouterr().out


def test_test_takes_a_dark_and_a_lit_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(Hidden("one", (40, 40)).write(tmp_path).path)
    assert main(["rig", "test", path]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("dark picture: ") and lines[0].endswith("mean 64.0")
    assert lines[-1] == "all devices answer; the lasers are off"


def test_a_rig_whose_devices_cannot_be_opened_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig = Hidden("one", (40, 40)).write(tmp_path)
    text = rig.path.read_text(encoding="utf-8").replace('device = "virtual"', 'device = "virtuel"', 1)
    rig.path.write_text(text, encoding="utf-8")
    assert main(["rig", "align", str(rig.path)]) == 2
    assert "virtuel" in capsys.readouterr().err
