"""The command line: parses, dispatches, and turns a user's mistake into one clear line and exit code 2."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

from holoview import __version__
from holoview.commands import demo, info, optimise, presets, render
from holoview.errors import UserError

INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `holoview` with the arguments (those of the process when None) and returns its exit code."""
    args = _parser().parse_args(arguments)
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


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="holoview",
        description="Interactive hologram previewer for polychromatic, dual-modulator displays.",
        epilog="Start with `holoview demo`.",
    )
    parser.add_argument("--version", action="version", version=f"holoview {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in (presets, info, render, optimise, demo):
        command.add_parser(commands)
    return parser


if __name__ == "__main__":
    sys.exit(main())
