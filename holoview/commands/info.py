"""`holoview info PRESET|FILE…`: the known properties of a hologram's file, and numbers that follow from its bench.

Cut-offs, sampling, diffraction angles, limits of the model, memory.
"""

from __future__ import annotations

import argparse
from itertools import groupby
from typing import Any

from holoview.commands.arguments import add_changes, add_effects
from holoview.commands.console import print_json
from holoview.commands.hologram_files import NAMES_HELP, add_field_options, shown_by_args
from holoview.commands.output_files import add_input
from holoview.model import preset
from holoview.model.derived_numbers import info_rows
from holoview.optimise.memory import peak_bytes


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(parser, "names", nargs="+", metavar="PRESET|FILE", help=NAMES_HELP)
    add_changes(parser)
    add_effects(parser, dest="switched_on")
    add_field_options(parser, has_plane=False)
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="machine-readable output")
    form.add_argument("--toml", action="store_true", help="the whole preset, to start your own from")


def run(args: argparse.Namespace) -> int:
    """Prints the numbers under their headings, or as JSON, or the whole preset as TOML."""
    shown = shown_by_args(args)
    system = shown.system
    if args.toml:
        print(preset.dumps(system), end="")
        return 0
    rows = info_rows(system, None if system.is_field else peak_bytes(system))
    if args.json:
        table: dict[str, Any] = {"read": shown.read} if shown.read else {}
        for row in rows:
            table.setdefault(row.heading, {})[row.name] = row.text
        print_json(table)
        return 0
    print(f"{system.name}: {system.description}")
    if shown.read:
        print("\nread")
        for known in shown.read["properties"]:
            print(f"  {known['name']:<32}  {known['value']} ({known['origin']}: {known['reason']})")
    for heading, group in groupby(rows, key=lambda row: row.heading):
        print(f"\n{heading}")
        for row in group:
            print(f"  {row.name:<32}  {row.text}")
    return 0
