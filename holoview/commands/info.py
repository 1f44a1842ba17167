"""`holoview info PRESET|FILE…`: the known properties of a hologram's file, and numbers that follow from its bench.

Cut-offs, sampling, diffraction angles, limits of the model, memory; of a hologram, where its light went.
"""

from __future__ import annotations

import argparse
import math
from itertools import groupby
from typing import Any

from holoview.commands.arguments import add_changes, add_effects
from holoview.commands.console import print_json, print_stderr
from holoview.commands.hologram_files import NAMES_HELP, ShownSystem, add_field_options, shown_by_args
from holoview.commands.output_files import add_input, add_output, check_files
from holoview.holograms.optimise.memory import peak_bytes
from holoview.holograms.view import simulate
from holoview.light.engine.light_budget import place_words, told_light
from holoview.light.model import preset
from holoview.light.model.bench_drawing import draw_bench
from holoview.light.model.derived_numbers import info_rows
from holoview.light.model.field_band import edge_power
from holoview.light.model.focus import focused_planes
from holoview.light.model.plan import make_plan
from holoview.light.model.validity import LightFigures
from holoview.util.drawing import as_png, as_svg
from holoview.util.errors import UserError
from holoview.util.file_writer import write_file

_DRAWN = (".svg", ".png")
_MOST_SUMMED = 1 << 24  # samples of all wavelengths and frames: about ten seconds
_LEAST_TOLD = 5e-5  # a share that would be printed as 0.00 %


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(parser, "names", nargs="+", metavar="PRESET|FILE", help=NAMES_HELP)
    add_changes(parser)
    add_effects(parser, dest="switched_on")
    add_field_options(parser, has_plane=False)
    add_output(parser, "--draw", metavar="FILE", suffix="", help="draw the bench, as .svg or .png")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="machine-readable output")
    form.add_argument("--toml", action="store_true", help="the whole preset, to start your own from")


def run(args: argparse.Namespace) -> int:
    """Prints the numbers under their headings, or as JSON, or the whole preset as TOML."""
    if args.draw is not None and args.draw.suffix.lower() not in _DRAWN:
        raise UserError(f"--draw {args.draw}", f'the suffix "{args.draw.suffix}"', expected=" or ".join(_DRAWN))
    check_files(args, {"--draw": [args.draw]} if args.draw is not None else {})
    shown = shown_by_args(args)
    system = shown.system
    if args.draw is not None:
        drawing = draw_bench(system)
        is_svg = args.draw.suffix.lower() == ".svg"
        write_file(args.draw, as_svg(drawing).encode() if is_svg else as_png(drawing))
        print_stderr(f"{args.draw}: the bench, its distances as written")
    if args.toml:
        print(preset.dumps(system), end="")
        return 0
    light, (passed, went) = _light(shown), _budget(shown)
    rows = info_rows(system, None if system.is_field or system.is_chain else peak_bytes(system), light)
    if args.json:
        table: dict[str, Any] = {}
        if shown.read:
            share = None if light.in_picture is None else round(light.in_picture, 9)
            table = {"read": shown.read, "light_in_picture": share}
        if went:
            table["light_budget"] = went
        if passed:
            table["light_behind"] = {name: round(share, 9) for name, share in passed.items()}
        for row in rows:
            table.setdefault(row.heading, {})[row.name] = row.text
        print_json(table)
        return 0
    print(": ".join(filter(None, (system.name, system.description))))
    if shown.read:
        print("\nread")
        for known in shown.read["properties"]:
            print(f"  {known['name']:<32}  {known['value']} ({known['origin']}: {known['reason']})")
    for heading, group in groupby(rows, key=lambda row: row.heading):
        print(f"\n{heading}")
        for row in group:
            print(f"  {row.name:<32}  {row.text}")
    if passed:
        print("\nlight that is left behind each element")
        for name, share in passed.items():
            print(f"  {name:<46}  {share:.2%}")
    if went:
        print("\nwhere the light went (middle plane)")
        for place, share in went.items():
            if share > _LEAST_TOLD:
                print(f"  {place_words(place, is_chain=system.is_chain):<46}  {share:.2%}")
    return 0


def _budget(shown: ShownSystem) -> tuple[dict[str, float], dict[str, float]]:
    """The light of a hologram at its middle plane: left behind each element of a chain, and where it goes, by place.

    Nothing of a preset, without light, or where the hologram is large.
    """
    system = shown.system
    if shown.drive is None:
        return {}, {}
    samples = math.prod(system.way.shape) * len(system.wavelengths_m) * system.frames
    if (samples if system.is_chain else shown.drive.size) > _MOST_SUMMED:
        return {}, {}
    planes_m = focused_planes(system)
    return told_light(make_plan(system, planes_m[len(planes_m) // 2 :][:1]), shown.drive)


def _light(shown: ShownSystem) -> LightFigures:
    """The light of a field in the picture of its middle plane, and at the edge of its band; unknown of other benches.

    It takes a simulation of the plane; a field of more than `_MOST_SUMMED` numbers isn't summed.
    """
    if not shown.system.is_field:
        return LightFigures()
    planes_m = focused_planes(shown.system)
    plane_m = float(planes_m[len(planes_m) // 2])
    at_edge = edge_power(shown.drive) if plane_m else None  # at 0 nothing propagates
    if shown.drive.size > _MOST_SUMMED:
        return LightFigures(at_edge=at_edge)
    view = simulate(shown.system, shown.drive, [plane_m], backend="torch")
    share = math.nan if view.light is None else float(view.light.by_plane[0]) * shown.light
    return LightFigures(None if math.isnan(share) else share, plane_m, at_edge)
