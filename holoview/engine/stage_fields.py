"""The complex field at each of `System.stages`, by the reference executor.

Fields have no carrier exp(2πi·z/λ). The powers of the lasers aren't in them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.engine.torch_executor import TorchExecutor, TorchField
from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.optics.frame_inputs import FrameInputs
from holoview.util.errors import UserError, suggest_matches


@dataclass(frozen=True, eq=False)
class StageField:
    """The light of one laser in one frame at a stage.

    values: (y, x) complex128. step: from one sample to the next, (y, x): m, or a direction sine where the light is
    known by direction. is_by_direction: whether it is. wavelength_m: of the light.
    """

    stage: str
    values: NDArray[np.complex128]
    step: tuple[float, float]
    is_by_direction: bool
    wavelength_m: float


def stage_field(
    system: System, drive: Any, stage: str, plane_m: float, *, laser: int = 0, frame: int = 0, source: int = 0
) -> StageField:
    """The field at a stage, in complex128.

    plane_m: the focal plane, on which the stages behind relay 2 depend. laser, frame, source: their indices.

    Raises UserError for a stage that the system doesn't have, and as `make_plan` and `FrameInputs` do.
    """
    stages = system.stages
    if stage not in stages:
        raise UserError("stage", f'"{stage}"', expected=", ".join(stages), remedy=suggest_matches(stage, stages))
    for key, index, count in (
        ("laser", laser, len(system.wavelengths_m)),
        ("frame", frame, system.frames),
        ("source", source, len(system.source.directions_rad)),
    ):
        if not 0 <= index < count:
            raise UserError(key, f"{index + 1}", expected=f"1 to {count}")
    seen = system if stage in ("pupil", "retina") else system.with_(eye=None)
    plan = make_plan(seen, [*system.planes_m, plane_m])  # all planes: padding that follows from them stays the same
    executor = TorchExecutor(plan, FrameInputs(plan, drive), double=True)
    frame *= len(plan.moments)
    light = executor.illuminate(laser, source)
    field = light if stage == "light" else _behind_modulators(executor, light, stage, frame, laser)
    λ = float(plan.system.wavelengths_m[laser])
    if stage in stages[: stages.index("stop")]:
        return _by_place(stage, executor, field, λ)
    spectrum = executor.spectrum(field, len(plan.system.modulators) - 1)
    passed = executor.transmit(spectrum, 1, laser, 0.0 if stage == "stop" else plane_m)
    if stage in ("plane", "retina"):
        return _by_place(stage, executor, executor.field(passed, 1), λ)
    rows, columns = (np.argsort(k) for k in executor.frequencies(1))
    by_direction = passed.values.numpy()[np.ix_(rows, columns)]
    sine_y, sine_x = (λ * step for step in plan.grid.frequency_step)
    return StageField(stage, by_direction, (sine_y, sine_x), True, λ)


def _by_place(stage: str, executor: TorchExecutor, field: TorchField, wavelength_m: float) -> StageField:
    pitch_m = executor.plan.grid.pitch_m
    values = executor.download_field(field).astype(np.complex128)
    return StageField(stage, values, (pitch_m, pitch_m), False, wavelength_m)


def _behind_modulators(executor: TorchExecutor, light: TorchField, stage: str, frame: int, laser: int) -> TorchField:
    """The field behind the last modulator, or at an earlier stage."""
    system = executor.plan.system
    field = executor.modulate(light, frame, 0, laser)
    if stage == "slm1" or system.gap_m is None:
        return field
    field = executor.field(executor.transmit(executor.spectrum(field, 0), 0, laser, system.gap_m), 0)
    return field if stage == "gap" else executor.modulate(field, frame, 1, laser)
