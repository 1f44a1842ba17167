"""Measure how fast a hologram's frame and its edits are on this machine, beside torch."""

from __future__ import annotations

import argparse
import json
import os
import platform
from typing import Any

import torch

from holoview.commands.arguments import add_system, parse_samples, system_from_args, whole
from holoview.commands.bench_report import write_report
from holoview.commands.console import deferred_interrupt, print_json, progress_bar
from holoview.commands.output_files import add_input, add_output_folder
from holoview.evidence.benchmark.frame_benchmark import (
    Criterion,
    DeviceTime,
    FrameTimings,
    benchmark_frame,
    device_time,
    first_image_criteria,
    first_image_timings,
)
from holoview.evidence.benchmark.frame_jobs import tune
from holoview.evidence.benchmark.machine import versions
from holoview.evidence.benchmark.report_run import ReportOptions
from holoview.light.gpu.device import TIMESTAMPS, Device, open_device
from holoview.light.gpu.line_fft import STRATEGIES, supported_strategies
from holoview.light.gpu.tune import StrategyOption
from holoview.light.model.fields import Integer, Several
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.numerics.sampling import is_fast_length
from holoview.util.errors import UserError
from holoview.util.files import data_dir

_DEFAULT, _SIZE = "holochrome-8", "1024x768"
_OPTIMISER_SIZE, _PICTURE = "128x96", "still-life.png"
_MOST_STARTS = 3  # of each command whose first image is timed


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_system(parser, optional=True)
    parser.add_argument(
        "--size", metavar="XxY[,XxY…]", help=f"simulated samples, x by y ({_SIZE}); with --report, one or several"
    )
    parser.add_argument(
        "--rounds", metavar="N", type=whole(1), default=7, help="how often each job is timed; medians are shown"
    )
    parser.add_argument("--half", action="store_true", help="store fields as f16 between kernels")
    parser.add_argument(
        "--strategy", choices=("auto", *STRATEGIES), default="auto", help="of the transforms; auto: the fastest"
    )
    parser.add_argument(
        "--tune", action="store_true", help="time the strategies of the transforms anew, remember the fastest, and stop"
    )
    parser.add_argument("--adapter", metavar="NAME", help="part of the name of the WebGPU adapter to use")
    parser.add_argument("--json", action="store_true", help="machine-readable output")
    add_output_folder(
        parser,
        "--report",
        metavar="DIR",
        help="measure all strategies at several sizes and numbers of lasers, the exactness of each stage, the viewer, "
        "the optimiser and the power, and write one file that can be attached to an issue",
    )
    parser.add_argument("--lasers", metavar="N[,N…]", help="with --report: numbers of lasers (1,3,8,16)")
    parser.add_argument(
        "--optimiser",
        action="store_true",
        help="measure instead the time until a hologram is as good as it gets, beside torch's Adam; "
        f"about two minutes for {_OPTIMISER_SIZE}, the default of --size here",
    )
    add_input(parser, "--picture", metavar="FILE", help="with --optimiser: the target (a still life)")
    parser.add_argument(
        "--long", metavar="N", type=whole(1), help="with --optimiser: iterations of the long runs (500)"
    )


def run(args: argparse.Namespace) -> int:
    """Run the benchmark and print a table or JSON."""
    args.preset = args.preset or _DEFAULT
    rounds = args.rounds
    if args.optimiser:
        return _optimiser(args, rounds)
    for flag, is_set in (("--picture", args.picture is not None), ("--long", args.long is not None)):
        if is_set:
            raise UserError(flag, "without --optimiser", remedy="add --optimiser, or leave it out")
    if args.report is not None:
        return _report(args, rounds)
    if args.lasers is not None:
        raise UserError("--lasers", "without --report", remedy="change the bench with --set wavelengths=…")
    system = system_from_args(args)
    if system.is_chain:
        _refuse_of_chain(args)
    else:
        system = _sized(system, args.size or _SIZE)
    device = open_device(args.adapter)
    if args.tune:
        print(_tuning_report(system, device, as_json=args.json))
        return 0
    _check_strategy(args.strategy, system, device)
    options, timed = {"half": args.half, "strategy": args.strategy}, None
    with progress_bar("frames and edits") as show:
        frame = benchmark_frame(system, device, rounds, progress=show, **options)
    if TIMESTAMPS in device.features:
        timed = device_time(system, device, rounds, **options)
    with deferred_interrupt("start of a process") as interruption, progress_bar("first images") as show:
        first_image = first_image_timings(
            system, args.adapter, min(rounds, _MOST_STARTS), progress=show, interruption=interruption
        )
    criteria = [*frame.criteria, *first_image_criteria(first_image)]
    result = _result(system, device, frame, criteria, timed, rounds)
    result["first_image"] = {name: sample.as_dict() for name, sample in first_image.items()}
    if args.json:
        print_json(result)
    else:
        print(_table(result))
    return interruption.exit_code


