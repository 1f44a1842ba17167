"""The files that a command reads and writes: declared with its arguments, checked before any work, saved at the end.

Inputs that exist are regular files or folders: pipes and devices are refused before anything is read.
`cli` checks the arguments of every command (`check_files`). A command that derives further names from them, such as
that of each focal plane, checks these as soon as it knows them. No output may be one of the inputs or another output,
also by way of a link, and every output must be possible to write. From then on until the command ends, no other
holoview writes them (`OutputLocks`).
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from holoview.commands.console import EXIT_FAILED, print_stderr
from holoview.util.errors import UserError
from holoview.util.file_writer import OutputLocks, WriteError, check_writable, save_elsewhere
from holoview.util.files import read_text, refuse_special_file
from holoview.util.tables import parse_toml
from holoview.viewer.page.link import split_link

LOCKS = "output_locks"  # the destination of the command's `OutputLocks`
_FILES = "files"  # the destination in argparse's namespace of all `FileArgument`s
_TOGETHER = ({"--checkpoint", "--resume"}, {"--resume"})  # a run that goes on from a checkpoint goes on writing to it
_MAX_BASES = 30  # that are followed; no sensible preset is based on more


@dataclass(frozen=True)
class FileArgument:
    """An argument that names files: its destination in argparse's namespace, its flag, and what it is for.

    kind: "input", "output", "folder" (to write to) or "shared folder" (which several commands may write to at a time).
    suffix: required of an output; "" if the command checks it.
    """

    dest: str
    flag: str
    kind: str
    suffix: str = ""


def add_input(parser: argparse._ActionsContainer, *names: str, **options: Any) -> None:
    """Adds an argument with the name of a file to read, or several; or of a value such as a preset's name."""
    _declare(parser, parser.add_argument(*names, **options), "input")


def add_output(parser: argparse._ActionsContainer, *names: str, suffix: str, **options: Any) -> None:
    """Adds an argument with the name of a file to write, which must have this suffix, such as ".png".

    With the suffix "", the command itself knows what it may be, and checks it by `check_suffix` and `check_files`.
    """
    _declare(parser, parser.add_argument(*names, type=Path, **options), "output", suffix)


def add_output_folder(parser: argparse._ActionsContainer, *names: str, is_shared: bool = False, **options: Any) -> None:
    """Adds an argument with the name of a folder to write to; a missing folder is made.

    is_shared: several commands may write to it at a time.
    """
    _declare(parser, parser.add_argument(*names, type=Path, **options), "shared folder" if is_shared else "folder")


def _declare(parser: argparse._ActionsContainer, action: argparse.Action, kind: str, suffix: str = "") -> None:
    flag = action.option_strings[0] if action.option_strings else str(action.metavar or action.dest)
    declared: tuple[FileArgument, ...] = parser.get_default(_FILES) or ()
    parser.set_defaults(**{_FILES: (*declared, FileArgument(action.dest, flag, kind, suffix))})


def check_files(args: argparse.Namespace, derived: Mapping[str, Iterable[Path]] | None = None) -> None:
    """Raises UserError unless inputs are files or folders, and all outputs can be written, are neither inputs nor one
    another, and nobody writes them.

    derived: outputs by the flag that they follow from, in place of the argument's own value.
    """
    arguments: tuple[FileArgument, ...] = getattr(args, _FILES, ())
    given = [(argument, path) for argument in arguments for path in _paths(getattr(args, argument.dest))]
    for argument, path in given:
        if argument.kind == "input":
            refuse_special_file(split_link(path)[0])
    inputs = [
        (_name_of_input(argument, path, file), file)
        for argument, path in given
        if argument.kind == "input" and os.path.exists(path)  # noqa: PTH110 (it takes any name)
        for file in (path, *_named_by_preset(path))
    ]
    for argument, path in given:
        if argument.kind in ("folder", "shared folder"):
            check_folder(path)
        elif argument.suffix:
            check_suffix(path, argument.suffix)
    derived = derived or {}
    declared = [(argument.flag, path) for argument, path in given if argument.kind == "output"]
    outputs = [(flag, path) for flag, path in declared if flag not in derived]
    outputs += [(flag, path) for flag, paths in derived.items() for path in paths]
    left_to_command = {argument.flag for argument, _ in given if not argument.suffix} - derived.keys()
    for number, (flag, path) in enumerate(outputs):
        if flag not in left_to_command:
            check_writable(path)
        others = [(f"would overwrite {name}", name, other) for name, other in inputs]
        others += [(f"is the file of {name} too", name, other) for name, other in outputs[:number]]
        for found, name, other in others:
            if {flag, name} not in _TOGETHER and _is_same_or_inside(path, other):
                raise UserError(f"{flag} {path}", found, expected="a file of its own", remedy="choose another name")
    hold_outputs(args, [path for argument, path in given if argument.kind == "folder"])
    hold_outputs(args, [path for flag, path in outputs if flag not in left_to_command])


