"""The optimiser and the reference executor keep to the device that they are given, tested without a card."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.holograms.view import random_drive
from holoview.light.engine.frame import compute_focal_stack
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.model.effects.registry import listed_effects
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import FrameInputs
from tests.second_device import SecondDevice, small_bench

pytestmark = pytest.mark.usefixtures("kernels_of_a_card")

BENCHES: dict[str, dict[str, Any]] = {
    "plain": {},
    "iris": {"relay2.iris_na": 0.02},
    "glass": {"relay1": {"iris_na": 0.03, "aberration": {"Z5": "40 nm"}}},
    "two sources": {"source": {"directions": [[0.0, 0.0], [0.01, -0.02]]}},
    "sixteen levels": {"levels": [i / 15 for i in range(16)]},
    "two frames": {"amplitudes": [[2.0, 0.0, 1.0], [0.0, 4.0, 1.0]]},
    "padded": {"propagation": "linear"},
}
SETTINGS: dict[str, dict[str, Any]] = {
    "patterns and amplitudes": {},
    "wavelengths too": {"free": ("patterns", "amplitudes", "wavelengths"), "amplitudes_every": 1},
    "eyebox": {"eyebox": 0.01},
    "sRGB": {"loss": "srgb"},
    "region and margin": {"region": (4, 4, 20, 20), "plane_weights": (1.0, 2.0)},
}
EFFECTS = sorted(listed_effects())
OF_LASERS = {"bandwidth", "second_line", "flicker", "polarisation", "laser_power"}
"""Effects that change the lasers themselves, which the optimiser refuses."""


def _with_effect(name: str) -> System:
    parameters = listed_effects()[name].parameters
    return small_bench(**{f"effects.{name}.{p.name}": p.nudged(1.0) for p in parameters})


def _losses(system: System, settings: dict[str, Any], device: str) -> list[float]:
    rows, columns = (n * system.sampling.upsample for n in system.modulators[0].shape)
    stack = np.random.default_rng(0).random((len(system.planes_m), rows, columns, 3), dtype=np.float32)
    return [state.loss for state in hv.iterate(system, stack, hv.Settings(iterations=2, **settings), device=device)]


@pytest.mark.parametrize("bench", BENCHES)
@pytest.mark.parametrize("settings", SETTINGS)
def test_the_optimiser_keeps_to_its_device(bench: str, settings: str) -> None:
    system = small_bench(**BENCHES[bench])
    expected = _losses(system, SETTINGS[settings], "cpu")
    with SecondDevice() as memories:
        assert _losses(system, SETTINGS[settings], "cuda") == expected
    assert memories.moves > 0


@pytest.mark.parametrize("name", EFFECTS)
def test_with_each_effect_the_executor_keeps_to_its_device(name: str) -> None:
    plan = make_plan(_with_effect(name))
    drive = random_drive(plan.nominal)
    expected = compute_focal_stack(TorchExecutor(plan, FrameInputs(plan, drive)))[1]
    with SecondDevice():
        executor = TorchExecutor(plan, FrameInputs(plan, drive), device="cuda")
        assert np.array_equal(compute_focal_stack(executor)[1], expected)


@pytest.mark.parametrize("name", sorted({*EFFECTS} - OF_LASERS))
def test_with_each_effect_the_optimiser_keeps_to_its_device(name: str) -> None:
    system = _with_effect(name)
    expected = _losses(system, {"free": ("patterns",)}, "cpu")
    with SecondDevice():
        assert _losses(system, {"free": ("patterns",)}, "cuda") == expected


def test_the_second_device_refuses_what_cuda_refuses() -> None:
    with SecondDevice() as memories:
        here, there = torch.ones(3), torch.ones(3, device="cuda")
        assert (there + 1).device.type == (2 * there[1:]).device.type == torch.zeros_like(there).device.type == "cuda"
        with pytest.raises(RuntimeError, match="same device"):
            here + there
        with pytest.raises(TypeError, match="copy it to the processor"):
            there.numpy()
        assert there.cpu().device.type == "cpu" and memories.moves == 1
        there[1:] = here[1:]
        there.copy_(here)
        assert there.device.type == "cuda" and torch.equal(there.cpu(), here)
