"""The command line: parses, dispatches, and turns a user's mistake into one clear line and exit code 2."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from importlib import import_module

from holoview import __version__
from holoview.errors import UserError

INTERRUPTED = 130
COMMANDS = {
    "presets": "list the presets, a line each",
    "info": "show the derived numbers of a preset",
    "render": "render what an observer sees, to PNG",
    "optimise": "find patterns and laser amplitudes for a picture",
    "demo": "make and show a hologram of the shipped picture",
}
ALIASES = {"optimize": "optimise"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `holoview` with the arguments (those of the process when None) and returns its exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    args = _parser(given[0] if given else "").parse_args(given)
    try:
        code: int = args.run(args)
        sys.stdout.flush()
    except UserError as error:
        print(f"holoview: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("holoview: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # e.g. `holoview presets | head -1`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return code


def _parser(chosen: str) -> argparse.ArgumentParser:
    """The parser; only the chosen command's module is imported, so that help and lists come at once."""
    parser = argparse.ArgumentParser(
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
