"""`holoview contrast WHAT`: measures speckle, σ/μ and its standard error, of a hologram, captures or photographs.

Of the luminance, of each laser and of blue, green and red, with the colour speckle, in the manner of IEC 62906-5-2 and
-5-4. A preset shows its own speckle, of random patterns.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.capture_file import is_capture_file, read_captures
from holoview.bench.captures.capture_speckle import (
    CaptureContrast,
    MeanContrast,
    TogetherContrast,
    capture_noise,
    capture_sets,
    contrast_of_captures,
    mean_by_laser,
    measure_set,
)
from holoview.bench.captures.speckle_meter import MeterReading, measure_hologram
from holoview.commands.arguments import (
    add_changes,
    add_fields,
    checked_region,
    dest_of,
    given_fields,
    parse_region,
    stated_observer,
    system_from_args,
)
from holoview.commands.console import print_json, print_stderr, progress_bar
from holoview.commands.hologram_files import (
    add_field_options,
    check_no_field_options,
    has_field_options,
    is_preset,
    shown_by_args,
)
from holoview.commands.output_files import add_input, add_output
from holoview.commands.speckle_options import (
    OF_CAMERA,
    add_edge,
    add_meter,
    add_place,
    add_target,
    edge_rows,
    laser_lines,
    meter_from_args,
    speckle_lines,
    target_from_args,
    visible_lines,
)
from holoview.evidence.study.charts import make_figure, retinal_figure, scatter_figure, speckle_figure
from holoview.evidence.study.study import StudyFigure
from holoview.holograms.files.image_reader import file_format
from holoview.holograms.files.light_file import is_light_file
from holoview.holograms.files.readers.registry import is_readable
from holoview.holograms.hologram import Hologram
from holoview.holograms.metrics.grains import PixelNoise, SumNoise
from holoview.holograms.metrics.image_quality import contrast_by_pupil, picture_luminance
from holoview.holograms.metrics.likeness import displaced
from holoview.holograms.metrics.photograph import (
    MOST_SATURATED,
    CameraStatements,
    censored_estimate,
    check_saturation,
    photographs_of_lasers,
    read_photograph,
    require_picture_of_camera,
)
from holoview.holograms.metrics.retinal import pupils_of
from holoview.holograms.metrics.sharpness import slanted_edge_mtf
from holoview.holograms.metrics.speckle import independent_patterns
from holoview.holograms.metrics.speckle_measurement import STRUCTURE_COUNTS, SpeckleMeasurement, measure_speckle
from holoview.holograms.targets.framing import FILL
from holoview.holograms.targets.picture import read_picture
from holoview.holograms.targets.target_source import TargetSource
from holoview.holograms.view import random_drive
from holoview.light.model.fields import fields_by_key
from holoview.light.model.focus import parse_plane, plane_label
from holoview.light.model.system import System
from holoview.light.numerics.sampling import Region, central_region, region_slices
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.figures import figure_bytes, require_matplotlib
from holoview.util.file_writer import write_file
from holoview.viewer.page.page import export_html

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
    add_changes(parser)
    add_place(parser)
    parser.add_argument(
        "--pupils",
        metavar="LIST",
        help="with an eye: also a table of the contrast through pupils of these diameters, e.g. 2,3,4mm",
    )
    add_fields(parser, CameraStatements, "is_linear")
    add_edge(parser)
    add_target(parser)
    parser.add_argument("--align", action="store_true", help="move the target by whole samples to where it fits best")
    add_meter(parser)
    _add_camera(parser)
    add_output(
        parser,
        "--scatter",
        metavar="PNG",
        suffix=".png",
        help="the scatter of the colours in u'v' and in Jzazbz, with the 95 %% ellipses",
    )
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


_OF_PICTURES = ("is_linear", "accepts_jpeg")  # also of pictures that are no photographs
_OF_PHOTOGRAPHS = {key: own for key, own in fields_by_key(CameraStatements).items() if key not in _OF_PICTURES}


def _add_camera(parser: argparse.ArgumentParser) -> None:
    """Adds what is known of the camera of a photograph."""
    group = parser.add_argument_group("photographs of a bench (any of these says that the pictures are)")
    add_fields(group, CameraStatements, *_OF_PHOTOGRAPHS)
    group.add_argument("--lasers", metavar="LIST", help="a photograph of each laser: their wavelengths, 638,532,450nm")
    add_input(group, "--together", metavar="PICTURE", help="with --lasers: a photograph of all lasers together")
    add_fields(parser, CameraStatements, "accepts_jpeg")


_DECODED = (
    "its whole numbers are taken as a display's signal, which was decoded: --linear if they are intensity, --dark or "
    "--black if a camera counted them"
)
_CAMERA_OPTIONS = (*map(dest_of, _OF_PHOTOGRAPHS.values()), "lasers", "together")
_NOT_OF_CAPTURES = (
    *("scheme", "plane", "pupils", "linear", "edge", "target", "depth", "align", "plot", "live", "jpeg"),
    *("meter", *OF_CAMERA, *_CAMERA_OPTIONS),
)


def _given(args: argparse.Namespace, names: Sequence[str]) -> list[str]:
    """Those of these options that were given, as they are typed."""
    stated = [name for name in names if getattr(args, name) is not None and getattr(args, name) is not False]
    return [f"--{name.replace('_', '-')}" for name in stated]


def _is_photograph(args: argparse.Namespace) -> bool:
    """Whether an option says that the pictures are photographs."""
    return bool(_given(args, _CAMERA_OPTIONS))


def camera_statements(args: argparse.Namespace) -> CameraStatements:
    """What the options say of a camera."""
    return CameraStatements(**given_fields(args, CameraStatements))


@dataclass(frozen=True)
class _ShownHologram:
    """Patterns on a bench, seen at a plane. name: of the patterns, for people."""

    hologram: Hologram
    plane_m: float
    name: str


@dataclass(frozen=True, eq=False)
class _Measured:
    """What is measured, of any source.

    what: in words. found: of a region. clipped: share of saturated pixels, clipped_at: from
    which number; clipping: what that does. notes: remarks. reading: of the instrument, where one is chosen. image:
    luminance (y, x) of a picture.
    """

    what: str
    found: SpeckleMeasurement
    clipped: float = 0.0
    clipped_at: str = ""
    notes: tuple[str, ...] = ()
    reading: MeterReading | None = None
    image: NDArray[np.floating] | None = None
    clipping: str = ": its contrast comes out too low"


def run(args: argparse.Namespace) -> int:
    """Measures and prints the contrast of a region, and plots it with its histogram if asked."""
    for flag in ("plot", "scatter"):
        if getattr(args, flag) is not None:
            require_matplotlib(f"--{flag}")
    if args.align and args.target is None:
        raise UserError("--align", "without --target", expected="both, or neither")
    if is_capture_file(Path(args.names[0])):
        return _measure_captures(args)
    shown = None if _is_photograph(args) else _shown_hologram(args)
    if args.live is not None and shown is None:
        raise UserError(
            "--live", f"with the picture {args.names[0]}", expected="a hologram or a preset, to compute again"
        )
    pupils_m = _parse_pupils(args.pupils, shown)
    region = None if args.region is None else parse_region(args.region)
    target: TargetSource | None = None
    if shown is None:
        _check_picture_options(args)
        measured = _measured_photograph(args, region) if _is_photograph(args) else _measured_picture(args, region)
    else:
        target = target_from_args(args, shown.hologram.system)
        measured = _measured_hologram(args, shown, region, target)
    result = _as_json(measured)
    if args.edge is not None:
        result["mtf"] = _mtf(args, shown, measured.image)
    draw = speckle_figure(measured.found.pattern)
    if shown is not None and pupils_m:
        target_of = partial(_target_of_eye, target, shown.plane_m, measured.found.displacement_px)
        own, region = (shown.hologram, shown.plane_m), measured.found.region
        with progress_bar("pupils") as progress:
            curve = contrast_by_pupil(*own, pupils_m, region, progress, target_of)
        result |= {"pupils": [found.as_json() for found in curve.contrasts], "independent_contrast": curve.independent}
        draw = retinal_figure(curve)
    for flag, figure in (("plot", draw), ("scatter", _scatter(args, measured.found))):
        if (path := getattr(args, flag)) is not None:
            drawn = make_figure(StudyFigure("contrast", measured.what, figure))
            write_file(path, figure_bytes(drawn, dpi=150))
            result[flag] = str(path)
    if args.live is not None and shown is not None:
        built = None if target is None else target.with_plane(shown.plane_m)
        region = None if args.meter else measured.found.region  # a page measures without an instrument
        export_html(args.live, {shown.name: shown.hologram}, plane_m=shown.plane_m, region=region, target=built)
        result["live"] = str(args.live)
    if args.json:
        print_json(result)
    else:
        print(_format_result(result, measured))
    return 0


def _mtf(
    args: argparse.Namespace, shown: _ShownHologram | None, image: NDArray[np.floating] | None
) -> list[dict[str, Any]]:
    """The MTF of --edge at each focal plane of a hologram, or of a picture; frequencies with an eye also by the degree.

    image: luminance (y, x) of the picture, linear in light. Raises UserError as `slanted_edge_mtf` does, and for a
    region outside.
    """
    region = parse_region(args.edge)
    if shown is not None:
        rows = edge_rows(shown.hologram, meter_from_args(args), region)
        if all("no_edge" in row for row in rows):
            raise UserError("--edge", rows[0]["no_edge"], expected="a region that a slanted edge divides")
        return rows
    assert image is not None
    found = slanted_edge_mtf(image, checked_region(region, image.shape, "--edge"))
    return [{"plane": "", **found.as_json(None)}]


def _as_json(measured: _Measured) -> dict[str, Any]:
    """The numbers for programs."""
    found = measured.found
    patterns = independent_patterns(found.luminance.contrast)
    return {
        "what": measured.what,
        "region": list(found.region),
        "mean": found.mean,
        "std": found.raw_contrast * found.mean,
        "pixels": found.pixels,
        "clipped": measured.clipped,
        "clipped_at": measured.clipped_at,
        "notes": [*measured.notes, *found.notes],
        "independent_patterns": patterns if np.isfinite(patterns) and not found.withheld else None,
        **found.as_json(),
        **({} if measured.reading is None else {"meter": measured.reading.as_json()}),
    }


def _scatter(args: argparse.Namespace, found: SpeckleMeasurement) -> Callable[[Figure], None]:
    """A function that draws the scatter of colours; only called where one is asked for."""
    if args.scatter is not None and found.colour is None:
        if found.independent_colour is not None:
            raise UserError("--scatter", "colours that scatter by the camera's noise alone", expected="more light")
        raise UserError("--scatter", "an image without colours", expected="a hologram, or a photograph in colour")
    return scatter_figure(found)


def _measured_hologram(
    args: argparse.Namespace, shown: _ShownHologram, region: Region | None, target: TargetSource | None
) -> _Measured:
    meter = meter_from_args(args)
    if meter.name and args.pupils:
        raise UserError("--pupils", f"with --meter {meter.name}", expected="one of them")
    chosen = region or central_region(shown.hologram.system.way.shape)
    measured = measure_hologram(shown.hologram, shown.plane_m, chosen, target, meter, is_aligned=args.align)
    system = shown.hologram.system
    place = plane_label(system, shown.plane_m) + ("" if system.eye is None else ", on the retina")
    notes = measured.reading.notes if meter.name else ()
    reading = measured.reading if meter.name else None
    return _Measured(f"luminance of {shown.name} at {place}", measured.found, notes=notes, reading=reading)


def _measured_picture(args: argparse.Namespace, region: Region | None) -> _Measured:
    path = Path(args.names[0])
    require_picture_of_camera(path, args.jpeg)
    image = picture_luminance(path, is_linear=args.linear, plane_m=_plane_of_light(args))
    chosen = region or central_region(image.luminance.shape)
    target = _picture_target(args, image.luminance.shape)
    found = measure_speckle(image.luminance, chosen, target, image.lasers, is_aligned=args.align)
    notes = (*image.notes, *([_DECODED] if image.is_decoded else []))
    own = image.clipped_share, image.clipped_at, notes
    return _Measured(image.description, found, *own, image=image.luminance)


def _picture_target(args: argparse.Namespace, shape: tuple[int, ...]) -> NDArray[np.floating] | None:
    """The picture of --target, linear sRGB. Raises UserError for another size than that of what is measured."""
    if args.target is None:
        return None
    picture = read_picture(args.target)
    for note in picture.notes:
        print_stderr(f"note: {args.target}: {note}")
    rgb = picture.rgb
    if rgb.shape[:2] != shape[:2]:
        found = f"a target of {rgb.shape[1]} × {rgb.shape[0]} pixels"
        expected = f"{shape[1]} × {shape[0]}, as the picture, pixel on pixel"
        raise UserError(str(args.target), found, expected=expected)
    return rgb


def _measured_photograph(args: argparse.Namespace, region: Region | None) -> _Measured:
    """Photographs of a bench: one of all lasers, or one of each with --lasers, perhaps one of all with --together."""
    statements = camera_statements(args)
    photographs = [read_photograph(Path(name), statements) for name in args.names]
    wavelengths_m = [] if args.lasers is None else units.parse_several(args.lasers, "--lasers")
    if not wavelengths_m:
        if len(photographs) > 1:
            remedy = "--lasers 638,532,450nm says which laser each shows"
            raise UserError("photographs", f"{len(photographs)}", expected="one", remedy=remedy)
        if args.together is not None:
            raise UserError("--together", "without --lasers", expected="both, or neither")
        whole, lasers = photographs[0], photographs[0].channels
        light = whole.luminance
        noise: PixelNoise | SumNoise | None = whole.luminance_noise
    else:
        lasers = photographs_of_lasers(photographs, wavelengths_m)
        if args.together is not None:
            whole = read_photograph(Path(args.together), statements)
            if whole.light.shape != photographs[0].light.shape:
                raise UserError(str(args.together), "another size than the others", expected="the same camera, unmoved")
            light, noise = whole.luminance, whole.luminance_noise
        else:
            whole, light = photographs[0], np.tensordot(lasers.luminances, lasers.intensity, axes=1)
            noise = lasers.noise and SumNoise.of(lasers.luminances, lasers.intensity, lasers.noise)
    chosen = checked_region(region or central_region(light.shape), light.shape, "--region")
    saturated = {note: None for photo in {id(p): p for p in (*photographs, whole)}.values() for note in (
        check_saturation(photo, chosen, statements)
    )}  # fmt: skip
    target = _picture_target(args, light.shape)
    found = measure_speckle(light, chosen, target, lasers, noise, is_aligned=args.align)
    share = float(whole.saturated[region_slices(chosen)].mean())
    if statements.saturation == "undo" and share > MOST_SATURATED and whole.level is not None:
        found = replace(found, luminance=censored_estimate(found.pattern, whole.level))
    notes = [note for photo in photographs for note in photo.notes]
    added: tuple[str, ...] = ()
    if wavelengths_m and args.together is None:
        added = ("the luminance is that of the photographs added pixel by pixel, the camera responding alike to all",)
    told = tuple(dict.fromkeys((*notes, *saturated, *added)))
    level = "" if whole.level is None else f"{whole.level:.6g} counts above black"
    names = ", ".join(Path(name).name for name in args.names)
    share = float(whole.saturated.mean())
    return _Measured(f"counts of {names}", found, share, level, told, image=light, clipping="")  # a note tells


def _measure_captures(args: argparse.Namespace) -> int:
    """Prints the contrast of each capture of a file, the mean of each laser, and that of all lasers together."""
    if len(args.names) > 1:
        raise UserError(str(args.names[1]), "beside a capture file", expected="one capture file")
    refused = _given(args, _NOT_OF_CAPTURES)
    refused += ["--framing"] if args.framing != FILL else []
    refused += [] if all(change.startswith("observer=") for change in args.changes) else ["--set"]
    if refused:
        raise UserError(refused[0], "with a capture file", expected="--region, --observer, --scatter or --json")
    captures = read_captures(args.names[0])
    region = central_region(captures.images.shape[1:]) if args.region is None else parse_region(args.region)
    x, y, width, height = checked_region(region, captures.images.shape[1:], "--region")
    noise, notes = capture_noise(captures)
    found = contrast_of_captures(captures, region, noise)
    if clipped := sum(of.saturated > MOST_SATURATED for of in found):
        notes += (f"{clipped} of {len(found)} captures are saturated in the region: theirs comes out too low",)
    notes += ("structure of the light counts as speckle: choose a region that should be even",)
    means, sets, together = mean_by_laser(found), capture_sets(captures), None
    if captures.usable is not None and sets:
        notes += ("lasers aren't added: the file leaves pixels out",)
    elif sets:
        observer = stated_observer(args.changes) or "eye"
        together = TogetherContrast.of(measure_set(captures, one, region, noise, observer) for one in sets)
        notes += ("lasers are added for equal exposures, the camera responding alike to all", *together.found.notes)
        if together.left_out:
            notes += (f"{together.left_out} sets of other lasers aren't in the mean",)
    elif len(means) > 1:
        notes += ("lasers aren't added: no captures of several lasers show equal patterns at equal distances",)
    result = _captures_json(args, region, found, means, together, notes)
    if args.scatter is not None:
        if together is None:
            raise UserError("--scatter", "captures whose lasers aren't added", expected="equal patterns for all lasers")
        draw = _scatter(args, together.found)
        write_file(args.scatter, figure_bytes(make_figure(StudyFigure("contrast", result["what"], draw)), dpi=150))
        result["scatter"] = str(args.scatter)
    if args.json:
        print_json(result)
        return 0
    print(f"captures of {args.names[0]}, {width} x {height} pixels at ({x}, {y})")
    for of in means:
        print(
            f"{of.wavelength_m * 1e9:.4g} nm: speckle contrast {of.contrast:.4f} +- {of.standard_error:.2g}, mean of "
            f"{of.count} captures"
        )
    if together is not None:
        print("\n".join(["", together.in_words(), *laser_lines(together.found), "", *visible_lines(together.found)]))
    print("\n".join(f"note: {note}" for note in notes))
    return 0


def _captures_json(
    args: argparse.Namespace,
    region: Region,
    found: Sequence[CaptureContrast],
    means: Sequence[MeanContrast],
    together: TogetherContrast | None,
    notes: Sequence[str],
) -> dict[str, Any]:
    """The numbers of a capture file for programs."""
    overall = float(np.mean([of.estimate.contrast for of in found]))
    return {
        "what": f"captures of {args.names[0]}",
        "region": list(region),
        "contrast": overall,
        **({} if together is None else {"together": together.as_json()}),
        "captures": [of.as_json() for of in found],
        "lasers": [of.as_json() for of in means],
        "notes": list(notes),
    }


def _format_result(result: dict[str, Any], measured: _Measured) -> str:
    x, y, width, height = result["region"]
    patterns = result["independent_patterns"]
    equivalent = "no speckle at all" if patterns is None else f"as of {patterns:.2f} independent speckle patterns"
    stated = f"speckle contrast {measured.found.luminance.contrast:.4f} ({equivalent})"
    if measured.found.withheld:
        stated = f"speckle contrast withheld: {measured.found.withheld}; raw it is {measured.found.raw_contrast:.4f}"
    lines = [
        f"{result['what']}",
        stated,
        f"mean {result['mean']:.4g}, standard deviation {result['std']:.4g}, {result['pixels']} pixels: "
        f"{width} x {height} at ({x}, {y})",
    ]
    if not measured.found.has_target and not measured.found.withheld:
        lines.append(STRUCTURE_COUNTS)
    lines += speckle_lines(measured.found, measured.reading)
    if result["clipped"] > 0:
        lines.append(
            f"{result['clipped']:.2%} of the picture is saturated{measured.clipping} (clipped at "
            f"{result['clipped_at']})"
        )
    lines += [f"note: {note}" for note in result["notes"]]
    if "mtf" in result:
        lines += ["", "MTF across the edge: frequency at which it is a half"]
        lines += [_mtf_line(row) for row in result["mtf"]]
    if "pupils" in result:
        lines += _format_rows(result["pupils"], result["independent_contrast"])
    return "\n".join([*lines, *(f"{name}: {result[name]}" for name in ("plot", "scatter", "live") if name in result)])


def _mtf_line(row: dict[str, Any]) -> str:
    if "no_edge" in row:
        return f"{row['plane']}: {row['no_edge']}"
    half, by_degree = row["half_cycles_a_sample"], row["half_cycles_a_degree"]
    error = "" if row["half_standard_error"] is None else f" +- {row['half_standard_error']:.2g}"
    words = "not below" if half is None else f"{half:.3f}{error} cycles a sample"
    degrees = "" if by_degree is None else f", {by_degree:.3g} line pairs a degree"
    return f"{row['plane'] or 'picture'}: {words}{degrees} (edge at {row['angle_deg']:.1f} degrees)"


def _shown_hologram(args: argparse.Namespace) -> _ShownHologram | None:
    """The hologram or the random patterns that the arguments name; None for a picture."""
    path = Path(args.names[0])
    if path.suffix.lower() == _HOLOGRAM_SUFFIX:
        if args.scheme or not all(change.startswith(("eye", "observer=")) for change in args.changes):
            remedy = "--set may give it an eye only, --observer who looks"
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


def _plane_of_light(args: argparse.Namespace) -> float | None:
    """The distance (m) of --plane, None without it. Raises UserError for one in dioptres."""
    return None if args.plane is None else units.parse(args.plane, "--plane")


def _check_picture_options(args: argparse.Namespace) -> None:
    if args.scheme or args.changes or (args.plane and not is_light_file(Path(args.names[0]))):
        what = "--set, --scheme, --observer or --plane"
        raise UserError(what, "with a picture", expected="a preset or a hologram for these")
    if meter_from_args(args).name:
        raise UserError("--meter", "with a picture", expected="a preset or a hologram: a picture has its instrument")
    for flag, is_given in (("--depth", args.depth is not None), ("--framing", args.framing != FILL)):
        if is_given:
            raise UserError(flag, "with a picture", expected="--target alone, pixel on pixel")


def _parse_pupils(text: str | None, shown: _ShownHologram | None) -> list[float]:
    """The diameters (m) of --pupils.

    Raises UserError for text of another kind, for a picture, and as `pupils_of` does.
    """
    if text is None:
        return []
    if shown is None:
        raise UserError("--pupils", "with a picture", expected="a preset or a hologram file")
    pupils_m = units.parse_several(text, "--pupils")
    pupils_of(shown.hologram.system, pupils_m)
    return sorted(set(pupils_m))


def _target_of_eye(
    target: TargetSource | None, plane_m: float, by_px: tuple[int, int], system: System
) -> NDArray[np.floating] | None:
    """The target (y, x, 3) that the eye of a system should see at a plane, displaced; None without one."""
    if target is None:
        return None
    built = target.build(None if target.is_stack else np.array([plane_m]), system=system)
    nearest = int(np.argmin(np.abs(np.asarray(built.planes_m) - plane_m)))
    return displaced(built.stack[nearest], by_px)


def _format_rows(rows: Sequence[dict[str, Any]], independent: float) -> list[str]:
    """The rows of a table as lines of text."""
    lines = ["", "pupil      contrast  as cones see it  grains"]
    for row in rows:
        own, cones = ("withheld" if of is None else f"{of:.4f}" for of in (row["contrast"], row["cone_contrast"]))
        lines.append(f"{row['pupil_mm']:<5.3g} mm   {own:<8}  {cones:<15}  {row['grain_arcmin']:.2f} arcmin")
    lines += [f"through {row['pupil_mm']:.3g} mm: {row['withheld']}" for row in rows if row["withheld"]]
    return [*lines, f"independent patterns of these lasers have {independent:.4f}, whatever the pupil"]
