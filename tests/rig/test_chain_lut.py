"""Tables of a chain's modulators, measured on its virtual rig: of phase by gratings, of amplitude by uniform light."""

from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from holoview.bench.calibrate.amplitude_table import fit_amplitudes
from holoview.bench.calibrate.lut_fit import FittedLut, fit_labelled
from holoview.bench.experiment.lut_sweep import DEVIATION, TRANSMITTED, LutMeasurement, SweepPlan, SweepReadings
from holoview.bench.rig import RigDescription, read_rig
from holoview.commands.cli import main
from holoview.util.errors import UserError
from holoview.viewer.document.rig_session import drive_pattern
from tests.rig.conftest import direct_devices
from tests.rig.test_chain_rig import CAMERA, COARSE, PHASE, SPACE, chain_of, write_chain_rig

WIDE = PHASE | {"shape": [32, 64]}
FINE = COARSE | {"shape": [16, 32]}
SEEN = {"camera": {"device": "virtual", "black_level": 64, **CAMERA, "shape": [64, 128]}}
NEAR = {"limits": {"power": 1.0, "exposure": [1e-5, 0.5], "stage": ["0 mm", "10 mm"]}}
STROKE_M, GAMMA = 825e-9, 1.3
FOURIER = [{"kind": "fourier", "name": name, "focal_length": "5 mm"} for name in ("there", "back")]
MASK = {"kind": "mask", "name": "glass", "pitch": "8 um", "shape": [32, 64], "pattern": "random", "stroke": "300 nm"}


def _rig(folder: Path, *elements: dict[str, Any], effects: dict[str, Any] | None = None) -> RigDescription:
    chain = chain_of(*elements)
    names = {name: {"device": "virtual", "settle": 0.1} for name in chain.drive_shapes}
    virtual = {"seed": 3, "settle": 0.02, "power_drift": 0.3, "effects": effects or {}}
    gone = dict.fromkeys({"phase", "coarse"} - set(names))
    return read_rig(write_chain_rig(folder, {**gone, **names, **SEEN, **NEAR, "virtual": virtual}, chain))


def _readings(rig: RigDescription, plan: SweepPlan, folder: Path) -> SweepReadings:
    readings = SweepReadings.at(folder / "t.csv", plan)
    LutMeasurement(rig, direct_devices(rig), lambda _: None).run(plan, readings, lambda *_: None)
    return readings


def _phase_error(lut: FittedLut) -> float:
    """R.m.s. deviation from the true phase, rad."""
    true = 2 * math.pi * STROKE_M / 450e-9 * (lut.levels / 255) ** GAMMA
    return float(np.sqrt(np.mean((lut.phase - true) ** 2)))


@pytest.mark.long
@pytest.mark.parametrize(
    "elements",
    [(WIDE, SPACE, FINE), (FINE, SPACE, WIDE), (WIDE, FOURIER[0], FINE | {"shape": [32, 32]}, FOURIER[1])],
    ids=["before amplitude", "behind amplitude", "imaged by Fourier planes"],
)
def test_the_table_of_a_phase_modulator_is_read_through_the_other_elements(
    elements: tuple[dict[str, Any], ...], tmp_path: Path
) -> None:
    """As of the short form: orders of 64 pixels leak into each other by a few per cent, 0.02 π of phase."""
    hidden = {"lut": {"element": "phase", "gamma": GAMMA}}
    rig = _rig(tmp_path, *elements, effects=hidden)
    plan = SweepPlan(rig.modulator_names.index("phase"), (450e-9,), (8, 16), np.arange(0, 256, 5))
    fitted = fit_labelled(_readings(rig, plan, tmp_path).sweeps())
    assert fitted.lut.explains and _phase_error(fitted.lut) < 0.02 * math.pi


def test_the_table_of_an_amplitude_modulator_is_its_leakage_and_gamma(tmp_path: Path) -> None:
    hidden = {
        "leakage": {"element": "coarse", "amplitude": 0.12},
        "amplitude_gamma": {"element": "coarse", "gamma": 1.4},
    }
    rig = _rig(tmp_path, WIDE, SPACE, FINE, effects=hidden)
    levels = np.unique(np.linspace(0, 63, 24).round().astype(int))
    readings = _readings(rig, SweepPlan(1, rig.wavelengths_m, (0,), levels), tmp_path)
    light, deviation = (readings.mean_over_lasers(order) for order in (TRANSMITTED, DEVIATION))
    found = fit_amplitudes(light, deviation, "t")
    np.testing.assert_allclose(found.amplitude, 0.12 + 0.88 * (levels / 63) ** 1.4, atol=3e-3)
    assert found.is_black_seen and abs(found.black - 0.0144) < 5 * found.black_deviation
    assert found.gamma == pytest.approx(1.4, abs=0.02)


