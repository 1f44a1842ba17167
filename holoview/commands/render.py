"""`holoview render PRESET|FILE…`: renders what an observer sees of a hologram at focal planes, as PNG or as numbers."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.commands.arguments import (
    add_backend,
    add_changes,
    add_effects,
    check_adapter_applies,
    default_output,
    number,
    parse_effects,
    parse_seed,
    system_from_args,
    warn_of_camera_effects,
    warn_of_limits,
    whole,
    with_changes,
)
from holoview.commands.console import print_json, print_stderr, progress_bar
from holoview.commands.hologram_files import (
    NAMES_HELP,
    ShownSystem,
    add_field_options,
    check_no_field_options,
    is_preset,
    shown_by_args,
)
from holoview.commands.output_files import ResultSaver, add_input, add_output, check_files, check_suffix
from holoview.holograms.files.light_file import SUFFIXES as LIGHT_SUFFIXES
from holoview.holograms.files.light_writer import write_light
from holoview.holograms.files.pictures import (
    MAX_FRAMES,
    SUFFIXES,
    Encoder,
    open_encoder,
    path_with_suffix,
    read_pattern,
    write_deep_png,
    write_png,
)
from holoview.holograms.files.pupil_path_file import load_pupil_path
from holoview.holograms.hologram import Hologram, load_hologram
from holoview.holograms.metrics.speckle import speckle_contrast
from holoview.holograms.view import View, field_at, light_numbers, random_drive, simulate
from holoview.light.colour import COLOUR_SPACES, ColourSpace, fitting_stops, to_srgb8
from holoview.light.model import preset
from holoview.light.model.drives import complex_names
from holoview.light.model.focus import focused_planes, parse_plane, plane_label, views_along
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.numerics.sampling import central_region
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.file_writer import make_folder
from holoview.viewer.render.planes import SeenView, describe_view, exposed_pictures, write_pictures
from holoview.viewer.render.tone_mapping import FieldPicture, field_picture, linear_picture
from holoview.viewer.render.view_settings import QUANTITIES

_UNWRAPPED = "unwrapped-phase"


_SEVERAL: dict[str, Any] = {"nargs": "+", "action": "extend"}


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(parser, "names", nargs="*", metavar="PRESET|FILE", help=NAMES_HELP)
    add_changes(parser)
    add_effects(parser, dest="switched_on")
    add_input(parser, "--hologram", metavar="FILE", help="a hologram file; alone, its own bench is used")
    _add_patterns(parser)
    parser.add_argument(
        "--random", metavar="SEED", type=parse_seed, help="random patterns: speckle (the default, with seed 0)"
    )
    parser.add_argument(
        "--plane",
        metavar="DISTANCE",
        **_SEVERAL,
        help='e.g. 10mm 11mm, with an eye also 0.5D, or "all"; the middle plane if absent',
    )
    add_input(
        parser,
        "--pupil-path",
        metavar="CSV",
        type=Path,
        help="with an eye: what it sees while its pupil moves along a path, as the viewer saves it",
    )
    parser.add_argument("--frames", metavar="N", type=whole(0), help="with --pupil-path: how many pictures (24)")
    parser.add_argument(
        "--exposure",
        metavar="STOPS",
        type=_exposure,
        help='brighten by 2^STOPS; "auto": until the brightest hundredth is white, as for fields if absent',
    )
    parser.add_argument(
        "--colour-space",
        choices=list(COLOUR_SPACES),
        help="write 16 bits a channel in this colour space, which the file names; 8 bits in sRGB if absent; of an .exr "
        "or .npz the space of its linear RGB",
    )
    parser.add_argument(
        "--keep-hues",
        action="store_true",
        help="colours that a screen can't show keep their hue, as in the viewer; each channel is clipped if absent",
    )
    _add_show(parser)
    add_backend(parser)
    add_output(
        parser,
        "-o",
        "--output",
        metavar="PNG",
        suffix="",
        help="a PNG, several planes are numbered: OUT-10mm.png; an .exr, .npz, .tif or .npy holds the numbers of all "
        "planes; with --pupil-path a PNG, GIF or MP4 that moves, or a folder",
    )
    parser.add_argument("--json", action="store_true", help="print what was made as JSON; of a file, what was read")
    add_field_options(parser)


def _add_patterns(parser: argparse.ArgumentParser) -> None:
    add_input(
        parser, "--slm1", metavar="PNG", **_SEVERAL, help="pattern of modulator 1, one a frame (0…max is 0…stroke)"
    )
    add_input(parser, "--slm2", metavar="PNG", **_SEVERAL, help="pattern of modulator 2, one a frame")
    add_input(
        parser,
        "--patterns",
        metavar="FOLDER",
        type=Path,
        help="patterns as `export --png` writes them: slm1.png, of a chain NAME.png of each element; NAME-frame0.png …",
    )


def _add_show(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("the field itself, of one laser, in place of what an observer sees")
    group.add_argument(
        "--show",
        choices=(*QUANTITIES, _UNWRAPPED),
        help="a picture of this quantity of the complex field; unwrapped-phase needs holoview[unwrap]",
    )
    group.add_argument(
        "--stage",
        metavar="NAME",
        help="light, slm1 (of a field: field), gap, slm2, stop, plane; with an eye pupil, retina; plane if absent",
    )
    group.add_argument("--laser", metavar="N", type=whole(1), help="which laser, counted from 1; the first if absent")


def run(args: argparse.Namespace) -> int:
    """Renders, writes a PNG for each plane and viewpoint, and prints their names with the speckle contrast."""
    if not args.viewpoint or len(args.viewpoint) == 1:
        return _run(args, print_json)
    if args.output is None:
        raise UserError("--viewpoint", "several without -o", expected="a name, which is numbered: OUT-view1.png")
    for flag in ("remember", "pupil_path"):
        if getattr(args, flag):
            raise UserError(f"--{flag.replace('_', '-')}", "with several viewpoints", expected="one viewpoint")
    results: list[dict[str, Any]] = []
    codes = []
    for place, viewpoint in enumerate(args.viewpoint, 1):
        own = {"viewpoint": [viewpoint], "output": path_with_suffix(args.output, f"view{place}")}
        codes.append(_run(argparse.Namespace(**vars(args) | own), results.append))
    if args.json:
        print_json({"viewpoints": [{"viewpoint": v} | r for v, r in zip(args.viewpoint, results, strict=True)]})
    return max(codes)


def _run(args: argparse.Namespace, report: Callable[[dict[str, Any]], None]) -> int:
    """The same seen from one place. report: takes what --json prints."""
    shown = _shown(args)
    system, drive = shown.system, shown.drive
    for note in shown.guess_notes:
        print_stderr(f"note: {note}")
    warn_of_camera_effects(system)
    planes_m = _parse_planes(args.plane, system)
    output = args.output or default_output(system.name, "", ".png")
    _check_options(args, output)
    if args.pupil_path is not None:
        return render_path(args, system, drive, planes_m)
    if args.show is not None:
        return _show_field(args, shown, planes_m, report)
    if output.suffix.lower() in LIGHT_SUFFIXES:
        return _write_numbers(args, shown, planes_m, report)
    check_suffix(output, ".png", *LIGHT_SUFFIXES)
    paths = _plane_paths(output, planes_m)
    beside = [] if shown.other_side is None else [path_with_suffix(path, "other-side") for path in paths]
    check_files(args, {"-o": [*paths, *beside]})
    check_adapter_applies(args)
    started = time.perf_counter()
    view = _simulated(args, system, drive, planes_m)
    seconds = time.perf_counter() - started
    warn_of_limits(view.notes)
    saver = ResultSaver()
    space = None if args.colour_space is None else COLOUR_SPACES[args.colour_space]
    stops = _stops(args.exposure, view, system)
    gamut = "hue" if args.keep_hues else "clip"
    files = _write_planes(view, system, paths, stops, (space, gamut), saver)
    if shown.other_side is not None:
        other = _simulated(args, *shown.other_side, planes_m)
        own_stops = _stops(args.exposure, other, system)
        sharper = _write_planes(other, shown.other_side[0], beside, own_stops, (space, gamut), saver)
        files += [entry | {"other_side": True} for entry in sharper]
    if args.json:
        result = {"preset": system.name, "backend": view.backend, "seconds": round(seconds, 3), "planes": files}
        shares = _light_shares(view, shown)
        for entry, share in zip(files, shares, strict=False):  # not of pictures of the other side
            entry["light_in_picture"] = share
        for entry, budget in zip(files, _light_budgets(system, drive, planes_m), strict=False):
            entry["light_budget"] = budget
        result |= {"light_in_picture": min((s for s in shares if s is not None), default=None)}
        result |= {"exposure_stops": round(stops, 3), "notes": view.notes, "guesses": shown.guesses}
        report(result | ({"read": shown.read} if shown.read else {}))
    else:
        print(f"backend: {view.backend} ({seconds:.2f} s)")
        if stops and args.exposure in (None, "auto"):
            print(f"exposure: {stops:+.2f} stops")
        for entry in files:
            contrast = entry["speckle_contrast"]
            speckle = "" if contrast is None else f"  raw speckle contrast {contrast:.3f} (central half)"
            side = ", with the other sign of the phase" if "other_side" in entry else ""
            print(f"{entry['plane']}{side}: {entry['file']}{speckle}")
    return saver.exit_code


def _check_options(args: argparse.Namespace, output: Path) -> None:
    """Raises UserError for options that don't go together, or lack the one that they belong to."""
    if args.pupil_path is None and args.frames is not None:
        raise UserError("--frames", "without --pupil-path", expected="both, or neither")
    if args.pupil_path is not None and args.colour_space is not None:
        raise UserError("--colour-space", "with --pupil-path", expected="one of them: moving pictures have 8 bits")
    if args.pupil_path is None and args.show is None:
        for flag, value in (("--stage", args.stage), ("--laser", args.laser)):
            if value is not None:
                raise UserError(flag, "without --show", expected=f"--show with it: {', '.join(QUANTITIES)}")
    others = {"--colour-space": args.colour_space, "--pupil-path": args.pupil_path, "--show": args.show}
    found = next((flag for flag, value in others.items() if value is not None), "")
    if output.suffix.lower() in LIGHT_SUFFIXES:
        found = str(output)
    if args.keep_hues and found:
        raise UserError("--keep-hues", f"with {found}", expected="a PNG of 8 bits, in sRGB")


