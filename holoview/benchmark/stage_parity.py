"""Compares each stage of the shaders with torch in complex128, on small benches that use every branch of the stages."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.engine.torch_executor import TorchExecutor
from holoview.engine.wgpu_executor import WgpuExecutor
from holoview.gpu.device import Device
from holoview.model.bench_parts import Modulator
from holoview.model.plan import Plan, make_plan
from holoview.model.system import System
from holoview.optics.frame_inputs import FrameInputs
from holoview.view import random_drive

TOLERANCES = {
    "illuminate": 7e-8,  # 5.6e-8: a polynomial for sine and cosine, of a phase that is exact
    "modulate": 2.1e-7,  # 1.8e-7 at 460 nm: f32 of stroke/λ and of its product with the drive, up to 1.8 turns
    "spectrum": 2.6e-7,  # 2.3e-7 at 250 × 384, the largest grid of `CHANGES`
    "transmit": 1.3e-7,  # 1.1e-7 at 50 mm, else 1.0e-7
    "field": 2.6e-7,  # 2.3e-7 at 250 × 384
    "accumulate": 6.5e-8,  # 5.5e-8
    "composite": 7e-8,  # 4.8e-8; a weight in f32 may be off by 6e-8, and product and sum add 2.4e-8 r.m.s. each
}
"""Relative L2 error of a stage by itself: the worst seen, over all benches and four drives each, plus a little."""


@dataclass(frozen=True)
class ExecutorPair:
    """The two executors of one plan: torch in complex128 and the shaders."""

    plan: Plan
    reference: TorchExecutor
    shaders: WgpuExecutor

    @classmethod
    def open(cls, system: System, device: Device, seed: int = 0) -> ExecutorPair:
        """Both executors of a bench, for one random drive."""
        plan, drive = make_plan(system), random_drive(system, seed)
        reference = TorchExecutor(plan, FrameInputs(plan, drive), double=True)
        return cls(plan, reference, WgpuExecutor(plan, FrameInputs(plan, drive), device))

    def clear(self) -> None:
        """Set the intensities of all planes to zero in both."""
        for plane in range(len(self.plan.planes_m)):
            self.reference.clear(plane)
            self.shaders.clear(plane)


@dataclass(frozen=True)
class Step:
    """A stage on the way of the light, the step whose field it takes, and its other arguments."""

    name: str
    stage: str
    after: str | None
    arguments: tuple[Any, ...]

    def run(self, executor: Any, fields: dict[str, Any]) -> Any:
        """The field that the stage gives; fields: those of earlier steps by name."""
        given = [] if self.after is None else [fields[self.after]]
        return getattr(executor, self.stage)(*given, *self.arguments)

    def seen(self, executor: Any, out: Any) -> NDArray[Any]:
        """The part of the result that can be compared: the field, or the intensity or XYZ that it went into."""
        if self.stage == "accumulate":
            return executor.intensity(self.arguments[0])
        if self.stage == "composite":
            return executor.xyz()
        return executor.download_field(out)


def steps_to_planes(plan: Plan, wavelength: int, frame: int, source: int) -> Iterator[Step]:
    """The way of the light through a bench, to the intensity at each plane."""
    yield Step("illuminate", "illuminate", None, (wavelength, source))
    yield Step("modulate 1", "modulate", "illuminate", (frame, 0, wavelength))
    last = "modulate 1"
    if plan.system.gap_m is not None:
        yield Step("spectrum of the gap", "spectrum", last, (0,))
        yield Step("transmit the gap", "transmit", "spectrum of the gap", (0, wavelength, plan.system.gap_m))
        yield Step("field behind the gap", "field", "transmit the gap", (0,))
        yield Step("modulate 2", "modulate", "field behind the gap", (frame, 1, wavelength))
        last = "modulate 2"
    yield Step("last spectrum", "spectrum", last, (len(plan.system.modulators) - 1,))
    for plane, distance_m in enumerate(plan.planes_m.tolist()):
        yield Step(f"transmit to plane {plane}", "transmit", "last spectrum", (1, wavelength, distance_m))
        yield Step(f"field at plane {plane}", "field", f"transmit to plane {plane}", (1,))
        weight = float(plan.weights[frame, wavelength])
        yield Step(f"accumulate plane {plane}", "accumulate", f"field at plane {plane}", (plane, weight))


def lit_rounds(plan: Plan, wavelength: int) -> Iterator[tuple[int, int]]:
    """Frame and source of all that adds up to the intensity at a wavelength."""
    for frame in plan.lit(wavelength):
        for source in range(len(plan.slopes)):
            yield frame, source


def relative_error(found: NDArray[Any], expected: NDArray[Any]) -> float:
    """Relative L2 error; infinite for what isn't finite."""
    error = float(np.linalg.norm(found - expected) / np.linalg.norm(expected))
    return error if math.isfinite(error) else math.inf


