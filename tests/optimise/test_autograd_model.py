"""Optimisation with effects: the physics of rendering, exact gradients, and a hologram that allows for the effect."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from holoview.holograms.optimise.forward_model import AutogradModel, ForwardModel
from holoview.holograms.optimise.problem import Problem
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.solve import iterate
from holoview.holograms.view import simulate
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.model.bench_parts import Modulator
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.util.errors import UserError
from tests.optimise.conftest import carry_back, intensity_at

EFFECTS: dict[str, dict[str, Any]] = {
    "lut": {"gamma1": 1.2, "level2_03": 0.05},
    "lut_dispersion": {"slope1": 0.3, "slope2": -0.2},
    "stroke_map": {"z2_1": 0.1, "z4_2": 0.05},
    "dispersion": {"slope": 0.2},
    "source_profile": {"fall": 0.5},
    "crosstalk": {"sigma": 0.5},
    "slm_alignment": {"shift_y": 3e-6, "rotation": 0.02},
    "slm_flatness": {"z5_1": 1e-7},
    "slm1_fringes": {"path_y": 2e-6, "cos1": 0.1, "sin2": 0.05},
    "undiffracted": {"share": 0.2},
    "settling": {"share1": 0.3, "share2": 0.1},
    "stroke": {"stroke_error": 0.1},
    "gap": {"gap_error": 1e-4},
    "aberration2": {"z5": 1e-7},
    "iris1": {"radius_error": -0.3, "decentre_y": 0.2},
    "tilt": {"tilt_y": 0.01},
    "source_extent": {"radius": 2e-3},
}
FAST = ("gap", "aberration2", "iris1", "tilt", "source_extent")


def _system(effects: dict[str, Any], **changes: Any) -> System:
    modulator = Modulator(pitch_m=8e-6, shape=(6, 7), stroke_m=825e-9)
    base = System(
        wavelengths_m=[460.3e-9, 638.2e-9],
        amplitudes=[[1.0, 2.0], [3.0, 1.0]],
        modulators=(modulator, modulator),
        gap_m=0.5e-3,
        planes_m=[0.8e-3, 1.3e-3],
    )
    return base.edit({"relay1.iris_na": 0.04, "relay2.iris_na": 0.035, "effects": effects, **changes})


def _drive(system: System) -> torch.Tensor:
    return 0.05 + 0.9 * torch.rand(system.drive_shape, generator=torch.Generator().manual_seed(4)).double()


@pytest.mark.parametrize("name", EFFECTS)
def test_intensities_and_gradients_are_those_of_the_reference_executor(name: str) -> None:
    system = _system({name: EFFECTS[name]})
    plan = make_plan(system)
    drive = _drive(system).requires_grad_()
    shown = TorchExecutor(plan, FrameInputs(plan, drive), double=True).intensity_tensor()
    wanted = torch.rand(shown.shape, generator=torch.Generator().manual_seed(5)).double()
    (expected,) = torch.autograd.grad((shown - wanted).square().sum(), drive)

    model = (ForwardModel if name in FAST else AutogradModel)(plan, double=True)
    opd_m = drive.detach() * 825e-9
    model.forward(opd_m)
    found = torch.zeros_like(shown)
    for plane in range(2):
        seen = intensity_at(model, plane)
        slopes = torch.empty_like(seen)
        for i, (frame, λ) in enumerate(model.lasers):
            found[plane, λ] += 0.5 * float(system.amplitudes[frame, λ]) * seen[i]
        for i, (frame, λ) in enumerate(model.lasers):
            slopes[i] = 2 * (found[plane, λ] - wanted[plane, λ]) * 0.5 * float(system.amplitudes[frame, λ])
        carry_back(model, plane, slopes)
    gradient = torch.zeros_like(opd_m)
    model.accumulate_gradients(gradient)
    torch.testing.assert_close(found, shown.detach(), rtol=1e-9, atol=1e-12)
    difference = (gradient * 825e-9 - expected).norm() / expected.norm()
    assert float(difference) < 1e-9


def test_the_fast_model_is_taken_where_it_serves() -> None:
    stack = np.full((2, 12, 14, 3), 0.2)
    for name, values in EFFECTS.items():
        model = Problem(_system({name: values}), stack, Settings()).model
        assert isinstance(model, AutogradModel) == (name not in FAST), name


@pytest.mark.parametrize("name", ["crosstalk", "gap"])
def test_a_hologram_made_for_the_effect_is_better_on_a_bench_that_has_it(name: str) -> None:
    values = {"crosstalk": {"sigma": 0.7}, "gap": {"gap_error": 0.3e-3}}[name]
    rng = np.random.default_rng(1)
    coarse = np.repeat(np.repeat(rng.random((2, 4, 5, 3)), 4, axis=1), 4, axis=2)
    changes = {"shape": [8, 10], "wavelengths": ["460 nm", "532 nm", "638 nm"], "amplitudes": "white", "frames": 1}
    with_it, without = _system({name: values}, **changes), _system({}, **changes)
    settings = Settings(iterations=30)
    psnr = []
    for system in (with_it, without):
        *_, last = iterate(system, coarse, settings)
        hologram = last.best
        view = simulate(with_it.edit({"amplitudes": hologram.system.amplitudes}), hologram.drive, backend="torch64")
        scale = (view.rgb * coarse).sum() / (view.rgb**2).sum()
        psnr.append(-10 * np.log10(np.mean((scale * view.rgb - coarse) ** 2)))
    assert psnr[0] > psnr[1] + 0.3


@pytest.mark.parametrize("effect", [{"lut": {"gamma1": 0.7}}, {"lut_dispersion": {"slope1": 0.5}}], ids=str)
def test_a_response_that_is_vertical_at_zero_drive_leaves_gradients_finite(effect: dict[str, Any]) -> None:
    """Steps end at no drive for some pixels, where the slope of drive^0.7 is infinite."""
    *_, last = iterate(_system(effect), np.full((2, 12, 14, 3), 0.2), Settings(iterations=8))
    assert np.isfinite(last.loss)


OF_LASERS: dict[str, dict[str, float]] = {
    "bandwidth": {"sigma": 1e-9},
    "second_line": {"share": 0.2},
    "flicker": {"depth": 0.1},
    "polarisation": {"share": 0.1},
    "laser_power": {"exponent": 0.2},
}


@pytest.mark.parametrize("name", OF_LASERS)
def test_effects_on_the_lasers_themselves_are_refused(name: str) -> None:
    effects = {"gap": {"gap_error": 1e-4}, name: OF_LASERS[name]}
    with pytest.raises(UserError, match=rf"effects\.{name}:.*switch it off"):
        Problem(_system(effects), np.full((2, 12, 14, 3), 0.2), Settings())


def test_free_wavelengths_and_effects_are_refused() -> None:
    with pytest.raises(UserError, match="wavelengths on a bench with effects"):
        Problem(_system({"gap": {"gap_error": 1e-4}}), np.full((2, 12, 14, 3), 0.2), Settings(free=("wavelengths",)))
