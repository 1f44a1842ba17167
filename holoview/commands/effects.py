"""`holoview effects list | check | new`: all effects, whether one of your own works, a file of one to start from."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from holoview.commands.console import EXIT_FAILED, print_json
from holoview.commands.output_files import add_input, hold_outputs
from holoview.light.model.effects.registry import (
    element_effects,
    ids_beside,
    listed_effects,
    load_user_effects,
    read_user_effects,
)
from holoview.util.errors import UserError
from holoview.util.file_writer import check_writable, write_file
from holoview.util.files import data_dir

_MARKS = {True: "ok", False: "WRONG", None: "–"}


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the subcommands; `list` where none is given."""
    parser.set_defaults(run=_list, own=[], json=False)
    commands = parser.add_subparsers(metavar="COMMAND")
    shown = commands.add_parser("list", help="all effects, a line each", description=_list.__doc__)
    add_input(shown, "own", metavar="FILE.py", nargs="*", help="files of effects of your own; all their code is run")
    check = commands.add_parser("check", help="try the effects of a file", description=_check.__doc__)
    add_input(check, "file", metavar="FILE.py", help="a file of effects; all its code is run")
    new = commands.add_parser("new", help="a file of an effect to start from", description=_new.__doc__)
    new.add_argument("name", metavar="NAME", help="id of the effect; the file is NAME.py in the present folder")
    for command, run_it in ((shown, _list), (check, _check), (new, _new)):
        command.set_defaults(run=run_it)
    for command in (shown, check):
        command.add_argument("--json", action="store_true", help="machine-readable output")


def run(args: argparse.Namespace) -> int:
    """Never called: each subcommand sets its own `run`."""
    raise AssertionError


def _list(args: argparse.Namespace) -> int:
    """Lists the effects of the library, and those of the files that are given: id, what they act on, what is wrong."""
    for file in args.own:
        load_user_effects(file)
    on_elements = {name: effect for name, effect in element_effects().items() if not effect.acts_on}
    effects = {**listed_effects(), **on_elements}
    if args.json:
        print_json(
            {
                name: {
                    "cause": effect.cause,
                    "acts_on": list(effect.acts_on),
                    "elements": list(effect.element_kinds),
                    "hooks": list(effect.hooks),
                    "parameters": {p.name: p.unit for p in effect.parameters},
                }
                for name, effect in effects.items()
            }
        )
        return 0
    width = max(map(len, effects))
    places = {name: ", ".join(effect.acts_on or effect.element_kinds) for name, effect in effects.items()}
    wide = max(map(len, places.values()))
    for name, effect in effects.items():
        print(f"{name:<{width}}  {places[name]:<{wide}}  {effect.cause}")
    return 0


def _check(args: argparse.Namespace) -> int:
    """Tries the effects of a file on a tiny bench, and says what each check found; exits with 1 if one fails.

    Mistakes in the class; whether each hook is called and changes the pictures; that it changes no bit at its identity,
    and vanishes where its parameters come near it; derivatives by the parameters, and by the patterns; its finding and
    its starting points.
    """
    from holoview.bench.captures.effect_trial import try_effect  # slow start: it imports torch

    effects, _ = read_user_effects(args.file)
    found = {effect.id: try_effect(effect, str(args.file), ids_beside(effects)) for effect in effects}
    passed = {name: all(result.is_passed is not False for result in results) for name, results in found.items()}
    if args.json:
        checks = {
            name: [{"check": one.check, "passed": one.is_passed, "found": one.found} for one in results]
            for name, results in found.items()
        }
        print_json({"file": str(args.file), "passed": all(passed.values()), "effects": checks})
    else:
        for name, results in found.items():
            print(f"{name}: {'all is well' if passed[name] else 'something is wrong'}")
            width = max(len(result.check) for result in results)
            for result in results:
                print(f"  {_MARKS[result.is_passed]:<5}  {result.check:<{width}}  {result.found}")
    return 0 if all(passed.values()) else EXIT_FAILED


def _new(args: argparse.Namespace) -> int:
    """Writes NAME.py, a file of an effect that works, with comments, to start from; overwrites nothing."""
    name = args.name.removesuffix(".py")
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise UserError(f"effects new {args.name}", "isn't an id", expected="small letters, digits and _, such as haze")
    if name in listed_effects():
        raise UserError(f"effects new {name}", "is an effect of the library", expected="an id of its own")
    path = Path(f"{name}.py")
    if path.exists():
        raise UserError(str(path), "is there already", remedy="choose another name")
    check_writable(path)
    hold_outputs(args, [path])
    template = (data_dir("assets") / "effect.py.txt").read_text(encoding="utf-8")
    title = "".join(part.capitalize() for part in name.split("_"))
    write_file(path, template.replace("NAME", name).replace("CLASS", title))
    print(f"{path}; try it with `holoview effects check {path}`")
    return 0
