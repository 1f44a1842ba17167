"""`holoview demo`: optimises holograms of the shipped picture for HoloChrome and for simultaneous colour, and compares.

Both displays are optimised with equal settings. All their focal planes are rendered and shown beside the target.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import holoview
from holoview.colour import to_srgb8
from holoview.commands.arguments import add_backend, check_adapter_applies, whole
from holoview.commands.console import print_stderr, progress_bar
from holoview.commands.optimise import optimise_with_progress
from holoview.commands.output_files import add_output_folder, check_files
from holoview.document.target_builder import example_target
from holoview.engine.backend import open_executor
from holoview.figures import CaptionedTile, contact_sheet
from holoview.io.hologram import Hologram
from holoview.io.pictures import write_png
from holoview.metrics.fidelity import PlaneScores
from holoview.metrics.image_quality import EyeboxUniformity, ImageQuality, eyebox_uniformity_of, measure_image_quality
from holoview.metrics.perceptual import measure_perceptual_scores
from holoview.metrics.perceptual_scores import OPTIONAL_SCORES, PERCEPTUAL_SCORES, usable_scores
from holoview.model import preset
from holoview.model.plan import make_plan
from holoview.optimise.hologram_job import RunOptions
from holoview.optimise.settings import Settings
from holoview.targets.focal_stack import Target
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.file_writer import make_folder
from holoview.util.processes import Interrupted
from holoview.view import View, random_drive, simulate

_DISPLAYS = ("holochrome-8", "simultaneous")
_COLUMN_TITLES = ("target", "HoloChrome, 8 wavelengths", "simultaneous, 3 wavelengths")
_DEFOCUSED_PLANE_M = 0.014
_MIN_SIDE = 16  # pixels: the eyebox is measured in 8 × 8 blocks
# Regions of the still life (x, y, width, height as shares of the picture): the die in front, the vase behind.
_WHOLE, _FRONT, _BACK = (0, 0, 1, 1), (0.36, 0.68, 0.28, 0.28), (0.70, 0.06, 0.28, 0.28)


@dataclass(frozen=True)
class _DisplayResult:
    """One display's hologram, its views at the target's planes and far out of focus, and its scores.

    perceptual: optional scores of the middle plane, by name.
    """

    name: str
    hologram: Hologram
    view: View
    defocused_view: View
    score: ImageQuality
    eyebox: EyeboxUniformity
    perceptual: Mapping[str, PlaneScores]


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_output_folder(parser, "-o", "--output", metavar="DIR", default=Path("holoview-demo"), help="folder to write to")
    parser.add_argument("--iterations", type=whole(1), default=20, help="of each display's optimisation")
    parser.add_argument(
        "--shape", type=whole(1, 16384), nargs=2, metavar=("ROWS", "COLUMNS"), help="fewer modulator pixels: faster"
    )
    add_backend(parser)


def run(args: argparse.Namespace) -> int:
    """Runs the demonstration; prints the scores, the files that were written and what to try next."""
    started = time.perf_counter()
    settings = Settings(iterations=args.iterations)
    changes = {"shape": args.shape} if args.shape else {}
    systems = [preset.load(name).edit(changes) for name in _DISPLAYS]
    _prepare(args, systems[0])
    usable = usable_scores(lambda problem: print_stderr(f"note: {problem}"))
    further = [name for name in usable if name in OPTIONAL_SCORES]
    target = example_target().build(systems[0])
    results: list[_DisplayResult] = []
    for system in systems:
        optimised, interruption = optimise_with_progress(system, target.stack, settings, RunOptions())
        if interruption():
            raise Interrupted(interruption.signal)
        optimised.hologram.save(args.output / f"{system.name}.safetensors")
        results.append(_render_display(system.name, optimised.hologram, target, further, args))
    written = [path for result in results for path in _write_planes(result, args.output)]
    sheet = args.output / "contact-sheet.png"
    planes = ", ".join(units.format_exact(z, "mm") for z in target.planes_m)
    write_png(
        sheet, _contact_sheet(target, results), {"holoview.preset": ", ".join(_DISPLAYS), "holoview.plane": planes}
    )
    _print_results(results, written, time.perf_counter() - started)
    _print_what_to_open(sheet, args.output / f"{_DISPLAYS[0]}.safetensors")
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


def _render_display(
    name: str, hologram: Hologram, target: Target, scores: Sequence[str], args: argparse.Namespace
) -> _DisplayResult:
    """Renders all planes and one far out of focus in one run, and scores the hologram."""
    planes = [*hologram.system.planes_m, _DEFOCUSED_PLANE_M]
    with progress_bar(f"rendering {name}") as progress:
        view = simulate(
            hologram.system,
            hologram.drive,
            planes,
            args.backend,
            adapter=args.adapter,
            progress=lambda done, total: progress(done, total, "wavelengths"),
        )
    focused, middle = view.at(range(len(planes) - 1)), (len(planes) - 1) // 2
    return _DisplayResult(
        name,
        hologram,
        focused,
        defocused_view=view.at([len(planes) - 1]),
        score=measure_image_quality(focused, target.stack),
        eyebox=eyebox_uniformity_of(hologram),
        perceptual=measure_perceptual_scores(view.at([middle]), target.stack[[middle]], scores),
    )


def _write_planes(display: _DisplayResult, folder: Path) -> list[Path]:
    """Writes a PNG for each plane; returns their paths."""
    written = []
    for view, note in ((display.view, ""), (display.defocused_view, "-out-of-focus")):
        for i, plane_m in enumerate(view.focus_m):
            plane = units.format_exact(float(plane_m), "mm")
            path = folder / f"{display.name}-{plane.replace(' ', '')}{note}.png"
            texts = {"holoview.preset": display.name, "holoview.plane": plane, "holoview.backend": view.backend}
            write_png(path, view.srgb8[i], texts)
            written.append(path)
    return written


def _contact_sheet(target: Target, results: list[_DisplayResult]) -> NDArray[np.uint8]:
    """A column for the target and for each display; rows: the middle plane, then regions in and out of focus."""
    last = len(target.planes_m) - 1
    target_rgb8 = to_srgb8(target.stack)
    rows = []
    for plane, region, name in (
        (last // 2, _WHOLE, "all"),
        (last, _FRONT, "front"),
        (0, _BACK, "back"),
        (last, _BACK, "back"),
    ):
        focus = f"{name}, focus at {units.format_rounded(target.planes_m[plane], 'mm')}"
        row = [CaptionedTile(_crop(target_rgb8[plane], region), focus)]
        for result in results:
            caption = _score_caption(result.score, plane) if region is _WHOLE else focus
            row.append(CaptionedTile(_crop(result.view.srgb8[plane], region), caption))
        rows.append(row)
    return contact_sheet("One frame, two phase modulators: what the eye sees", _COLUMN_TITLES, rows)


def _score_caption(score: ImageQuality, plane: int) -> str:
    return f"PSNR {score.psnr.planes_db[plane]:.1f} dB, speckle contrast {score.speckle[plane].contrast:.2f}"


def _crop(picture: NDArray[np.uint8], region: tuple[float, float, float, float]) -> NDArray[np.uint8]:
    """A region of a picture (y, x, 3), given as shares of its width and height."""
    rows, columns = picture.shape[:2]
    x, y, w, h = (round(share * side) for share, side in zip(region, (columns, rows, columns, rows), strict=True))
    return picture[y : y + h, x : x + w]


def _print_results(results: list[_DisplayResult], written: list[Path], seconds: float) -> None:
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


def _score_row(result: _DisplayResult) -> str:
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
