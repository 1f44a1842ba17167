"""`holoview info PRESET`: prints numbers that follow from a bench: cut-offs, sampling, diffraction angles, memory."""

from __future__ import annotations

import argparse
from itertools import groupby

from holoview.commands.arguments import add_system, system_from_args
from holoview.commands.console import print_json
from holoview.commands.system_info import info_rows
from holoview.model import preset


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_system(parser)
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="machine-readable output")
    form.add_argument("--toml", action="store_true", help="the whole preset, to start your own from")


def run(args: argparse.Namespace) -> int:
    """Prints the numbers under their headings, or as JSON, or the whole preset as TOML."""
    system = system_from_args(args)
    if args.toml:
        print(preset.dumps(system), end="")
        return 0
    rows = info_rows(system)
    if args.json:
        table: dict[str, dict[str, str]] = {}
        for row in rows:
            table.setdefault(row.heading, {})[row.name] = row.text
        print_json(table)
        return 0
    print(f"{system.name}: {system.description}")
    for heading, group in groupby(rows, key=lambda row: row.heading):
        print(f"\n{heading}")
        for row in group:
            print(f"  {row.name:<32}  {row.text}")
    return 0