def _write_numbers(
    args: argparse.Namespace,
    shown: ShownSystem,
    planes_m: NDArray[np.float64],
    report: Callable[[dict[str, Any]], None],
) -> int:
    """Writes the light at all planes as numbers, without exposure, and prints the file's name."""
    system, output = shown.system, args.output
    if args.exposure is not None:
        raise UserError("--exposure", f"with {output}", expected="none: numbers are written as they are")
    check_files(args, {"-o": [output]})
    check_adapter_applies(args)
    started = time.perf_counter()
    view = _simulated(args, system, shown.drive, planes_m)
    seconds = time.perf_counter() - started
    warn_of_limits(view.notes)
    light = light_numbers(view, COLOUR_SPACES[args.colour_space or "srgb"], system=preset.dumps(system))
    saver = ResultSaver()
    written = saver.save(output, partial(write_light, light=light))
    names = [plane_label(system, plane_m) for plane_m in view.focus_m.tolist()]
    planes: list[dict[str, Any]] = [
        {"plane": name, "file": str(written), "light_in_picture": share}
        | {"mean_luminance": float(xyz[..., 1].mean()), "speckle_contrast": _speckle_contrast(xyz[..., 1])}
        for name, xyz, share in zip(names, view.xyz, _light_shares(view, shown), strict=True)
    ]
    if args.json:
        for entry, budget in zip(planes, _light_budgets(system, shown.drive, planes_m), strict=True):
            entry["light_budget"] = budget
        result = {"preset": system.name, "backend": view.backend, "seconds": round(seconds, 3), "planes": planes}
        result |= {"notes": view.notes, "guesses": shown.guesses, "observer": system.observer}
        report(result | ({"read": shown.read} if shown.read else {}))
    else:
        print(f"backend: {view.backend} ({seconds:.2f} s)\n{', '.join(names)}: {written}")
    return saver.exit_code