def _optimiser(args: argparse.Namespace, rounds: int) -> int:
    """Measure the time to a good hologram, and print it as text or JSON."""
    from holoview.evidence.benchmark.time_to_quality import QualityRun, quality_text, quality_work, time_to_quality

    _refuse_options(args, "--optimiser", "leave it out: the optimiser needs no adapter")
    system = system_from_args(args)
    if system.is_chain:
        _refuse_of_chain(args)
    else:
        system = _sized(system, args.size or _OPTIMISER_SIZE)
    work = quality_work(system, args.picture or data_dir("assets") / _PICTURE)
    long = args.long or QualityRun.long
    with deferred_interrupt() as interruption, progress_bar("bench") as show:
        found = time_to_quality(work, QualityRun(long, rounds, progress=show, interruption=interruption))
    if found is None:
        return interruption.exit_code
    if args.json:
        print_json(found)
    else:
        print(quality_text(found))
    return 0


def _refuse_options(args: argparse.Namespace, flag: str, remedy: str) -> None:
    """Raise UserError for options that don't belong to --report or --optimiser."""
    others = {
        "--report": flag == "--optimiser" and args.report is not None,
        "--lasers": flag == "--optimiser" and args.lasers is not None,
        "--adapter": flag == "--optimiser" and args.adapter is not None,
        "--json": flag == "--report" and args.json,
        "--tune": args.tune,
        "--half": args.half,
        "--strategy": args.strategy != "auto",
    }
    for other, is_set in others.items():
        if is_set:
            raise UserError(other, f"with {flag}", remedy=remedy)


def _refuse_of_chain(args: argparse.Namespace) -> None:
    """Raise UserError for options that a chain of elements doesn't have."""
    smaller = "change the shapes of its elements, e.g. --set elements.NAME.shape=…"
    for flag, is_set, remedy in (
        ("--size", args.size is not None, smaller),
        ("--lasers", args.lasers is not None, "change them with --set wavelengths=…"),
    ):
        if is_set:
            raise UserError(flag, "of a chain of elements", remedy=remedy)


def _report(args: argparse.Namespace, rounds: int) -> int:
    """Write the report that --report asks for."""
    _refuse_options(args, "--report", "leave it out: a report has all strategies, and JSON in it")
    system, options = system_from_args(args), {"rounds": rounds, "adapter": args.adapter}
    if system.is_chain:
        _refuse_of_chain(args)
        options |= {"sizes": (), "wavelengths": ()}
    elif args.size is not None:
        for size in args.size.split(","):
            _sized(system, size)
        options["sizes"] = tuple((x, y) for x, y in map(_samples, args.size.split(",")))
    if args.lasers is not None and not system.is_chain:
        options["wavelengths"] = Several(Integer(1)).parse(args.lasers, "--lasers")
    return write_report(open_device(args.adapter), ReportOptions(system, **options), args.report)


def _result(
    system: System,
    device: Device,
    frame: FrameTimings,
    criteria: list[Criterion],
    timed: DeviceTime | None,
    rounds: int,
) -> dict[str, Any]:
    """All results and circumstances as JSON values."""
    rows, columns = system.way.shape
    return {
        "preset": system.name,
        "size": [columns, rows],
        "wavelengths": frame.wavelengths,
        "rounds": rounds,
        "strategies": frame.strategies,
        "adapter": _adapter(device),
        "versions": versions(),
        "platform": platform.platform(),
        "cores": os.cpu_count(),
        "torch_threads": torch.get_num_threads(),
        "bars": [criterion.as_dict() for criterion in criteria],
        "jobs": {name: sample.as_dict() for name, sample in frame.timings.items()},
        "traffic_bytes_a_wavelength": frame.traffic_bytes,
        "device_memory_bytes": frame.memory_bytes,
        "device_time": None if timed is None else timed.as_dict(),
    }


