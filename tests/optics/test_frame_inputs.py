"""Inputs of a frame: drives are checked and become optical paths; relays have a pupil only where they need one."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import torch

from holoview.light.model.bench_parts import Modulator
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.util.errors import UserError


def _plan(**changes: Any) -> Plan:
    first = Modulator(pitch_m=8e-6, shape=(3, 4), stroke_m=800e-9)
    second = Modulator(pitch_m=8e-6, shape=(3, 4), stroke_m=600e-9)
    base = System([460e-9, 638e-9], [[1.0, 1.0]] * 2, (first, second), gap_m=2e-3)
    return make_plan(base.edit(changes))


@pytest.fixture(autouse=True)
def _every_warning() -> Iterator[None]:
    """Torch gives some warnings once a process; here every test must be without."""
    torch.set_warn_always(True)
    yield
    torch.set_warn_always(False)


def _drive(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((2, 2, 3, 4))


def test_each_modulator_turns_its_own_drive_into_its_own_path() -> None:
    drive = _drive()
    opd = FrameInputs(_plan(), drive).opd_m.numpy()
    np.testing.assert_allclose(opd[:, 0], drive[:, 0] * 800e-9, rtol=1e-15)
    np.testing.assert_allclose(opd[:, 1], drive[:, 1] * 600e-9, rtol=1e-15)


def test_a_modulator_with_levels_shows_the_nearest_ones() -> None:
    drive = _drive()
    opd = FrameInputs(_plan(**{"modulators.1.levels": 3}), drive).opd_m.numpy()
    np.testing.assert_allclose(opd[:, 0], drive[:, 0] * 800e-9, rtol=1e-15)
    np.testing.assert_allclose(opd[:, 1], np.round(drive[:, 1] * 2) / 2 * 600e-9, rtol=1e-15)


@pytest.mark.parametrize("kind", ["numpy", "torch", "list", "frozen", "reversed"])
def test_any_kind_of_array_will_do_and_becomes_double_precision(kind: str) -> None:
    drive = _drive().astype(np.float32)
    frozen = drive.copy()
    frozen.setflags(write=False)
    kinds: dict[str, Any] = {
        "numpy": drive,
        "torch": torch.from_numpy(drive),
        "list": drive.tolist(),
        "frozen": frozen,
        "reversed": drive[::-1].copy()[::-1],
    }
    opd = FrameInputs(_plan(), kinds[kind]).opd_m
    assert opd.dtype == torch.float64
    torch.testing.assert_close(opd, FrameInputs(_plan(), drive).opd_m, rtol=0, atol=0)


@pytest.mark.parametrize(
    ("shape", "found"),
    [((2, 2, 4, 3), r"\(2, 2, 4, 3\)"), ((2, 1, 3, 4), r"\(2, 1, 3, 4\)"), ((3, 4), r"\(3, 4\)"), ((0,), r"\(0,\)")],
)
def test_a_drive_of_another_shape_is_refused_with_the_shape_expected(shape: tuple[int, ...], found: str) -> None:
    with pytest.raises(UserError, match=rf"drive: an array of shape {found}; .*\(2, 2, 3, 4\)"):
        FrameInputs(_plan(), np.full(shape, 0.5))


@pytest.mark.parametrize(("value", "found"), [(-0.01, "-0.01"), (1.01, "1.01"), (np.nan, "nan"), (np.inf, "inf")])
def test_a_drive_outside_the_stroke_is_refused(value: float, found: str) -> None:
    drive = _drive()
    drive[1, 0, 2, 3] = value
    with pytest.raises(UserError, match=rf"drive: values from .*{found}.*; expected 0 to 1"):
        FrameInputs(_plan(), drive)


@pytest.mark.parametrize("drive", [np.full((2, 2, 3, 4), 0.5j), "noise"], ids=["complex", "text"])
def test_a_drive_that_is_no_real_array_is_refused(drive: Any) -> None:
    with pytest.raises(UserError, match="drive"):
        FrameInputs(_plan(), drive)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda drive: drive[..., 1:],
        lambda drive: drive[:0],
        lambda drive: drive + 0.5,
        lambda drive: drive - 0.5,
        lambda drive: np.where(drive == drive.min(), np.nan, drive),
    ],
    ids=["shape", "empty", "above", "below", "NaN"],
)
def test_arrays_and_tensors_are_refused_alike(spoil: Any) -> None:
    drive = spoil(_drive())
    with pytest.raises(UserError) as array:
        FrameInputs(_plan(), drive)
    with pytest.raises(UserError) as tensor:
        FrameInputs(_plan(), torch.from_numpy(drive))
    assert str(array.value) == str(tensor.value)


def test_the_ends_of_the_stroke_are_allowed() -> None:
    assert float(FrameInputs(_plan(), np.ones((2, 2, 3, 4))).opd_m.max()) == 800e-9


def test_only_relays_with_aberration_or_apodisation_have_pupils() -> None:
    inputs = FrameInputs(_plan(**{"relay1.iris_na": 0.02, "relay2.apodisation_na": 0.02}), _drive())
    assert inputs.pupils[0] == (None, None)
    assert all(pupil is not None and pupil.dtype == torch.complex128 for pupil in inputs.pupils[1])


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int64])
@pytest.mark.parametrize("change", [{}, {"modulators.0.levels": 16}, {"effects.crosstalk.sigma": 0.5}], ids=str)
def test_shaders_read_the_same_of_arrays_and_of_tensors(dtype: type, change: dict[str, Any]) -> None:
    drive = np.round(_drive(3)).astype(dtype) if dtype is np.int64 else _drive(3).astype(dtype)
    plan = _plan(**change)
    array, tensor = FrameInputs(plan, drive), FrameInputs(plan, torch.from_numpy(drive))
    for frame in range(2):
        for modulator, description in enumerate(plan.system.modulators):
            np.testing.assert_array_equal(
                array.stroke_fractions(frame, modulator, description.stroke_m),
                tensor.stroke_fractions(frame, modulator, description.stroke_m),
            )


_WITHOUT_TORCH = """
import sys; from holoview.light.model import preset; from holoview.holograms.view import random_drive
system = preset.load("holochrome-8").edit({"shape": [12, 16]})
"""


def test_a_bench_without_levels_pupils_and_effects_needs_no_torch() -> None:
    program = _WITHOUT_TORCH + (
        "from holoview.light.model.plan import make_plan; from holoview.light.optics.frame_inputs import FrameInputs\n"
        "inputs = FrameInputs(make_plan(system), random_drive(system, 0))\n"
        "assert inputs.stroke_fractions(0, 1, 1e-6).shape == (12, 16) and not inputs.is_sampled(0)\n"
        "assert inputs.pupils == ((None,) * 8,) * 2 and 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.gpu
def test_a_first_picture_doesn_t_wait_for_torch() -> None:
    program = _WITHOUT_TORCH + (
        "from holoview.light.engine.incremental import IncrementalRenderer\n"
        "from holoview.light.gpu.device import open_device\n"
        "renderer = IncrementalRenderer(system, random_drive(system, 0), open_device())\n"
        "renderer.update(); renderer.srgb8()\n"
        "assert 'torch' not in sys.modules and 'colour' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
