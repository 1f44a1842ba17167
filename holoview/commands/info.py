"""`holoview info PRESET`: the numbers that a bench implies."""

from __future__ import annotations

import argparse
import json
from itertools import groupby

from holoview.commands.arguments import add_system, system_from_args
from holoview.commands.system_info import info_rows
from holoview.model import preset


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_system(parser)
    shown = parser.add_mutually_exclusive_group()
    shown.add_argument("--json", action="store_true", help="machine-readable output")
    shown.add_argument("--toml", action="store_true", help="the whole preset, to start your own from")


def run(args: argparse.Namespace) -> int:
    """Prints the facts under their headings."""
    system = system_from_args(args)
    if args.toml:
        print(preset.dumps(system), end="")
        return 0
    derived = info_rows(system)
    if args.json:
        table: dict[str, dict[str, str]] = {}
        for fact in derived:
            table.setdefault(fact.heading, {})[fact.name] = fact.text
        print(json.dumps(table, indent=2, ensure_ascii=False))
        return 0
    print(f"{system.name}: {system.description}")
    for heading, group in groupby(derived, key=lambda fact: fact.heading):
        print(f"\n{heading}")
        for fact in group:
            print(f"  {fact.name:<32}  {fact.text}")
    return 0
