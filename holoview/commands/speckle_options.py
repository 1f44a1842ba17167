"""What `contrast` and `report` share: which hologram, region, target and instrument, and what was found, as text."""

from __future__ import annotations

import argparse
import math
from dataclasses import fields
from pathlib import Path
from typing import Any

from holoview.bench.captures.speckle_meter import METERS, CameraLens, Meter, MeterReading
from holoview.commands.arguments import add_fields, add_framing, checked_region, given_fields, parse_seed
from holoview.commands.console import print_stderr
from holoview.commands.output_files import add_input
from holoview.holograms.hologram import Hologram
from holoview.holograms.metrics.colour_speckle import ColourSpeckle
from holoview.holograms.metrics.grains import ContrastEstimate
from holoview.holograms.metrics.likeness import Likeness, StructureLeft
from holoview.holograms.metrics.sharpness import slanted_edge_mtf
from holoview.holograms.metrics.speckle_measurement import SpeckleMeasurement, visibility
from holoview.holograms.targets.framing import FILL
from holoview.holograms.targets.target import Placement
from holoview.holograms.targets.target_source import TargetFile, TargetSource
from holoview.holograms.view import simulate
from holoview.light.model.fields import flag_of
from holoview.light.model.focus import focused_planes, plane_label
from holoview.light.model.system import System
from holoview.light.numerics.sampling import Region
from holoview.util.errors import UserError
from holoview.util.progress import TextCallback

OF_CAMERA = ("f_number", "pixel", "bits", "exposure")
_MOST_SHOWN = 12  # lasers in a matrix of text


def add_place(parser: argparse.ArgumentParser) -> None:
    """Adds --region, --plane and --random: what of a hologram, or of a preset's random patterns, is measured."""
    parser.add_argument("--region", metavar="X,Y,W,H", help="samples from the upper left; the central half if absent")
    parser.add_argument("--plane", metavar="DISTANCE", help="focal plane of a preset or hologram; else the middle one")
    parser.add_argument(
        "--random", metavar="SEED", type=parse_seed, default=0, help="seed of a preset's random patterns"
    )


def add_target(parser: argparse._ActionsContainer) -> None:
    """Adds --target, --depth and --framing; see `target_from_args`."""
    add_input(parser, "--target", metavar="PICTURE", help="what it should show: its structure is divided out")
    add_input(parser, "--depth", metavar="PICTURE", help="its depth map: black is nearest to the viewer")
    add_framing(parser)


def target_from_args(
    args: argparse.Namespace, system: System, tell: TextCallback = lambda text: print_stderr(f"note: {text}")
) -> TargetSource | None:
    """The target of --target for a bench; None without one. tell: called with each note on its files.

    Raises UserError for --depth or --framing alone, and for bad files.
    """
    check_needs_target(args)
    if args.target is None:
        return None
    depth = None if args.depth is None else Path(args.depth)
    file = TargetFile(str(args.target), Placement(depth=depth, framing=args.framing))
    return TargetSource(system, file, tell)


def check_needs_target(args: argparse.Namespace) -> None:
    """Raises UserError for --depth or --framing without --target."""
    for flag, is_given in (("--depth", args.depth is not None), ("--framing", args.framing != FILL)):
        if args.target is None and is_given:
            raise UserError(flag, "without --target", expected="both, or neither")


def add_edge(parser: argparse.ArgumentParser) -> None:
    """Adds --edge; see `edge_rows`."""
    parser.add_argument(
        "--edge", metavar="X,Y,W,H", help="also the MTF across a slanted edge in these samples, at each focal plane"
    )


def edge_rows(hologram: Hologram, meter: Meter, region: Region) -> list[dict[str, Any]]:
    """The MTF across the edge in a region at each focal plane, with an instrument, for programs.

    "no_edge" says why there is none at a plane. Raises UserError for a region outside.
    """
    system = meter.bench(hologram.system)
    view = simulate(system, hologram.drive, focused_planes(system), backend="torch")
    rows = []
    for plane_m, xyz in zip(view.focus_m, view.xyz, strict=True):
        image = xyz[..., 1]
        checked_region(region, image.shape, "--edge")
        row: dict[str, Any] = {"plane": plane_label(system, float(plane_m))}
        try:
            row |= slanted_edge_mtf(image, region).as_json(view.degrees_per_sample)
        except UserError as error:
            row["no_edge"] = error.found
        rows.append(row)
    return rows


def add_meter(parser: argparse.ArgumentParser) -> None:
    """Adds --meter and what a camera needs; see `meter_from_args`."""
    group = parser.add_argument_group("the instrument; the samples of the simulation if absent")
    group.add_argument(
        "--meter",
        choices=METERS,
        help="eye: 3 mm and cones; iec: 1.2 mm without aberrations; camera: a lens and pixels",
    )
    add_fields(group, CameraLens, *OF_CAMERA, states_units=True)


def meter_from_args(args: argparse.Namespace) -> Meter:
    """The instrument of --meter. Raises UserError for a camera without lens or pixel, and these without a camera."""
    given = given_fields(args, CameraLens)
    if args.meter != "camera":
        for field in fields(CameraLens):
            if field.name in given:
                raise UserError(flag_of(field), "without --meter camera", expected="both, or neither")
        return Meter(args.meter or "")
    if "f_number" not in given or "pixel_m" not in given:
        expected = "e.g. --f-number 16 --pixel 3.45um"
        raise UserError("--meter camera", "without --f-number and --pixel", expected=expected)
    return Meter("camera", CameraLens(**given))


