"""The command line: parses, dispatches, and turns a user's mistake into one clear line and exit code 2."""

from __future__ import annotations

import argparse
import io
import os
import re
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any, NoReturn

from holoview.commands.exit_codes import EXIT_INTERRUPTED, EXIT_USER_ERROR
from holoview.util.errors import UserError
from holoview.util.version import __version__

COMMANDS = {
    "presets": "list the presets, a line each",
    "info": "show the derived numbers of a preset",
    "view": "see, scrub, compare and optimise in a window",
    "render": "render what an observer sees, to PNG",
    "optimise": "find patterns and laser amplitudes for a picture",
    "export": "write a hologram's patterns as PNG",
    "captures": "make, check, show and import measured captures",
    "diagnose": "name what the simulation of a measured bench gets wrong",
    "calibrate": "learn a bench from captures, or a modulator's table",
    "bench": "measure how fast frames and edits are, beside torch",
    "study": "make a figure of the paper again, with its numbers",
    "contrast": "measure the speckle contrast of a picture or bench",
    "demo": "make and show a hologram of the shipped picture",
}
ALIASES = {"optimize": "optimise"}


class _Parser(argparse.ArgumentParser):
    """Takes "-1mm" for a value rather than an option, and refuses wrong usage in one line like any other mistake."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def error(self, message: str) -> NoReturn:
        raise UserError("", message, remedy=f"see `{self.prog} --help`")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `holoview` with the arguments (those of the process when None) and returns its exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # "étendue" on a terminal that has no é
    try:
        args = _parser(given[0] if given else "").parse_args(given)
        code: int = args.run(args)
        sys.stdout.flush()
    except UserError as error:
        return _refuse(str(error))
    except KeyboardInterrupt:
        print("holoview: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # e.g. `holoview presets | head -1`
        _drop_output()
        return 0
    except OSError as error:
        if error.filename is None:  # standard output itself, e.g. on a full disk
            _drop_output()
        return _refuse(f"{error.filename or 'output'}: {error.strerror or error}")
    except (MemoryError, RuntimeError) as error:
        if not (isinstance(error, MemoryError) or "can't allocate memory" in str(error)):
            raise
        return _refuse("memory: not enough for a grid of this size; choose a smaller shape, upsample or frames")
    return code


def _refuse(message: str) -> int:
    """Says in one line why nothing was done."""
    print(f"holoview: {' '.join(message.splitlines())}", file=sys.stderr)
    return EXIT_USER_ERROR


def _drop_output() -> None:
    """Lets Python's flush at exit succeed though nobody reads what is left."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _parser(chosen: str) -> argparse.ArgumentParser:
    """The parser; only the chosen command's module is imported, so that help and lists come at once."""
    parser = _Parser(
        prog="holoview",
        description="Interactive hologram previewer for polychromatic, dual-modulator displays.",
        epilog="Start with `holoview demo`.",
    )
    parser.add_argument("--version", action="version", version=f"holoview {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, summary in COMMANDS.items():
        aliases = [alias for alias, meant in ALIASES.items() if meant == name]
        command = commands.add_parser(name, help=summary, aliases=aliases)
        if chosen in (name, *aliases):
            module = import_module(f"holoview.commands.{name}")
            command.description = module.__doc__
            command.set_defaults(run=module.run)
            module.configure(command)
    return parser


if __name__ == "__main__":
    sys.exit(main())
