"""The shaders compute chains of elements as torch does in complex128, stage by stage and as a whole."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from holoview.evidence.benchmark.report_run import ExecutorPair, relative_error, stage_errors
from holoview.holograms.view import random_drive, simulate
from holoview.light.gpu.device import Device
from holoview.light.model.system import System

pytestmark = pytest.mark.gpu

UM, MM, NM = 1e-6, 1e-3, 1e-9
MOST = 1e-6
"""Relative L2 error of a stage by itself: single precision is 6e-8, a transform of 120 samples adds 2e-7."""


def _pixels(kind: str, **keys: Any) -> dict[str, Any]:
    return {"kind": kind, "pitch": 8 * UM, "shape": (30, 24)} | keys


_SPACE = {"kind": "space", "distance": 1 * MM, "iris_na": 0.03, "aberration": {"Z5": 50 * NM}}
_MASK = {"kind": "mask", "pitch": 4 * UM, "shape": (60, 48), "pattern": "random", "stroke": 700 * NM}
CHAINS: dict[str, list[dict[str, Any]]] = {
    "phase, coarse amplitude": [
        _pixels("phase", stroke=800 * NM),
        _SPACE,
        _pixels("amplitude", pitch=24 * UM, shape=(10, 8)),
    ],
    "complex and mask": [_pixels("complex", stroke=600 * NM), _MASK],
    "side by side": [
        _MASK,
        _SPACE,
        _pixels("phase", stroke=800 * NM, name="one"),
        _pixels("amplitude", beside="one", offset=[8 * UM, 0.0]),
        _MASK | {"beside": "one", "seed": 2},
    ],
    "a modulator beside a mask": [_MASK | {"name": "still"}, _pixels("phase", stroke=800 * NM, beside="still")],
    "binary": [_pixels("amplitude", levels=2)],
    "lens and fourier": [
        _pixels("phase", stroke=800 * NM),
        {"kind": "lens", "focal_length": 20 * MM},
        _SPACE,
        {"kind": "fourier", "focal_length": 2.4 * MM},
        _pixels("amplitude"),
        _SPACE,
        _pixels("phase", stroke=800 * NM),
        {"kind": "space", "square": "first order"},
    ],
}


def _chain(elements: list[dict[str, Any]]) -> System:
    lasers = [532 * NM, 580 * NM]
    return System(lasers, [[1.0, 0.5], [0.0, 1.0]], elements=elements, planes_m=[3 * MM, 4 * MM], observer="mono")


@pytest.mark.parametrize("name", CHAINS)
def test_each_stage_of_a_chain_alone_gives_what_torch_gives(device: Device, name: str) -> None:
    errors = stage_errors(ExecutorPair.open(_chain(CHAINS[name]), device))
    assert not {step: error for step, error in errors.items() if error > MOST}


@pytest.mark.parametrize("name", CHAINS)
def test_a_whole_chain_is_the_same_on_all_backends(name: str) -> None:
    system = _chain(CHAINS[name])
    drive = random_drive(system, seed=2)
    exact = simulate(system, drive, backend="torch64").intensity
    for backend in ("torch", "wgpu"):
        found = simulate(system, drive, backend=backend).intensity
        # independent roundings of up to 30 stages of 2.6e-7 each, in quadrature, √2 times as much in intensity
        assert relative_error(found, exact) < np.sqrt(2 * 30) * 2.6e-7