def _light_shares(view: View, shown: ShownSystem) -> list[float | None]:
    """The share of the light that is in the picture of each plane; None without light.

    Of a field that was brought to its image, in the light of the field itself.
    """
    shares = [] if view.light is None else view.light.by_plane.tolist()
    return [None if math.isnan(share) else round(share * shown.light, 9) for share in shares]


_MOST_FOLLOWED = 1 << 24  # samples of all wavelengths, frames and planes whose light is followed: some seconds


def _light_budgets(
    system: System, drive: NDArray[np.float32], planes_m: NDArray[np.float64]
) -> list[dict[str, float] | None]:
    """Where the light of each plane went; None without light and where following it would take long."""
    samples = math.prod(system.way.shape) * system.frames if system.is_chain else drive.size
    if samples * len(planes_m) * (1 if system.is_field else len(system.wavelengths_m)) > _MOST_FOLLOWED:
        return [None] * len(planes_m)
    from holoview.light.engine.light_budget import told_light  # slow start: importing torch takes a second

    plan = make_plan(system, planes_m)
    return [told_light(plan, drive, plane)[1] or None for plane in range(len(planes_m))]


def _simulated(
    args: argparse.Namespace, system: System, drive: NDArray[np.float32], planes_m: NDArray[np.float64]
) -> View:
    with progress_bar("rendering") as progress:
        return simulate(
            system,
            drive,
            planes_m,
            args.backend,
            adapter=args.adapter,
            progress=lambda done, total: progress(done, total, "wavelengths"),
        )


