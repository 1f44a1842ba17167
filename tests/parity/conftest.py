"""Fixtures of the parity tests: a small bench, and both executors of one plan for the same drive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from holoview.engine.torch_executor import TorchExecutor
from holoview.engine.wgpu_executor import WgpuExecutor
from holoview.gpu.device import Device
from holoview.model.bench_parts import Modulator
from holoview.model.plan import Plan, make_plan
from holoview.model.system import System
from holoview.optics.frame_inputs import make_frame_inputs
from holoview.view import random_drive


@dataclass(frozen=True)
class Both:
    """The two executors of one plan: torch in complex128 and the shaders."""

    plan: Plan
    reference: TorchExecutor
    shaders: WgpuExecutor


@pytest.fixture(scope="session")
def bench() -> Callable[..., System]:
    """A bench of two modulators of 25 × 32 pixels, with some of its keys changed."""

    def changed(**changes: Any) -> System:
        modulator = Modulator(pitch_m=8e-6, shape=(25, 32), stroke_m=825e-9)
        base = System(
            wavelengths_m=[460e-9, 638e-9],
            amplitudes=[[1.0, 2.0]],
            modulators=(modulator, modulator),
            gap_m=1e-3,
            planes_m=[3e-3, 4e-3],
        )
        return base.edit(changes)

    return changed


@pytest.fixture
def both(device: Device) -> Callable[[System], Both]:
    """Both executors of a bench, for one random drive."""

    def opened(system: System, seed: int = 0) -> Both:
        plan, drive = make_plan(system), random_drive(system, seed)
        reference = TorchExecutor(plan, make_frame_inputs(plan, drive), double=True)
        return Both(plan, reference, WgpuExecutor(plan, make_frame_inputs(plan, drive), device))

    return opened
