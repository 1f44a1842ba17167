"""Makes the measurements of a report one after the other, and keeps what is known if one of them fails.

A report is made to learn about machines that nobody here has. Whatever goes wrong in a measurement, its text goes into
the report and the next one begins.

`time_case`  frames and edits at a size, a number of wavelengths, a strategy, and so many wavelengths in a dispatch
`ReportRun`  all measurements of a device

`stage_errors` compares each stage of the shaders with torch in complex128, on small benches that use every branch of
the stages.
"""

from __future__ import annotations

import math
import statistics
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.evidence.benchmark.frame_benchmark import (
    benchmark_frame,
    first_image_criterion,
    frame_error,
    job_device_s,
    reference_intensity,
)
from holoview.evidence.benchmark.frame_jobs import (
    TimedJob,
    amplitude_edit,
    frames_in_a_row,
    full_frame,
    gap_edit,
    open_renderer,
    scrub,
    time_interleaved,
    tune,
)
from holoview.evidence.benchmark.machine import has_cuda, machine_facts, measure_power, probe_device
from holoview.holograms.view import random_drive
from holoview.light.engine.incremental import IncrementalRenderer
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.engine.wgpu_executor import WgpuExecutor
from holoview.light.gpu.device import TIMESTAMPS, Device
from holoview.light.gpu.line_fft import STRATEGIES, Strategy, supported_strategies
from holoview.light.model.bench_parts import Modulator
from holoview.light.model.chain import Modulate
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.util.errors import UserError
from holoview.util.files import data_dir

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
CHAIN_TOLERANCE = 1e-6
"""The same of a chain of elements, whose transmissions are uploaded: of f32, and of transforms of any size."""


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
        for plane in range(len(self.plan.planes)):
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
        """The field that the stage gives; fields: the fields of earlier steps by name."""
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
    last, number, to_planes = "illuminate", 0, plan.way.last
    for step in plan.way.steps:
        if isinstance(step, Modulate):
            name, number = f"modulate {step.number + 1}", step.number
            yield Step(name, "modulate", last, (frame, number, wavelength))
        else:
            way = f"relay {step.relay + 1}" if plan.way.is_chain else "the gap"
            name = f"field behind {way}"
            yield Step(f"spectrum of {way}", "spectrum", last, (number,))
            yield Step(f"transmit {way}", "transmit", f"spectrum of {way}", (step.relay, wavelength))
            yield Step(name, "field", f"transmit {way}", (step.relay,))
        last = name
    yield Step("last spectrum", "spectrum", last, (number,))
    for plane in range(len(plan.planes)):
        yield Step(f"transmit to plane {plane}", "transmit", "last spectrum", (to_planes, wavelength, plane))
        yield Step(f"field at plane {plane}", "field", f"transmit to plane {plane}", (to_planes,))
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
    for plane in range(len(pair.plan.planes)):
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


# --- the measurements of a report -------------------------------------------------------------------------------------


FRAME, IN_A_ROW, SCRUB, GAP, AMPLITUDES = "frame", "frame in a row", "focal plane", "gap", "amplitudes"
_ROW_S = 0.05
"""Least duration of frames in a row, in which the wait at their end is a small part."""
_MAX_ROW = 64
_F32, _XYZ_PIXEL_BYTES = 4, 16


@dataclass(frozen=True)
class FrameCase:
    """A case that is timed. size: simulated samples, x by y. per_dispatch: how many wavelengths a dispatch computes."""

    size: tuple[int, int]
    wavelengths: int
    strategy: Strategy
    per_dispatch: int = 1

    @property
    def label(self) -> str:
        """The case in a few words."""
        together = f", {self.per_dispatch} in a dispatch" if self.per_dispatch > 1 else ""
        return f"{self.size[0]} × {self.size[1]}, {self.wavelengths} λ, {self.strategy}{together}"