def _show_field(
    args: argparse.Namespace,
    shown: ShownSystem,
    planes_m: NDArray[np.float64],
    report: Callable[[dict[str, Any]], None],
) -> int:
    """Writes a PNG of the field at a stage for each plane, and prints what its colours mean."""
    system, stage, laser = shown.system, args.stage or "plane", (args.laser or 1) - 1
    output = args.output or default_output(system.name, "", ".png")
    check_suffix(output, ".png")
    paths = _plane_paths(output, planes_m)
    check_files(args, {"-o": paths})
    saver, files = ResultSaver(), []
    for plane_m, path in zip(planes_m.tolist(), paths, strict=True):
        field = field_at(system, shown.drive, stage=stage, plane=plane_m, laser=laser)
        picture, plane = _field_picture(field.values, args.show), plane_label(system, plane_m)
        texts = {"holoview.preset": system.name, "holoview.plane": plane, "holoview.stage": stage}
        texts |= {
            "holoview.quantity": args.show,
            "holoview.scale": picture.scale,
            "holoview.system": preset.dumps(system),
        }
        written = saver.save(path, partial(write_png, pixels=picture.srgb8, texts=texts))
        step = f"a direction sine of {field.step[1]:.4g}" if field.is_by_direction else f"{field.step[1] * 1e6:.4g} um"
        entry = {"plane": plane, "file": str(written), "stage": stage, "quantity": args.show, "scale": picture.scale}
        most = float(np.abs(field.values).max())
        entry |= {"sample": step, "largest_amplitude": most, "wavelength_m": field.wavelength_m}
        files.append(entry | {"share": field.share, "note": field.note})
    if args.json:
        read = {"read": shown.read} if shown.read else {}
        report({"preset": system.name, "planes": files, "guesses": shown.guesses} | read)
    for entry in [] if args.json else files:
        note = f"; {entry['note']}" if entry["note"] else ""
        print(f"{entry['stage']} at {entry['plane']}: {entry['file']}  {entry['quantity']}, {entry['scale']}{note}")
    return saver.exit_code


def _field_picture(values: NDArray[np.complexfloating], quantity: str) -> FieldPicture:
    """A picture of a field (y, x). Raises UserError if the phase is to be unwrapped and scikit-image isn't there."""
    if quantity != _UNWRAPPED:
        return field_picture(values, quantity)
    from holoview.holograms.fields.demodulation import unwrapped_phase  # slow start: it imports scipy

    return linear_picture(unwrapped_phase(values), "rad")


