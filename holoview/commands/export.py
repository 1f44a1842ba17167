"""`holoview export HOLOGRAM`: as a page that any browser shows live, as patterns for real modulators, or as a field.

`--html` writes one file for one hologram, or for several to compare (`holoview.viewer.page`). `--field` writes the
complex field behind the last modulator, or the field of another program's file, as a field file. `--light` writes what
an observer sees at the focal planes as numbers: .exr, .npz, .tif or .npy. `--png` writes a PNG for each frame and
modulator. A pixel holds one of three things: a grey value from 0 to the maximum for an optical path from 0 to the
stroke; with `--levels` the number of its level, in rising order of optical path, which drivers call the state index;
with `--cells p67` the memory cells of a device, black for 0 and white for 1 (`holoview.holograms.files.pictures`).
patterns.json beside them says what every file is, and test.png shows on a camera whether patterns arrive unscaled and
with all their levels.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.bench.captures.gratings import signal_pattern
from holoview.commands.arguments import parse_region, whole
from holoview.commands.console import progress_bar
from holoview.commands.hologram_files import add_field_options, open_files
from holoview.commands.output_files import add_input, add_output, add_output_folder, check_files
from holoview.commands.speckle_options import add_target, target_from_args
from holoview.holograms.files.light_writer import check_light_suffix
from holoview.holograms.files.pattern_manifest import MANIFEST, Driven, PatternFile, pattern_manifest
from holoview.holograms.files.pictures import (
    CELL_MAPS,
    PATH_PATTERN,
    memory_cells,
    pattern_pixels,
    write_bmp,
    write_png,
)
from holoview.holograms.hologram import Hologram
from holoview.holograms.view import as_field, save, simulate
from holoview.light.model.drives import complex_names
from holoview.light.model.elements import AmplitudeModulator, PhaseModulator
from holoview.light.model.focus import parse_plane
from holoview.light.optics.slm import level_numbers
from holoview.util.errors import UserError
from holoview.util.file_writer import make_folder, write_file
from holoview.viewer.page.page import export_html


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(
        parser,
        "hologram",
        nargs="+",
        help="a hologram's file; with --html several, to compare; with --parts several that are the parts of one field",
    )
    form = parser.add_mutually_exclusive_group(required=True)
    add_output_folder(form, "--png", metavar="DIR", help="folder of patterns to write to; made if missing")
    add_output_folder(form, "--bmp", metavar="DIR", help="the same as BMP, which drivers of modulators may want")
    add_output(form, "--html", metavar="HTML", suffix=".html", help="page to write, which any browser shows live")
    add_output(form, "--field", metavar="FILE", suffix=".safetensors", help="field file to write")
    add_output(
        form, "--light", metavar="FILE", suffix="", help="numbers of the planes to write: .exr, .npz, .tif, .npy"
    )
    _configure_page(parser.add_argument_group("with --html"))
    _configure_patterns(parser.add_argument_group("with --png and --bmp"))
    add_field_options(parser)


def _configure_page(group: argparse._ArgumentGroup) -> None:
    add_target(group)
    group.add_argument(
        "--plane", metavar="DISTANCE", help="focal plane that the page opens with; the middle one if absent"
    )
    group.add_argument(
        "--region", metavar="X,Y,W,H", help="samples whose speckle contrast the page states and computes"
    )
    group.add_argument("--title", default="", help="heading of the page; the holograms' names if absent")
    group.add_argument("--note", default="", help="a sentence below the heading")
    group.add_argument("--backend", default="auto", help="what renders the pictures for browsers without WebGPU")


def _configure_patterns(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--bits", type=whole(1), choices=(8, 16), default=8, help="grey levels: 0…max stands for 0…stroke"
    )
    form = group.add_mutually_exclusive_group()
    form.add_argument(
        "--levels",
        action="store_true",
        help="write the modulator's level numbers 0…n-1 in rising order of path instead",
    )
    form.add_argument(
        "--cells",
        metavar="DEVICE",
        help=f"write the memory cells of a phase light modulator ({', '.join(CELL_MAPS)}) instead, "
        "twice as many a side",
    )


def run(args: argparse.Namespace) -> int:
    """Writes the page or the patterns, and prints their paths."""
    if args.html is not None:
        return _export_page(args)
    holograms = _opened(args)
    if len(holograms) > 1:
        flag = next(f"--{name}" for name in ("png", "bmp", "field", "light") if getattr(args, name) is not None)
        raise UserError(flag, f"{len(holograms)} holograms", expected="one", remedy="export them one by one")
    (_, hologram), *_ = holograms
    if args.field is not None:
        as_field(hologram).save(args.field)
        print(args.field)
        return 0
    if args.light is not None:
        check_light_suffix(args.light)
        check_files(args, {"--light": [args.light]})
        with progress_bar("light") as progress:
            view = simulate(hologram, progress=lambda done, total: progress(done, total, "wavelengths"))
        save(view, args.light)
        print(args.light)
        return 0
    if hologram.system.is_field:
        flag, remedy = "--png" if args.bmp is None else "--bmp", "--html or --field writes a field"
        raise UserError(flag, "a field", expected="patterns of modulators", remedy=remedy)
    return _export_patterns(args, hologram)


def _opened(args: argparse.Namespace) -> list[tuple[str, Hologram]]:
    """The holograms of the files and their names; files that are the parts of one field make one hologram."""
    groups = [args.hologram] if args.parts else [[file] for file in args.hologram]
    return [(Path(files[0]).stem, open_files(files, args).hologram) for files in groups]


def _export_page(args: argparse.Namespace) -> int:
    """Writes the page, and prints its path and size."""
    holograms = _named(_opened(args))
    system = next(iter(holograms.values())).system
    plane_m = None if args.plane is None else parse_plane(system, args.plane, "--plane")
    source = target_from_args(args, system)
    target = None if source is None else source.build() if plane_m is None else source.with_plane(plane_m)
    with progress_bar("pictures of the planes") as progress:
        export_html(
            args.html,
            holograms,
            target=target,
            title=args.title,
            note=args.note,
            plane_m=plane_m,
            region=None if args.region is None else parse_region(args.region),
            backend=args.backend,
            progress=lambda done, total: progress(done, total, "wavelengths"),
        )
    print(f"{args.html} ({args.html.stat().st_size / 1e6:.1f} MB)")
    return 0


def _named(holograms: list[tuple[str, Hologram]]) -> dict[str, Hologram]:
    """Holograms by names that differ: files of the same name are numbered."""
    named: dict[str, Hologram] = {}
    for name, hologram in holograms:
        number = sum(other == name or other.startswith(f"{name} (") for other in named)
        named[f"{name} ({number + 1})" if number else name] = hologram
    return named


def _export_patterns(args: argparse.Namespace, hologram: Hologram) -> int:
    """Writes slm1.png, slm2.png, or slm1-frame0.png … with several frames, of a chain NAME.png of its elements, a test
    pattern and the manifest, and prints their paths.
    """
    system, driven = hologram.system, _driven(hologram)
    flag = "--levels" if args.levels else "--cells" if args.cells else None
    if flag and any(shown.levels is None for shown in driven.values()):
        raise UserError(flag, "the modulators are continuous", expected="modulators with levels", remedy="leave it out")
    if args.cells:
        _check_cells(args.cells, driven.values())
    folder, suffix = (args.png, ".png") if args.bmp is None else (args.bmp, ".bmp")
    if suffix == ".bmp" and args.bits == 16:
        raise UserError("--bits 16", "with --bmp, which has 8", expected="--png, or --bits 8")
    meaning = "level number" if args.levels else f"memory cells of {args.cells}" if args.cells else "path"
    make_folder(folder)
    files: list[PatternFile] = []
    for frame in range(system.frames):
        for key, shown in driven.items():
            patterns = hologram.drive[key] if system.is_chain else hologram.drive[:, int(key) - 1]
            if frame >= len(patterns):
                continue  # all frames show one pattern
            if args.levels:
                pixels = _level_number_image(patterns[frame], shown)
            elif args.cells:
                pixels = memory_cells(_level_number_image(patterns[frame], shown), args.cells) * np.uint8(255)
            else:
                pixels = pattern_pixels(patterns[frame], args.bits)
            name = str(key) if system.is_chain else f"slm{key}"
            path = folder / (f"{name}{suffix}" if len(patterns) == 1 else f"{name}-frame{frame}{suffix}")
            moment = None if len(patterns) == 1 else frame
            files.append(_write_pattern(path, pixels, meaning, system.name, key, moment))
    test = None
    if not flag:
        name = "test" if "test" not in driven else "test of the signal"
        pixels = signal_pattern(next(iter(driven.values())).shape, args.bits)
        test = _write_pattern(folder / f"{name}{suffix}", pixels, "test of the signal", system.name)
    manifest = pattern_manifest(system, driven, meaning, args.bits, files, test)
    write_file(folder / MANIFEST, json.dumps(manifest, indent=1))
    print(folder / MANIFEST)
    return 0


def _driven(hologram: Hologram) -> dict[int | str, Driven]:
    """What shows the patterns of a hologram: its modulators by number, or a chain's elements by name."""
    system = hologram.system
    if not system.is_chain:
        return dict(enumerate(system.modulators, start=1))
    if shown := sorted(complex_names(system)):
        found = f'complex patterns, of "{shown[0]}"'
        raise UserError("--png", found, expected="--light, or the hologram's file itself")
    named = zip(system.element_names, system.elements, strict=True)
    return {
        name: element
        for name, element in named
        if name in hologram.drive and isinstance(element, PhaseModulator | AmplitudeModulator)
    }


