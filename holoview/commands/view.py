"""`holoview view [PRESET|FILE…]`: the interactive viewer."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from holoview.commands.arguments import add_changes, add_fields, given_fields, parse_samples, whole, with_changes
from holoview.commands.console import EXIT_DEVICE_LOST, print_stderr
from holoview.commands.hologram_files import (
    add_field_options,
    check_no_field_options,
    has_field_options,
    request_from_args,
)
from holoview.commands.output_files import add_input, add_output
from holoview.holograms.fields.reading import remember
from holoview.light.model import preset
from holoview.light.model.fields import fields_by_key, flag_of
from holoview.light.model.scheme import with_scheme
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.files import read_text
from holoview.util.processes import is_left, last_work_s, wait_for_threads
from holoview.util.progress import ProgressCallback
from holoview.viewer.app.serve import ServeOptions
from holoview.viewer.page.link import split_link

if TYPE_CHECKING:
    from holoview.viewer.document.document import Document
    from holoview.viewer.document.sweeper import SweepRequest, SweptCurve

_PRESET = "holochrome-8"
_SIZES = (320, 16384)
_REMEDY = "install the library that is missing; on Debian and Ubuntu: apt-get install libx11-6 libxext6"


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(
        parser,
        "names",
        nargs="*",
        metavar="PRESET|FILE",
        help="a preset, a hologram file, files of a field of another program, pattern PNGs or a picture to show; "
        f"a hologram for {_PRESET} if absent",
    )
    add_changes(parser)
    add_input(
        parser, "--rig", metavar="RIG.toml", type=Path, help="opens the devices of a rig; its bench, if none is named"
    )
    parser.add_argument("--size", default="1280x800", metavar="WxH", help="of the window, in pixels")
    parser.add_argument("--adapter", metavar="NAME", help="part of the name of the WebGPU adapter to use")
    parser.add_argument("--new", action="store_true", help="begin anew instead of with the last session")
    parser.add_argument("--random", action="store_true", help="random patterns: the speckle of the bench, no picture")
    parser.add_argument("--serve", metavar="HOST:PORT", help="show it in a browser; asks for the token that is printed")
    add_fields(parser.add_argument_group("with --serve"), ServeOptions, *fields_by_key(ServeOptions))
    parser.add_argument("--listen", action="store_true", help="show fields that programs on this machine send: hv.push")
    parser.add_argument(
        "--listen-port", metavar="PORT", type=whole(0, 65535), help="the port to listen on; a free one if absent"
    )
    parser.add_argument("--offscreen", action="store_true", help="draw it without a screen, for --script, --screenshot")
    parser.add_argument("--until-image", action="store_true", help="end when the first image is displayed, and say so")
    add_field_options(parser, has_plane=False)
    parser.add_argument("--recover", type=whole(0, 2**31), metavar="PID", help=argparse.SUPPRESS)  # of `supervisor`
    add_input(parser, "--script", metavar="FILE", type=Path, help="actions to do, a line each; with --offscreen")
    add_output(parser, "--screenshot", metavar="PNG", suffix=".png", help="a picture of the window; with --offscreen")


def run(args: argparse.Namespace) -> int:
    """Opens the viewer and returns when it is closed."""
    size = _size(args.size)
    _check(args)
    serve_options = _serve_options(args)
    system = _system(args)
    names = [name for name in args.names if not _is_preset(name)]
    names = list(args.names) if not names and len(args.names) > 1 else names  # benches beside each other
    request = request_from_args(args) if has_field_options(args) else None
    if request is not None and not names:
        check_no_field_options(args, "no file")
    if args.random and names:
        raise UserError("--random", f"with {names[0]}", expected="a preset or nothing with it")
    script = _read(args.script) if args.script is not None else ""
    try:
        from holoview.viewer.app.startup import Startup  # here: help needs no graphics or window library

        startup = Startup(args.adapter)  # before the imports of all else, which it overlaps with
        from holoview.light.gpu.device import DeviceLost
        from holoview.viewer.app.launch import LaunchOptions, launch
    except ImportError as error:  # a library of the operating system is missing; ImGui itself is a dependency
        raise UserError("view", f"its window can't be drawn: {error}", remedy=_REMEDY) from error
    options = LaunchOptions(
        system=system,
        is_random=args.random or bool(names),
        names=names,
        size=size,
        adapter=args.adapter,
        restores=not (args.new or args.random or args.names or args.changes or args.scheme or args.rig),
        serve=args.serve,
        is_offscreen=args.offscreen,
        script=script,
        script_name=str(args.script or "script"),
        screenshot=args.screenshot,
        until_image=args.until_image,
        recovers=args.recover,
        serve_options=serve_options,
        rig=args.rig,
        request=request,
        listen_port=(args.listen_port or 0) if args.listen else None,
        sweeper=_sweep,
    )
    if request is not None and args.remember:
        remember(names[0], request)
    try:
        launch(options, startup, print_stderr)
    except DeviceLost as error:
        print_stderr(f"holoview: {error.where}: {error.found}; your work is saved")
        return EXIT_DEVICE_LOST
    finally:
        if not is_left():
            wait_for_threads(last_work_s())
    return 0


def _sweep(
    document: Document, request: SweepRequest, report: ProgressCallback, show: Callable[[SweptCurve], None]
) -> None:
    """A `Sweeper`."""
    from holoview.evidence.sweep.in_viewer import sweep_document  # slow start: it imports torch

    sweep_document(document, request, report, show)


def _check(args: argparse.Namespace) -> None:
    if not args.offscreen and (args.script is not None or args.screenshot is not None):
        flag = "--script" if args.script is not None else "--screenshot"
        raise UserError(flag, "without --offscreen", expected="--offscreen with it")
    if args.offscreen and args.serve is not None:
        raise UserError("--serve", "with --offscreen", expected="one of them")
    if args.offscreen and args.script is None and args.screenshot is None and not args.until_image:
        raise UserError("--offscreen", "alone would show nothing", expected="--script or --screenshot with it")
    if args.listen_port is not None and not args.listen:
        raise UserError("--listen-port", "without --listen", expected="--listen with it")
    if args.listen and (args.offscreen or args.until_image):
        raise UserError("--listen", "without a window", expected="a window, or --serve")
    others = {"--serve": args.serve, "--script": args.script, "--screenshot": args.screenshot}
    for flag, value in others.items():
        if args.until_image and value is not None:
            raise UserError("--until-image", f"with {flag}", expected="one of them")


def _serve_options(args: argparse.Namespace) -> ServeOptions:
    """To whom the viewer is served. Raises UserError for such an option without --serve, and for wrong values."""
    given = {name: value for name, value in given_fields(args, ServeOptions).items() if value is not False}
    flag = next((flag_of(field) for field in fields(ServeOptions) if field.name in given), "")
    if flag and args.serve is None:
        raise UserError(flag, "without --serve", expected="--serve HOST:PORT with it")
    return ServeOptions(**given)


def _system(args: argparse.Namespace) -> System:
    """The system to open: the preset among the names, else the rig's or the default one, with the options' changes."""
    presets = [name for name in args.names if _is_preset(name)]
    if len(presets) > 1 and (args.changes or args.scheme is not None or len(presets) < len(args.names)):
        expected = "one preset, or presets alone, which are shown beside each other"
        raise UserError(presets[1], "a second preset", expected=expected, remedy="choose others in the window")
    if args.rig is not None and not args.names:
        from holoview.bench.experiment.rig_bench import read_rig_system  # slow start: only a rig needs it

        system = read_rig_system(args.rig)
    else:
        system = preset.load(presets[0] if presets else _PRESET)
    return with_changes(system if args.scheme is None else with_scheme(system, args.scheme), args.changes)


def _is_preset(name: str) -> bool:
    if name in preset.names() and not Path(name).exists():
        return True
    if Path(name).suffix == ".toml":
        return True
    if not split_link(name)[0].exists():
        preset.load(name)  # raises: neither a file nor a preset, with near matches
    return False


def _read(path: Path) -> str:
    return read_text(path, "a script, a line an action")


def _size(text: str) -> tuple[int, int]:
    expected = f"WIDTHxHEIGHT, each from {_SIZES[0]} to {_SIZES[1]} pixels"
    width, height = parse_samples(text.replace("×", "x"), 2, "--size", expected, "x")
    if not all(_SIZES[0] <= side <= _SIZES[1] for side in (width, height)):
        raise UserError("--size", f'"{text}"', expected=expected)
    return width, height
