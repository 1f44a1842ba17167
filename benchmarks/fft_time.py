"""Times a 2-D FFT with each strategy, and torch.fft for comparison.

    python -m benchmarks.fft_time --sizes 1024x768,512x512

All jobs of a size alternate in one process, so that other load on the machine slows all alike. README.md explains the
columns.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.common import count_of, machine_facts, shape_of
from holoview.evidence.benchmark.frame_jobs import JobTimings, time_interleaved
from holoview.light.gpu.device import Device, open_device
from holoview.light.gpu.fft import FftPlan
from holoview.light.gpu.line_fft import Strategy, supported_strategies
from holoview.light.gpu.recorder import CommandRecorder
from holoview.util.errors import UserError

SIZES = "1024x768,512x512,1024x1024,2048x1536"
THREADS = 2
"""Threads of PyTorch; CPU times are divided by it."""
WARM_UP = 2

Shape = tuple[int, int]
Field = NDArray[np.complex64]


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark and print its table, or JSON."""
    args = _parser().parse_args(arguments)
    torch.set_num_threads(THREADS)
    try:
        device = open_device(args.adapter)
        sizes = [measure(device, shape, args.repeats) for shape in args.sizes]
    except UserError as error:
        print(f"fft_time: {error}", file=sys.stderr)
        return 2
    result = {"machine": machine_facts(device.info.label), "repeats": args.repeats, "sizes": sizes}
    print(json.dumps(result, indent=2, ensure_ascii=False) if args.json else table(result))
    return 0


def measure(device: Device, shape: Shape, repeats: int) -> dict[str, Any]:
    """Times (ms), ratios to torch, errors and compile times (s) of a forward FFT of one field of a shape (ny, nx)."""
    field = _field(shape)
    expected = np.fft.fft2(field.astype(np.complex128))
    jobs: dict[str, Callable[[], None]] = {"torch": _torch_job(field)}
    rows: dict[str, dict[str, float]] = {"torch": {"error": _error(torch.fft.fft2(_tensor(field)).numpy(), expected)}}
    for strategy in supported_strategies(device, shape):
        jobs[strategy], rows[strategy] = _prepared(device, strategy, field, expected)
    samples = time_interleaved(jobs, repeats, WARM_UP)
    for name, sample in samples.items():
        rows[name] |= _times(sample, samples["torch"])
    return {"size": [shape[1], shape[0]], "rows": rows}


def _prepared(
    device: Device, strategy: Strategy, field: Field, expected: NDArray[np.complexfloating]
) -> tuple[Callable[[], None], dict[str, float]]:
    """A job that transforms a field, and the error and compile time of its first run."""
    start = time.perf_counter()
    plan = FftPlan(device, (field.shape[0], field.shape[1]), strategy=strategy)
    buffer = device.upload(plan.pack(field), "field")

    def job() -> None:
        recorder = CommandRecorder(device)
        plan.forward(recorder, buffer)
        recorder.submit(wait=True)

    job()
    seconds = time.perf_counter() - start
    error = _error(plan.natural_order(plan.download(buffer))[0], expected)
    device.write(buffer, np.zeros_like(plan.pack(field)))  # so that values don't grow from run to run
    return job, {"error": error, "first_run_s": seconds}


def _torch_job(field: Field) -> Callable[[], None]:
    tensor = _tensor(field)

    def job() -> None:
        torch.fft.fft2(tensor)

    return job


def _times(sample: JobTimings, torch_sample: JobTimings) -> dict[str, float]:
    return {
        "median_ms": sample.median_ms,
        "minimum_ms": sample.minimum_ms,
        "processor_ms": sample.cpu_ms / THREADS,
        "ratio_of_median": sample.median_ms / torch_sample.median_ms,
        "ratio_of_minimum": sample.minimum_ms / torch_sample.minimum_ms,
        "ratio_of_processor": sample.cpu_ms / torch_sample.cpu_ms,
    }


def _field(shape: Shape) -> Field:
    parts = np.random.default_rng(0).standard_normal((2, *shape))
    field: Field = (parts[0] + 1j * parts[1]).astype(np.complex64)
    return field


def _tensor(field: Field) -> torch.Tensor:
    return torch.from_numpy(field)


def _error(found: NDArray[np.complexfloating], expected: NDArray[np.complexfloating]) -> float:
    """Relative L2."""
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def table(result: dict[str, Any]) -> str:
    """The result for people."""
    machine = result["machine"]
    versions = ", ".join(f"{name} {number}" for name, number in machine["versions"].items())
    lines = [
        f"{machine['adapter']}; torch with {machine['torch_threads']} threads; {machine['cores']} cores",
        f"{versions}; {result['repeats']} repeats, jobs of a size in turns",
        "",
        "| size | by | median ms | least ms | processor/2 ms | ÷ torch: median | least | processor | error | first s |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for measured in result["sizes"]:
        size = "x".join(map(str, measured["size"]))
        lines += [f"| {size} | {name} | {_cells(row)} |" for name, row in measured["rows"].items()]
    return "\n".join(lines)


def _cells(row: dict[str, float]) -> str:
    times = [f"{row[key]:.2f}" for key in ("median_ms", "minimum_ms", "processor_ms")]
    ratios = [f"{row[f'ratio_of_{key}']:.2f}" for key in ("median", "minimum", "processor")]
    first = f"{row['first_run_s']:.2f}" if "first_run_s" in row else ""
    return " | ".join([*times, *ratios, f"{row['error']:.1e}", first])


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fft_time", description=(__doc__ or "").split("\n")[0])
    parser.add_argument(
        "--sizes", type=_sizes, default=_sizes(SIZES), metavar=SIZES, help="x by y, with commas between"
    )
    parser.add_argument("--repeats", type=count_of, default=25, help="how often each job is timed")
    parser.add_argument("--adapter", metavar="NAME", help="part of the name of the WebGPU adapter to use")
    parser.add_argument("--json", action="store_true", help="machine-readable output")
    return parser


def _sizes(text: str) -> list[Shape]:
    """(y, x) of each size in '1024x768,512x512'."""
    return [shape_of(part) for part in text.split(",")]


if __name__ == "__main__":
    sys.exit(main())
