"""`holoview contrast WHAT`: measures the speckle contrast σ/μ of a picture, a hologram, or a preset's own speckle."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from holoview.commands.arguments import add_observer, parse_lengths, parse_region, parse_seed, system_from_args
from holoview.commands.console import print_json, progress_bar
from holoview.commands.hologram_files import (
    add_field_options,
    check_no_field_options,
    has_field_options,
    is_preset,
    shown_by_args,
)
from holoview.commands.output_files import add_input, add_output
from holoview.evidence.study.charts import make_figure, retinal_figure, speckle_figure
from holoview.evidence.study.study import StudyFigure
from holoview.holograms.files.image_reader import file_format
from holoview.holograms.files.readers.registry import is_readable
from holoview.holograms.hologram import Hologram
from holoview.holograms.metrics.image_quality import (
    central_region,
    contrast_by_pupil,
    hologram_luminance,
    picture_luminance,
)
from holoview.holograms.metrics.speckle import independent_patterns, pupils_of, speckle_contrast
from holoview.holograms.view import random_drive
from holoview.light.model.focus import parse_plane
from holoview.util.errors import UserError
from holoview.util.figures import figure_bytes, require_matplotlib
from holoview.util.file_writer import write_file
from holoview.viewer.page.page import export_html

_HOLOGRAM_SUFFIX = ".safetensors"


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(
        parser,
        "names",
        metavar="WHAT",
        nargs="+",
        help="a picture, a preset's name or TOML file, a hologram's file, or files that are its parts",
    )
    parser.add_argument("--scheme", metavar="NAME", help="drive the preset's bench by a colour scheme")
    parser.add_argument("--set", metavar="KEY=VALUE", action="append", default=[], dest="changes", help="change it")
    add_observer(parser)
    parser.add_argument("--region", metavar="X,Y,W,H", help="samples from the upper left; the central half if absent")
    parser.add_argument("--plane", metavar="DISTANCE", help="focal plane of a preset or hologram; else the middle one")
    parser.add_argument(
        "--random", metavar="SEED", type=parse_seed, default=0, help="seed of a preset's random patterns"
    )
    parser.add_argument(
        "--pupils",
        metavar="LIST",
        help="with an eye: also a table of the contrast through pupils of these diameters, e.g. 2,3,4mm",
    )
    parser.add_argument("--linear", action="store_true", help="an integer picture holds intensity, not an sRGB signal")
    add_output(
        parser,
        "--plot",
        metavar="PNG",
        suffix=".png",
        help="the region and its histogram beside the speckle laws; with --pupils, the contrast against them",
    )
    add_output(
        parser,
        "--live",
        metavar="HTML",
        suffix=".html",
        help="also a page on which any browser computes the hologram and the contrast of the region again",
    )
    parser.add_argument("--json", action="store_true", help="machine-readable output")
    add_field_options(parser)


@dataclass(frozen=True)
class _ShownHologram:
    """Patterns on a bench, seen at a plane. name: of the patterns, for people."""

    hologram: Hologram
    plane_m: float
    name: str


def run(args: argparse.Namespace) -> int:
    """Measures and prints the contrast of a region, and plots it with its histogram if asked."""
    if args.plot is not None:
        require_matplotlib("--plot")
    shown = _shown_hologram(args)
    if args.live is not None and shown is None:
        raise UserError(
            "--live", f"with the picture {args.names[0]}", expected="a hologram or a preset, to compute again"
        )
    pupils_m = _parse_pupils(args.pupils, shown)
    if shown is None:
        _check_picture_options(args)
        image = picture_luminance(Path(args.names[0]), is_linear=args.linear)
    else:
        image = hologram_luminance(shown.hologram, shown.plane_m, shown.name)
    region = central_region(image.luminance.shape) if args.region is None else parse_region(args.region)
    speckle = speckle_contrast(image.luminance, region)
    patterns = independent_patterns(speckle.contrast)
    result: dict[str, Any] = {
        "what": image.description,
        "region": list(region),
        "contrast": speckle.contrast,
        "mean": speckle.mean,
        "std": speckle.std,
        "pixels": speckle.n_pixels,
        "clipped": image.clipped_share,
        "clipped_at": image.clipped_at,
        "notes": list(image.notes),
        "independent_patterns": patterns if np.isfinite(patterns) else None,
    }
    draw = speckle_figure(image.luminance, region, speckle.contrast)
    if shown is not None and pupils_m:
        with progress_bar("pupils") as progress:
            curve = contrast_by_pupil(shown.hologram, shown.plane_m, pupils_m, region, progress)
        result |= {"pupils": [found.as_json() for found in curve.contrasts], "independent_contrast": curve.independent}
        draw = retinal_figure(curve)
    if args.plot is not None:
        write_file(args.plot, figure_bytes(make_figure(StudyFigure("contrast", image.description, draw)), dpi=150))
        result["plot"] = str(args.plot)
    if args.live is not None and shown is not None:
        export_html(args.live, {shown.name: shown.hologram}, plane_m=shown.plane_m, region=region)
        result["live"] = str(args.live)
    if args.json:
        print_json(result)
    else:
        print(_format_result(result))
    return 0


def _format_result(result: dict[str, Any]) -> str:
    x, y, width, height = result["region"]
    patterns = result["independent_patterns"]
    equivalent = "no speckle at all" if patterns is None else f"as of {patterns:.2f} independent speckle patterns"
    lines = [
        f"{result['what']}",
        f"speckle contrast {result['contrast']:.4f} ({equivalent})",
        f"mean {result['mean']:.4g}, standard deviation {result['std']:.4g}, {result['pixels']} pixels: "
        f"{width} x {height} at ({x}, {y})",
        "structure of a picture counts as speckle here: choose a region that should be even",
    ]
    if result["clipped"] > 0:
        lines.append(
            f"{result['clipped']:.2%} of the picture is saturated: its contrast comes out too low (clipped at "
            f"{result['clipped_at']})"
        )
    lines += [f"note: {note}" for note in result["notes"]]
    if "pupils" in result:
        lines += _format_rows(result["pupils"], result["independent_contrast"])
    return "\n".join([*lines, *(f"{name}: {result[name]}" for name in ("plot", "live") if name in result)])


def _shown_hologram(args: argparse.Namespace) -> _ShownHologram | None:
    """The hologram or the random patterns that the arguments name; None for a picture."""
    path = Path(args.names[0])
    if path.suffix.lower() == _HOLOGRAM_SUFFIX:
        if args.scheme or not all(change.startswith("eye") for change in args.changes):
            remedy = "--set may give it an eye only"
            raise UserError(
                "--set or --scheme", "with a hologram file", expected="the bench that it was made for", remedy=remedy
            )
        return _of_files(args)
    if not is_preset(args.names[0]) or len(args.names) > 1:
        is_picture = (
            len(args.names) == 1 and not has_field_options(args) and (file_format(path) or not is_readable(path))
        )
        return None if is_picture else _of_files(args)
    args.preset = args.names[0]
    check_no_field_options(args, f"the preset {args.preset}")
    system = system_from_args(args)
    hologram = Hologram(random_drive(system, args.random), system)
    return _shown(hologram, args.plane, f"{system.name}, random patterns of seed {args.random}")


def _of_files(args: argparse.Namespace) -> _ShownHologram:
    shown = shown_by_args(args)
    return _shown(Hologram(shown.drive, shown.system), args.plane, Path(args.names[0]).name)


def _shown(hologram: Hologram, plane: str | None, name: str) -> _ShownHologram:
    planes_m = hologram.system.planes_m
    plane_m = float(planes_m[len(planes_m) // 2]) if plane is None else parse_plane(hologram.system, plane, "--plane")
    return _ShownHologram(hologram, plane_m, name)


def _check_picture_options(args: argparse.Namespace) -> None:
    if args.scheme or args.changes or args.plane:
        raise UserError("--set, --scheme or --plane", "with a picture", expected="a preset or a hologram for these")


def _parse_pupils(text: str | None, shown: _ShownHologram | None) -> list[float]:
    """The diameters (m) of --pupils.

    Raises UserError for text of another kind, for a picture, and as `pupils_of` does.
    """
    if text is None:
        return []
    if shown is None:
        raise UserError("--pupils", "with a picture", expected="a preset or a hologram file")
    pupils_m = parse_lengths(text, "--pupils")
    pupils_of(shown.hologram.system, pupils_m)
    return sorted(set(pupils_m))


def _format_rows(rows: Sequence[dict[str, Any]], independent: float) -> list[str]:
    """The rows of a table as lines of text."""
    lines = ["", "pupil      contrast  as cones see it  grains"]
    lines += [
        f"{row['pupil_mm']:<5.3g} mm   {row['contrast']:.4f}    {row['cone_contrast']:.4f}           "
        f"{row['grain_arcmin']:.2f} arcmin"
        for row in rows
    ]
    return [*lines, f"independent patterns of these lasers have {independent:.4f}, whatever the pupil"]
