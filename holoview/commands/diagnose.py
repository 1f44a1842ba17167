"""`holoview diagnose CAPTURES.h5`: the errors of the simulation of a real bench, and their sizes.

With `--rig RIG.toml` in place of a file it takes the captures itself, each chosen by what is still open, until the
cause is certain.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from holoview.bench.captures import Captures, read_captures, write_captures
from holoview.bench.captures.predictor import SamplingConfig, check_user_effects
from holoview.bench.captures.records import plausible_units
from holoview.bench.captures.records.corrections import apply_corrections
from holoview.bench.diagnose.extended_model import extended_system, with_preset_geometry
from holoview.bench.diagnose.intervals import format_value
from holoview.bench.diagnose.likelihood import Values
from holoview.bench.diagnose.pipeline import DiagnosisOptions, diagnose
from holoview.bench.diagnose.report.diagnosis import Diagnosis
from holoview.bench.experiment.closed_loop import LoopResult, LoopSettings, diagnose_rig
from holoview.bench.experiment.rig_bench import KnownEffects
from holoview.bench.rig.registration import read_registration
from holoview.commands.arguments import add_fields, given_fields, parse_effects
from holoview.commands.console import deferred_interrupt, print_stderr, progress_bar
from holoview.commands.output_files import ResultSaver, add_input, add_output, add_output_folder
from holoview.light.model import preset
from holoview.light.model.effects.effect import Effect
from holoview.light.model.effects.registry import load_user_effects
from holoview.light.model.fields import fields_by_key, flag_of
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.figures import require_matplotlib
from holoview.util.file_writer import make_folder, write_file
from holoview.util.processes import process_cpu_count
from holoview.util.progress import ProgressCallback

_SHORT_S = 10.0  # of a search that says nothing before its end
_MAX_DEFAULT_WORKERS = 8  # each worker keeps a cache of a quarter of a gigabyte


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(
        parser, "file", metavar="CAPTURES.h5", nargs="?", help="a capture file, see docs/captures.md; or take --rig"
    )
    add_rig_options(parser)
    add_input(
        parser,
        "--preset",
        metavar="PRESET",
        help="the nominal bench, in place of what the file says; its effects count as known",
    )
    add_input(
        parser,
        "--known",
        metavar="NAME.KEY=VALUE|RIG.placement.toml",
        nargs="+",
        action="extend",
        default=[],
        help="effects that the bench is known to have, or the placement that `rig align` has written",
    )
    add_input(
        parser,
        "--effects",
        metavar="FILE.py",
        nargs="+",
        action="extend",
        default=[],
        help="effects of your own that may be the cause; the files are run",
    )
    _add_outputs(parser)
    parser.add_argument(
        "--no-display",
        action="store_true",
        help="leave out of the report what the extended model buys on the display, which takes half a minute",
    )
    duration = parser.add_mutually_exclusive_group()
    add_fields(duration, DiagnosisOptions, "time", "thorough")
    add_fields(parser, SamplingConfig, "finer", "padding", "points", "has_weighted_stops")
    workers = min(process_cpu_count(), _MAX_DEFAULT_WORKERS)
    add_fields(parser, DiagnosisOptions, "workers", defaults={"workers": workers})


def _add_outputs(parser: argparse.ArgumentParser) -> None:
    add_output_folder(parser, "--report", metavar="DIR", help="write report.html and pictures into this folder")
    add_output(parser, "--json", metavar="OUT.json", suffix=".json", help="write the diagnosis for programs")
    add_output(
        parser,
        "--save-preset",
        metavar="P2.toml",
        suffix=".toml",
        help="write the bench with the causes that were named",
    )
    add_output(
        parser,
        "--save-corrected",
        metavar="FILE.h5",
        suffix=".h5",
        help="write the captures as they should have been recorded, with a note of what was wrong",
    )


@dataclass(frozen=True, eq=False)
class _Diagnosed:
    """A diagnosis. recorded: the captures as their file or the rig has them. bench: the nominal one; None if that is
    what the corrected captures say. loop: how captures were taken; None of a file's."""

    found: Diagnosis
    recorded: Captures
    bench: System | None
    exit_code: int
    loop: LoopResult | None = None


