"""What is written: maps and a preset that every executor uses as the predictor does; scores; the lasers' response."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.bench.calibrate.calibration_result import (
    CalibrationResult,
    PredictionScore,
    fit_laser_response,
    plot_calibration,
    score_predictions,
    starting_bench,
)
from holoview.bench.calibrate.train import CalibrationModel, TrainingData
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.light.model import preset
from holoview.light.model.effects.learned_maps import LearnedMaps, read_calibration, write_calibration
from holoview.light.model.effects.registry import get_effect, listed_effects
from holoview.util.errors import UserError


@pytest.fixture(scope="module")
def model(trained: Any) -> CalibrationModel:
    model = CalibrationModel(trained.captures, trained.layout, {})
    model.set_maps(trained.states[-1].best_maps.tensors)
    return model


@pytest.fixture(scope="module")
def scored(trained: Any, model: CalibrationModel) -> PredictionScore:
    return score_predictions(
        TrainingData(trained.captures), trained.split, model.predict_nominal, model.predict, lambda *_: None
    )


@pytest.fixture(scope="module")
def saved(trained: Any, scored: PredictionScore, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("calibrated")
    bench = starting_bench(trained.captures, None, "mine")
    CalibrationResult(trained.captures, bench, trained.states[-1].best_maps, scored, normalise_amplitudes=True).save(
        folder / "mine.toml"
    )
    return folder / "mine.toml"


def test_scores_rise_on_what_was_held_out_at_every_wavelength(scored: PredictionScore) -> None:
    overall = next(row for row in scored.rows if row.group == "captures" and row.wavelength_m is None)
    before, after = overall.before.chi2_per_pixel, overall.after.chi2_per_pixel
    assert before > 50 and after - 1 < 0.01 * before  # as in `test_train`
    assert all(row.after.psnr_db - row.before.psnr_db > 6 for row in scored.rows)
    assert {row.wavelength_m for row in scored.rows if row.group == "train"} == {None, 460e-9, 532e-9, 638e-9}


def test_the_lasers_law_is_the_hidden_one(trained: Any, scored: PredictionScore) -> None:
    """Gains of maps that aren't quite at rest let it scatter by 0.004 (six draws)."""
    exponent, _ = scored.response.common_exponent
    assert scored.response.is_nonlinear
    assert exponent == pytest.approx(trained.hidden["laser_power"]["exponent"], abs=0.03)


def test_a_preset_with_another_kind_of_stop_is_refused(trained: Any) -> None:
    nominal = trained.captures.nominal_system()
    assert starting_bench(trained.captures, nominal, "") == nominal
    for edits in ({"relay1.square": "first order"}, {"relay2.iris_na": None}, {"modulators.0.stroke": 800e-9}):
        with pytest.raises(UserError, match="preset: "):
            starting_bench(trained.captures, nominal.edit(edits), "")


def test_the_preset_names_its_maps_beside_it_and_moves_with_them(saved: Path, tmp_path: Path) -> None:
    assert 'file = "mine.safetensors"' in saved.read_text(encoding="utf-8")
    for path in saved.parent.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    moved = preset.load(tmp_path / "mine.toml")
    assert moved.effect_values["calibrated"]["file"] == str(tmp_path / "mine.safetensors")
    assert moved.effect_values["laser_power"]["exponent"] == pytest.approx(0.15, abs=0.03)  # as above
    assert float(moved.amplitudes.max()) == 1.0
    preset.save(moved, tmp_path / "again.toml")
    assert preset.load(tmp_path / "again.toml") == moved


