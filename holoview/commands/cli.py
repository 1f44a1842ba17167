"""Entry point of the command line: parses arguments, runs a subcommand, and reports a user's mistake in one line."""

from __future__ import annotations

import argparse
import re
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any, NoReturn

from holoview.commands.console import EXIT_USER_ERROR, console_streams
from holoview.commands.output_files import LOCKS, check_files
from holoview.util.errors import UserError
from holoview.util.file_writer import OutputLocks
from holoview.util.memory_limit import memory_setting
from holoview.util.packages import __version__
from holoview.util.processes import exit_code_of, garbage_kept, handled_signals, raise_interrupted, share_the_machine

COMMANDS = {
    "presets": "list the presets, a line each",
    "info": "show the derived numbers of a preset",
    "view": "see, scrub, compare and optimise in a window",
    "render": "render what an observer sees, to PNG",
    "optimise": "find patterns and laser amplitudes for a picture",
    "export": "write a hologram's patterns as PNG",
    "rig": "show, test and align a rig of real or virtual devices",
    "measure": "take captures with a rig of real or virtual devices",
    "captures": "make, check, show and import measured captures",
    "diagnose": "name what the simulation of a measured bench gets wrong",
    "calibrate": "learn a bench from captures, or a modulator's table",
    "effects": "list what benches do, and check an effect of your own",
    "conformance": "check the propagation of light on cases with known answers",
    "bench": "measure how fast frames and edits are, beside torch",
    "sweep": "measure against any parameter, and find tolerances",
    "study": "make a figure of the paper again, with its numbers",
    "focus": "find the distance at which a hologram is sharpest",
    "point": "show the light at a point, along the axis, and where it is from",
    "compare": "score a hologram and its views beside a reference, as JPEG Pleno does",
    "contrast": "measure the speckle contrast of a picture or bench",
    "report": "write a report on holograms for a reviewer, with its numbers",
    "demo": "make and show a hologram of the shipped picture",
}
"""Each command, which is a module of `holoview.commands`, with its line in the help."""

ALIASES = {"optimize": "optimise"}


class _Parser(argparse.ArgumentParser):
    """Reads "-1mm" as a value rather than an option, and raises wrong usage as UserError."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def error(self, message: str) -> NoReturn:
        raise UserError("", message, remedy=f"see `{self.prog} --help`")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `holoview` with these arguments, of this process if None, and returns its exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    share_the_machine()
    with console_streams() as (output, _):
        code = _run(words)
        output.flush()
        if output.error is not None and not isinstance(output.error, BrokenPipeError):  # as with `holoview … | head -1`
            return _report_error(f"output: {output.error.strerror}")
    return code


def _run(words: list[str]) -> int:
    """Carries out the command; an error is one line on stderr."""
    try:
        with handled_signals(raise_interrupted), OutputLocks() as locks:
            with garbage_kept():  # imports leave none, and looking for it takes a tenth of their time
                args = _parser(words[0] if words else "").parse_args(words)
            setattr(args, LOCKS, locks)
            args.words = words
            check_files(args)
            with memory_setting(getattr(args, "memory", None)):
                code: int = args.run(args)
            return code
    except UserError as error:
        return _report_error(str(error))
    except KeyboardInterrupt as error:
        code = exit_code_of(error)
        name = "" if code == 128 + signal.SIGINT else f" by {error}"
        print(f"holoview: interrupted{name}", file=sys.stderr)
        return code
    except OSError as error:
        return _report_error(f"{error.filename or 'file'}: {error.strerror or error}")
    except (MemoryError, RuntimeError) as error:
        if not (isinstance(error, MemoryError) or "can't allocate memory" in str(error)):
            raise
        return _report_error("memory: not enough for a grid of this size; choose a smaller shape, upsample or frames")


def _report_error(message: str) -> int:
    """Prints a message as one line to stderr; returns the exit code."""
    print(f"holoview: {' '.join(message.splitlines())}", file=sys.stderr)
    return EXIT_USER_ERROR


def _parser(chosen: str) -> argparse.ArgumentParser:
    """The parser. Only the chosen command's module is imported, so that `holoview --help` starts fast."""
    parser = _Parser(
        prog="holoview",
        description="Interactive hologram previewer for polychromatic, dual-modulator displays.",
        epilog="Start with `holoview demo`.",
    )
    parser.add_argument("--version", action="version", version=f"holoview {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, summary in COMMANDS.items():
        aliases = [alias for alias, command_name in ALIASES.items() if command_name == name]
        command = commands.add_parser(name, help=summary, aliases=aliases)
        if chosen in (name, *aliases):
            module = import_module(f"holoview.commands.{name}")
            command.description = module.__doc__
            command.set_defaults(run=module.run)
            module.configure(command)
            _add_memory(command)
    return parser


def _add_memory(command: argparse.ArgumentParser) -> None:
    """Adds --memory to a command, or to each command within it."""
    nested = [action for action in command._actions if isinstance(action, argparse._SubParsersAction)]
    for inner in (parser for action in nested for parser in action.choices.values()):
        _add_memory(inner)
    if not nested:
        command.add_argument(
            "--memory",
            metavar="SIZE",
            help="the most memory to take in all, e.g. 8GB (default: three quarters of what is free)",
        )


if __name__ == "__main__":
    sys.exit(main())
