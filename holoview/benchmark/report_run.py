"""Makes the measurements of a report one after the other, and keeps what is known if one of them fails.

A report is made to learn about machines that nobody here has. So whatever goes wrong in a measurement, its text goes
into the report and the next one begins.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.benchmark.device_probe import probe_device
from holoview.benchmark.first_image import first_image_criterion
from holoview.benchmark.frame_benchmark import benchmark_frame, frame_error, reference_intensity
from holoview.benchmark.frame_cases import FRAME, FrameCase, case_system, time_case
from holoview.benchmark.frame_jobs import open_renderer
from holoview.benchmark.machine_facts import machine_facts
from holoview.benchmark.parity_benches import CHANGES, parity_bench
from holoview.benchmark.power import measure_power
from holoview.benchmark.stage_parity import TOLERANCES, ExecutorPair, worst_by_stage
from holoview.benchmark.strategy_choice import tune
from holoview.gpu.device import Device
from holoview.gpu.line_fft import STRATEGIES, Strategy, supported_strategies
from holoview.model.system import System
from holoview.util.errors import UserError

FORMAT = 1
"""Version of the report's JSON."""
PARITY, PROBE, TUNING, FRAME_PARITY, FRAMES = "stages", "device", "strategies", "frame errors", "frames"
TORCH, OPTIMISER, VIEWER, POWER = "torch", "optimiser", "viewer", "power"
_POWER_S = 3.0
Size = tuple[int, int]


@dataclass(frozen=True)
class ReportOptions:
    """What a report covers. sizes: samples, x by y. wavelengths: numbers of lasers. limit_s: of one case's rounds.

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
        """What the measurements of a section have given, without those that failed."""
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
