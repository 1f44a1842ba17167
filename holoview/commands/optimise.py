"""`holoview optimise PRESET TARGET`: patterns and laser amplitudes that show a target, as a hologram file."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from holoview.colour import to_srgb8
from holoview.commands.common import (
    Report,
    check_output,
    progress_bar,
    say,
    stopping_on_interrupt,
    system_of,
    warn_of_camera_effects,
)
from holoview.commands.optimise_options import Run, TargetSource, add_options, run_of, settings_of
from holoview.commands.optimise_score import in_words, scores_of
from holoview.errors import UserError
from holoview.hologram import Hologram
from holoview.optimise.memory import on_compact_grid
from holoview.optimise.settings import Settings
from holoview.optimise.solve import iterate
from holoview.optimise.state import State
from holoview.optimise.team import ALONE, Team, joined
from holoview.pictures import write_png
from holoview.system import System
from holoview.targets.focal_stack import Target

_PREVIEW_EVERY_S = 2.0


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_options(parser)


def run(args: argparse.Namespace) -> int:
    """Optimises, saves (also after Ctrl-C: the best so far), and scores on the preset's own grid."""
    system = system_of(args)
    warn_of_camera_effects(system)
    output = args.output or Path(f"{system.name or 'hologram'}-{Path(args.target).stem}.safetensors")
    check_output(output, ".safetensors")
    settings, how = settings_of(args, system), run_of(args)
    source = TargetSource(args, system)
    target = source.target()
    with joined(how.device) if how.sharded else nullcontext(ALONE) as team:
        found = solve(system, target, settings, how, team)
    if not team.leads:
        return 130 if found.interrupted else 0
    found.hologram.save(output)
    if found.interrupted:
        say(f"interrupted after iteration {found.state.iteration}: the best so far is kept in {output}")
        return 130
    _report(args, output, found, scores_of(found.hologram, source, settings.region))
    return 0


@dataclass(frozen=True)
class Found:
    """What an optimisation ended with; `interrupted` by Ctrl-C."""

    hologram: Hologram
    state: State
    interrupted: bool


_HERE = Run()


def solve(system: System, target: Target, settings: Settings, how: Run = _HERE, team: Team = ALONE) -> Found:
    """Runs the optimisation under a progress bar; Ctrl-C ends it with the best so far, for the whole team.

    On the grid "compact" it pads by the walk-off only; the hologram keeps the system's own sampling.
    """
    on = on_compact_grid(system) if how.grid == "compact" else system
    state: State | None = None
    start = None if how.start is None else how.start.drive
    interrupted = False
    with stopping_on_interrupt() as asked, _progress_of(system, team) as report:
        saved = shown = time.monotonic()
        for state in iterate(on, target.stack, settings, start, how.resume, device=how.device, team=team):
            report(state.iteration, state.iterations, _words(state))
            interrupted = team.any(asked())
            enough = interrupted or state.best_psnr_db >= how.until_psnr_db or team.any(state.seconds >= how.until_s)
            ends = enough or state.iteration == state.iterations
            now = time.monotonic()
            if team.leads and (ends or now - saved >= how.every_s):
                _write("checkpoint", how.checkpoint, state, lambda s, path: s.checkpoint().save(path))
                saved = now
            if team.leads and (ends or state.iteration == 0 or now - shown >= _PREVIEW_EVERY_S):
                _write("preview", how.preview, state, _write_preview)
                shown = now
            if enough:
                break
    if state is None:
        raise UserError("--resume", "the checkpoint is of a finished optimisation", expected="one with iterations left")
    best = state.best.system.edit({"propagation": system.sampling.propagation})
    return Found(Hologram(state.best.drive, best), state, interrupted)


def _progress_of(system: System, team: Team) -> AbstractContextManager[Report]:
    """A progress bar of the process that leads."""
    return progress_bar(f"optimising {system.name}") if team.leads else nullcontext(lambda done, total, note: None)


def _words(state: State) -> str:
    return f"loss {state.loss:.4g} PSNR {state.best_psnr_db:.2f} dB eyebox variation {state.eyebox:.2f}"


def _write(what: str, path: Path | None, state: State, write: Callable[[State, Path], None]) -> None:
    """A file on the way that can't be written is no reason to lose the optimisation: the one before stays."""
    if path is None:
        return
    try:
        write(state, path)
    except UserError as error:
        say(f"note: no {what} after iteration {state.iteration}: {error}")


def _write_preview(state: State, path: Path) -> None:
    texts = {"holoview.iteration": str(state.iteration), "holoview.psnr_db": f"{state.psnr_db:.2f}"}
    write_png(path, to_srgb8(state.picture()), texts)


def _report(args: argparse.Namespace, output: Path, found: Found, scores: dict[str, Any] | str) -> None:
    """What was written and how good it is."""
    state, system = found.state, found.hologram.system
    if isinstance(scores, str):
        say(f"note: {output} is saved but can't be scored: {scores}")
        scores = {}
    wavelengths = [round(float(λ) * 1e9, 3) for λ in system.wavelengths_m]
    if args.json:
        table = {"preset": system.name, "file": str(output), "iterations": state.iteration}
        table |= {"seconds": round(state.seconds, 2), "loss": state.loss, "wavelengths_nm": wavelengths}
        print(json.dumps(table | scores, indent=2))
        return
    print(f"{output}: {state.iteration} iterations in {state.seconds:.1f} s")
    if "wavelengths" in args.free:
        print(f"wavelengths {', '.join(f'{λ:.1f}' for λ in wavelengths)} nm")
    for line in in_words(scores, system):
        print(line)
    print(f"look at it: holoview render --hologram {output} -o seen.png")