def run(args: argparse.Namespace) -> int:
    """Diagnoses, then writes the files that were asked for, each whole or not at all."""
    _check_arguments(args)
    user_effects = [effect for file in args.effects for effect in _load_effects(file)]
    done = _diagnose_file(args, user_effects) if args.rig is None else _diagnose_rig(args, user_effects)
    found = done.found
    corrected = found.records.corrected(done.recorded)
    bench = done.bench or corrected.nominal_system()
    told = found.as_json() if done.loop is None else found.as_json() | {"loop": done.loop.as_json()}
    text = json.dumps(told, indent=2, ensure_ascii=False) + "\n"
    extended = extended_system(bench.edit({"effects": found.known}), found.values)
    saver, written = ResultSaver(), [] if args.save is None else [args.save]
    for path, save in (
        (args.report, partial(_write_report, args, bench, corrected.is_fourier, found.known, found)),
        (args.json, partial(write_file, content=text)),
        (args.save_preset, partial(preset.save, extended)),
        (args.save_corrected, partial(write_captures, captures=corrected)),
    ):
        if path is not None:
            written.append(saver.save(path, save))
    if done.loop is not None:
        print(done.loop.sentence)
    _print_diagnosis(found, _source(args), written)
    return done.exit_code or saver.exit_code


def _diagnose_file(args: argparse.Namespace, user_effects: Sequence[Effect]) -> _Diagnosed:
    """The diagnosis of a file."""
    captures = recorded = read_captures(args.file, plausible_units)
    plausible = apply_corrections(recorded, plausible_units(recorded))
    check_user_effects(plausible, user_effects)
    known: dict[str, dict[str, float]] = {}
    bench = None
    if args.preset is not None:
        captures, known, bench = with_preset_geometry(captures, preset.load(args.preset), args.preset)
    stated = _known(args.known)
    known = stated.added_to(known)
    with progress_bar("diagnosing") as progress, deferred_interrupt("prediction") as interruption:
        so_far = _SoFar(progress)
        found = diagnose(
            captures,
            known=known,
            uncertain=stated.uncertain,
            progress=so_far.progress,
            time_s=math.inf if args.thorough else args.time,
            is_asked_to_end=interruption,
            so_far=so_far.note,
            forecast=print_stderr,
            **_search_options(args),
        )
    return _Diagnosed(stated.with_notes(found), recorded, bench, interruption.exit_code)


def _known(texts: Sequence[str]) -> KnownEffects:
    """The effects that --known states, and the files of `rig align`. Raises UserError that names what is wrong."""
    files = [text for text in texts if text.endswith(".toml") and "=" not in text]
    effects = parse_effects([text for text in texts if text not in files])
    return KnownEffects(effects, [read_registration(Path(file)) for file in files])


def _diagnose_rig(args: argparse.Namespace, user_effects: Sequence[Effect]) -> _Diagnosed:
    """The diagnosis of captures that are taken one by one."""
    with progress_bar("diagnosing") as progress, deferred_interrupt("capture") as interruption:
        captures, result = diagnose_rig(
            args.rig,
            _known(args.known),
            LoopSettings(**given_fields(args, LoopSettings)),
            user_effects,
            args.save,
            progress=progress,
            tell=print_stderr,
            is_asked_to_end=interruption,
            time_s=math.inf if args.thorough else args.time,
            **_search_options(args),
        )
    return _Diagnosed(result.diagnosis, captures, None, interruption.exit_code, result)


def _search_options(args: argparse.Namespace) -> dict[str, Any]:
    """How a diagnosis searches, in the options of `diagnose`."""
    is_thorough = args.thorough or args.time is not None
    return {
        "workers": args.workers,
        "thorough": is_thorough,
        "sampling": SamplingConfig(**given_fields(args, SamplingConfig)),
    }


def _source(args: argparse.Namespace) -> str:
    """The name of the captures' file or of the rig."""
    return str(args.rig or args.file)


class _SoFar:
    """Prints what the search has found so far, while it takes longer than a short one."""

    def __init__(self, progress: ProgressCallback) -> None:
        self._progress, self._from, self._text = progress, time.monotonic() + _SHORT_S, ""

    def note(self, text: str) -> None:
        """Takes what was found."""
        self._text = text
        self._print()

    def progress(self, done: int, total: int, note: str) -> None:
        """Passes progress on."""
        self._progress(done, total, note)
        self._print()

    def _print(self) -> None:
        if self._text and time.monotonic() > self._from:
            print_stderr(f"so far: {self._text}")
            self._text = ""