def hold_outputs(args: argparse.Namespace, paths: Iterable[Path]) -> None:
    """Keeps other programs from writing these files and folders until the command ends.

    Of processes that share one command (--sharded), the first holds them. Raises UserError if a program writes one now.
    """
    locks: OutputLocks | None = getattr(args, LOCKS, None)
    is_first = not getattr(args, "sharded", False) or os.environ.get("RANK", "0") == "0"
    if locks is not None and is_first:
        for path in paths:
            locks.hold(path)


def _name_of_input(argument: FileArgument, path: Path, file: Path) -> str:
    """The input as the user wrote it: by its flag, or by its name where it has none."""
    name = argument.flag if argument.flag.startswith("-") else str(path)
    return name if file == path else f"a file of {name}"


def _paths(value: Any) -> Iterator[Path]:
    """The paths of an argument's value: none, one or several."""
    for name in value if isinstance(value, list | tuple) else [value]:
        if isinstance(name, str | Path):
            yield Path(name)


def _named_by_preset(path: Path, depth: int = 0) -> Iterator[Path]:
    """The files that a preset names: the one that it is based on, and those of its effects; none for other files."""
    if path.suffix.lower() != ".toml" or depth > _MAX_BASES:
        return
    try:
        table = parse_toml(read_text(path, "a preset"), str(path), "a preset")
        effects = table.get("effects", {}).values()
        files = [path.parent / values["file"] for values in effects if isinstance(values, dict) and "file" in values]
        base = path.parent / table["base"] if str(table.get("base", "")).endswith(".toml") else None
    except (UserError, TypeError, AttributeError):
        return  # the command says what is wrong with it
    yield from files
    if base is not None and base.is_file():
        yield base
        yield from _named_by_preset(base, depth + 1)


def _is_same_or_inside(path: Path, other: Path) -> bool:
    """Whether two names mean one file, or `path` is one that is there already in the folder `other`."""
    with suppress(OSError):
        if path.exists() and other.exists():
            return path.samefile(other) or (other.is_dir() and path.parent.samefile(other))
    return os.path.normcase(os.path.realpath(path)) == os.path.normcase(os.path.realpath(other))


def check_suffix(path: Path, suffix: str, *others: str) -> None:
    """Raises UserError unless the path can be the name of a file with this suffix. others: named as fit, too."""
    if path.suffix.lower() != suffix:
        raise UserError(str(path), f'the suffix "{path.suffix}"', expected=" or ".join((suffix, *others)))
    if path.is_dir():
        raise UserError(str(path), "is a folder", expected=f"the name of a {suffix} file to write")


def check_folder(path: Path) -> None:
    """Raises UserError unless the folder can be written to, or made in the nearest folder above it that there is."""
    if os.path.lexists(path) and not path.is_dir():
        remedy = "choose another folder"
        raise UserError(str(path), "can't be made: it is a file", expected="a folder to write to", remedy=remedy)
    try:
        there = next((folder for folder in (path, *path.absolute().parents) if os.path.lexists(folder)), Path())
        tempfile.TemporaryFile(dir=there).close()
        with suppress(FileNotFoundError):
            path.lstat()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UserError(str(path), f"can't be written: {reason}", remedy="choose another folder") from error


class ResultSaver:
    """Saves the results of a command; a result that can't be written where it was wanted is kept at another place.

    exit_code: 0, or EXIT_FAILED once a result had to go elsewhere.
    """

    def __init__(self) -> None:
        self.exit_code = 0

    def save(self, path: Path, save: Callable[[Path], object]) -> Path:
        """Saves by `save(path)`; returns the path where it is. Raises WriteError if no place takes it."""
        try:
            save(path)
            return path
        except WriteError as error:
            kept = save_elsewhere(path, save)
            if kept is None:
                raise
            print_stderr(f"holoview: {error}")
            print_stderr(f"kept at another place: {kept}")
            self.exit_code = EXIT_FAILED
            return kept
