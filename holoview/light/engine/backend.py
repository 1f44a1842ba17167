"""Opens the PyTorch or the WebGPU executor by the name of its backend."""

from __future__ import annotations

import math
from typing import Any

from holoview.light.engine.frame import Executor
from holoview.light.model.plan import Plan
from holoview.light.model.validity import check_plan
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.util.errors import UserError, suggest_matches

BACKENDS = ("auto", "wgpu", "torch", "torch64")


def open_executor(
    plan: Plan, drive: Any, backend: str = "auto", adapter: str | None = None, *, measures_power: bool = False
) -> tuple[Executor[Any], str]:
    """An executor of a plan for a drive (frame, modulator, y, x) from 0 to 1, and a label that describes it.

    backend: "wgpu", "torch" (complex64), "torch64" (complex128), or "auto": WebGPU if possible, else PyTorch, in which
    case the label states the reason. adapter: a part of the name of the WebGPU adapter. measures_power: measure
    `power_behind` beside the frame, where the executor can.
    Raises UserError for an unknown backend, for "wgpu" or a named adapter if none is suitable, and for a plan that
    leaves nothing to see (`check_plan`).
    """
    if backend not in BACKENDS:
        raise UserError(
            "backend", f'"{backend}"', expected=" or ".join(BACKENDS), remedy=suggest_matches(backend, BACKENDS)
        )
    check_plan(plan)
    inputs = FrameInputs(plan, drive)
    if backend in ("torch", "torch64"):
        return _torch_executor(plan, inputs, measures_power, double=backend == "torch64")
    from holoview.light.engine.wgpu_executor import WgpuExecutor  # optional library: PyTorch alone doesn't need wgpu
    from holoview.light.gpu.device import open_device

    try:
        device = open_device(adapter)
        try:
            return WgpuExecutor(plan, inputs, device, measures_power=measures_power), f"wgpu: {device.info.label}"
        except UserError as error:
            size = " x ".join(map(str, reversed(plan.grid.padded)))
            remedy = f"{error.remedy}: it is {size}, from shape, upsample and propagation; or use --backend torch"
            raise UserError(error.where, error.found, expected=error.expected, remedy=remedy) from error
    except UserError as error:
        if backend == "wgpu" or adapter is not None:
            raise
        executor, label = _torch_executor(plan, inputs, measures_power)
        return executor, f"{label} (chosen because: {error})"


def _torch_executor(
    plan: Plan, inputs: FrameInputs, measures_power: bool, double: bool = False
) -> tuple[Executor[Any], str]:
    from holoview.light.engine.torch_executor import TorchExecutor  # slow start: importing torch takes a second

    executor = TorchExecutor(plan, inputs, double=double, measures_power=measures_power)
    return executor, f"torch, {'complex128' if double else 'complex64'}"


# --- memory -----------------------------------------------------------------------------------------------------------


_COMPLEX64 = 8
_FIELDS_AT_A_TIME = 8  # of a padded grid or band: transforms, tables in double precision, and their products
_IMAGE_BYTES = 240  # a sample of a plane while it becomes a picture: XYZ, linear and encoded colours in float64
_DRIVE_BYTES = 32  # a pixel of a pattern: drive, levels and optical path


def simulation_bytes(plan: Plan, *, double: bool = False) -> int:
    """Memory that simulating a plan and making pictures of all its planes takes, an upper estimate.

    double: in complex128. Of 22 simulations of 0.8 and 3.1 million samples, 1 to 10 planes, 3 or 8 lasers and 1 or 3
    frames, measured on the CPU with one thread, each took 47 to 90 % of it.
    """
    numbers = 2 if double else 1
    samples, planes = math.prod(plan.grid.shape), len(plan.planes)
    band = max(min(math.prod(plan.band(relay).shape), math.prod(plan.grid.padded)) for relay in range(len(plan.relays)))
    fields = numbers * _COMPLEX64 * ((planes + _FIELDS_AT_A_TIME) * band + _FIELDS_AT_A_TIME * samples)
    spectra = planes * samples * numbers * 12 * len(plan.system.wavelengths_m)
    images = planes * samples * (_IMAGE_BYTES + 60 * (numbers - 1))
    system = plan.system
    shapes = list(system.drive_shapes.values()) if system.is_chain else [system.drive_shape]
    drive = sum(map(math.prod, shapes)) * _DRIVE_BYTES * numbers
    return drive + spectra + max(fields, images)
