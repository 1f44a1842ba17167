"""Make the demonstration pictures: `python -m assets.make_assets` from the root of the checkout (about ten minutes).

`--only chart|sharp|stack` makes some of them; `--preview N` draws the still life N pixels wide into another `--out`.
"""

from __future__ import annotations

import argparse
import io
import time
from pathlib import Path

import imagecodecs
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from assets.scene.chart import chart
from assets.scene.lens import focal_stack, pinhole
from assets.scene.still_life import scene
from assets.scene.trace import Camera
from holoview.light.colour import srgb_encode

PARTS = ("chart", "sharp", "stack")
_STEPS = 4095  # 12 bits of depth: a step is 0.004 pixels of blur, and the file is half as large as with 16
_NO_FILTER = 8  # PNG_FILTER_NONE


def main() -> None:
    """Write the chosen pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=PARTS, action="append", help="make only this part (may be repeated)")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder to write to")
    parser.add_argument("--preview", type=int, default=1024, metavar="WIDTH", help="width of the still life in pixels")
    options = parser.parse_args()
    parts, out, start = options.only or PARTS, options.out, time.perf_counter()
    camera = Camera(options.preview, options.preview * 3 // 4)
    if "chart" in parts:
        _write(out / "resolution.png", chart())
    still_life = scene() if set(parts) & {"sharp", "stack"} else None
    if still_life and "sharp" in parts:
        colour, depth = pinhole(still_life, camera)
        _write(out / "still-life.png", colour)
        _save(out / "still-life-depth.png", np.rint(np.rint(depth * _STEPS) / _STEPS * 65535).astype(np.uint16))
    if still_life and "stack" in parts:
        (out / "still-life-stack").mkdir(parents=True, exist_ok=True)
        for number, picture in enumerate(focal_stack(still_life, camera)):
            _write(out / "still-life-stack" / f"plane-{number}.png", picture)
    print(f"{', '.join(parts)} in {time.perf_counter() - start:.0f} s")


def _write(path: Path, linear: NDArray[np.float32]) -> None:
    _save(path, np.rint(np.clip(srgb_encode(linear), 0, 1) * 255).astype(np.uint8))


def _save(path: Path, codes: NDArray[np.unsignedinteger]) -> None:
    """As PNG, with or without row filters, whichever is smaller."""
    filtered = io.BytesIO()
    Image.fromarray(codes).save(filtered, "PNG", optimize=True)
    plain = bytes(imagecodecs.png_encode(codes, level=9, filter=_NO_FILTER))
    path.write_bytes(min(filtered.getvalue(), plain, key=len))


if __name__ == "__main__":
    main()
