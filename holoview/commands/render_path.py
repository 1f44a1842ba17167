"""What `holoview render --pupil-path` does: pictures of what an eye sees while its pupil moves along a path."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.colour import to_srgb8, xyz_to_linear_srgb
from holoview.commands.arguments import check_adapter_applies
from holoview.commands.console import print_json, progress_bar
from holoview.commands.default_output import default_output
from holoview.commands.output_files import check_files, check_suffix
from holoview.io.animation import MAX_FRAMES, SUFFIXES, Encoder, Pixels, open_encoder
from holoview.io.png import write_png
from holoview.io.pupil_path_file import load_pupil_path
from holoview.model import preset
from holoview.model.focus import plane_label
from holoview.model.pupil_path import views_along
from holoview.model.system import System
from holoview.render.plane_images import render_each
from holoview.util.errors import UserError
from holoview.util.file_writer import make_folder

_FRAMES = 24
_SHORTEST_S = 0.1
_MAX_STOPS = 60  # 2^60 exceeds any brightness to see, and its square is still far inside the range of float64


def check_exposure(stops: float) -> None:
    """Raises UserError for an exposure that no picture needs."""
    if not abs(stops) <= _MAX_STOPS:
        raise UserError("--exposure", f"{stops:g}", expected=f"from -{_MAX_STOPS} to {_MAX_STOPS} stops")


def render_path(
    args: argparse.Namespace, system: System, drive: NDArray[np.float32], planes_m: NDArray[np.float64]
) -> int:
    """Writes an animation (PNG, GIF, MP4) or a folder of pictures, and prints what was made.

    planes_m: those of --plane, one of which is seen where the path tells no accommodation.
    """
    path, count = load_pupil_path(args.pupil_path), _FRAMES if args.frames is None else args.frames
    _check(args, path.accommodation_dpt is not None, planes_m, count)
    times_s, views = views_along(system, path, count, float(planes_m[0]))
    output = args.output or default_output(system.name, "path", ".png")
    write = _open_output(args, output, count, max(path.duration_s, _SHORTEST_S))
    texts = {"holoview.preset": system.name, "holoview.path": args.pupil_path.name}
    texts |= {"holoview.exposure": f"{args.exposure:g} stops", "holoview.system": preset.dumps(system)}
    started = time.perf_counter()
    frames = _frames(args, views, drive)
    if write is not None:
        write(list(frames), texts)
        files = [str(output)]
    else:
        files = _write_pictures(frames, output, views, texts)
    _report(args, files, times_s, views, time.perf_counter() - started)
    return 0


def _check(args: argparse.Namespace, tells_focus: bool, planes_m: NDArray[np.float64], count: int) -> None:
    """Raises UserError for arguments that contradict the path or each other."""
    check_adapter_applies(args)
    check_exposure(args.exposure)
    if not 1 <= count <= MAX_FRAMES:
        raise UserError("--frames", str(count), expected=f"1 to {MAX_FRAMES}")
    if tells_focus and args.plane:
        raise UserError(
            "--plane", f"with {args.pupil_path}", expected="one of them: the path tells where it is focused"
        )
    if len(planes_m) > 1:
        raise UserError("--plane", f"{len(planes_m)} planes", expected="one, with --pupil-path")


def _open_output(args: argparse.Namespace, output: Path, count: int, duration_s: float) -> Encoder | None:
    """What writes an animation; None for a folder, which is made. Raises UserError for what can't be written."""
    suffix = output.suffix.lower()
    if suffix in SUFFIXES:
        check_suffix(output, suffix)
        check_files(args, {"-o": [output]})
        return open_encoder(output, count, duration_s)
    if suffix and not output.is_dir():
        raise UserError(str(output), f'the suffix "{suffix}"', expected=f"{', '.join(SUFFIXES)}, or a folder")
    make_folder(output)
    return None


def _frames(
    args: argparse.Namespace, views: Sequence[tuple[System, float]], drive: NDArray[np.float32]
) -> Iterator[Pixels]:
    """What is seen of each view, 8-bit sRGB (y, x, 3)."""
    with progress_bar("rendering") as progress:
        rendered = render_each(views, drive, backend=args.backend, adapter=args.adapter)
        for number, xyz in enumerate(rendered, start=1):
            yield to_srgb8(xyz_to_linear_srgb(xyz * 2.0**args.exposure))
            progress(number, len(views), "pictures")


def _write_pictures(
    frames: Iterator[Pixels], folder: Path, views: Sequence[tuple[System, float]], texts: dict[str, str]
) -> list[str]:
    files = []
    for number, (pixels, (system, plane_m)) in enumerate(zip(frames, views, strict=True)):
        files.append(str(folder / f"{number:04}.png"))
        own = {"holoview.plane": plane_label(system, plane_m, digits=7), "holoview.system": preset.dumps(system)}
        write_png(files[-1], pixels, texts | own)
    return files


def _report(
    args: argparse.Namespace,
    files: list[str],
    times_s: list[float],
    views: Sequence[tuple[System, float]],
    seconds: float,
) -> None:
    if not args.json:
        where = files[0] if len(files) == 1 else f"{files[0]} to {Path(files[-1]).name}"
        print(f"{len(views)} pictures of {times_s[-1]:.3g} s: {where} ({seconds:.2f} s)")
        return
    states: list[dict[str, Any]] = []
    for time_s, (system, plane_m) in zip(times_s, views, strict=True):
        assert system.eye is not None
        pupil_mm = system.eye.pupil_diameter_m(system.field_m) * 1e3
        place = {"y_mm": system.eye.pupil_y_m * 1e3, "x_mm": system.eye.pupil_x_m * 1e3, "pupil_mm": pupil_mm}
        states.append({"time_s": time_s, **place, "plane": plane_label(system, plane_m, digits=7)})
    print_json({"preset": views[0][0].name, "seconds": round(seconds, 3), "files": files, "states": states})