def _table(result: dict[str, Any]) -> str:
    """The results as a table."""
    adapter, (columns, rows) = result["adapter"], result["size"]
    software = ", ".join(f"{name} {number}" for name, number in result["versions"].items())
    lines = [
        f"{result['preset']}: {columns} x {rows} samples, {result['wavelengths']} wavelengths, "
        f"medians of {result['rounds']} rounds, all jobs in turn; "
        f"transforms: {', '.join(dict.fromkeys(result['strategies'].values()))}",
        f"{adapter['name']}, {adapter['backend']}, {adapter['driver']}",
        f"{software}; {result['cores']} cores, {result['torch_threads']} threads of torch",
        "",
        f"{'':<48}  {'value':>9}  {'bar':>7}  {'aim':>7}",
    ]
    for bar in result["bars"]:
        mark = "" if bar["holds"] else "  above the bar"
        unit = f" {bar['unit']}" if bar["unit"] else ""
        lines.append(f"{bar['name']:<48}  {bar['value']:>9.3g}  {bar['bar']:>7.3g}  {bar['aim']:>7.3g}{unit}{mark}")
    lines += ["", f"{'ms':<48}  {'median':>9}  {'least':>7}  {'processor':>9}"]
    for name, sample in (result["jobs"] | result["first_image"]).items():
        lines.append(f"{name:<48}  {sample['median_ms']:>9.2f}  {sample['minimum_ms']:>7.2f}  {sample['cpu_ms']:>9.2f}")
    lines += [
        "",
        f"memory traffic of a wavelength: {result['traffic_bytes_a_wavelength'] / 1e6:.1f} MB",
        f"device memory: {result['device_memory_bytes'] / 2**20:.0f} MiB",
    ]
    return "\n".join(lines + _device_lines(result["device_time"]))


def _device_lines(timed: dict[str, Any] | None) -> list[str]:
    """Lines about the time on the device."""
    if timed is None:
        return ["time on the device: the adapter has no timestamp queries"]
    return [
        f"time on the device: {timed['frame_ms']:.3f} ms a frame, {timed['wavelength_ms']:.3f} ms a wavelength",
        f"bandwidth: {timed['bandwidth'] / 1e9:.1f} GB/s, {timed['share_of_copy']:.0%} of the "
        f"{timed['copy_bandwidth'] / 1e9:.1f} GB/s that copying a buffer reaches",
    ]


def _sized(system: System, size: str) -> System:
    """A short form with modulators of `size` samples, such as "1024x768" (x by y). Raises UserError for other sizes."""
    columns, rows = _samples(size)
    upsample = system.sampling.upsample
    if columns % upsample or rows % upsample:
        raise UserError("--size", size, expected=f"multiples of the bench's upsampling, {upsample}")
    if not (is_fast_length(columns) and is_fast_length(rows)):
        raise UserError("--size", size, expected="products of 2, 3 and 5, so that torch transforms the same grid")
    return system.edit({"shape": [rows // upsample, columns // upsample]})


def _tuning_report(system: System, device: Device, *, as_json: bool) -> str:
    """New times of the FFT strategies for the grids of a system, as text or JSON."""
    reports = [tune(device, shape, remeasure=True) for shape in _grids(system)]
    if as_json:
        result = {"adapter": _adapter(device), "grids": [report.as_dict() for report in reports]}
        return json.dumps(result, indent=2, ensure_ascii=False)
    return "\n".join([device.info.label, *(line for report in reports for line in report.format_lines())])


def _check_strategy(name: StrategyOption, system: System, device: Device) -> None:
    """Raise UserError if the device doesn't support a strategy for the sizes of a system."""
    if name != "auto" and not all(name in supported_strategies(device, shape) for shape in _grids(system)):
        found = f"isn't possible on {device.info.name} at {system.name}'s sizes"
        raise UserError(f"--strategy {name}", found, expected="--strategy passes")


def _grids(system: System) -> list[tuple[int, int]]:
    """Shapes (ny, nx) of grids that are transformed: without padding and with linear padding, of a chain its own."""
    if system.is_chain:
        return [make_plan(system).grid.padded]
    return [make_plan(system.edit({"propagation": how})).grid.padded for how in ("periodic", "linear")]


def _adapter(device: Device) -> dict[str, str]:
    info = device.info
    return {"name": info.name, "kind": info.kind, "backend": info.backend, "driver": info.driver}


def _samples(size: str) -> list[int]:
    return parse_samples(size, 2, "--size", "samples such as 1024x768", "x")
