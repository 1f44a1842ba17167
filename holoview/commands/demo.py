"""`holoview demo`: optimises holograms of the shipped picture for HoloChrome and for simultaneous colour, and compares.

Both displays are optimised with equal settings. All their focal planes are rendered and shown beside the target.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import holoview
from holoview.commands.arguments import add_backend, add_fields, check_adapter_applies, whole
from holoview.commands.console import print_stderr, progress_bar
from holoview.commands.optimise import optimise_with_progress
from holoview.commands.output_files import add_output_folder, check_files
from holoview.evidence.study.demonstration import (
    DISPLAYS,
    DisplayResult,
    comparison_sheet,
    render_display,
    write_planes,
)
from holoview.holograms.files.pictures import write_png
from holoview.holograms.hologram import Hologram
from holoview.holograms.metrics.perceptual_scores import OPTIONAL_SCORES, PERCEPTUAL_SCORES, usable_scores
from holoview.holograms.optimise.hologram_job import RunOptions
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.targets.focal_stack import Target
from holoview.holograms.view import random_drive
from holoview.light.engine.backend import open_executor
from holoview.light.model import preset
from holoview.light.model.plan import make_plan
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.file_writer import make_folder
from holoview.util.processes import Interrupted
from holoview.viewer.document.target_builder import example_target

_MIN_SIDE = 16  # pixels: the eyebox is measured in 8 × 8 blocks


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_output_folder(parser, "-o", "--output", metavar="DIR", default=Path("holoview-demo"), help="folder to write to")
    add_fields(parser, Settings, "iterations", defaults={"iterations": 20})
    parser.add_argument(
        "--shape", type=whole(1, 16384), nargs=2, metavar=("ROWS", "COLUMNS"), help="fewer modulator pixels: faster"
    )
    add_backend(parser)


def run(args: argparse.Namespace) -> int:
    """Runs the demonstration; prints the scores, the files that were written and what to try next."""
    started = time.perf_counter()
    settings = Settings(iterations=args.iterations)
    changes = {"shape": args.shape} if args.shape else {}
    systems = [preset.load(name).edit(changes) for name in DISPLAYS]
    _prepare(args, systems[0])
    usable = usable_scores(lambda problem: print_stderr(f"note: {problem}"))
    further = [name for name in usable if name in OPTIONAL_SCORES]
    target = example_target().build(systems[0])
    results: list[DisplayResult] = []
    for system in systems:
        optimised, interruption = optimise_with_progress(system, target.stack, settings, RunOptions())
        if interruption():
            raise Interrupted(interruption.signal)
        optimised.hologram.save(args.output / f"{system.name}.safetensors")
        results.append(_render(system.name, optimised.hologram, target, further, args))
    written = [path for result in results for path in write_planes(result, args.output)]
    sheet = args.output / "contact-sheet.png"
    planes = ", ".join(units.format_exact(z, "mm") for z in target.planes_m)
    write_png(
        sheet, comparison_sheet(target, results), {"holoview.preset": ", ".join(DISPLAYS), "holoview.plane": planes}
    )
    _print_results(results, written, time.perf_counter() - started)
    _print_what_to_open(sheet, args.output / f"{DISPLAYS[0]}.safetensors")
    return 0


def _prepare(args: argparse.Namespace, system: holoview.System) -> None:
    """Creates the folder, and raises UserError for a size, backend or file that would fail after the optimisation."""
    check_adapter_applies(args)
    rows, columns = system.modulators[0].shape
    if min(rows, columns) < _MIN_SIDE:
        raise UserError("--shape", f"{rows} {columns}", expected=f"at least {_MIN_SIDE} rows and columns")
    small = system.edit({"shape": [_MIN_SIDE, _MIN_SIDE], "propagation": "periodic"})
    open_executor(make_plan(small), random_drive(small), args.backend, args.adapter)
    make_folder(args.output)
    check_files(args, {"-o": [args.output / "contact-sheet.png"]})


def _render(
    name: str, hologram: Hologram, target: Target, scores: Sequence[str], args: argparse.Namespace
) -> DisplayResult:
    with progress_bar(f"rendering {name}") as progress:
        return render_display(
            name,
            hologram,
            target,
            scores,
            lambda done, total: progress(done, total, "wavelengths"),
            backend=args.backend,
            adapter=args.adapter,
        )


def _print_results(results: list[DisplayResult], written: list[Path], seconds: float) -> None:
    print_stderr(f"rendered by {results[0].view.backend}; {seconds:.0f} s in all")
    titles = f"{'':<14} {'PSNR':>9} {'lum. PSNR':>10} {'CIEDE2000':>10} {'MS-SSIM':>8} {'speckle':>8} {'eyebox':>7}"
    perceptual = results[0].perceptual
    print(titles + "".join(f" {name.upper():>6}" for name in perceptual))
    for result in results:
        print(_score_row(result))
    if perceptual:
        print(f"{' and '.join(name.upper() for name in perceptual)}: of the middle plane")
    print("\nall focal planes:")
    for path in written:
        print(f"  {path}")


def _score_row(result: DisplayResult) -> str:
    """The scores of a display as a row of the table."""
    score = result.score
    similarity = "" if score.ms_ssim is None else f"{score.ms_ssim.mean:.3f}"
    decibels = f"{score.psnr.mean_db:6.2f} dB {score.psnr_luminance.mean_db:7.2f} dB"
    further = "".join(f" {one.mean:6.{PERCEPTUAL_SCORES[name].digits}f}" for name, one in result.perceptual.items())
    others = f"{score.delta_e:10.2f} {similarity:>8} {score.mean_speckle_contrast:8.3f} {result.eyebox.uniformity:7.2f}"
    return f"{result.name:<14} {decibels} {others}{further}"


def _print_what_to_open(sheet: Path, hologram: Path) -> None:
    """Prints what to try next, and at last the picture to open and the command of the viewer."""
    program = _program()
    print("\ntry next:")
    print(f"  {program} render --hologram {hologram} --plane 9.3mm -o seen.png")
    print(f'  {program} render holochrome-8 --random 1 --set gap="4 mm" -o speckle.png')
    print(f"  {program} info bench-plm")
    print(f"\nthe target beside both displays, open:  {sheet}")
    print(f"the hologram in the viewer:             {program} view {hologram}")


def _program() -> str:
    """The command that started this program, as a user can type it again."""
    started_as = Path(sys.argv[0])
    on_path = shutil.which("holoview")
    if on_path is not None and started_as.exists() and Path(on_path).samefile(started_as):
        return "holoview"
    return str(started_as) if started_as.stem == "holoview" else "python -m holoview"