def _shown(args: argparse.Namespace) -> ShownSystem:
    """The bench and its patterns (frame, modulator, y, x), from a hologram file, pattern images, or at random."""
    named = [flag for flag in ("hologram", "slm1", "patterns", "random") if getattr(args, flag) is not None]
    if len(named) > 1:
        raise UserError(f"--{named[0]} with --{named[1]}", "contradict each other", expected="one of them")
    if args.slm2 and not args.slm1:
        raise UserError("--slm2", "without --slm1", expected="a pattern for each modulator")
    args.preset = None
    if args.names and not (len(args.names) == 1 and is_preset(args.names[0])):
        if named:
            raise UserError(f"--{named[0]}", f"with {args.names[0]}", expected="one of them")
        return shown_by_args(args)
    args.preset = args.names[0] if args.names else None
    check_no_field_options(args, f"the preset {args.preset}" if args.preset else "no file")
    return ShownSystem(*_system_and_drive(args))


def _system_and_drive(args: argparse.Namespace) -> tuple[System, NDArray[np.float32]]:
    """The bench and its patterns (frame, modulator, y, x), of a preset or --hologram."""
    if args.hologram:
        return _system_and_drive_of_hologram(args)
    if args.preset is None:
        raise UserError(
            "PRESET",
            "is missing",
            expected="a preset's name or file, or a hologram's file, also by --hologram FILE",
            remedy="give it first: behind --plane, --slm1 or --slm2 it is taken for one of their values",
        )
    system = system_from_args(args)
    if args.slm1:
        return system, _read_patterns(args, system)
    if args.patterns:
        return system, _read_folder(args.patterns, system)
    return system, random_drive(system, args.random or 0)


def _system_and_drive_of_hologram(args: argparse.Namespace) -> tuple[System, NDArray[np.float32]]:
    """The patterns of a hologram file, and its own bench or the preset with the hologram's lasers."""
    if args.scheme is not None:
        raise UserError("--scheme", "with --hologram", expected="the lasers and frames that the hologram was made for")
    effects = parse_effects(args.switched_on)  # first: the hologram's bench may name effects of the user's files
    hologram = load_hologram(args.hologram)
    system = hologram.system
    if args.preset is not None:
        lasers = {"wavelengths": system.wavelengths_m, "amplitudes": system.amplitudes}
        system = preset.load(args.preset).edit(lasers)
    system = with_changes(system, args.changes, effects)
    try:
        return system, Hologram(hologram.drive, system).drive
    except UserError as error:
        raise UserError(
            str(args.hologram),
            f"patterns of shape {_shapes_words(hologram.system)}",
            expected=f"{_shapes_words(system)} for {system.name}",
            remedy="leave the preset out to use the hologram's own bench",
        ) from error


def _shapes_words(system: System) -> str:
    """The shape of a bench's patterns, (frame, modulator, y, x); of a chain those of each element."""
    if not system.is_chain:
        return str(system.drive_shape)
    return ", ".join(f"{shape} of {name}" for name, shape in system.drive_shapes.items())


def _read_folder(folder: Path, system: System) -> Any:
    """The patterns of a folder, as `holoview export --png` names them: slm1.png, or NAME.png of a chain's elements, and
    NAME-frame0.png … of several frames. Raises UserError for a missing file, and as `read_pattern` does.
    """
    if shown := sorted(complex_names(system)):
        found = f'complex patterns, of "{shown[0]}"'
        raise UserError("--patterns", found, expected="phase and amplitude modulators, whose patterns pictures hold")
    names = list(system.drive_shapes) if system.is_chain else [f"slm{n + 1}" for n in range(len(system.modulators))]
    drives = {}
    for name, (frames, *shape) in zip(names, system.drive_shapes.values(), strict=True):
        files = [folder / (f"{name}.png" if frames == 1 else f"{name}-frame{n}.png") for n in range(frames)]
        drives[name] = np.stack([read_pattern(file, (shape[0], shape[1])) for file in files])
    return drives if system.is_chain else np.stack(list(drives.values()), axis=1)


