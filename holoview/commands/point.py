"""`holoview point PRESET|FILE…`: the light at a point of the image, sections through it, and where it comes from.

Lasers, diffraction orders, directions, and areas of the modulators that light the point.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holoview.commands.arguments import add_changes, add_effects, parse_range, parse_samples, parse_seed, whole
from holoview.commands.console import print_json, progress_bar
from holoview.commands.hologram_files import NAMES_HELP, add_field_options, shown_by_args
from holoview.commands.output_files import ResultSaver, add_input, add_output, check_files, check_suffix
from holoview.holograms.files.pictures import path_with_suffix, write_png
from holoview.holograms.view import point_light, random_drive, sections
from holoview.light.colour import fitting_stops, to_srgb8, xyz_to_linear_srgb
from holoview.light.model.focus import focused_planes, parse_plane, plane_label
from holoview.light.model.system import System
from holoview.util import units
from holoview.viewer.document.focus_edits import focus_range_m
from holoview.viewer.render.point_probe import SECTION_PLANES
from holoview.viewer.render.tone_mapping import by_decades, in_own_units

if TYPE_CHECKING:
    from holoview.light.engine.point_light import PointLight

_MOST_ORDERS = 9  # that are printed


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(parser, "names", nargs="+", metavar="PRESET|FILE", help=NAMES_HELP)
    add_changes(parser)
    add_effects(parser, dest="switched_on")
    parser.add_argument("--random", metavar="SEED", type=parse_seed, default=0, help="of a preset's random patterns")
    parser.add_argument("--at", metavar="X,Y", help="sample of the image from the upper left; the middle if absent")
    parser.add_argument("--plane", metavar="DISTANCE", help="focal plane; the middle one if absent")
    parser.add_argument(
        "--range", metavar="A,B", help="distances of the sections, e.g. 8,12mm; as the viewer if absent"
    )
    parser.add_argument(
        "--window", metavar="N", type=whole(2), default=64, help="samples across the window of the directions (64)"
    )
    add_output(
        parser,
        "-o",
        "--output",
        metavar="PNG",
        suffix="",
        help="also pictures: OUT-x-z.png and OUT-y-z.png (z to the right), OUT-directions.png, OUT-areas-1.png …",
    )
    parser.add_argument("--json", action="store_true", help="machine-readable output")
    add_field_options(parser)


def run(args: argparse.Namespace) -> int:
    """Prints the light of the point, and writes the pictures if asked."""
    shown = shown_by_args(args)
    system = shown.system
    drive = random_drive(system, args.random) if shown.drive is None else shown.drive
    planes_m = focused_planes(system)
    plane_m = float(planes_m[len(planes_m) // 2])
    if args.plane is not None:
        plane_m = parse_plane(system, args.plane, "--plane")
    at = None if args.at is None else _parse_sample(args.at)
    low_m, high_m = focus_range_m(system) if args.range is None else parse_range(args.range, "--range")
    names = ("x-z", "y-z", "directions", *(f"areas-{n}" for n in range(1, len(system.drive_shapes) + 1)))
    paths: list[Path] = []
    if args.output is not None:
        check_suffix(args.output, ".png")
        paths = [path_with_suffix(args.output, name) for name in names]
        check_files(args, {"-o": paths})
    with progress_bar("the light of the point") as progress:
        light = point_light(
            system, drive, at=at, plane=plane_m, window=args.window, progress=lambda n, of: progress(n, of, "‰")
        )
    saver, files = ResultSaver(), []
    if paths:
        for path, picture in zip(paths, _pictures(system, drive, light, low_m, high_m), strict=True):
            files.append(
                str(saver.save(path, partial(write_png, pixels=picture, texts={"holoview.preset": system.name})))
            )
    result = _as_json(light, plane_label(system, plane_m), (low_m, high_m) if paths else None)
    if args.json:
        print_json(result | {"files": files} | ({"read": shown.read} if shown.read else {}))
    else:
        print("\n".join([*_format(result), *files]))
    return saver.exit_code


def _parse_sample(text: str) -> tuple[int, int]:
    """Row and column of a sample that is given as X,Y. Raises UserError for other texts."""
    column, row = parse_samples(text, 2, "--at", "x,y in whole samples from the upper left, e.g. 640,384")
    return row, column


def _pictures(
    system: System, drive: NDArray[Any], light: PointLight, low_m: float, high_m: float
) -> list[NDArray[np.uint8]]:
    """8-bit sRGB of both sections, the directions, and the areas of each modulator."""
    with progress_bar("sections") as progress:
        found = sections(
            system,
            drive,
            planes=np.linspace(low_m, high_m, SECTION_PLANES).tolist(),
            at=light.place,
            progress=lambda done, of: progress(done, of, "planes"),
        )
    factor = 2.0 ** fitting_stops(np.concatenate([found.xz, found.yz], axis=1))
    along = [np.swapaxes(picture, 0, 1) * factor for picture in (found.xz, found.yz)]
    own = [by_decades(light.directions), *(in_own_units(area) for area in light.areas)]
    return [to_srgb8(xyz_to_linear_srgb(xyz)) for xyz in (*along, *own)]


def _as_json(light: PointLight, plane: str, range_m: tuple[float, float] | None) -> dict[str, Any]:
    total = float(light.intensities.sum()) or 1.0
    row, column = light.place
    lasers = [
        {"wavelength_m": float(λ), "intensity": float(intensity), "share": float(intensity) / total}
        for λ, intensity in zip(light.wavelengths_m, light.intensities, strict=True)
    ]
    orders = [
        {"y": y, "x": x, "share": share} for (y, x), share in sorted(light.orders.items(), key=lambda o: -abs(o[1]))
    ]
    table: dict[str, Any] = {"x": column, "y": row, "plane": plane, "xyz": light.xyz.tolist()}
    table |= {"lasers": lasers, "orders": orders, "frequency_step": light.frequency_step}
    return table if range_m is None else table | {"range_m": list(range_m)}


def _format(result: dict[str, Any]) -> list[str]:
    lasers = [f"{units.format_rounded(each['wavelength_m'], 'nm')} {each['share']:.1%}" for each in result["lasers"]]
    orders = [f"({each['y']}, {each['x']}) {each['share']:.1%}" for each in result["orders"][:_MOST_ORDERS]]
    return [
        f"x {result['x']}, y {result['y']} at {result['plane']}: luminance {result['xyz'][1]:.4g}",
        f"lasers: {', '.join(lasers)}",
        f"orders (y, x): {', '.join(orders)}",
    ]
