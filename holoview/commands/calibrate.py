"""`holoview calibrate CAPTURES.h5 -o CALIBRATED.toml` learns corrections to a bench's model from camera captures;
`holoview calibrate lut FILE.csv` fits a modulator's look-up table to sweeps of its grey level.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import time
from pathlib import Path
from typing import Any

from holoview.bench.calibrate.calibration_result import CalibrationTask, format_score, maps_path, plan_calibration
from holoview.bench.calibrate.lut_fit import fit_labelled, known_labels
from holoview.bench.calibrate.lut_table import (
    compare_vendor,
    format_lut,
    lut_table,
    plot_lut,
    read_vendor_table,
    save_lut,
    vendor_table,
    with_lut,
)
from holoview.bench.calibrate.sweep import ORDERS, LabelledSweep, read_sweeps, sweep_of_readings
from holoview.bench.calibrate.train import CalibrationSettings, TrainingState, load_checkpoint
from holoview.bench.captures import read_captures
from holoview.bench.captures.count_bits import with_clipped_as_saturated
from holoview.bench.captures.slmsuite_calibration import PixelCalibration, read_slmsuite
from holoview.commands.arguments import add_fields, dest_of, given_fields, number, whole
from holoview.commands.console import deferred_interrupt, print_json, print_stderr, progress_bar
from holoview.commands.output_files import ResultSaver, add_input, add_output, add_output_folder, check_files
from holoview.holograms.optimise.parallel import thread_count, torch_threads
from holoview.light.model import preset
from holoview.light.model.fields import fields_by_key
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.figures import require_matplotlib
from holoview.util.file_writer import make_folder, write_file
from holoview.util.processes import Interruption


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(
        parser, "source", nargs="+", metavar="CAPTURES.h5 | lut FILE.csv …", help="a capture file, or lut and sweeps"
    )
    add_output(parser, "-o", "--output", metavar="TOML", suffix=".toml", help="the preset, or the table, to write")
    add_input(parser, "--preset", help="the bench to start from: a preset's name or a TOML file")
    parser.add_argument("--json", action="store_true", help="machine-readable figures on stdout")
    _add_captures_options(parser.add_argument_group("captures"))
    _add_lut_options(parser.add_argument_group("lut"))


def run(args: argparse.Namespace) -> int:
    """Runs a calibration from captures or from a sweep of levels."""
    source: list[str] = args.source
    if source[0] == "lut" and len(source) >= 2:
        _reject_foreign_options(args, _CAPTURES_OPTIONS, "holoview calibrate CAPTURES.h5")
        return run_lut(args, [Path(name) for name in source[1:]])
    if len(source) != 1 or source[0] == "lut":
        expected = "CAPTURES.h5, or: lut FILE.csv …"
        raise UserError("holoview calibrate", f'"{" ".join(source)}"', expected=expected)
    _reject_foreign_options(args, _LUT_OPTIONS, "holoview calibrate lut")
    return run_captures(args, Path(source[0]))


def _reject_foreign_options(args: argparse.Namespace, options: tuple[str, ...], belongs_to: str) -> None:
    """Raises UserError for an option that only the other form of the command has."""
    for option in options:
        if getattr(args, option) is not None:
            raise UserError(f"--{option.replace('_', '-')}", "doesn't apply here", expected=f"it with `{belongs_to}`")


# --- from captures: maps of a bench, its preset with their file ---


# destinations in argparse's namespace of the options that only this form of the command has
_SETTINGS = tuple(map(dest_of, fields_by_key(CalibrationSettings).values()))
_CAPTURES_OPTIONS = (*_SETTINGS, "pixels_a_node", "pictures", "checkpoint", "resume")


def _add_captures_options(group: argparse._ArgumentGroup) -> None:
    """Adds the options for a calibration from captures."""
    add_fields(group, CalibrationSettings, *fields_by_key(CalibrationSettings))
    group.add_argument(
        "--pixels-a-node", type=whole(1, 1000), metavar="N", help="how coarse the source's maps are (default 8)"
    )
    add_output_folder(group, "--pictures", metavar="DIR", help="draw what was learned into a folder")
    add_output(group, "--checkpoint", metavar="FILE", suffix=".safetensors", help="keep the state after every epoch")
    add_input(group, "--resume", metavar="FILE", type=Path, help="go on from a checkpoint")


def run_captures(args: argparse.Namespace, file: Path) -> int:
    """Trains, scores, plots if asked, writes the preset and its maps, and prints the scores.

    After Ctrl-C it does the same with the best maps so far, and returns the exit code of the signal.
    """
    if args.output is None:
        raise UserError("-o", "is missing", expected="the preset to write, e.g. -o calibrated.toml")
    check_files(args, {"the maps of -o": [maps_path(args.output)]})
    if args.pictures is not None:
        require_matplotlib("--pictures")
        make_folder(args.pictures)
    task = _prepare_task(args, file)
    with torch_threads(thread_count(task.padded_samples)):
        state, interruption = _train(args, task)
        with progress_bar("scoring") as progress:
            result, drawn = task.result(state.best_maps, progress, args.pictures)
    for path in drawn:
        print_stderr(f"drawn: {path}")
    saver = ResultSaver()
    output = saver.save(args.output, result.save)
    maps = maps_path(output)
    if args.json:
        print_json(result.as_json() | {"preset": str(output), "maps": str(maps)})
    else:
        print("\n".join([*format_score(result.score), f"written: {output}, {maps}"]))
    if interruption():
        print_stderr(f"interrupted after epoch {state.epoch}: the best so far is kept in {output}")
    return interruption.exit_code or saver.exit_code


def _prepare_task(args: argparse.Namespace, file: Path) -> CalibrationTask:
    """Reads the captures and makes everything from the arguments. Prints notes on what the captures can't show."""
    settings = given_fields(args, CalibrationSettings)
    start = None if args.preset is None else preset.load(args.preset)
    captures = with_clipped_as_saturated(read_captures(file), lambda text: print_stderr(f"note: {text}"))
    task = plan_calibration(captures, start, args.output.stem, settings, args.pixels_a_node)
    for note in task.notes:
        print_stderr(f"note: {note}")
    return task