def _read_patterns(args: argparse.Namespace, system: System) -> NDArray[np.float32]:
    """The patterns of --slm1 and --slm2, (frame, modulator, y, x). Raises UserError for too few or too many files."""
    if system.is_chain:
        expected = f"--patterns FOLDER with {', '.join(f'{name}.png' for name in system.drive_shapes)}"
        raise UserError("--slm1", "of a chain, whose elements have names", expected=expected)
    groups = [args.slm1] + ([args.slm2] if args.slm2 else [])
    frames, modulators = system.drive_shape[:2]
    if len(groups) != modulators or any(len(group) != frames for group in groups):
        found = " and ".join(f"{len(group)} for modulator {i}" for i, group in enumerate(groups, 1))
        expected = " and ".join(f"{frames} for --slm{i + 1}" for i in range(modulators))
        raise UserError("patterns", found, expected=f"{expected}: one a frame, for each modulator of {system.name}")
    shape = system.modulators[0].shape
    return np.stack([np.stack([read_pattern(path, shape) for path in group]) for group in groups], axis=1)


def _parse_planes(texts: list[str] | None, system: System) -> NDArray[np.float64]:
    """The distances of --plane in m, each once; "all" stands for the bench's planes, no text for the middle one."""
    if not texts:
        own_m = focused_planes(system)
        return own_m[len(own_m) // 2 :][:1]
    planes_m = [
        z
        for text in texts
        for z in (focused_planes(system) if text == "all" else [parse_plane(system, text, "--plane")])
    ]
    return np.array(list(dict.fromkeys(planes_m)))


def _plane_paths(output: Path, planes_m: NDArray[np.floating]) -> list[Path]:
    """The file of each plane."""
    if len(planes_m) == 1:
        return [output]
    return [path_with_suffix(output, units.format_exact(z, "mm").replace(" ", "")) for z in planes_m.tolist()]


def _write_planes(
    view: View,
    system: System,
    paths: list[Path],
    exposure: float,
    colours: tuple[ColourSpace | None, str],
    saver: ResultSaver,
) -> list[dict[str, Any]]:
    """Writes a PNG for each plane of a view; returns plane, file, contrast and mean luminance of each, for JSON.

    exposure: stops by which the view is brightened; the file's metadata tells them. colours: the space of 16-bit
    pictures, and how `gamut_map` fits colours into 8 bits.
    """
    space, gamut = colours
    view = view.exposed(exposure) if exposure else view
    files = []
    for i, (plane_m, wanted) in enumerate(zip(view.focus_m.tolist(), paths, strict=True)):
        plane = plane_label(system, plane_m)
        texts = {
            "holoview.preset": system.name,
            "holoview.plane": plane,
            "holoview.exposure": f"{exposure:g} stops",
            "holoview.backend": view.backend,
            "holoview.system": preset.dumps(system),
        }
        luminance = view.xyz[i, ..., 1]
        if space is None:
            save = partial(write_png, pixels=to_srgb8(view.rgb[i], gamut), texts=texts)
        else:
            save = partial(write_deep_png, signal=space.encode(view.xyz[i]), space=space, texts=texts)
        path = saver.save(wanted, save)
        figures = {"speckle_contrast": _speckle_contrast(luminance), "mean_luminance": float(luminance.mean())}
        files.append({"plane": plane, "file": str(path), **figures})
    if not to_srgb8(view.rgb.max()):  # of the brightest channel
        print_stderr("note: every picture is black; raise --exposure or the laser amplitudes")
    return files


def _speckle_contrast(luminance: NDArray[np.floating]) -> float | None:
    """Speckle contrast of the central half of an image (y, x); None if it is dark or too small."""
    try:
        return speckle_contrast(luminance, region=central_region(luminance.shape)).contrast
    except UserError:
        return None


# --- `--pupil-path`: pictures of what an eye sees while its pupil moves along a path ---


_FRAMES = 24
_SHORTEST_S = 0.1
_MAX_STOPS = 60  # 2^60 exceeds any brightness to see, and its square is still far inside the range of float64


def _exposure(text: str) -> float | str:
    """An argparse type: stops, or "auto"."""
    if text == "auto":
        return text
    stops = number()(text)
    if not abs(stops) <= _MAX_STOPS:
        raise argparse.ArgumentTypeError(f"{stops:g}; expected from -{_MAX_STOPS} to {_MAX_STOPS} stops")
    return stops


def _stops(exposure: float | str | None, view: View, system: System) -> float:
    """The stops of --exposure; of "auto", and where a field has none, those that make the brightest samples white."""
    if exposure is None and not system.is_field:
        return 0.0
    if isinstance(exposure, float):
        return exposure
    return fitting_stops(view.xyz)


def render_path(
    args: argparse.Namespace, system: System, drive: NDArray[np.float32], planes_m: NDArray[np.float64]
) -> int:
    """Writes an animation (PNG, GIF, MP4) or a folder of pictures, and prints what was made.

    planes_m: those of --plane, one of which is seen where the path tells no accommodation.
    """
    path, count = load_pupil_path(args.pupil_path), _FRAMES if args.frames is None else args.frames
    _check_path_arguments(args, path.accommodation_dpt is not None, planes_m, count)
    times_s, views = views_along(system, path, count, float(planes_m[0]))
    output = args.output or default_output(system.name, "path", ".png")
    write = _open_output(args, output, count, max(path.duration_s, _SHORTEST_S))
    texts = {"holoview.preset": system.name, "holoview.path": args.pupil_path.name}
    texts |= {"holoview.exposure": f"{_path_stops(args):g} stops", "holoview.system": preset.dumps(system)}
    started = time.perf_counter()
    with progress_bar("rendering") as progress:
        frames = exposed_pictures(views, drive, _path_stops(args), progress, backend=args.backend, adapter=args.adapter)
        if write is not None:
            write(list(frames), texts)
            files = [str(output)]
        else:
            files = write_pictures(frames, output, views, texts)
    _print_pictures(args, files, times_s, views, time.perf_counter() - started)
    return 0


def _check_path_arguments(
    args: argparse.Namespace, tells_focus: bool, planes_m: NDArray[np.float64], count: int
) -> None:
    """Raises UserError for arguments that contradict the path or each other."""
    check_adapter_applies(args)
    if args.exposure == "auto":
        raise UserError("--exposure", "auto with --pupil-path", expected="stops, the same for all pictures")
    if not 1 <= count <= MAX_FRAMES:
        raise UserError("--frames", str(count), expected=f"1 to {MAX_FRAMES}")
    if tells_focus and args.plane:
        raise UserError(
            "--plane", f"with {args.pupil_path}", expected="one of them: the path tells where it is focused"
        )
    if len(planes_m) > 1:
        raise UserError("--plane", f"{len(planes_m)} planes", expected="one, with --pupil-path")


def _path_stops(args: argparse.Namespace) -> float:
    return args.exposure or 0.0


def _open_output(args: argparse.Namespace, output: Path, count: int, duration_s: float) -> Encoder | None:
    """The encoder of an animation; None for a folder, which is made. Raises UserError for what can't be written."""
    suffix = output.suffix.lower()
    if suffix in SUFFIXES:
        check_suffix(output, suffix)
        check_files(args, {"-o": [output]})
        return open_encoder(output, count, duration_s)
    if suffix and not output.is_dir():
        raise UserError(str(output), f'the suffix "{suffix}"', expected=f"{', '.join(SUFFIXES)}, or a folder")
    make_folder(output)
    return None


def _print_pictures(
    args: argparse.Namespace, files: list[str], times_s: list[float], views: Sequence[SeenView], seconds: float
) -> None:
    if args.json:
        states = [describe_view(time_s, *view) for time_s, view in zip(times_s, views, strict=True)]
        print_json({"preset": views[0][0].name, "seconds": round(seconds, 3), "files": files, "states": states})
        return
    where = files[0] if len(files) == 1 else f"{files[0]} to {Path(files[-1]).name}"
    print(f"{len(views)} pictures of {times_s[-1]:.3g} s: {where} ({seconds:.2f} s)")
