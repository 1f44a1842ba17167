"""Captures of a chain of elements that are chosen one after the other, on its virtual rig."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from holoview.bench.captures.predictor import Predictor
from holoview.bench.experiment.capture_choice import ShownPatterns, draw_proposals, starting_proposals
from holoview.bench.experiment.closed_loop import ClosedLoop, InformedPlanner, LoopSettings
from holoview.bench.rig import RigDescription, read_rig
from holoview.commands.cli import main
from holoview.light.model.effects.registry import get_effect
from tests.rig.conftest import direct_devices
from tests.rig.test_chain_rig import write_chain_rig

LEAKAGE = 0.15
HIDDEN = {"leakage": {"element": "coarse", "amplitude": LEAKAGE}}
CANDIDATES = ("leakage@coarse", "misplaced@coarse", "gap@space", "ambient")


@pytest.fixture
def rig(tmp_path: Path) -> RigDescription:
    return read_rig(write_chain_rig(tmp_path, {"virtual": {"seed": 5, "effects": HIDDEN}}))


@pytest.mark.long
def test_a_fault_of_an_element_is_found_with_few_captures_whose_reasons_name_it(rig: RigDescription) -> None:
    told: list[str] = []
    effects = [get_effect(name) for name in CANDIDATES]
    settings = LoopSettings(max_captures=8)
    loop = ClosedLoop(
        rig, direct_devices(rig), effects, InformedPlanner(rig), settings, free_maps=False, tell=told.append
    )
    result = loop.run()
    assert result.is_certain and list(result.diagnosis.values) == ["leakage@coarse"]
    assert result.diagnosis.values["leakage@coarse"]["amplitude"] == pytest.approx(LEAKAGE, abs=0.02)
    assert len(told) == len(result.steps) and "phase" in told[0] and "coarse" in told[0]


def test_proposals_are_patterns_of_each_elements_own_shape(rig: RigDescription) -> None:
    proposals = [*starting_proposals(rig, 0), *draw_proposals(rig, np.random.default_rng(0), 40)]
    words = " ".join(proposal.words for proposal in proposals)
    assert "coarse flat" in words and "phase flat" in words and "px on coarse" in words and "modulator" not in words
    for proposal in proposals:
        assert proposal.levels.shape == (2, 24, 32) and proposal.levels[1].max() <= 63
        assert not proposal.levels[1, 12:].any() and not proposal.levels[1, :, 16:].any()


def test_gradients_reach_the_patterns_of_every_element(rig: RigDescription) -> None:
    """Against central differences of the light along the gradient, for patterns between levels."""
    levels = rig.random_levels(np.random.default_rng(1), 1.5)
    shape = rig.camera_shape
    capture = rig.capture(
        levels, np.zeros(shape, np.uint16), wavelength_m=638e-9, distance_m=3e-3, power=1.0, exposure_s=1.0
    )
    weight = torch.from_numpy(np.random.default_rng(2).random(shape))
    drive = torch.from_numpy(0.2 + 0.6 * np.random.default_rng(3).random((2, 24, 32)))

    def light(patterns: Any, *, grad: bool = False) -> torch.Tensor:
        shown = ShownPatterns(patterns, capture.slm_names)
        seen = Predictor(capture, [shown], double_precision=True)([0], {ShownPatterns.id: {"on": 1.0}}, grad=grad)
        return (weight * seen.signal[0]).sum()

    free = drive.clone().requires_grad_(True)
    (slope,) = torch.autograd.grad(light(free, grad=True), free)
    assert not slope[1, 12:].any() and not slope[1, :, 16:].any()
    for number in range(2):
        step = torch.zeros_like(drive)
        step[number] = 1e-5 * slope[number] / slope[number].norm()
        difference = float(light(drive + step) - light(drive - step)) / 2e-5
        assert difference == pytest.approx(float(slope[number].norm()), rel=1e-5)


@pytest.mark.long
def test_the_command_takes_captures_and_names_the_cause(
    rig: RigDescription, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(rig.path.parent)
    assert main(["diagnose", "--rig", "rig.toml", "--captures", "3", "--time", "20s", "-o", "seen.h5"]) in (0, 1)
    told = capsys.readouterr()
    assert "leakage@coarse" in told.out + told.err or "Black pixels of coarse" in told.out
    assert (rig.path.parent / "seen.h5").exists()
