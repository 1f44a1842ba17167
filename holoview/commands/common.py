"""Arguments and messages that several subcommands share."""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from holoview.model import preset
from holoview.model.effects.active_effects import ActiveEffects
from holoview.model.effects.effect_table import EffectTable
from holoview.model.effects.registry import load_user_effects
from holoview.model.scheme import with_scheme
from holoview.model.system import System
from holoview.util.errors import UserError

ProgressCallback = Callable[[int, int, str], None]
_LINE_INTERVAL_S = 10.0
_LARGEST_SEED = 2**63 - 1


def add_system(parser: argparse.ArgumentParser, *, optional: bool = False, effects: bool = True) -> None:
    """PRESET, --scheme and --set KEY=VALUE; with `effects` also --effects, which `system_of` switches on."""
    parser.add_argument(
        "preset", nargs="?" if optional else None, help="a preset's name (see `holoview presets`) or a TOML file"
    )
    add_changes(parser)
    if effects:
        add_effects(parser, dest="switched_on")


def add_changes(parser: argparse.ArgumentParser) -> None:
    """--scheme and --set KEY=VALUE."""
    parser.add_argument(
        "--scheme",
        metavar="NAME",
        help="drive the bench by a colour scheme: simultaneous, time-sequential, multiplexed, holochrome-8x3, and "
        "+multisource-3x3, +1slm; before --set",
    )
    parser.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        dest="changes",
        help='change the bench, e.g. --set gap="3 mm" --set relay2.iris_na=0.02; several may be given',
    )


def add_effects(parser: argparse.ArgumentParser, dest: str = "effects") -> None:
    """--effects: values of effects, and files of the user's own."""
    parser.add_argument(
        "--effects",
        dest=dest,
        metavar="NAME.KEY=VALUE|FILE.py",
        nargs="+",
        action="extend",
        default=[],
        help='e.g. gap.gap_error="0.1 mm" crosstalk.sigma=0.4; a Python file that defines effects of your own is run',
    )


def parse_effects(texts: list[str]) -> dict[str, dict[str, float]]:
    """The values that --effects states, {id: {parameter: SI value}}; files are run first, and it says so."""
    files = [text for text in texts if text.endswith(".py") and "=" not in text]
    for file in files:
        print_stderr(f"running {file} for its effects")
        load_user_effects(file)
    changes = dict(_parse_assignment(text, "--effects", "gap.gap_error=0.1mm") for text in texts if text not in files)
    kind = EffectTable()
    return {name: dict(pairs) for name, pairs in kind.with_changes((), changes, "--effects")}


def add_backend(parser: argparse.ArgumentParser) -> None:
    """--backend and --adapter."""
    parser.add_argument(
        "--backend", default="auto", help="wgpu (WGSL shaders), torch, torch64, or auto: wgpu where an adapter is found"
    )
    parser.add_argument("--adapter", metavar="NAME", help="part of the name of the WebGPU adapter to use")


def parse_seed(text: str) -> int:
    """The whole number of --random or --seed."""
    if not text.strip().isdecimal() or int(text) > _LARGEST_SEED:
        raise argparse.ArgumentTypeError(f"{text}; expected a whole number from 0 to {_LARGEST_SEED}")
    return int(text)


def check_output_file(path: Path, suffix: str) -> None:
    """Refuses a file that couldn't be written later, before any time is spent on what goes into it."""
    if path.suffix.lower() != suffix:
        raise UserError(str(path), f'the suffix "{path.suffix}"', expected=suffix)
    if path.is_dir():
        raise UserError(str(path), "is a folder", expected=f"the name of a {suffix} file to write")
    if not path.parent.is_dir():
        raise UserError(str(path), f"the folder {path.parent} doesn't exist", remedy="create it or choose another")
    try:
        tempfile.TemporaryFile(dir=path.parent).close()
    except OSError as error:
        raise UserError(str(path), f"can't be written: {error.strerror}", remedy="choose another folder") from error


