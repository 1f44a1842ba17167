"""`holoview rig` on a virtual bench: once in a process of its own, elsewhere in this one."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest

from holoview.bench.rig import read_rig
from holoview.commands.cli import main
from tests.rig.align.hidden_bench import Hidden
from tests.rig.conftest import write_rig


@pytest.mark.long
@pytest.mark.usefixtures("bench_here")
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


@pytest.mark.long
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


@pytest.mark.long
@pytest.mark.usefixtures("bench_here")
def test_a_table_is_measured_verified_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A modulator whose stroke is 5 % shorter than stated, in one light; 24 levels leave 0.02 π."""
    slm = {"device": "virtual", "shape": [16, 32], "pitch": "8 um", "num_levels": 256, "opd_range": "825 nm"}
    hidden = {"seed": 3, "effects": {"stroke": {"stroke_error": -0.05}}}
    changes = {"slm2": None, "slm1": slm, "geometry": {"iris2_na": 0.03}, "camera.shape": [64, 96], "virtual": hidden}
    rig = str(write_rig(tmp_path / "rig.toml", changes | {"lasers.wavelengths": ["520 nm"]}))
    table = tmp_path / "lut.toml"
    more = ("--period", "4", "--period", "8", "--levels", "24", "--verify", "--json")
    assert main(["rig", "lut", rig, "-o", str(table), *more]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["stroke_pi"] == pytest.approx(2 * 825 / 520 * 0.95, abs=0.03)
    assert found["verification"]["rms_pi"] < 0.03
    assert tomllib.loads(table.read_text(encoding="utf-8"))["stroke_pi"] == found["stroke_pi"]
    readings = tmp_path / "lut.sweep.csv"
    assert found["readings"] == str(readings)
    assert main(["calibrate", "lut", str(readings), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["stroke_pi"] == pytest.approx(found["stroke_pi"], abs=1e-3)
    assert main(["rig", "lut", rig, "-o", str(table), "--period", "10"]) == 2
    assert "--period: 10" in capsys.readouterr().err
    assert main(["rig", "lut", rig, "-o", str(table), "--wavelength", "600nm"]) == 2
    assert "one of 520 nm" in capsys.readouterr().err


@pytest.mark.usefixtures("bench_here")
def test_settling_is_measured_and_written_beside_the_other_keys(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = write_rig(tmp_path / "rig.toml", {"slm2": None, "geometry": {}})
    text = rig.read_text(encoding="utf-8").replace("settle = 0.1", "settle = 0.01  # s, guessed")
    rig.write_text(text, encoding="utf-8")
    assert main(["rig", "settling", str(rig), "--write"]) == 0
    said = capsys.readouterr().out
    assert "settle = 0.01 s is too short" in said
    constant = re.search(r"time constant of ([\d.]+) ± ", said)
    assert constant is not None and float(constant[1]) == pytest.approx(20, rel=0.03)
    written = rig.read_text(encoding="utf-8")
    settle = re.search(r"settle = ([\d.]+)  # s, guessed", written)
    assert settle is not None and float(settle[1]) == pytest.approx(
        0.0921, abs=0.03 * 0.0921 + 1e-3
    )  # 0.02·ln 100, rounded up
    assert written.replace(settle[0], "settle = 0.01  # s, guessed") == text


@pytest.mark.usefixtures("bench_here")
def test_settling_that_no_picture_shows_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Right behind a modulator a phase has no contrast."""
    rig = write_rig(tmp_path / "rig.toml", {"slm2": None, "geometry": {}, "limits.stage": ["0 mm", "0 mm"]})
    assert main(["rig", "settling", str(rig)]) == 2
    assert "hardly change with the pattern" in capsys.readouterr().err
