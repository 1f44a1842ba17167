"""Times each stage of a frame, and a whole frame of one wavelength, in WebGPU and in PyTorch (complex64).

    python -m benchmarks.frame_time --size 1024x768 --propagation periodic

Both alternate in one process, so that other load on the machine slows both alike. README.md explains the columns.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import count_of, machine_facts, shape_of
from holoview.holograms.view import random_drive
from holoview.light.engine.frame import Executor, spectrum_behind_modulators
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.engine.wgpu_executor import WgpuExecutor
from holoview.light.gpu.device import open_device
from holoview.light.gpu.recorder import CommandRecorder
from holoview.light.model import preset
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.util.errors import UserError

STAGES = ("illuminate", "modulate", "spectrum", "transmit", "field", "accumulate", "composite")
SUM, FRAME, EMPTY = "sum of the stages", "frame in one go", "empty submission"
WARM_UP = 3
_KEYS = ("median_ms", "minimum_ms")

Finish = Callable[[], None]
Seconds = dict[str, dict[str, list[float]]]
"""Wall times (s) by row and executor."""


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark and print its table, or JSON."""
    args = _parser().parse_args(arguments)
    try:
        result = measure(_system(args), args.repeats, args.adapter)
    except UserError as error:
        print(f"frame_time: {error}", file=sys.stderr)
        return 2
    print(json.dumps(result, indent=2, ensure_ascii=False) if args.json else table(result))
    return 0


