"""Repeats published examples of FLIP and ColorVideoVDP with holoview's own functions, from the files they were made of.

    python benchmarks/perceptual_scores.py --flip tree-ref.png tree-test.png --vdp wavy_facade.png

The files are not part of holoview. `tree-ref.png` and `tree-test.png` are in the folder `etc` of nv-flip-rs, whose
test states what NVIDIA's command line tool finds of them. `wavy_facade.png` is in the folder `example_media` of
ColorVideoVDP; its `examples/ex_simple_image.py` states what blur and noise do to it on a display of 200 cd/m² in a room
of 250 lux. The noise has no seed there, so that its last digits differ.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from holoview.holograms.files.image_reader import read_raster
from holoview.holograms.metrics.perceptual import color_video_vdp, flip
from holoview.light.colour import srgb_decode

PUBLISHED_FLIP, PUBLISHED_BLUR, PUBLISHED_NOISE = 0.133285, 8.514, 8.955
_WHITE_CD_M2, _BLACK_CD_M2, _ROOM_CD_M2 = 200.0, 0.2, 250 / np.pi * 0.005
_SAMPLES_PER_DEGREE = 75.40245  # of a 30-inch monitor of 3840 x 2160 pixels from 0.7472 m


def main() -> None:
    """Prints published and found values."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flip", nargs=2, type=Path, metavar=("REFERENCE", "TEST"))
    parser.add_argument("--vdp", type=Path, metavar="PICTURE")
    args = parser.parse_args()
    if args.flip:
        wanted, seen = (srgb_decode(read_raster(path).values[..., :3]) for path in args.flip)
        print(f"FLIP: published {PUBLISHED_FLIP:.6f}, found {flip(seen, wanted, 67.0).mean:.6f}")
    if args.vdp:
        signal = read_raster(args.vdp).values[..., :3].astype(np.float64)
        blurred = gaussian_filter(signal, (2, 2, 0), mode="nearest", truncate=2.0)
        noisy = np.clip(signal + np.random.default_rng(0).normal(0, np.sqrt(0.003), signal.shape), 0, 1)
        for name, published, seen in (("blur", PUBLISHED_BLUR, blurred), ("noise", PUBLISHED_NOISE, noisy)):
            score = color_video_vdp(_light(seen), _light(signal), _SAMPLES_PER_DEGREE, _WHITE_CD_M2)
            print(f"ColorVideoVDP, {name}: published {published:.3f} JOD, found {score.mean:.3f} JOD")


def _light(signal: NDArray[np.float64]) -> NDArray[np.float64]:
    """What the example's monitor shows of a display signal, relative to its white, with the room's reflection."""
    shown = (_WHITE_CD_M2 - _BLACK_CD_M2) * srgb_decode(signal) + _BLACK_CD_M2 + _ROOM_CD_M2
    return shown / _WHITE_CD_M2


if __name__ == "__main__":
    main()