def _write_pattern(
    path: Path,
    pixels: NDArray[np.uint8 | np.uint16],
    meaning: str,
    name: str,
    shown_by: int | str = 0,
    frame: int | None = None,
) -> PatternFile:
    """Writes the pixels of a pattern, prints the path, and says what it wrote."""
    if path.suffix == ".bmp":
        write_bmp(path, pixels.astype(np.uint8))
    else:
        element = {"holoview.element": shown_by} if isinstance(shown_by, str) else {}
        said = PATH_PATTERN if meaning == "path" else meaning
        write_png(path, pixels, {"holoview.pattern": said, "holoview.preset": name} | element)
    print(path)
    return PatternFile(path.name, shown_by, frame, pixels.shape, hashlib.sha256(path.read_bytes()).hexdigest())


def _check_cells(device: str, modulators: Iterable[Driven]) -> None:
    """Raises UserError for an unknown device, or modulators with another number of levels than the device."""
    memory_cells(np.zeros((1, 1), dtype=np.int64), device)
    count = len(CELL_MAPS[device].level_codes)
    for modulator in modulators:
        if modulator.levels is not None and len(modulator.levels) != count:
            raise UserError("--cells", f"{len(modulator.levels)} levels", expected=f"{count}, as {device} has")


def _level_number_image(pattern: NDArray[np.float32], modulator: Driven) -> NDArray[np.uint8 | np.uint16]:
    """The number of the level of each pixel, (y, x), for a pattern of fractions of the stroke."""
    assert modulator.levels is not None
    numbers = level_numbers(torch.from_numpy(pattern).double(), modulator).numpy()
    return numbers.astype(np.uint8 if len(modulator.levels) <= 256 else np.uint16)