def case_system(base: System, size: tuple[int, int], wavelengths: int) -> System:
    """A bench without padding, of `size` samples (x, y) and so many lasers of equal amplitude, all lit in one frame.

    One laser is the middle one of the bench; several are evenly spaced over its range. Raises UserError for a size
    that isn't a multiple of the bench's upsampling, as `System.edit` does for other impossible values.
    """
    lowest, highest = float(base.wavelengths_m.min()), float(base.wavelengths_m.max())
    middle = float(base.wavelengths_m[len(base.wavelengths_m) // 2])
    chosen = [middle] if wavelengths == 1 else np.linspace(lowest, highest, wavelengths).tolist()
    columns, rows = (n // base.sampling.upsample for n in size)
    return base.edit(
        {
            "wavelengths": chosen,
            "amplitudes": [[1.0] * wavelengths],
            "shape": [rows, columns],
            "propagation": "periodic",
        }
    )


def time_case(device: Device, base: System, case: FrameCase, rounds: int, limit_s: float) -> dict[str, Any]:
    """Times of a case as JSON values, ms; its device times are absent where the device has no timestamps.

    host_ms: processor time of recording and submitting a frame.

    limit_s: no further round begins after this time. Raises UserError if the device's limits or memory don't suffice.
    """
    system = case_system(base, case.size, case.wavelengths)
    start = time.perf_counter()
    renderer = open_renderer(system, device, strategy=case.strategy, max_wavelengths=case.per_dispatch)
    device.wait()
    first_s = time.perf_counter() - start
    jobs = _jobs(renderer, _row_length(renderer))
    timings = time_interleaved({name: job for name, (job, _) in jobs.items()}, rounds, limit_s=limit_s)
    result = asdict(case) | {
        "size": list(case.size),
        "first_frame_ms": 1e3 * first_s,
        "median_ms": {name: timings[name].median_ms / count for name, (_, count) in jobs.items()},
        "minimum_ms": {name: timings[name].minimum_ms / count for name, (_, count) in jobs.items()},
        "host_ms": 1e3 * _host_s(renderer, len(timings[FRAME].seconds)),
        "rounds": len(timings[FRAME].seconds),
        "frame_bytes": frame_bytes(renderer),
        "memory_bytes": renderer.memory_bytes,
    }
    if TIMESTAMPS not in device.features:
        return result
    timed = {name: job for name, (job, _) in jobs.items() if name != IN_A_ROW}
    repeats = len(timings[FRAME].seconds)
    return result | {"device_ms": {name: 1e3 * job_device_s(renderer, job, repeats) for name, job in timed.items()}}


def frame_bytes(renderer: IncrementalRenderer) -> int:
    """Bytes that the kernels of a frame must read and write, from the source to XYZ, for one frame and source.

    The fields between the kernels of each wavelength, the patterns, the intensities (written once, read once), and XYZ.
    Bytes that a strategy moves between the passes of one transform aren't counted.
    """
    wavelengths, samples = len(renderer.system.wavelengths_m), math.prod(renderer.compositor.shape)
    return wavelengths * (renderer.traffic_bytes + samples * _F32) + samples * _XYZ_PIXEL_BYTES


def parts_ms(case: Mapping[str, Any]) -> dict[str, float]:
    """Device times (ms) of the parts of a frame, as differences of edits that begin at different kernels.

    Empty without device times, and for a bench with one modulator.
    """
    device = case.get("device_ms", {})
    if GAP not in device:
        return {}
    return {
        "light": device[FRAME] - device[GAP],
        "propagate, modulate": device[GAP] - device[SCRUB],
        "propagate, observe": device[SCRUB] - device[AMPLITUDES],
        "composite": device[AMPLITUDES],
    }


def _jobs(renderer: IncrementalRenderer, row: int) -> dict[str, tuple[TimedJob, int]]:
    """The timed jobs by name, each with the number of frames or edits that it makes."""
    gap = gap_edit(renderer)
    return {
        FRAME: (full_frame(renderer), 1),
        IN_A_ROW: (frames_in_a_row(renderer, row), row),
        SCRUB: (scrub(renderer), 1),
        **({} if gap is None else {GAP: (gap, 1)}),
        AMPLITUDES: (amplitude_edit(renderer), 1),
    }


def _host_s(renderer: IncrementalRenderer, rounds: int) -> float:
    """Processor time (s) of this thread for recording and submitting a frame: a card can't be faster than that."""
    seconds = []
    for _ in range(rounds):
        renderer.invalidate()
        start = time.thread_time()
        renderer.update(with_srgb=False)
        seconds.append(time.thread_time() - start)
        renderer.device.wait()
    return statistics.median(seconds)


def _row_length(renderer: IncrementalRenderer) -> int:
    """How many frames in a row take at least _ROW_S."""
    job = full_frame(renderer)
    job()
    start = time.perf_counter()
    job()
    return min(_MAX_ROW, math.ceil(_ROW_S / (time.perf_counter() - start)))


# --- the report ---


FORMAT = 1
"""Version of the report's JSON."""
PARITY, PROBE, TUNING, FRAME_PARITY, FRAMES = "stages", "device", "strategies", "frame errors", "frames"
TORCH, OPTIMISER, QUALITY, VIEWER, POWER = "torch", "optimiser", "time to quality", "viewer", "power"
_POWER_S = 3.0
_QUALITY_PICTURE, _QUALITY_LONG = "still-life.png", 300
_QUALITY_SIZE, _CARD_QUALITY_SIZE = (128, 96), (1024, 768)
_QUALITY_SAMPLES = 1_000_000  # of a chain: samples, of all lasers and planes, that a run of minutes takes
Size = tuple[int, int]


@dataclass(frozen=True)
class ReportOptions:
    """The scope of a report. sizes: samples, x by y. wavelengths: numbers of lasers. limit_s: of one case's rounds.

    A chain of elements has its own size and lasers, and none of these. adapter: part of its name, as the user gave it.
    """

    system: System
    sizes: tuple[Size, ...] = ((512, 512), (1024, 768), (2048, 2048), (4096, 2160))
    wavelengths: tuple[int, ...] = (1, 3, 8, 16)
    rounds: int = 7
    limit_s: float = 3.0
    adapter: str | None = None

    @property
    def middle_size(self) -> Size:
        """The size at which what takes no table of sizes is measured: 1024 × 768 where it is among them."""
        if self.system.is_chain:
            rows, columns = self.system.way.shape
            return columns, rows
        return (1024, 768) if (1024, 768) in self.sizes else self.sizes[0]

    @property
    def middle_system(self) -> System:
        """The bench at its middle size."""
        if self.system.is_chain:
            return self.system
        columns, rows = (n // self.system.sampling.upsample for n in self.middle_size)
        return self.system.edit({"shape": [rows, columns]})


@dataclass(frozen=True)
class ReportMeasurement:
    """One measurement: the section that it belongs to, what it measures, and the function that does it."""

    section: str
    title: str
    measure: Callable[[], dict[str, Any]]


class ReportRun:
    """Measurements of one device and what they have given so far, in `data` as JSON values."""

    def __init__(self, device: Device, options: ReportOptions) -> None:
        self.device, self.options = device, options
        self._references: dict[Size, NDArray[np.floating]] = {}
        self.data: dict[str, Any] = {
            "format": FORMAT,
            "begun": datetime.now(UTC).isoformat(timespec="seconds"),
            "is_complete": False,
            "preset": options.system.name,
            "sizes": [list(size) for size in options.sizes],
            "wavelengths": list(options.wavelengths),
            "rounds": options.rounds,
            "machine": machine_facts(device),
            "results": {},
        }

    def measurements(self) -> list[ReportMeasurement]:
        """All measurements but those that need a window, in order."""
        is_chain, own = self.options.system.is_chain, ReportMeasurement(PARITY, "this chain", self._stages_of_chain)
        sizes = [] if is_chain else [of for size in self.options.sizes for of in self._of_size(size)]
        return [
            ReportMeasurement(PROBE, "copies and submissions", self._probe),
            *(ReportMeasurement(PARITY, name, lambda name=name: self._stages(name)) for name in CHANGES),  # type: ignore[misc]
            *([own] if is_chain else []),
            *sizes,
            ReportMeasurement(TORCH, "frames beside torch, first image", self._beside_torch),
            ReportMeasurement(OPTIMISER, "an iteration", self._optimiser),
            ReportMeasurement(QUALITY, "until a hologram is as good as it gets", self._quality),
            *([ReportMeasurement(QUALITY, "the same on a card", self._quality_on_card)] if has_cuda() else []),
            ReportMeasurement(POWER, "frames in a row", self._power),
        ]

    def make(self, measurement: ReportMeasurement) -> None:
        """Make one measurement, and enter its result or the reason why there is none."""
        entry: dict[str, Any] = {"title": measurement.title}
        try:
            entry["result"] = measurement.measure()
        except UserError as error:
            entry["refused"] = str(error)
        except ImportError as error:
            entry["refused"] = f"not installed: {error.name or error}"
        except Exception:  # of an unknown driver: see above
            entry["failed"] = traceback.format_exc()
        self.data["results"].setdefault(measurement.section, []).append(entry)

    def finish(self) -> None:
        """Note that all measurements were made."""
        self.data["is_complete"] = True

    def results(self, section: str) -> list[dict[str, Any]]:
        """The results of a section, without measurements that failed."""
        return [entry["result"] for entry in self.data["results"].get(section, []) if "result" in entry]

    # --- measurements -----------------------------------------------------------------------------------------------

    def _of_size(self, size: Size) -> Iterator[ReportMeasurement]:
        """The measurements of one size."""
        columns, rows = size
        where = f"{columns} × {rows}"
        yield ReportMeasurement(TUNING, where, lambda: tune(self.device, (rows, columns)).as_dict())
        for strategy in STRATEGIES:
            title = f"{where}, {strategy}"
            yield ReportMeasurement(FRAME_PARITY, title, lambda strategy=strategy: self._frame_error(size, strategy))  # type: ignore[misc]
        for count in self.options.wavelengths:
            for strategy in STRATEGIES:
                case = FrameCase(size, count, strategy)
                yield ReportMeasurement(FRAMES, case.label, lambda case=case: self._frames(case))  # type: ignore[misc]
            if count > 1:
                title = f"{where}, {count} λ, several in a dispatch"
                yield ReportMeasurement(FRAMES, title, lambda count=count: self._batched(size, count))  # type: ignore[misc]

    def _probe(self) -> dict[str, Any]:
        probe = probe_device(self.device, self.options.rounds)
        return asdict(probe) | {"copy_bandwidth": probe.copy_bandwidth}

    def _stages(self, name: str) -> dict[str, Any]:
        errors = worst_by_stage(ExecutorPair.open(parity_bench(**CHANGES[name]), self.device))
        return {stage: {"error": error, "allowed": TOLERANCES[stage]} for stage, error in errors.items()}

    def _stages_of_chain(self) -> dict[str, Any]:
        errors = worst_by_stage(ExecutorPair.open(self.options.system, self.device))
        return {stage: {"error": error, "allowed": CHAIN_TOLERANCE} for stage, error in errors.items()}

    def _frame_error(self, size: Size, strategy: Strategy) -> dict[str, Any]:
        self._check_strategy(size, strategy)
        system = case_system(self.options.system, size, 1)
        if size not in self._references:
            self._references = {size: reference_intensity(system)}  # of the present size only
        error = frame_error(system, self.device, False, strategy, self._references[size])
        return {"size": list(size), "strategy": strategy, "error": error}

    def _frames(self, case: FrameCase) -> dict[str, Any]:
        self._check_strategy(case.size, case.strategy)
        return time_case(self.device, self.options.system, case, self.options.rounds, self.options.limit_s)

    def _batched(self, size: Size, wavelengths: int) -> dict[str, Any]:
        """The fastest strategy with as many wavelengths in a dispatch as the device's limits allow."""
        strategy, count = self._fastest(size, wavelengths), wavelengths
        while True:
            try:
                return self._frames(FrameCase(size, wavelengths, strategy, count))
            except UserError:
                if count == 2:
                    raise
                count = max(count // 2, 2)

    def _fastest(self, size: Size, wavelengths: int) -> Strategy:
        cases = [
            case
            for case in self.results(FRAMES)
            if (case["size"], case["wavelengths"], case["per_dispatch"]) == (list(size), wavelengths, 1)
        ]
        if not cases:
            raise UserError("strategies", "none could be measured at this size")
        fastest: Strategy = min(cases, key=lambda case: case["median_ms"][FRAME])["strategy"]
        return fastest

    def _check_strategy(self, size: Size, strategy: Strategy) -> None:
        """Raise UserError for a strategy that this size doesn't allow, or that the search has refused."""
        columns, rows = size
        if strategy not in supported_strategies(self.device, (rows, columns)):
            raise UserError(strategy, f"isn't possible at {columns} × {rows} on this device")
        for tuning in self.results(TUNING):
            if tuning["size"] == list(size) and strategy in tuning["refused"]:
                raise UserError(strategy, tuning["refused"][strategy])

    def _beside_torch(self) -> dict[str, Any]:
        options, system = self.options, self.options.middle_system
        frame = benchmark_frame(system, self.device, options.rounds)
        criteria = [*frame.criteria, first_image_criterion(system, options.adapter)]
        return {
            "size": list(options.middle_size),
            "wavelengths": frame.wavelengths,
            "bars": [criterion.as_dict() for criterion in criteria],
            "jobs": {name: timings.as_dict() for name, timings in frame.timings.items()},
        }

    def _optimiser(self) -> dict[str, Any]:
        from holoview.evidence.benchmark.optimiser_iteration import time_handover, time_iterations

        system, rounds = self.options.middle_system, self.options.rounds
        handover = time_handover(system, self.device, rounds)
        return time_iterations(system, rounds, self.options.limit_s) | {"handover_ms": handover}

    def _quality_on_card(self) -> dict[str, Any]:
        return self._quality(_CARD_QUALITY_SIZE, "cuda")

    def _quality(self, size: Size = _QUALITY_SIZE, device: str = "cpu") -> dict[str, Any]:
        from holoview.evidence.benchmark.time_to_quality import QualityRun, quality_work, time_to_quality

        system = self.options.system
        if system.is_chain:
            _require_few_samples(system)
        else:
            pairs = zip(self.options.middle_size, size, strict=True)
            columns, rows = (min(n, most) // system.sampling.upsample for n, most in pairs)
            system = system.edit({"shape": [rows, columns]})
        work = quality_work(system, data_dir("assets") / _QUALITY_PICTURE, device=device)
        found = time_to_quality(work, QualityRun(_QUALITY_LONG, self.options.rounds))
        assert found is not None  # nothing interrupts it
        return found

    def _power(self) -> dict[str, Any]:
        return measure_power(open_renderer(self.options.middle_system, self.device), _POWER_S)


def _require_few_samples(system: System) -> None:
    """Raises UserError for a chain whose long runs take more than some minutes."""
    samples = math.prod(system.way.shape) * int((system.amplitudes > 0).sum()) * len(system.planes_m)
    if samples > _QUALITY_SAMPLES:
        found = f"{samples} samples in all lasers and planes"
        remedy = "`holoview bench --optimiser` measures it, in hours"
        raise UserError(system.name, found, expected=f"at most {_QUALITY_SAMPLES}", remedy=remedy)