def stage_errors(pair: ExecutorPair) -> dict[str, float]:
    """Relative L2 error of each step by itself, by "wavelength, frame, source: step"; XYZ last."""
    errors = {}
    for wavelength in range(len(pair.plan.system.wavelengths_m)):
        for frame, source in lit_rounds(pair.plan, wavelength):
            fields: dict[str, Any] = {}
            for step in steps_to_planes(pair.plan, wavelength, frame, source):
                name = f"wavelength {wavelength}, frame {frame}, source {source}: {step.name}"
                given = None if step.after is None else pair.reference.download_field(fields[step.after])
                errors[name] = _isolated_error(pair, step, given)
                fields[step.name] = step.run(pair.reference, fields)
    return errors | {"composite": composite_error(pair)}


def worst_by_stage(pair: ExecutorPair) -> dict[str, float]:
    """The greatest of `stage_errors` for each stage."""
    errors = stage_errors(pair)
    steps = list(steps_to_planes(pair.plan, 0, 0, 0))
    stages = {step.name: step.stage for step in steps} | {"composite": "composite"}
    worst: dict[str, float] = {}
    for name, error in errors.items():
        stage = stages[name.rpartition(": ")[2]]
        worst[stage] = max(worst.get(stage, 0.0), error)
    return worst


def composite_error(pair: ExecutorPair) -> float:
    """Relative L2 error of XYZ from the same intensities: one pattern of intensities, with a weight for each plane."""
    pair.clear()
    for plane in range(len(pair.plan.planes_m)):
        field = pair.shaders.modulate(pair.shaders.illuminate(0, 0), 0, 0, 0)
        pair.shaders.accumulate(field, plane, 0.25 + 2.75 * plane)
        shown = np.sqrt(pair.shaders.intensity(plane).astype(np.complex128))
        pair.reference.accumulate(pair.reference.upload_field(shown), plane, 1.0)
    for executor in (pair.reference, pair.shaders):
        executor.clear_xyz()
        for wavelength in range(len(pair.plan.system.wavelengths_m)):
            executor.composite(wavelength)
    return relative_error(pair.shaders.xyz(), pair.reference.xyz())


def _isolated_error(pair: ExecutorPair, step: Step, given: NDArray[np.complexfloating] | None) -> float:
    """Error of one step whose input is `given`, rounded to what both executors can hold."""
    pair.clear()
    exact: dict[str, Any] = {}
    on_device: dict[str, Any] = {}
    if step.after is not None and given is not None:
        rounded = given.astype(np.complex64)
        relay = step.arguments[0] if step.stage in ("transmit", "field") else None
        exact[step.after] = pair.reference.upload_field(rounded)
        on_device[step.after] = pair.shaders.upload_field(rounded, relay=relay)
    expected = step.seen(pair.reference, step.run(pair.reference, exact))
    found = step.seen(pair.shaders, step.run(pair.shaders, on_device))
    return relative_error(found, expected) if found.shape == expected.shape else math.inf


# --- the benches ---


