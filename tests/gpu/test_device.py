"""Adapters are chosen and checked before they are opened; a device refuses what it can't hold before trying."""

from __future__ import annotations

import gc
import re
import subprocess
import sys
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import wgpu
from numpy.typing import NDArray

import holoview.light.gpu
from holoview.light.gpu import device as device_module
from holoview.light.gpu.adapter import MIB, REQUIRED_LIMITS, AdapterInfo, check_limits, choose_adapter, native_adapters
from holoview.light.gpu.device import Device, DeviceLost, Pipeline, open_device
from holoview.light.gpu.recorder import CommandRecorder, Dispatch, check_workgroups, workgroup_grid
from holoview.light.gpu.shader import GeneratedWgsl, link
from holoview.util.errors import UserError

gpu = pytest.mark.gpu


class FakeAdapter:
    """What choosing an adapter looks at."""

    def __init__(self, name: str, kind: str, backend: str = "Vulkan", **limits: int) -> None:
        self.info = {"device": name, "adapter_type": kind, "backend_type": backend, "description": "driver 1.2"}
        self.limits = {**REQUIRED_LIMITS, **{key.replace("_", "-"): value for key, value in limits.items()}}


class FullMemory:
    """A wgpu device without memory to spare."""

    def create_buffer(self, **_: Any) -> None:
        raise wgpu.GPUValidationError("Not enough memory left.")


CPU = FakeAdapter("llvmpipe", "CPU")
INTEGRATED = FakeAdapter("Iris Xe", "IntegratedGPU")
DISCRETE_GL = FakeAdapter("GeForce RTX 3060", "DiscreteGPU", "OpenGL")
DISCRETE = FakeAdapter("GeForce RTX 3060", "DiscreteGPU")


@pytest.mark.parametrize(
    ("found", "best"),
    [
        ([CPU, INTEGRATED, DISCRETE_GL, DISCRETE], DISCRETE),
        ([CPU, FakeAdapter("Venus", "Unknown"), INTEGRATED], INTEGRATED),
        ([CPU, DISCRETE_GL], DISCRETE_GL),
    ],
)
def test_discrete_goes_before_integrated_before_cpu_and_native_before_opengl(found: list[Any], best: Any) -> None:
    assert choose_adapter(found) is best


def test_without_a_name_an_adapter_with_enough_limits_goes_first() -> None:
    small = FakeAdapter("old card", "DiscreteGPU", max_buffer_size=MIB)
    assert choose_adapter([small, CPU]) is CPU


def test_part_of_a_name_chooses_an_adapter_whatever_its_case() -> None:
    assert choose_adapter([DISCRETE, DISCRETE_GL, CPU], "LLVM") is CPU
    assert choose_adapter([CPU, DISCRETE_GL, DISCRETE], "rtx") is DISCRETE


def test_a_name_that_fits_nothing_is_answered_with_those_that_exist() -> None:
    with pytest.raises(UserError, match=r"no adapter is called 'radeon'.*llvmpipe"):
        choose_adapter([CPU, INTEGRATED], "radeon")


def test_no_adapter_at_all_is_answered_with_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device_module, "native_adapters", list)
    with pytest.raises(UserError, match=r"mesa-vulkan-drivers.*--backend torch"):
        open_device()


def test_a_small_limit_is_named_with_what_was_needed_and_found(monkeypatch: pytest.MonkeyPatch) -> None:
    poor = FakeAdapter("old card", "IntegratedGPU", max_storage_buffers_per_shader_stage=4)
    monkeypatch.setattr(device_module, "native_adapters", lambda: [poor])
    with pytest.raises(UserError, match=r"max-storage-buffers-per-shader-stage is 4.*of at least 8"):
        open_device()


def test_enough_limits_pass() -> None:
    check_limits(AdapterInfo.of(CPU), CPU.limits)