def _train(args: argparse.Namespace, task: CalibrationTask) -> tuple[TrainingState, Interruption]:
    """The last state of the training, and what Ctrl-C did to it. Raises UserError if no epoch is left to train."""
    state: TrainingState | None = None
    resume = None if args.resume is None else load_checkpoint(args.resume)
    with deferred_interrupt() as interruption, progress_bar("calibrating") as progress:
        start: tuple[float, int] | None = None
        for state in task.train(resume):
            start = start or (time.monotonic(), state.epoch)
            progress(state.epoch, state.epochs, f"chi2/n {state.validation_chi2:.4g}{_time_left(state, *start)}")
            _save_checkpoint(args.checkpoint, state)
            if interruption():
                break
    if state is None:
        raise UserError("--resume", "the checkpoint is of a finished calibration", expected="one with epochs left")
    return state, interruption


def _save_checkpoint(path: Path | None, state: TrainingState) -> None:
    """Writes a checkpoint; a failure only prints a note, because the calibration itself isn't affected."""
    if path is None:
        return
    try:
        state.checkpoint().save(path)
    except UserError as error:
        print_stderr(f"note: no checkpoint after epoch {state.epoch}: {error}")


def _time_left(state: TrainingState, start_time: float, first_epoch: int) -> str:
    """Text with the time that the epochs left will take, as long as those since `first_epoch`; "" in that epoch."""
    if state.epoch == first_epoch:
        return ""
    seconds_per_epoch = (time.monotonic() - start_time) / (state.epoch - first_epoch)
    return f", {seconds_per_epoch * (state.epochs - state.epoch):.0f} s left"


# --- lut: a modulator's look-up table from sweeps of its grey level ---


# destinations in argparse's namespace of the options that only this form of the command has
_LUT_OPTIONS = ("wavelength", "period", "order", "plot", "save_preset", "compare", "drive_bits", "vendor_table")
_WAVELENGTH_RANGE_M = (100e-9, 10e-6)
_REMEDY = "state --order if it isn't that one; else look for drift, saturation or another spot in the reading"
_REMEDY_OF_SEVERAL = "fit it alone, or state --order: then sweeps that don't fit the coarsest grating's are left out"


def _add_lut_options(group: argparse._ArgumentGroup) -> None:
    """Adds the options for a look-up table."""
    group.add_argument(
        "--wavelength",
        action="append",
        metavar="LENGTH",
        help='of the sweep, e.g. "820 nm": turns phases into lengths; once, or once for each file in their order',
    )
    group.add_argument(
        "--period",
        action="append",
        type=number(),
        metavar="PIXELS",
        help="of the grating; once, or once for each file in their order",
    )
    group.add_argument(
        "--order",
        action="append",
        choices=(*ORDERS, "auto"),
        help="whose power was read: that of the first or zero order of a binary grating, or of an interferometer; "
        "once, or once for each file in their order (default: auto, recognised by the reading at the reference level)",
    )
    add_output(group, "--plot", metavar="PNG", suffix=".png", help="draw the sweep, its fit and the table")
    add_input(group, "--compare", metavar="VENDOR.lut", type=Path, help="compare with a vendor's table")
    group.add_argument(
        "--drive-bits",
        type=whole(8, 16),
        metavar="N",
        help="of these tables' drives (default: read by the largest, written 12)",
    )
    add_output(
        group, "--vendor-table", metavar="LUT", suffix=".lut", help="write a turn as lines: grey level, 12-bit drive"
    )
    add_output(
        group,
        "--save-preset",
        metavar="TOML",
        suffix=".toml",
        help="write --preset with this stroke and table (wants --wavelength)",
    )