_P67 = [0, 0.0107, 0.0219, 0.045, 0.0598, 0.0775, 0.1206, 0.185, 0.3655, 0.3955, 0.451, 0.5244, 0.6393, 0.7116, 0.8502]
SOURCES = {"directions": [[0.0, 0.0], [0.01, -0.02], [-0.03, 0.005]]}
CHANGES: dict[str, dict[str, Any]] = {
    "two modulators": {},
    "one modulator": {"modulators": [{"pitch": "8 um", "shape": [25, 32], "stroke": "825 nm"}], "gap": None},
    "tilted sources": {"source": SOURCES},
    "a tilt for each wavelength": {"source": SOURCES | {"tilts": [[0.002, 0.0], [-0.001, 0.004]]}},
    "irises and a DC block": {"relay1.iris_na": 0.025, "relay2.iris_na": 0.02, "relay2.dc_block_na": 0.003},
    "glass in both relays": {
        "relay1": {"iris_na": 0.03, "aberration": {"Z5": "40 nm", "Z8": "-60 nm"}},
        "relay2": {"iris_na": 0.025, "apodisation_na": 0.02, "aberration": {"Z4": "70 nm"}},
    },
    "sixteen uneven levels": {"levels": [*_P67, 1]},
    "lasers in turn": {"amplitudes": [[2.0, 0.0], [0.0, 4.0], [0.5, 1.5]]},
    "one sample a pixel, periodic": {"upsample": 1, "propagation": "periodic"},
    "nine samples a pixel": {"upsample": 3},
    "250 x 384 samples, periodic": {"shape": [125, 192], "propagation": "periodic"},
    "first orders": {"relay1.square": "first order", "relay2.square": "first order"},
    "stops beside the axis": {
        "relay1": {"square": 0.02, "centre_na": [0.012, -0.02], "dc_block_na": 0.004},
        "relay2": {"iris_na": 0.02, "centre_na": [0.0, 0.025]},
        "source": SOURCES,
        "propagation": "periodic",
    },
    "one modulator, a stop, tilted sources": {
        "modulators": [{"pitch": "8 um", "shape": [25, 32], "stroke": "825 nm"}],
        "gap": None,
        "source": SOURCES,
        "relay2.square": "first order",
    },
    "compact": {"shape": [27, 45], "upsample": 3, "propagation": "compact", "relay2.iris_na": 0.01},
    "an eye": {
        "eye": {"pupil": "1.5 mm", "pupil_y": "0.4 mm", "pupil_x": "-0.3 mm", "accommodation": ["0.3 D", "2 D"]}
    },
    "an eye that moves as a whole, with a prescription": {
        "eye": {
            "eyepiece": "25 mm",
            "pupil": "auto",
            "pupil_x": "0.2 mm",
            "chromatic_axis": "pupil",
            "stiles_crawford": True,
            "prescription": {"sphere": "-0.5 D", "cylinder": "0.75 D", "axis": 30.0, "aberration": {"Z8": "60 nm"}},
        },
        "relay2.square": "first order",
    },
    "a field, planes before and behind it": {
        "modulators": [{"pitch": "8 um", "shape": [100, 128], "content": "field"}],
        "gap": None,
        "upsample": 1,
        "planes": ["-40 mm", "0 mm", "60 mm"],
        "source": SOURCES,
        "relay2.iris_na": 0.02,
    },
    "no gap, planes at zero and far": {"gap": 0.0, "planes": [0.0, "50 mm"], "propagation": "periodic"},
}
"""The changes of `parity_bench` that make each bench, by its name."""


def parity_bench(**changes: Any) -> System:
    """A bench of two modulators of 25 × 32 pixels, two lasers and two planes, with some of its keys changed."""
    modulator = Modulator(pitch_m=8e-6, shape=(25, 32), stroke_m=825e-9)
    base = System(
        wavelengths_m=np.array([460e-9, 638e-9]),
        amplitudes=np.array([[1.0, 2.0]]),
        modulators=(modulator, modulator),
        gap_m=1e-3,
        planes_m=np.array([3e-3, 4e-3]),
    )
    return base.edit(changes)
