"""`holoview compare FILE… REFERENCE…`: scores a complex field and its views beside those of a reference.

Of two files of light that holoview wrote (.npz, .npy, .exr, .tif) it says whether they are equal, or how far apart.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from holoview.commands.arguments import parse_samples
from holoview.commands.console import print_json, print_stderr, progress_bar
from holoview.commands.hologram_files import add_field_options, request_from_args
from holoview.commands.output_files import add_input
from holoview.holograms.fields.synthetic_aperture import aperture_of
from holoview.holograms.fields.wavefield import Wavefield
from holoview.holograms.files.light_file import is_light_file, read_light
from holoview.holograms.files.request import Viewpoint, ViewpointType
from holoview.holograms.load_field import field_of_files
from holoview.holograms.metrics.fidelity import light_differences
from holoview.holograms.metrics.field_scores import check_alike, hologram_scores, scores_at
from holoview.util import units
from holoview.util.errors import UserError

_COLUMNS = {"psnr_db": "PSNR dB", "ssim": "SSIM", "vifp": "VIFp"}


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(
        parser,
        "names",
        metavar="FILE",
        nargs="+",
        help="a hologram and its reference; if their parts are in several files, first all of the hologram's, then as "
        "many of the reference",
    )
    several: dict[str, Any] = {"nargs": "+", "action": "extend"}
    parser.add_argument(
        "--plane",
        metavar="DISTANCE",
        **several,
        help="of the views, e.g. 10mm 11mm; the distance of the image if absent",
    )
    parser.add_argument("--resize", metavar="W,H", help="score the views at this size, by cubic convolution")
    parser.add_argument(
        "--percentiles",
        metavar="LOW,HIGH",
        default="0,100",
        help="of the reference's amplitude that become black and white (0,100)",
    )
    parser.add_argument("--json", action="store_true", help="machine-readable output")
    add_field_options(parser)


def run(args: argparse.Namespace) -> int:
    """Prints the scores in the plane of the hologram, and of the view at each plane from each viewpoint."""
    if len(args.names) == 2 and (light := [name for name in args.names if is_light_file(Path(name))]):
        if len(light) == 2:
            return _compare_light(args)
        (other,) = set(args.names) - set(light)
        remedy = "`holoview render HOLOGRAM -o light.npz` writes that of a hologram"
        raise UserError(other, f"isn't light that holoview wrote, as {light[0]} is", expected="both", remedy=remedy)
    field, reference = _fields(args)
    check_alike(field, reference)
    hologram, views = hologram_scores(field, reference), _view_scores(args, field, reference)
    if args.json:
        names = {"hologram": args.names[: len(args.names) // 2], "reference": args.names[len(args.names) // 2 :]}
        scores = {"hologram": _finite(hologram), "views": [_finite(view) for view in views]}
        print_json({"files": names, "what": reference.describe(), **scores})
        return 0
    print(f"{field.name} beside {reference.name}: {reference.describe()}")
    print(f"hologram: SNR {hologram['snr_db']:.2f} dB, SSIM {hologram['ssim']:.4f}")
    print(f"{'view at':<12}{'from':<16}" + "".join(f"{name:>10}" for name in _COLUMNS.values()))
    for view in views:
        cells = "".join(f"{view.get(name, math.nan):>10.4g}" for name in _COLUMNS)
        print(f"{units.format_rounded(view['plane_m'], 'mm'):<12}{view['viewpoint'] or 'the whole':<16}{cells}")
    return 0


def _compare_light(args: argparse.Namespace) -> int:
    """Prints how far the light of each plane is from that of a reference."""
    light, reference = (read_light(Path(name)) for name in args.names)
    if light.xyz.shape != reference.xyz.shape:
        found = f"light of shape {light.xyz.shape}"
        raise UserError(args.names[0], found, expected=f"{reference.xyz.shape}, as {args.names[1]} has")
    rows = light_differences(light, reference)
    if args.json:
        files = {"hologram": args.names[:1], "reference": args.names[1:]}
        print_json({"files": files, "planes": [_finite(row) for row in rows]})
        return 0
    for row in rows:
        plane = "plane" if row["plane_m"] is None else units.format_rounded(row["plane_m"], "mm")
        if row["equal"]:
            print(f"{plane}: equal to the last bit ({', '.join(row['quantities'])})")
        else:
            print(
                f"{plane}: PSNR {row['psnr_db']:.2f} dB of linear sRGB, mean ΔE2000 {row['delta_e']:.4g}, "
                f"largest difference of XYZ {row['largest_xyz']:.3g}"
            )
    return 0


def _fields(args: argparse.Namespace) -> tuple[Wavefield, Wavefield]:
    """The hologram and the reference, each in its own plane. Raises UserError for an odd number of files."""
    count, odd = divmod(len(args.names), 2)
    if odd:
        raise UserError("FILE", f"{len(args.names)} of them", expected="as many of the hologram as of the reference")
    request = request_from_args(argparse.Namespace(**vars(args) | {"viewpoint": None}))
    fields = []
    for names in (args.names[:count], args.names[count:]):
        found = field_of_files(names, request)
        for note in found.notes:
            print_stderr(f"note: {Path(names[0]).name}: {note}")
        fields.append(found.field)
    return fields[0], fields[1]


def _view_scores(args: argparse.Namespace, field: Wavefield, reference: Wavefield) -> list[dict[str, Any]]:
    """A table of scores for each plane and viewpoint."""
    planes_m = [units.parse(text, "--plane") for text in args.plane or ()] or [reference.distance_m]
    viewpoints: list[tuple[str | None, Viewpoint | None]]
    viewpoints = [(text, ViewpointType().parse(text, "--viewpoint")) for text in args.viewpoint or ()] or [(None, None)]
    width, height = parse_samples(args.resize, 2, "--resize", "width,height, e.g. 1024,768") if args.resize else (0, 0)
    try:
        low, high = map(float, args.percentiles.split(","))
    except ValueError:
        raise UserError("--percentiles", f'"{args.percentiles}"', expected="two numbers, such as 0,99.5") from None
    cases = [(plane_m, *viewpoint) for plane_m in planes_m for viewpoint in viewpoints]
    rows = []
    with progress_bar("views") as progress:
        for done, (plane_m, text, viewpoint) in enumerate(cases):
            aperture = None if viewpoint is None else aperture_of(reference, viewpoint, plane_m)
            scores = scores_at(
                field,
                reference,
                plane_m,
                aperture,
                method=args.propagation,
                shape=(height, width) if args.resize else None,
                percentiles=(low, high),
            )
            rows.append({"plane_m": plane_m, "viewpoint": text, **scores})
            progress(done + 1, len(cases), "views")
    return rows


def _finite(scores: Mapping[str, Any]) -> dict[str, Any]:
    """The scores with None for the infinite ones of equal fields, which JSON doesn't have."""
    endless = {name for name, score in scores.items() if isinstance(score, float) and not math.isfinite(score)}
    return {name: None if name in endless else score for name, score in scores.items()}