@pytest.mark.parametrize(
    ("info", "label"),
    [
        (
            AdapterInfo("llvmpipe (LLVM 15.0.6, 256 bits)", "CPU", "Vulkan", "Mesa 22.3.6 (LLVM 15.0.6)"),
            "llvmpipe (LLVM 15.0.6, 256 bits), Vulkan, Mesa 22.3.6, a CPU adapter",
        ),
        (AdapterInfo("Iris", "IntegratedGPU", "OpenGL", ""), "Iris, OpenGL, through OpenGL only"),
        (AdapterInfo("RTX 3060", "DiscreteGPU", "Vulkan", "550.54"), "RTX 3060, Vulkan, 550.54"),
    ],
)
def test_a_label_says_it_all_and_flags_opengl_and_cpu(info: AdapterInfo, label: str) -> None:
    assert info.label == label


def test_importing_the_package_needs_no_driver() -> None:
    program = """
import importlib, pkgutil, holoview.light.gpu
for module in pkgutil.iter_modules(holoview.light.gpu.__path__, "holoview.light.gpu."):
    importlib.import_module(module.name)
"""
    no_driver = {"VK_ICD_FILENAMES": "/nowhere", "VK_DRIVER_FILES": "/nowhere", "PATH": ""}
    done = subprocess.run([sys.executable, "-c", program], env=no_driver, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_package_knows_no_optics() -> None:
    allowed = {"light.gpu", "light.numerics"}
    for path in Path(holoview.light.gpu.__file__).parent.glob("*.py"):
        text = path.read_text(encoding="utf-8")
        imported = set(re.findall(r"(?:from|import) holoview\.(\w+(?:\.\w+)?)", text))
        assert {name for name in imported if not name.startswith("util.")} <= allowed, path
        assert "torch" not in re.findall(r"^\s*(?:from|import) (\w+)", text, re.MULTILINE), path


def _fake_device(raw: Any = None) -> Device:
    limits = {
        **REQUIRED_LIMITS,
        "max-uniform-buffer-binding-size": 65536,
        "max-compute-workgroups-per-dimension": 65535,
    }
    return Device(raw, AdapterInfo.of(CPU), limits)


def test_a_buffer_beyond_the_binding_limit_is_refused_before_it_is_allocated() -> None:
    with pytest.raises(UserError, match=r"'field': needs 80 MiB; expected at most 64 MiB.*lower the size"):
        _fake_device().buffer(80 * MIB, "field")


def test_a_uniform_beyond_its_limit_is_refused_before_it_is_allocated() -> None:
    with pytest.raises(UserError, match="max-uniform-buffer-binding-size"):
        _fake_device().uniform(bytes(65552), "parameters")


def test_memory_that_runs_out_is_the_users_to_mend() -> None:
    with pytest.raises(UserError, match=r"'field': no memory is left.*lower the size"):
        _fake_device(FullMemory()).buffer(64 * MIB, "field")


def test_a_dispatch_beyond_the_limit_is_refused_with_its_size() -> None:
    with pytest.raises(UserError, match=r"'blur'.*1 × 70000 × 1 workgroups; expected at most 65535"):
        check_workgroups(_fake_device(), "blur", (1, 70000, 1))


@pytest.mark.parametrize("workgroups", [1, 65535, 65536, 1_000_001])
def test_many_workgroups_are_spread_over_two_axes_with_few_to_spare(workgroups: int) -> None:
    across, down = workgroup_grid(workgroups, _fake_device())
    assert across <= 65535
    assert 0 <= across * down - workgroups < down


@gpu
def test_the_device_that_opens_is_one_of_those_listed(device: Device) -> None:
    assert device.info in [AdapterInfo.of(native) for native in native_adapters()]
    assert device.limits["max-storage-buffer-binding-size"] >= REQUIRED_LIMITS["max-storage-buffer-binding-size"]


@gpu
@pytest.mark.parametrize("dtype", [np.float32, np.uint16, np.complex64])
def test_what_is_uploaded_comes_back(device: Device, dtype: type) -> None:
    sent: NDArray[Any] = np.arange(15).reshape(3, 5).astype(dtype)
    assert np.array_equal(device.download(device.upload(sent, "sent"), dtype, (3, 5)), sent)


@gpu
def test_an_array_of_any_memory_order_is_uploaded_row_by_row(device: Device) -> None:
    sent = np.arange(12, dtype=np.float32).reshape(3, 4).T
    assert np.array_equal(device.download(device.upload(sent, "sent"), np.float32, (4, 3)), sent)


@gpu
def test_a_new_buffer_holds_zeros(device: Device) -> None:
    assert not device.download(device.buffer(64, "new"), np.uint8, (64,)).any()


@gpu
def test_transfers_beyond_the_end_of_a_buffer_are_refused(device: Device) -> None:
    buffer = device.buffer(8, "small")
    with pytest.raises(ValueError, match="small: 12 bytes of data for a buffer of 8"):
        device.write(buffer, np.zeros(3, np.float32))
    with pytest.raises(ValueError, match="small: 12 bytes asked of a buffer of 8"):
        device.download(buffer, np.float32, (3,))


COUNT_UP = """
override step: u32 = 1u;
@group(1) @binding(0) var<storage, read_write> counter: array<u32>;
@compute @workgroup_size(1)
fn main() { counter[0] = counter[0] * 10u + step; }
"""


def _count(device: Device, step: int) -> Pipeline:
    return device.pipeline(link(GeneratedWgsl("count", COUNT_UP)), {"step": step})


def _counting(device: Device, counter: Any, step: int) -> Dispatch:
    return Dispatch.bind(device, _count(device, step), [[], [counter]], (1, 1, 1))


@gpu
def test_passes_and_copies_run_in_the_order_recorded(device: Device) -> None:
    counter, kept = device.upload(np.array([9], np.uint32), "counter"), device.buffer(4, "kept")
    recorder = CommandRecorder(device)
    recorder.clear(counter)
    recorder.add(_counting(device, counter, 1))
    recorder.add(_counting(device, counter, 2))
    recorder.copy(counter, kept)
    recorder.add(_counting(device, counter, 3))
    recorder.submit(wait=True)
    assert device.download(kept, np.uint32, (1,)) == 12
    assert device.download(counter, np.uint32, (1,)) == 123


@gpu
def test_a_pipeline_is_compiled_once_for_the_same_source_and_constants(device: Device) -> None:
    first, again, other = (
        device.pipeline(link(GeneratedWgsl("count", COUNT_UP)), {"step": step}, "main") for step in (5, 5, 6)
    )
    assert first is again
    assert first is not other


@gpu
def test_pipelines_that_nobody_has_asked_for_lately_are_given_back(device: Device) -> None:
    """A viewer whose sizes change compiles others for each, and would keep all of them for as long as it runs."""
    small = Device(device.raw, device.info, device.limits, max_pipelines=2)
    compiled = [weakref.ref(_count(small, step)) for step in (1, 2, 1, 3)]
    gc.collect()
    assert [kept() is not None for kept in compiled] == [True, False, True, True]
    assert compiled[0]() is compiled[2]() is _count(small, 1)


@gpu
def test_a_recorder_runs_once(device: Device) -> None:
    recorder = CommandRecorder(device)
    recorder.submit()
    with pytest.raises(RuntimeError, match="runs once"):
        recorder.submit()


@gpu
def test_a_lost_device_raises_instead_of_ending_the_process(wgpu_log: list[str]) -> None:
    device = open_device()
    buffer = device.buffer(4, "kept")
    recorder = CommandRecorder(device)
    recorder.clear(buffer)
    device.raw.destroy()
    for use in (
        recorder.submit,
        device.wait,
        lambda: device.download(buffer, np.uint32, (1,)),
        lambda: device.write(buffer, bytes(4)),
        lambda: device.buffer(4, "new"),
        lambda: device.pipeline(link(GeneratedWgsl("count", COUNT_UP))),
    ):
        with pytest.raises(DeviceLost, match="reopen"):
            use()
    wgpu_log.clear()