def test_black_that_lets_nothing_through_is_a_limit_of_the_contrast(tmp_path: Path) -> None:
    rig = _rig(tmp_path, WIDE, SPACE, FINE)
    readings = _readings(rig, SweepPlan(1, rig.wavelengths_m, (0,), np.array([0, 32, 63])), tmp_path)
    light, deviation = (readings.mean_over_lasers(order) for order in (TRANSMITTED, DEVIATION))
    found = fit_amplitudes(light, deviation, "t")
    assert abs(found.black) < 5 * found.black_deviation < 1e-3
    assert found.is_black_seen or "a contrast above" in found.lines[0]


@pytest.mark.parametrize(
    ("light", "said"),
    [
        ({0: 1.0, 1: 0.5, 2: 0.2}, "no more light through than level 0"),
        ({0: 0.0, 1: 0.9, 2: 0.3, 3: 1.0}, "fall and rise with the level"),
    ],
)
def test_light_that_no_table_explains_is_refused(light: dict[int, float], said: str) -> None:
    with pytest.raises(UserError, match=said):
        fit_amplitudes(light, dict.fromkeys(light, 1e-3), "t.csv")


def test_the_levels_of_a_table_rise_as_a_preset_takes_them() -> None:
    """Two levels that let equal light through, and levels between those that were sent."""
    sent, amplitude = (0, 3, 6, 9, 12), (0.2, 0.2, 0.6, 0.6, 1.0)
    found = fit_amplitudes({n: a**2 for n, a in zip(sent, amplitude, strict=True)}, dict.fromkeys(sent, 1e-4), "t")
    assert len(found.shares) == 13 and (np.diff(found.shares) > 0).all()
    assert found.shares[0] == 0.0 and found.shares[-1] == 1.0
    np.testing.assert_allclose(found.shares[[3, 4, 6, 9, 11]], [0, 1 / 6, 0.5, 0.5, 5 / 6], atol=1e-7)
    chain = chain_of(WIDE, SPACE, FINE).edit({"elements.coarse.levels": found.as_toml["levels"]})
    np.testing.assert_array_equal(chain.elements[2].levels, found.shares)  # type: ignore[attr-defined]


@pytest.mark.long
def test_the_command_writes_what_a_preset_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _rig(tmp_path, WIDE, SPACE, FINE, effects={"leakage": {"element": "coarse", "amplitude": 0.2}})
    monkeypatch.chdir(tmp_path)
    command = ["rig", "lut", "rig.toml", "-o", "coarse.toml", "--slm", "coarse", "--levels", "12"]
    assert main([*command, "--json"]) == 0, capsys.readouterr().err
    told = json.loads(capsys.readouterr().out)
    table = tomllib.loads((tmp_path / "coarse.toml").read_text(encoding="utf-8"))
    assert told["element"] == table["element"] == "coarse" and table["range"][0] == pytest.approx(0.2, abs=5e-3)
    chain = read_rig(tmp_path / "rig.toml").bench.chain
    assert chain is not None
    changed = chain.edit({f"elements.coarse.{key}": table[key] for key in ("range", "levels")})
    assert changed.elements[2].range == (table["range"][0], 1.0)  # type: ignore[attr-defined]
    measured = read_rig(write_chain_rig(tmp_path, {**SEEN, **NEAR}, changed))  # a rig of this bench
    assert len(table["levels"]) == 64 and measured.bench.slms[1].shares == tuple(table["levels"])
    drive = drive_pattern(measured, {"phase": np.zeros((1, 32, 64)), "coarse": np.full((1, 16, 32), 0.5)}, "half")
    level = int(drive.levels[1, 0, 0])
    assert abs(table["levels"][level] - 0.5) == min(abs(own - 0.5) for own in table["levels"])


@pytest.mark.parametrize(
    ("elements", "options", "said"),
    [
        ((WIDE, SPACE, FINE), ("--slm", "nobody"), "--slm: nobody; expected phase, coarse"),
        ((WIDE, SPACE, FINE), ("--slm", "3"), "--slm: 3; expected phase, coarse"),
        ((WIDE, SPACE, MASK), (), "glass, of kind mask; expected gratings that no speckle hides"),
        ((WIDE, SPACE, FINE), ("--slm", "coarse", "--period", "8"), "shows one level everywhere"),
        ((WIDE, SPACE, FINE), ("--slm", "coarse", "--verify"), "shows one level everywhere"),
        ((FINE, FINE | {"name": "other", "beside": "coarse"}, SPACE | {"distance": None}), (), "coarse beside other"),
    ],
)
def test_what_cannot_be_read_is_refused_with_its_reason(
    elements: tuple[dict[str, Any], ...],
    options: tuple[str, ...],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    _rig(tmp_path, *({key: v for key, v in element.items() if v is not None} for element in elements))
    monkeypatch.chdir(tmp_path)
    assert main(["rig", "lut", "rig.toml", "-o", "t.toml", *options]) == 2
    told = capsys.readouterr().err
    assert said in told and len(told.strip().splitlines()) == 1 and not (tmp_path / "t.toml").exists()
