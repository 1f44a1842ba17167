"""Choosing an executor by name, and saying which one it became. Nothing falls back silently."""

from __future__ import annotations

from typing import Any

from holoview.engine.frame import Executor
from holoview.model.plan import Plan
from holoview.util.errors import UserError, suggest_matches

BACKENDS = ("auto", "wgpu", "torch", "torch64")


def open_executor(
    plan: Plan, drive: Any, backend: str = "auto", adapter: str | None = None
) -> tuple[Executor[Any], str]:
    """An executor of the plan for a drive, and its label.

    Raises UserError for an unknown backend, and for "wgpu" where no adapter serves; "auto" then takes torch and its
    label says why.
    """
    if backend not in BACKENDS:
        raise UserError(
            "backend", f'"{backend}"', expected=" or ".join(BACKENDS), remedy=suggest_matches(backend, BACKENDS)
        )
    from holoview.engine.torch_executor import TorchExecutor  # here, as importing torch takes a second
    from holoview.optics.frame_inputs import make_frame_inputs

    if backend == "torch64":
        return TorchExecutor(plan, make_frame_inputs(plan, drive), double=True), "torch, complex128"
    slots = make_frame_inputs(plan, drive)
    if backend == "torch":
        return TorchExecutor(plan, slots), "torch, complex64"
    from holoview.engine.wgpu_executor import WgpuExecutor  # here, so that torch alone needs no WebGPU library
    from holoview.gpu.device import open_device

    try:
        device = open_device(adapter)
        try:
            return WgpuExecutor(plan, slots, device), f"wgpu: {device.info.label}"
        except UserError as error:
            size = " x ".join(map(str, reversed(plan.grid.padded)))
            remedy = f"{error.remedy}: it is {size}, from shape, upsample and propagation; or use --backend torch"
            raise UserError(error.where, error.found, expected=error.expected, remedy=remedy) from error
    except UserError as error:
        if backend == "wgpu" or adapter is not None:
            raise
        return TorchExecutor(plan, slots), f"torch, complex64 (chosen because: {error})"
