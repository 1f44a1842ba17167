"""`holoview calibrate`: from a capture file to a preset that renders, resumed, interrupted, and refused."""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from holoview.bench.captures import write_captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.light.model import preset
from holoview.light.model.bench_parts import Modulator, Relay
from holoview.light.model.system import System
from tests.captures.slmsuite_files import fourier, pixel, save

SHAPE = (24, 32)
Run = Callable[..., Any]


def _measure(path: Path, effects: dict[str, dict[str, float]], **settings: Any) -> Path:
    """Captures of a small bench with effects."""
    modulator = Modulator(pitch_m=8e-6, shape=SHAPE, stroke_m=825e-9, levels=16)
    system = System(
        wavelengths_m=[520e-9, 638e-9],
        amplitudes=[[1.0, 1.0]],
        modulators=(modulator, modulator),
        gap_m=1e-3,
        planes_m=[3e-3],
        relay1=Relay(iris_na=0.03),
        relay2=Relay(iris_na=0.03),
        observer="mono",
    )
    write_captures(path, make_captures(system, effects, AcquisitionSettings(**settings)))
    return path


@pytest.fixture(scope="module")
def captures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight captures of a bench whose second modulator is off by 3/4 of a pixel and leaks into neighbours."""
    effects = {"slm_alignment": {"shift_y": 6e-6}, "crosstalk": {"sigma": 0.5}}
    return _measure(tmp_path_factory.mktemp("captures") / "c.h5", effects, captures_per_condition=4)


@pytest.fixture
def sweep(tmp_path: Path) -> Path:
    x = np.linspace(0, 1, 64)
    power = 10 + 900 * np.sin(2.4 * np.pi * x**1.2 / 2) ** 2 + np.random.default_rng(1).normal(0, 5, 64)
    path = tmp_path / "sweep.csv"
    path.write_text("".join(f"{k},{p:.2f}\n" for k, p in enumerate(power)))
    return path


@pytest.mark.long
def test_a_calibrated_bench_renders(holoview: Callable[..., Any], captures: Path, tmp_path: Path) -> None:
    done = holoview("calibrate", captures, "-o", "c.toml", "--epochs", 40, "--batch", 1, "--pictures", "seen", "--json")
    assert done.code == 0, done.err
    found = json.loads(done.out)
    scores = {row["group"]: row for row in found["scores"] if row["wavelength_nm"] is None}
    # Of eight draws 40 epochs left 1/4 to 1/27 of it; after 12 two were worse than before.
    assert scores["captures"]["after"]["chi2_per_pixel"] < scores["captures"]["before"]["chi2_per_pixel"]
    assert {path.name for path in tmp_path.iterdir()} == {"c.toml", "c.safetensors", "seen"}
    assert (tmp_path / "seen" / "pupils.png").is_file()
    assert holoview("render", "c.toml", "--backend", "torch", "-o", "c.png").code == 0


@pytest.mark.long
def test_a_bench_is_sampled_as_finely_as_asked(holoview: Callable[..., Any], tmp_path: Path) -> None:
    """Captures that were computed with finer samples fit a bench without errors when it is sampled like that."""
    _measure(tmp_path / "f.h5", {}, captures_per_condition=4, finer=2)

    def chi2(*options: object) -> float:
        done = holoview("calibrate", "f.h5", "-o", "c.toml", "--epochs", 1, "--json", *options)
        assert done.code == 0, done.stderr
        return json.loads(done.out)["scores"][0]["before"]["chi2_per_pixel"]

    # of the one capture or more that are held out; weights are of neighbours' noise: twice the scatter of known noise
    right = chi2("--finer", 2)
    assert right == pytest.approx(1, abs=2 * 5 * math.sqrt(2 / math.prod(SHAPE)))
    assert right < chi2("--finer", 2, "--padding", 3, "--points", 4) < chi2()


def test_a_checkpoint_goes_on_to_the_same_maps(holoview: Callable[..., Any], captures: Path, tmp_path: Path) -> None:
    common = ("calibrate", captures, "--epochs", 2)
    assert holoview(*common, "-o", "whole.toml", "--checkpoint", "k.safetensors").code == 0
    finished = holoview(*common, "-o", "rest.toml", "--resume", "k.safetensors")
    assert finished.code == 2
    assert "finished" in finished.err
    assert not (tmp_path / "rest.toml").exists()
    other = holoview("calibrate", captures, "--epochs", 3, "-o", "rest.toml", "--resume", "k.safetensors")
    assert "epochs differ" in other.err


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
def test_ctrl_c_keeps_the_best(interrupted: Callable[..., Any], captures: Path, tmp_path: Path) -> None:
    done = interrupted("calibrating: 2/", "calibrate", captures, "-o", "c.toml", "--epochs", 5000)
    assert done.code == 130
    assert "Traceback" not in done.err
    assert "the best so far is kept in c.toml" in done.err
    assert {path.name for path in tmp_path.iterdir()} == {"c.toml", "c.safetensors"}


def test_a_sweep_becomes_a_table_a_bench_and_a_picture(
    holoview: Callable[..., Any], sweep: Path, tmp_path: Path
) -> None:
    more = ("--preset", "simultaneous", "--save-preset", "mine.toml", "--wavelength", "520nm", "--plot", "lut.png")
    done = holoview("calibrate", "lut", sweep, "-o", "lut.toml", *more)
    assert done.code == 0, done.err
    printed = re.search(r"stroke ([\d.]+) π \(95 %: [\d.]+ to [\d.]+ π\) = ", done.out)
    assert printed is not None and float(printed[1]) == pytest.approx(2.4, abs=0.03), "8 nm, as below, of 520 nm / 2"
    assert {path.name for path in tmp_path.iterdir()} == {"sweep.csv", "lut.toml", "lut.png", "mine.toml"}
    # 2.4 π at 520 nm is 624 nm, to the interval of about 0.02 π
    assert preset.load("mine.toml").modulators[0].stroke_m == pytest.approx(624e-9, abs=8e-9)
    figures = json.loads(holoview("calibrate", "lut", sweep, "--json").out)
    assert figures["stroke_pi"] == pytest.approx(2.4, abs=0.05)


BAD: dict[str, tuple[str, ...]] = {
    "is missing": ("calibrate", "{captures}"),
    "expected .toml": ("calibrate", "{captures}", "-o", "c.txt"),
    "doesn't exist": ("calibrate", "{captures}", "-o", "nowhere/c.toml"),
    "no such file": ("calibrate", "none.h5", "-o", "c.toml"),
    "none.csv": ("calibrate", "lut", "none.csv"),
    "epochs": ("calibrate", "{captures}", "-o", "c.toml", "--epochs", "0"),
    "held-out share": ("calibrate", "{captures}", "-o", "c.toml", "--held-out", "0.9"),
    "preset: gap": ("calibrate", "{captures}", "-o", "c.toml", "--preset", "holochrome-8"),
    "--wavelength: doesn't apply": ("calibrate", "{captures}", "-o", "c.toml", "--wavelength", "520nm"),
    "--epochs: doesn't apply": ("calibrate", "lut", "{sweep}", "--epochs", "3"),
    "--save-preset: is missing": ("calibrate", "lut", "{sweep}", "--preset", "holochrome-8"),
    "has no unit": ("calibrate", "lut", "{sweep}", "--wavelength", "520"),
    "CAPTURES.h5, or: lut": ("calibrate", "{captures}", "{captures}", "-o", "c.toml"),
    "checkpoint": ("calibrate", "{captures}", "-o", "c.toml", "--resume", "{sweep}"),
}


@pytest.mark.parametrize("said", BAD)
def test_bad_input_is_one_clear_line_and_nothing_is_written(
    said: str, holoview: Callable[..., Any], captures: Path, sweep: Path, tmp_path: Path
) -> None:
    done = holoview(*(word.format(captures=captures, sweep=sweep) for word in BAD[said]))
    assert done.code == 2
    assert said in done.err
    assert len(done.err.strip().splitlines()) <= 2  # a note about one plane may come before
    assert {path.name for path in tmp_path.iterdir()} == {"sweep.csv"}


def test_captures_that_are_cut_short_are_named(holoview: Callable[..., Any], captures: Path, tmp_path: Path) -> None:
    whole = captures.read_bytes()
    (tmp_path / "cut.h5").write_bytes(whole[: len(whole) // 2])
    done = holoview("calibrate", "cut.h5", "-o", "c.toml")
    assert done.code == 2
    assert "cut.h5" in done.err
    assert not (tmp_path / "c.toml").exists()


def test_a_plan_says_what_to_set(holoview: Callable[..., Any], captures: Path, tmp_path: Path) -> None:
    done = holoview("captures", "plan", captures, "-o", "plan.csv")
    assert done.code == 0, done.err
    assert done.out.startswith("520 nm: power 1, exposure ")
    lines = (tmp_path / "plan.csv").read_text().splitlines()
    assert lines[0] == "wavelength_nm,power,exposure_s,reached_counts,note"
    assert len(lines) == 3


def test_a_pixel_calibration_of_slmsuite_is_a_sweep(holoview: Run) -> None:
    truth = 2.4 * np.pi * (np.arange(64) / 63) ** 1.3
    save(Path("p.h5"), pixel(truth))
    outcome = holoview("calibrate", "lut", "p.h5", "-o", "t.toml", "--json")
    assert outcome.code == 0, outcome.err
    found = json.loads(outcome.out)
    assert found["stroke_pi"] == pytest.approx(2.4, rel=0.01)  # as in `test_slmsuite_calibration`
    assert found["wavelength"] == "532 nm"
    assert [sweep["period"] for sweep in found["sweeps"]] == [8, 16]
    save(Path("f.h5"), fourier(1000.0, (5, 6)))
    assert "is a Fourier calibration" in holoview("calibrate", "lut", "f.h5", "-o", "t.toml").err


def test_a_table_of_sweeps_says_what_they_are(holoview: Run, tmp_path: Path) -> None:
    phase = 2.4 * np.pi * (np.arange(48) / 47) ** 1.2
    powers = {
        ("8", "1"): np.sin(phase / 2) ** 2,
        ("16", "1"): np.sin(phase / 2) ** 2,
        ("16", "0"): np.cos(phase / 2) ** 2,
    }
    rows = [f"532,{p},{o},{k},{v:.6f}" for (p, o), own in powers.items() for k, v in enumerate(own)]
    Path("s.csv").write_text("\n".join(["wavelength_nm,period_px,order,level,power", *rows]), encoding="utf-8")
    outcome = holoview("calibrate", "lut", "s.csv", "--order", "auto", "--wavelength", "532nm", "--json")
    assert outcome.code == 0, outcome.err
    found = json.loads(outcome.out)
    assert found["stroke_pi"] == pytest.approx(2.4, abs=0.01)  # without noise; a spline through 16 knots or more
    assert [sweep["period"] for sweep in found["sweeps"]] == [8, 16, 16] and found["wavelength"] == "532 nm"
    refused = holoview("calibrate", "lut", "s.csv", "--period", "4")
    assert refused.code == 2 and "the file states it for each sweep" in refused.err