def run_lut(args: argparse.Namespace, files: list[Path]) -> int:
    """Fits the table, writes the files that were asked for, and prints stroke and residuals.

    Raises UserError, after the figures are printed and before anything is written, where no table explains the sweeps.
    """
    if args.plot is not None:
        require_matplotlib("--plot")
    labelled = _read_sweeps(args, files)
    known_labels(labelled)  # of all or none, before the fit
    if (args.save_preset is None) != (args.preset is None):
        missing = "--preset" if args.preset is None else "--save-preset"
        raise UserError(missing, "is missing", expected="--preset and --save-preset together")
    preset_system = None if args.preset is None else preset.load(args.preset)
    vendor = None if args.compare is None else read_vendor_table(args.compare, args.drive_bits)
    fitted = fit_labelled(labelled)
    lut, name = fitted.lut, files[0].name
    wavelengths, periods = known_labels(fitted.sweeps)
    figures = lut_table(lut, name, wavelengths, periods) | ({"left_out": fitted.notes} if fitted.notes else {})
    lines = format_lut(lut, wavelengths, periods) + fitted.notes
    if vendor is not None:
        comparison = compare_vendor(lut, vendor)
        figures["compared"] = {
            "file": args.compare.name,
            "rms_pi": comparison.rms / math.pi,
            "greatest_pi": comparison.greatest / math.pi,
            "level": comparison.level,
            "share": comparison.share,
            "is_reversed": comparison.is_reversed,
        }
        direction = ", with levels that count down in its drive" if comparison.is_reversed else ""
        lines.append(
            f"{args.compare.name}{direction}: the fitted phase is off by {comparison.rms / math.pi:.3f} π r.m.s., "
            f"{comparison.greatest / math.pi:+.3f} π at its level {comparison.level}"
        )
    if args.json:
        print_json(figures)
    else:
        print("\n".join(lines))
    lut.check(_REMEDY if len(lut.fits) == 1 else _REMEDY_OF_SEVERAL)
    wavelength = wavelengths[0] if wavelengths else None
    system = None if preset_system is None else with_lut(preset_system, lut, wavelength)
    drives = None if args.vendor_table is None else vendor_table(lut, args.drive_bits or 12)
    if args.output is not None:
        save_lut(args.output, lut, name, wavelengths, periods)
    if system is not None:
        preset.save(system, args.save_preset)
    if drives is not None:
        write_file(args.vendor_table, drives)
    if args.plot is not None:
        plot_lut(args.plot, lut, name)
    return 0


def _read_sweeps(args: argparse.Namespace, files: list[Path]) -> list[LabelledSweep]:
    """The sweeps of files with their periods, wavelengths and orders, from the files or from the options."""
    found: list[LabelledSweep] = []
    told = {
        "period_px": args.period or [],
        "wavelength_m": [_parse_wavelength(text) for text in args.wavelength or ()],
        "order": [None if name == "auto" else name for name in args.order or ()],
    }
    for name, values in told.items():
        if len(values) not in (0, 1, len(files)):
            option = f"--{name.partition('_')[0]}"
            raise UserError(option, f"{len(values)} values", expected=f"one, or one for each of {len(files)} files")
    for place, file in enumerate(files):
        own = {name: values[place if len(values) > 1 else 0] for name, values in told.items() if values}
        own = {name: value for name, value in own.items() if value is not None}
        is_slmsuite = file.suffix.lower() == ".h5"
        sweeps = _pixel_calibration(file, "wavelength_m" in own) if is_slmsuite else read_sweeps(file)
        found += [_with_options(sweep, own, file) for sweep in sweeps]
    return found


def _with_options(sweep: LabelledSweep, own: dict[str, Any], file: Path) -> LabelledSweep:
    """The sweep with what options say of it. Raises UserError where its file says it, too."""
    for name, value in own.items():
        stated = getattr(sweep, name)
        is_same = stated == value or (isinstance(stated, float) and math.isclose(stated, value))
        if stated is not None and not is_same:
            option = f"--{name.partition('_')[0]}"
            raise UserError(option, f"for {file.name}", expected="none: the file states it for each sweep")
    return dataclasses.replace(sweep, **own)


def _pixel_calibration(file: Path, is_wavelength_given: bool) -> list[LabelledSweep]:
    """The sweeps of a pixel calibration of slmsuite, with its wavelength unless an option gives it."""
    found = read_slmsuite(file)
    if not isinstance(found, PixelCalibration):
        raise UserError(str(file), "is a Fourier calibration", expected="a pixel calibration of slmsuite")
    return [
        LabelledSweep(
            sweep_of_readings(one.levels, one.power, f"{file.name} period {one.period_px:g} {one.direction}"),
            one.period_px,
            None if is_wavelength_given else found.wavelength_m,
        )
        for one in found.sweeps
    ]


def _parse_wavelength(text: str) -> float:
    value = units.parse(text, "--wavelength")
    if not _WAVELENGTH_RANGE_M[0] <= value <= _WAVELENGTH_RANGE_M[1]:
        raise UserError("--wavelength", text, expected="between 100 nm and 10 um")
    return value
