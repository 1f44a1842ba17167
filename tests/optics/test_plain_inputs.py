"""Inputs of a frame without torch: the same drives and refusals as with it, and only for plain systems."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from holoview.model import preset
from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.optics.frame_inputs import make_frame_inputs
from holoview.optics.plain_inputs import plain_frame_inputs
from holoview.util.errors import UserError
from holoview.view import random_drive


def _bench(**changes: Any) -> System:
    return preset.load("holochrome-8").edit({"shape": [12, 16], **changes})


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int64])
def test_stroke_fractions_are_those_of_frame_inputs(dtype: type) -> None:
    system = _bench(frames=2)
    drive = (
        np.round(random_drive(system, 3)).astype(dtype) if dtype is np.int64 else random_drive(system, 3).astype(dtype)
    )
    plan = make_plan(system)
    plain, full = plain_frame_inputs(plan, drive), make_frame_inputs(plan, drive)
    assert plain is not None
    assert plain.pupils == full.pupils
    for frame in range(2):
        for modulator, description in enumerate(system.modulators):
            np.testing.assert_array_equal(
                plain.stroke_fractions(frame, modulator, description.stroke_m),
                full.stroke_fractions(frame, modulator, description.stroke_m),
            )


@pytest.mark.parametrize(
    "change",
    [
        {"modulators.0.levels": 16},
        {"relay1.iris_na": 0.02, "relay1.aberration": {"4": "100 nm"}},
        {"relay2.apodisation_na": 0.03},
        {"effects.crosstalk.sigma": 0.5},
    ],
    ids=["levels", "aberration", "apodisation", "effect"],
)
def test_levels_pupils_and_effects_need_torch(change: dict[str, Any]) -> None:
    system = _bench(**change)
    assert plain_frame_inputs(make_plan(system), random_drive(system, 0)) is None


@pytest.mark.parametrize(
    "spoil",
    [
        lambda drive: drive[..., 1:],
        lambda drive: drive[:0],
        lambda drive: drive + 0.5,
        lambda drive: drive - 0.5,
        lambda drive: np.where(drive < 0.1, np.nan, drive),
        lambda drive: drive.astype(complex),
        lambda drive: drive.astype(str),
    ],
    ids=["shape", "empty", "above", "below", "NaN", "complex", "text"],
)
def test_refusals_are_the_same(spoil: Any) -> None:
    system = _bench()
    plan, drive = make_plan(system), spoil(random_drive(system, 0))
    with pytest.raises(UserError) as full:
        make_frame_inputs(plan, drive)
    with pytest.raises(UserError) as plain:
        plain_frame_inputs(plan, drive)
    assert str(plain.value) == str(full.value)


@pytest.mark.gpu
def test_a_first_picture_doesn_t_wait_for_torch() -> None:
    program = (
        "import sys; from holoview.model import preset; from holoview.engine.incremental import IncrementalRenderer\n"
        "from holoview.gpu.device import open_device; from holoview.view import random_drive\n"
        "system = preset.load('holochrome-8').edit({'shape': [12, 16]})\n"
        "renderer = IncrementalRenderer(system, random_drive(system, 0), open_device())\n"
        "renderer.update(); renderer.srgb8()\n"
        "assert 'torch' not in sys.modules and 'colour' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
