"""Makes the measurements of a report one after the other, and keeps what is known if one of them fails.

A report is made to learn about machines that nobody here has. Whatever goes wrong in a measurement, its text goes into
the report and the next one begins.

`time_case`  frames and edits at a size, a number of wavelengths, a strategy, and so many wavelengths in a dispatch
`ReportRun`  all measurements of a device
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

from holoview.benchmark.frame_benchmark import (
    benchmark_frame,
    first_image_criterion,
    frame_error,
    job_device_s,
    reference_intensity,
)
from holoview.benchmark.frame_jobs import (
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
from holoview.benchmark.machine import machine_facts, measure_power, probe_device
from holoview.benchmark.stage_parity import CHANGES, TOLERANCES, ExecutorPair, parity_bench, worst_by_stage
from holoview.engine.incremental import IncrementalRenderer
from holoview.gpu.device import TIMESTAMPS, Device
from holoview.gpu.line_fft import STRATEGIES, Strategy, supported_strategies
from holoview.model.system import System
from holoview.util.errors import UserError

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
    What a strategy moves between the passes of one transform isn't counted.
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
TORCH, OPTIMISER, VIEWER, POWER = "torch", "optimiser", "viewer", "power"
_POWER_S = 3.0
Size = tuple[int, int]


@dataclass(frozen=True)
class ReportOptions:
    """The scope of a report. sizes: samples, x by y. wavelengths: numbers of lasers. limit_s: of one case's rounds.

    adapter: part of its name, as the user gave it.
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
        return (1024, 768) if (1024, 768) in self.sizes else self.sizes[0]


@dataclass(frozen=True)
class Measurement:
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

    def measurements(self) -> list[Measurement]:
        """All measurements but those that need a window, in order."""
        sizes = [measurement for size in self.options.sizes for measurement in self._of_size(size)]
        return [
            Measurement(PROBE, "copies and submissions", self._probe),
            *(Measurement(PARITY, name, lambda name=name: self._stages(name)) for name in CHANGES),  # type: ignore[misc]
            *sizes,
            Measurement(TORCH, "frames beside torch, first image", self._beside_torch),
            Measurement(OPTIMISER, "an iteration", self._optimiser),
            Measurement(POWER, "frames in a row", self._power),
        ]

    def make(self, measurement: Measurement) -> None:
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

    def _of_size(self, size: Size) -> Iterator[Measurement]:
        """The measurements of one size."""
        columns, rows = size
        where = f"{columns} × {rows}"
        yield Measurement(TUNING, where, lambda: tune(self.device, (rows, columns)).as_dict())
        for strategy in STRATEGIES:
            title = f"{where}, {strategy}"
            yield Measurement(FRAME_PARITY, title, lambda strategy=strategy: self._frame_error(size, strategy))  # type: ignore[misc]
        for count in self.options.wavelengths:
            for strategy in STRATEGIES:
                case = FrameCase(size, count, strategy)
                yield Measurement(FRAMES, case.label, lambda case=case: self._frames(case))  # type: ignore[misc]
            if count > 1:
                title = f"{where}, {count} λ, several in a dispatch"
                yield Measurement(FRAMES, title, lambda count=count: self._batched(size, count))  # type: ignore[misc]

    def _probe(self) -> dict[str, Any]:
        probe = probe_device(self.device, self.options.rounds)
        return asdict(probe) | {"copy_bandwidth": probe.copy_bandwidth}

    def _stages(self, name: str) -> dict[str, Any]:
        errors = worst_by_stage(ExecutorPair.open(parity_bench(**CHANGES[name]), self.device))
        return {stage: {"error": error, "allowed": TOLERANCES[stage]} for stage, error in errors.items()}

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
        options, system = self.options, self._middle_system()
        frame = benchmark_frame(system, self.device, options.rounds)
        criteria = [*frame.criteria, first_image_criterion(system, options.adapter)]
        return {
            "size": list(options.middle_size),
            "wavelengths": frame.wavelengths,
            "bars": [criterion.as_dict() for criterion in criteria],
            "jobs": {name: timings.as_dict() for name, timings in frame.timings.items()},
        }

    def _optimiser(self) -> dict[str, Any]:
        from holoview.benchmark.optimiser_iteration import time_iterations

        return time_iterations(self._middle_system(), self.options.rounds, self.options.limit_s)

    def _power(self) -> dict[str, Any]:
        return measure_power(open_renderer(self._middle_system(), self.device), _POWER_S)

    def _middle_system(self) -> System:
        """The bench of the options at their middle size."""
        columns, rows = (n // self.options.system.sampling.upsample for n in self.options.middle_size)
        return self.options.system.edit({"shape": [rows, columns]})