def check_folder(path: Path) -> None:
    """Refuses a file where a folder is to be, before any time is spent on what goes into it."""
    if path.exists() and not path.is_dir():
        raise UserError(
            str(path), "can't be made: it is a file", expected="a folder to write to", remedy="choose another folder"
        )


def make_folder(path: Path) -> None:
    """Makes a folder to write to, if it is missing."""
    check_folder(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(str(path), f"can't be made: {error.strerror}", remedy="choose another folder") from error


def check_adapter_applies(args: argparse.Namespace) -> None:
    """Refuses an adapter for a backend that has none, rather than leave it aside silently."""
    if args.adapter is not None and args.backend.startswith("torch"):
        raise UserError("--adapter", f"with --backend {args.backend}", expected="--backend wgpu or auto")


def system_from_args(args: argparse.Namespace) -> System:
    """The preset, driven by --scheme, with the changes of --set and the effects of --effects."""
    effects = parse_effects(getattr(args, "switched_on", []))  # first: the preset may hold effects of one's own
    system = with_effects(preset.load(args.preset), effects)
    return with_changes(system if args.scheme is None else with_scheme(system, args.scheme), args.changes)


def with_effects(system: System, effects: dict[str, dict[str, float]]) -> System:
    """A system with effects switched on beside those that it has."""
    changes = {f"effects.{name}.{key}": value for name, table in effects.items() for key, value in table.items()}
    return system.edit(changes) if changes else system


def warn_of_camera_effects(system: System) -> None:
    """Says which of the bench's effects change what a camera records and nothing that is shown here."""
    if not system.effects:
        return
    if camera := [one.id for one in ActiveEffects(system.effect_values).camera_effects()]:
        print_stderr(f"note: {', '.join(camera)} belong to the camera that took captures; eyes don't look through it")


def with_changes(system: System, changes: list[str]) -> System:
    """A system with KEY=VALUE texts applied together; the value is TOML where it parses as such, else plain text."""
    return system.edit(dict(_parse_assignment(change) for change in changes)) if changes else system


def _parse_assignment(change: str, flag: str = "--set", example: str = 'gap="3 mm"') -> tuple[str, Any]:
    key, equals, value = change.partition("=")
    if not equals or not key.strip():
        raise UserError(f"{flag} {change}", "isn't KEY=VALUE", expected=f"e.g. {flag} {example}")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()


def print_stderr(text: str) -> None:
    """A line for people: to stderr, so that stdout stays clean for --json."""
    print(text, file=sys.stderr, flush=True)


def _line_progress(title: str) -> ProgressCallback:
    next_line = time.monotonic() + _LINE_INTERVAL_S

    def report(done: int, total: int, note: str = "") -> None:
        nonlocal next_line
        if time.monotonic() >= next_line or done == total:
            print_stderr(f"{title}: {done}/{total} {note}".rstrip())
            next_line = time.monotonic() + _LINE_INTERVAL_S

    return report


@contextmanager
def deferred_interrupt() -> Iterator[Callable[[], bool]]:
    """Ctrl-C makes the yielded function true, so that a loop can end between two steps; a second one interrupts."""
    asked = False

    def ask(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True
        print_stderr("stopping after this iteration; press Ctrl-C again to stop at once")

    before = signal.signal(signal.SIGINT, ask)
    try:
        yield lambda: asked
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def progress_bar(title: str) -> Iterator[ProgressCallback]:
    """A bar on stderr while the block runs; call the yielded function with (done, total, note).

    Where stderr is no terminal, a line every ten seconds instead.
    """
    console = Console(stderr=True)
    if not console.is_terminal:
        yield _line_progress(title)
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=30),
        TextColumn("{task.completed:.0f}/{task.total:.0f}"),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(title, total=1, note="")

        def report(done: int, total: int, note: str = "") -> None:
            bar.update(task, completed=done, total=total, note=note)

        yield report
