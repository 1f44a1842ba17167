"""Fixtures of the parity tests: a small bench, and both executors of one plan for the same drive."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from holoview.evidence.benchmark.report_run import ExecutorPair, parity_bench
from holoview.light.gpu.device import Device
from holoview.light.model.system import System


@pytest.fixture(scope="session")
def bench() -> Callable[..., System]:
    """A bench of two modulators of 25 × 32 pixels, with some of its keys changed."""
    return parity_bench


@pytest.fixture
def both(device: Device) -> Callable[[System], ExecutorPair]:
    """Both executors of a bench, for one random drive."""

    def opened(system: System, seed: int = 0) -> ExecutorPair:
        return ExecutorPair.open(system, device, seed)

    return opened