def speckle_lines(found: SpeckleMeasurement, reading: MeterReading | None = None) -> list[str]:
    """All that was found beyond the contrast of the luminance, a line each."""
    grains = found.luminance.grains
    sides = zip(reversed(grains.width_px), found.region[2:], strict=True)
    width = " x ".join(f">{side}" if math.isnan(w) else f"{w:.2g}" for w, side in sides)
    what = "standard error of the raw contrast" if found.withheld else "standard error"
    lines = [
        f"{what} {found.luminance.standard_error:.2g}, from {grains.count:.0f} independent grains, {width} samples "
        "wide (autocorrelation)"
    ]
    if found.has_target:
        lines.append(f"structure of the target divided out; with it the contrast is {found.raw_contrast:.4f}")
        lines += [] if found.likeness is None else _likeness_lines(found.likeness, found.blur_px, found.left)
    if reading is not None:
        lines.append(f"instrument: {reading.words}")
    lines += laser_lines(found)
    return lines if found.withheld else [*lines, "", *visible_lines(found)]


def visible_lines(found: SpeckleMeasurement) -> list[str]:
    """The contrasts beside the thresholds of seeing them, a line each below a heading."""
    lines = ["visible?"]
    for row in visibility(found):
        lines.append(f"{row.what}: {row.contrast:.1%}, threshold {row.threshold:.1%}: {row.verdict} ({row.source})")
    return lines


def _likeness_lines(alike: Likeness, blur_px: float, left: StructureLeft | None) -> list[str]:
    if not math.isfinite(alike.standard_error):
        return []
    blur = f", blurred by {blur_px:g} samples" if blur_px else ""
    lines = [f"the picture has {_percent(alike)} of the target's structure{blur}"]
    if left is not None:
        lines.append(
            f"of the variance that division leaves, {_percent(left.levels)} follows the target's levels, "
            f"{_percent(left.edges)} its edges, and {_percent(left.places)} is in places alone"
        )
    return lines


def _percent(share: Likeness) -> str:
    return f"{max(100 * share.share, 0):.0f} +- {100 * share.standard_error:.0f} %"


def laser_lines(found: SpeckleMeasurement) -> list[str]:
    """What is known of the lasers, of groups of them and of their colours; none where they weren't measured."""
    if not found.lasers:
        return []
    names = [laser.name for laser in found.lasers]
    lines = ["", f"{'laser':<9} {'luminance':>9}  contrast"]
    lines += [f"{of.name:<9} {of.luminance_share:>9.1%}  {_estimate(of.estimate)}" for of in found.lasers]
    lines += [f"{name:<9} {'':>9}  {_estimate(estimate)}" for name, estimate in found.groups.items()]
    count, equal, (by_powers, by_correlation) = found.patterns_of_powers, len(names), found.pattern_errors
    lines += [
        "",
        f"N_eff from powers {count:.2f} +- {by_powers:.2g}, from the correlation between lasers "
        f"{found.patterns_of_correlation:.2f} +- {by_correlation:.2g} (errors by blocks of the region); "
        f"{equal} equal ones have 1/sqrt(N) = {equal**-0.5:.4f}, these 1/sqrt(N_eff) = {count**-0.5:.4f}",
    ]
    if 1 < equal <= _MOST_SHOWN:
        lines.append("correlation between the lasers' patterns:")
        lines += [
            f"{name:<9}" + "".join(f"{value:6.2f}" for value in row)
            for name, row in zip(names, found.correlation, strict=True)
        ]
    together, apart = found.luminance, found.one_by_one
    lines += [
        "",
        "in the manner of IEC 62906-5-4, a standard for laser projection:",
        f"(a) one by one, taken as independent: {apart:.4f} +- {found.one_by_one_error:.2g}",
        f"(b) together: {together.contrast:.4f} +- {together.standard_error:.2g}; (a) is off by "
        f"{(apart - together.contrast) / together.contrast:+.1%}"
        if together.contrast
        else "(b) together: 0",
    ]
    for name, colour in (("(b) colour", found.colour), ("(a) colour", found.independent_colour)):
        lines += [] if colour is None else [f"{name}: {colour_line(colour)}"]
    return lines


def colour_line(colour: ColourSpeckle) -> str:
    """Colour speckle in a line."""
    (uu, uv), (_, vv) = colour.covariance_uv
    error = "" if colour.area_error is None else f" +- {colour.area_error:.1e}"
    off = f"; noise taken off, {colour.noise_share:.0%} of the variance" if colour.noise_share > 0 else ""
    return (
        f"mean u'v' ({colour.mean_uv[0]:.4f}, {colour.mean_uv[1]:.4f}), covariance ({uu:.2e}, {uv:.2e}; {vv:.2e}), "
        f"95 % ellipse {colour.area:.2e}{error}; r.m.s. {colour.jzazbz_scatter:.4f} in Jzazbz"
        f"{off}"
    )


def _estimate(estimate: ContrastEstimate) -> str:
    return f"{estimate.contrast:.4f} +- {estimate.standard_error:.4f}"
