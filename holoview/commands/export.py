"""`holoview export HOLOGRAM`: writes its patterns as PNG, one for each frame and modulator, to drive real modulators.

A pixel holds one of three things: a grey value from 0 to the maximum for an optical path from 0 to the stroke; with
`--levels` the number of its level, in rising order of optical path, which drivers call the state index; with
`--cells p67` the memory cells of a device, black for 0 and white for 1, in the order of `holoview.io.pictures`.
"""

from __future__ import annotations

import argparse

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.commands.number_options import whole
from holoview.commands.output_files import add_input, add_output_folder
from holoview.io.hologram import load_hologram
from holoview.io.pictures import CELL_MAPS, memory_cells, write_pattern, write_png
from holoview.model.bench_parts import Modulator
from holoview.optics.slm import level_numbers
from holoview.util.errors import UserError
from holoview.util.file_writer import make_folder


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(parser, "hologram", help="a hologram file")
    add_output_folder(parser, "--png", metavar="DIR", required=True, help="folder to write to; made if missing")
    parser.add_argument(
        "--bits", type=whole(1), choices=(8, 16), default=8, help="grey levels: 0…max stands for 0…stroke"
    )
    form = parser.add_mutually_exclusive_group()
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
    """Writes slm1.png, slm2.png, or slm1-frame0.png … with several frames, and prints their paths."""
    hologram = load_hologram(args.hologram)
    modulators = hologram.system.modulators
    flag = "--levels" if args.levels else "--cells" if args.cells else None
    if flag and any(modulator.levels is None for modulator in modulators):
        raise UserError(flag, "the modulators are continuous", expected="modulators with levels", remedy="leave it out")
    if args.cells:
        _check_cells(args.cells, modulators)
    make_folder(args.png)
    frames, texts = len(hologram.drive), {"holoview.preset": hologram.system.name}
    for frame, patterns in enumerate(hologram.drive):
        for number, (pattern, modulator) in enumerate(zip(patterns, modulators, strict=True), start=1):
            path = args.png / (f"slm{number}.png" if frames == 1 else f"slm{number}-frame{frame}.png")
            if args.levels:
                write_png(path, _level_number_image(pattern, modulator), {"holoview.pattern": "level number", **texts})
            elif args.cells:
                cells = memory_cells(_level_number_image(pattern, modulator), args.cells) * np.uint8(255)
                write_png(path, cells, {"holoview.pattern": f"memory cells of {args.cells}", **texts})
            else:
                write_pattern(path, pattern, args.bits, texts)
            print(path)
    return 0


def _check_cells(device: str, modulators: tuple[Modulator, ...]) -> None:
    """Raises UserError for an unknown device, or modulators with another number of levels than the device."""
    memory_cells(np.zeros((1, 1), dtype=np.int64), device)
    count = len(CELL_MAPS[device].level_codes)
    for modulator in modulators:
        if modulator.levels is not None and len(modulator.levels) != count:
            raise UserError("--cells", f"{len(modulator.levels)} levels", expected=f"{count}, as {device} has")


def _level_number_image(pattern: NDArray[np.float32], modulator: Modulator) -> NDArray[np.uint8 | np.uint16]:
    """The number of the level of each pixel, (y, x), for a pattern of fractions of the stroke."""
    assert modulator.levels is not None
    numbers = level_numbers(torch.from_numpy(pattern).double(), modulator).numpy()
    return numbers.astype(np.uint8 if len(modulator.levels) <= 256 else np.uint16)