def _check_arguments(args: argparse.Namespace) -> None:
    """Raises UserError for options that don't belong together and for outputs that can't be written."""
    check_rig_options(args)
    if args.report is not None:
        require_matplotlib("--report")


def _load_effects(file: str) -> list[Effect]:
    """The effects of a user's file, which is run."""
    print_stderr(f"running {file} for its effects")
    return load_user_effects(file)


def _write_report(
    args: argparse.Namespace, bench: System, fourier: bool, known: Values, found: Diagnosis, folder: Path
) -> None:
    # here: the optimiser and matplotlib take a second to import
    from holoview.bench.diagnose.report.display_gain import display_gain
    from holoview.bench.diagnose.report.html_report import write_report

    make_folder(folder)
    gain = None
    if found.values and not fourier and not args.no_display:
        with progress_bar("optimising holograms") as progress:
            gain = display_gain(bench.edit({"effects": {}}), known, found.values, progress=progress)
    with progress_bar("drawing") as progress:
        write_report(folder, Path(_source(args)).name, found, gain, progress)


def _print_diagnosis(found: Diagnosis, source: str, written: list[Path]) -> None:
    """The diagnosis in a few lines."""
    before, after = found.before, found.after
    of_how_many = f" ({found.captures - len(found.bad_captures)} of {found.captures} captures)"
    print(f"{source}: {found.verdict}{of_how_many if found.bad_captures else ''}")
    print(
        f"  held-out captures: χ²/n {before.chi2_per_pixel:.4g} → {after.chi2_per_pixel:.4g} (noise: 1), "
        f"{before.psnr_db:.1f} → {after.psnr_db:.1f} dB"
    )
    for bad in found.bad_captures:
        print(f"  left out: capture {bad.index}, {bad.why}. {bad.sentence}")
    for cause in found.causes:
        print(f"  {cause.effect}{f' ({cause.choice})' * bool(cause.choice)}: {cause.sentence}")
        for name, interval in cause.intervals.items():
            print(f"      {name} = {format_value(cause.effect, name, interval)}")
        if cause.confounded_with:
            print(f"      looks much like: {', '.join(f'{n} ({c:.2f})' for n, c in cause.confounded_with.items())}")
        if cause.separate_by:
            print(f"      to separate them: {cause.separate_by}")
    for rival in found.rivals:
        print(f"  can't be excluded: {' and '.join(rival)}")
    if found.lives_in:
        where = ", ".join(f"{place} ({share:.0%})" for place, share in found.lives_in.items())
        print(f"  what is left lives in: {where}")
    for place, suggestion in found.suggestions.items():
        print(f"  {place}: {suggestion}")
    for note in found.notes:
        print(f"  note: {note}")
    for path in written:
        print(f"  written: {path / 'report.html' if path.is_dir() else path}")


# --- `--rig`: captures taken one by one, each chosen by what is still open ---


def add_rig_options(parser: argparse.ArgumentParser) -> None:
    """Adds --rig and what belongs to it."""
    group = parser.add_argument_group("captures that are taken, in place of a file")
    add_input(group, "--rig", metavar="RIG.toml", help="take captures with this rig until the cause is certain")
    add_output(group, "-o", "--save", metavar="FILE.h5", suffix=".h5", help="keep the captures; a loop goes on there")
    add_fields(group, LoopSettings, *fields_by_key(LoopSettings))


def check_rig_options(args: argparse.Namespace) -> None:
    """Raises UserError unless either a file or a rig is given, with options that belong to it."""
    if (args.file is None) == (args.rig is None):
        found = "both are given" if args.rig is not None else "neither is given"
        raise UserError("CAPTURES.h5 or --rig", found, expected="one of them")
    settings = given_fields(args, LoopSettings)
    flags = [flag_of(field) for field in fields_by_key(LoopSettings).values() if field.name in settings]
    if args.rig is None and (flags := ["--save"] * (args.save is not None) + flags):
        raise UserError(flags[0], "is of captures that are taken", expected="--rig RIG.toml with it")
    if args.rig is not None and args.preset is not None:
        raise UserError("--preset", "together with --rig", remedy="state the geometry in rig.toml")
