"""`holoview presets`: lists the presets that come with holoview, with a line of description each."""

from __future__ import annotations

import argparse

from holoview.commands.console import print_json
from holoview.light.model import preset


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    parser.add_argument("--json", action="store_true", help="machine-readable output")


def run(args: argparse.Namespace) -> int:
    """Prints name and description of every shipped preset."""
    descriptions = {name: preset.load(name).description for name in preset.names()}
    if args.json:
        print_json(descriptions)
        return 0
    width = max(map(len, descriptions))
    for name, description in descriptions.items():
        print(f"{name:<{width}}  {description}")
    return 0