@pytest.mark.parametrize("backend", ["torch64", "torch"])
def test_frames_are_what_the_predictor_expects(saved: Path, trained: Any, backend: str) -> None:
    captures: Captures = trained.captures
    system = preset.load(saved)
    table = {"calibrated": system.effect_values["calibrated"]}
    one = system.edit({"effects": table, "wavelengths": [float(captures.wavelength_m[3])], "amplitudes": [[1.0]]})
    frame = hv.simulate(one, captures.drive(3)[None].astype(np.float32), backend=backend).intensity[0, 0]
    alone = dataclasses.replace(captures, power=np.ones(len(captures)), exposure_s=np.ones(len(captures)))
    expected = Predictor(alone, double_precision=True)([3], table).signal[0].numpy()
    # single precision through four transforms; the predictor in double against the executor
    assert np.abs(frame - expected).max() < (1e-4 if backend == "torch" else 1e-6) * expected.max()


def test_maps_that_are_missing_damaged_or_of_another_bench_are_named(saved: Path, trained: Any, tmp_path: Path) -> None:
    text = saved.read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(UserError, match=r"mine\.safetensors: no such file"):
        hv.make_plan(preset.load(tmp_path / "mine.toml"))
    (tmp_path / "mine.safetensors").write_bytes(b"not tensors")
    with pytest.raises(UserError, match="can't be read"):
        hv.make_plan(preset.load(tmp_path / "mine.toml"))
    single = dataclasses.replace(trained.layout, modulators=1, warp_nodes=(0, 0), noll1=())
    write_calibration(tmp_path / "mine.safetensors", LearnedMaps.nominal(single), {})
    with pytest.raises(UserError, match="maps of 1 modulators"):
        hv.make_plan(preset.load(tmp_path / "mine.toml"))


def test_a_file_of_maps_with_nan_is_refused(trained: Any, tmp_path: Path) -> None:
    maps = LearnedMaps.nominal(trained.layout)
    maps.tensors["warp_m"][0, 0, 0] = math.nan
    write_calibration(tmp_path / "m.safetensors", maps, {})
    with pytest.raises(UserError, match="warp_m: holds nan at entry 0, warp rows 0"):
        read_calibration(tmp_path / "m.safetensors")


def test_maps_of_zeros_change_nothing(trained: Any) -> None:
    model = CalibrationModel(trained.captures, trained.layout, {}, double_precision=True)
    model.set_maps(LearnedMaps.nominal(trained.layout, torch.float64).tensors)
    nominal, mapped = model.predict_nominal([0])[0], model.predict([0])[0]
    # the warp's interpolation and a blur of a thousandth of a pixel are all that is left
    assert float((nominal - mapped).abs().max() / nominal.max()) < 1e-4


def test_calibrated_is_no_cause_to_be_searched() -> None:
    assert "calibrated" not in listed_effects()
    assert get_effect("calibrated").id == "calibrated"


@pytest.mark.long
def test_pictures_are_drawn_of_everything(trained: Any, model: CalibrationModel, tmp_path: Path) -> None:
    data, best = TrainingData(trained.captures), trained.states[-1].best_maps
    drawn = plot_calibration(tmp_path, data, best, trained.split, model.predict_nominal, model.predict)
    assert {path.name for path in drawn} == {"source.png", "lut.png", "warp.png", "pupils.png", "residual.png"}
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in drawn)


def test_a_preset_that_contradicts_the_captures_is_refused(trained: Any) -> None:
    nominal = trained.captures.nominal_system()
    assert starting_bench(trained.captures, nominal.edit({"effects.tilt.tilt_x": 1e-3}), "").effect_values
    with pytest.raises(UserError, match=r"preset: gap: 2 mm; expected 1 mm"):
        starting_bench(trained.captures, nominal.edit({"gap": 2e-3}), "")


def test_a_power_that_never_changed_tells_no_exponent(small: Captures) -> None:
    same = dataclasses.replace(small, power=np.ones(len(small)))
    response = fit_laser_response(same, np.arange(len(small)), np.full(len(small), 2.0))
    assert response.common_exponent == (0.0, math.inf)
    assert not response.is_nonlinear
    assert response.scale == pytest.approx([2.0, 2.0, 2.0])