def measure(system: System, repeats: int, adapter: str | None = None) -> dict[str, Any]:
    """Times (ms), ratios, errors and conditions for a frame of one wavelength, one source and one focal plane."""
    plan = make_plan(system, system.planes_m[len(system.planes_m) // 2 :][:1])
    drive = random_drive(system)
    device = open_device(adapter)
    inputs = FrameInputs(plan, drive)
    shaders, single = WgpuExecutor(plan, inputs, device), TorchExecutor(plan, inputs)
    runs: dict[str, tuple[Executor[Any], Finish]] = {
        "wgsl": (shaders, lambda: shaders.submit(wait=True)),
        "torch": (single, _nothing),
    }

    for _ in range(WARM_UP):  # compiles the shaders, and computes the transfer functions that TorchExecutor caches
        for executor, finish in runs.values():
            _stages(executor, finish)
            _frame(executor, finish)
    seconds: Seconds = {}
    for _ in range(repeats):
        for name, (executor, finish) in runs.items():
            taken = _stages(executor, finish)
            taken[SUM] = sum(taken.values())
            taken[FRAME] = _timed(_frame, executor, finish)
            for row, sample in taken.items():
                seconds.setdefault(row, {}).setdefault(name, []).append(sample)
        empty = _timed(lambda: CommandRecorder(device).submit(wait=True))
        seconds.setdefault(EMPTY, {}).setdefault("wgsl", []).append(empty)

    reference = TorchExecutor(plan, FrameInputs(plan, drive), double=True)
    return {
        "bench": _bench_facts(plan),
        "machine": machine_facts(device.info.label),
        "repeats": repeats,
        "rows": {row: _summary(samples) for row, samples in seconds.items()},
        "relative_l2_error": _errors(reference, {name: run[0] for name, run in runs.items()}),
    }


# --- one frame ------------------------------------------------------------------------------------------------------


def _frame(executor: Executor[Any], finish: Finish) -> None:
    """Compute one wavelength of one frame from one source at one plane, and composite it."""
    plan = executor.plan
    wavelength, frame, weight = _selection(plan)
    executor.clear(0)
    executor.clear_xyz()
    spectrum = spectrum_behind_modulators(executor, wavelength, frame, 0)
    executor.accumulate(executor.field(executor.transmit(spectrum, 1, wavelength), 1), 0, weight)
    executor.composite(wavelength)
    finish()


def _calls(executor: Executor[Any]) -> Iterator[tuple[str, Callable[[Any], Any]]]:
    """The stages of `_frame` in order, each as a function of the preceding field."""
    plan, e = executor.plan, executor
    wavelength, frame, weight = _selection(plan)
    yield "illuminate", lambda _: e.illuminate(wavelength, 0)
    yield "modulate", lambda field: e.modulate(field, frame, 0, wavelength)
    if plan.system.gap_m is not None:
        yield "spectrum", lambda field: e.spectrum(field, 0)
        yield "transmit", lambda field: e.transmit(field, 0, wavelength)
        yield "field", lambda field: e.field(field, 0)
        yield "modulate", lambda field: e.modulate(field, frame, 1, wavelength)
    last = len(plan.system.modulators) - 1
    yield "spectrum", lambda field: e.spectrum(field, last)
    yield "transmit", lambda field: e.transmit(field, 1, wavelength)
    yield "field", lambda field: e.field(field, 1)
    yield "accumulate", lambda field: e.accumulate(field, 0, weight)
    yield "composite", lambda _: e.composite(wavelength)


def _stages(executor: Executor[Any], finish: Finish) -> dict[str, float]:
    """Wall time (s) of each stage in a frame: the sum over its calls, each of which is waited for."""
    executor.clear(0)
    executor.clear_xyz()
    finish()
    taken: dict[str, float] = {}
    field: Any = None
    for stage, call in _calls(executor):
        start = time.perf_counter()
        field = call(field)
        finish()
        taken[stage] = taken.get(stage, 0.0) + time.perf_counter() - start
    return taken


def _selection(plan: Plan) -> tuple[int, int, float]:
    """The middle wavelength, the first frame in which it has light, its weight."""
    wavelength = len(plan.system.wavelengths_m) // 2
    frame = plan.lit(wavelength)[0]
    return wavelength, frame, float(plan.weights[frame, wavelength])


def _errors(reference: TorchExecutor, executors: dict[str, Executor[Any]]) -> dict[str, float]:
    """Relative L2 error of each executor's intensity against complex128."""
    _frame(reference, _nothing)
    expected = reference.intensity(0)
    return {name: _relative(executor.intensity(0), expected) for name, executor in executors.items()}


def _relative(found: NDArray[Any], expected: NDArray[Any]) -> float:
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def _timed(call: Callable[..., None], *arguments: Any) -> float:
    start = time.perf_counter()
    call(*arguments)
    return time.perf_counter() - start


def _nothing() -> None:
    """PyTorch on the CPU has finished when a call returns."""


# --- results --------------------------------------------------------------------------------------------------------


def _summary(samples: dict[str, list[float]]) -> dict[str, Any]:
    """Median and minimum in ms by executor, and the ratios WGSL ÷ torch of either."""
    out: dict[str, Any] = {
        name: {"median_ms": 1e3 * statistics.median(taken), "minimum_ms": 1e3 * min(taken)}
        for name, taken in samples.items()
    }
    if len(samples) == 2:
        for key in ("median", "minimum"):
            out[f"ratio_of_{key}"] = out["wgsl"][f"{key}_ms"] / out["torch"][f"{key}_ms"]
    return out


def _bench_facts(plan: Plan) -> dict[str, Any]:
    wavelength, _, _ = _selection(plan)
    return {
        "preset": plan.system.name,
        "modulators": len(plan.system.modulators),
        "field": list(plan.grid.shape[::-1]),
        "padded": list(plan.grid.padded[::-1]),
        "propagation": plan.system.sampling.propagation,
        "wavelength_m": float(plan.system.wavelengths_m[wavelength]),
        "plane_m": float(plan.planes_m[0]),
    }


def table(result: dict[str, Any]) -> str:
    """The results as a table."""
    bench, machine = result["bench"], result["machine"]
    (width, height), (padded_x, padded_y) = bench["field"], bench["padded"]
    lines = [
        f"{bench['preset']}, {bench['modulators']} modulators: {width} x {height} samples, {bench['propagation']}, "
        f"transformed as {padded_x} x {padded_y}; {bench['wavelength_m'] * 1e9:.0f} nm, "
        f"plane at {bench['plane_m'] * 1e3:g} mm",
        f"WGSL: {machine['adapter']}",
        f"torch: complex64, {machine['torch_threads']} threads, transfer functions kept from an earlier frame",
        ", ".join(f"{name} {number}" for name, number in machine["versions"].items())
        + f"; {machine['cores']} cores; {result['repeats']} repeats",
        "",
        "| ms | WGSL median | WGSL min | torch median | torch min | WGSL/torch median | WGSL/torch min |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for row in (*STAGES, SUM, FRAME, EMPTY):
        lines.append(f"| {row} | {' | '.join(_cells(result['rows'][row]))} |")
    errors = result["relative_l2_error"]
    lines += ["", f"error of the frame: WGSL {errors['wgsl']:.1e}, torch {errors['torch']:.1e} (relative L2)"]
    return "\n".join(lines)


def _cells(row: dict[str, Any]) -> list[str]:
    times = [f"{row[name][key]:.2f}" if name in row else "" for name in ("wgsl", "torch") for key in _KEYS]
    ratios = [f"{row[key]:.2f}" if key in row else "" for key in ("ratio_of_median", "ratio_of_minimum")]
    return times + ratios


# --- command line ---------------------------------------------------------------------------------------------------


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.frame_time", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--preset", default="holochrome-8", help="a preset's name or a TOML file")
    parser.add_argument(
        "--size", type=shape_of, default=(768, 1024), metavar="1024x768", help="simulated samples, x by y"
    )
    parser.add_argument("--propagation", choices=("periodic", "compact", "linear"), default="periodic")
    parser.add_argument(
        "--repeats", type=count_of, default=15, help="frames to time; the median and the least are shown"
    )
    parser.add_argument("--adapter", metavar="NAME", help="part of the name of the WebGPU adapter to use")
    parser.add_argument("--json", action="store_true", help="machine-readable output")
    return parser


def _system(args: argparse.Namespace) -> System:
    system = preset.load(args.preset)
    upsample = system.sampling.upsample
    rows, columns = args.size
    if rows % upsample or columns % upsample:
        raise UserError("--size", f"{columns}x{rows}", expected=f"multiples of the preset's upsampling, {upsample}")
    return system.edit({"shape": [rows // upsample, columns // upsample], "propagation": args.propagation})


if __name__ == "__main__":
    sys.exit(main())
