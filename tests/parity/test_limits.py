"""Which executor is opened, and what is said when the one that was asked for can't be."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from holoview.holograms.view import random_drive
from holoview.light.engine.backend import open_executor
from holoview.light.engine.frame import compute_focal_stack
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.engine.wgpu_executor import WgpuExecutor
from holoview.light.gpu import device as device_module
from holoview.light.gpu.adapter import MIB
from holoview.light.gpu.device import Device
from holoview.light.model.derived_numbers import info_rows
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.util.errors import UserError

gpu = pytest.mark.gpu

Opened = Callable[..., Any]


def _open(system: System, backend: str, adapter: str | None = None) -> tuple[Any, str]:
    return open_executor(make_plan(system), random_drive(system), backend, adapter)


def _limited(device: Device, **limits: int) -> Device:
    """The device with lower limits, which holoview checks before it asks the driver for anything."""
    lower = {name.replace("_", "-"): limit for name, limit in limits.items()}
    return Device(device.raw, device.info, {**device.limits, **lower})


def _shaders(system: System, device: Device) -> WgpuExecutor:
    plan = make_plan(system)
    return WgpuExecutor(plan, FrameInputs(plan, random_drive(system)), device)


@pytest.fixture
def no_adapter(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine without a graphics driver."""
    monkeypatch.setattr(device_module, "native_adapters", list)


# --- too large for the device ---------------------------------------------------------------------------------------


@gpu
def test_a_grid_beyond_the_binding_limit_is_refused_with_its_size(device: Device, bench: Opened) -> None:
    small = _limited(device, max_storage_buffer_binding_size=MIB)
    refusal = r"padded field, 768 x 500.*needs 2.96 MiB; expected at most 1 MiB.*lower the size of the grid"
    with pytest.raises(UserError, match=refusal):
        _shaders(bench(shape=[125, 192]), small)


@gpu
def test_a_grid_beyond_the_adapters_own_limit_is_refused_and_the_device_lives_on(device: Device, bench: Opened) -> None:
    if device.limits["max-storage-buffer-binding-size"] > 140 * MIB:
        pytest.skip("this adapter holds the largest grid that is quick to try")
    with pytest.raises(UserError, match=r"padded field, 4320 x 4320.*needs 142.6 MiB.*lower the size of the grid"):
        _shaders(bench(shape=[2130, 2130], upsample=1), device)
    assert compute_focal_stack(_shaders(bench(), device))[0].any()


@gpu
def test_more_workgroups_than_the_device_takes_are_refused_before_it_is_asked(device: Device, bench: Opened) -> None:
    executor = _shaders(bench(), _limited(device, max_compute_workgroups_per_dimension=1))
    with pytest.raises(UserError, match=r"workgroups; expected at most 1 along an axis.*lower the size of the grid"):
        compute_focal_stack(executor)


@gpu
@pytest.mark.parametrize(
    ("changes", "refusal"),
    [
        ({"shape": [2, 4200]}, r"points a side; expected at most 8192; lower the size"),
        ({"shape": [2, 4200], "propagation": "periodic"}, r"points a side; expected at most 8192; lower the size"),
    ],
)
def test_a_size_that_the_shaders_cannot_transform_is_refused(
    device: Device, bench: Opened, changes: dict[str, Any], refusal: str
) -> None:
    with pytest.raises(UserError, match=refusal):
        _shaders(bench(**changes), device)


@gpu
def test_a_periodic_size_that_has_no_transform_is_padded_to_the_next_one_in_both_executors(
    device: Device, bench: Opened
) -> None:
    system = bench(shape=[11, 32], propagation="periodic")
    plan, drive = make_plan(system), random_drive(system)
    assert plan.grid.padded == (24, 64) and plan.grid.shape == (22, 64)
    assert "24 (periodic, padded to the next sizes" in str(info_rows(system))
    expected = compute_focal_stack(TorchExecutor(plan, FrameInputs(plan, drive), double=True))[0]
    found = compute_focal_stack(_shaders(system, device))[0]
    assert np.linalg.norm(found - expected) <= 1e-6 * np.linalg.norm(expected)


@gpu
def test_auto_takes_torch_for_a_grid_that_the_device_cannot_hold_and_says_so(
    device: Device, bench: Opened, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = _limited(device, max_storage_buffer_binding_size=MIB)
    monkeypatch.setattr(device_module, "open_device", lambda adapter: small)
    executor, label = _open(bench(shape=[125, 192]), "auto")
    assert isinstance(executor, TorchExecutor)
    assert label.startswith("torch, complex64 (chosen because: buffer 'padded field, 768 x 500': needs 2.96 MiB")
    with pytest.raises(UserError, match="lower the size of the grid"):
        _open(bench(shape=[125, 192]), "wgpu")


# --- by name --------------------------------------------------------------------------------------------------------


@gpu
@pytest.mark.parametrize("backend", ["wgpu", "auto"])
def test_with_an_adapter_the_shaders_are_taken_and_the_label_names_it(
    device: Device, bench: Opened, backend: str
) -> None:
    executor, label = _open(bench(), backend)
    assert isinstance(executor, WgpuExecutor)
    assert label == f"wgpu: {device.info.label}"


@pytest.mark.usefixtures("no_adapter")
def test_without_an_adapter_wgpu_is_refused_with_what_to_install(bench: Opened) -> None:
    with pytest.raises(UserError, match=r"none was found.*mesa-vulkan-drivers.*--backend torch"):
        _open(bench(), "wgpu")


@pytest.mark.usefixtures("no_adapter")
def test_without_an_adapter_auto_takes_torch_and_its_label_says_why(bench: Opened) -> None:
    executor, label = _open(bench(), "auto")
    assert isinstance(executor, TorchExecutor)
    assert label.startswith("torch, complex64 (chosen because: graphics adapter: none was found")


@pytest.mark.usefixtures("no_adapter")
@pytest.mark.parametrize(("backend", "precision"), [("torch", "complex64"), ("torch64", "complex128")])
def test_torch_needs_no_adapter(bench: Opened, backend: str, precision: str) -> None:
    executor, label = _open(bench(), backend)
    assert isinstance(executor, TorchExecutor)
    assert label == f"torch, {precision}"


@gpu
@pytest.mark.parametrize("backend", ["wgpu", "auto"])
def test_an_adapter_of_an_unknown_name_is_refused_and_never_replaced(
    device: Device, bench: Opened, backend: str
) -> None:
    with pytest.raises(UserError, match=r"no adapter is called 'no such card'; (did you mean|known:)"):
        _open(bench(), backend, "no such card")


@gpu
def test_part_of_an_adapters_name_opens_it(device: Device, bench: Opened) -> None:
    _, label = _open(bench(), "auto", device.info.name[:6].upper())
    assert label == f"wgpu: {device.info.label}"


@pytest.mark.parametrize(
    ("backend", "remedy"),
    [("wgup", "did you mean wgpu"), ("torch32", "did you mean torch"), ("cuda", "known: auto, torch, torch64, wgpu")],
)
def test_an_unknown_backend_is_answered_with_those_like_it(bench: Opened, backend: str, remedy: str) -> None:
    with pytest.raises(UserError, match=f'backend: "{backend}"; expected auto or wgpu or torch or torch64; {remedy}'):
        _open(bench(), backend)


@pytest.mark.long
def test_torch_needs_no_webgpu_library() -> None:
    program = """
import sys
sys.modules["wgpu"] = None
import holoview as hv
system = hv.load("holochrome-8-1slm").with_(shape=[6, 8])
print(hv.simulate(system, hv.random_drive(system), backend="torch").backend)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "torch, complex64\n"), done.stderr
