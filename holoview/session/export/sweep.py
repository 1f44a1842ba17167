"""Writes an animated focal sweep, from the farthest plane to the nearest and back, as GIF or MP4."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from holoview.session.document import Document
from holoview.session.editing_session import EditingSession
from holoview.session.export.suffix import check_suffix
from holoview.session.jobs import BackgroundJob, JobControl
from holoview.session.rendering import render_planes
from holoview.session.tone_mapping import tone_map
from holoview.util.errors import UserError
from holoview.util.files import atomic_write
from holoview.util.optional_library import import_optional

SUFFIXES = (".gif", ".mp4")
_MAX_FRAMES = 600


def save_sweep(session: EditingSession, path: Path, *, frames: int = 24, seconds: float = 3.0) -> BackgroundJob:
    """Writes `frames` evenly spaced planes, played forwards and backwards in `seconds`, in the background.

    Raises UserError for another suffix than .gif and .mp4, for numbers out of range, and for .mp4 without the libraries
    of the extra "export".
    """
    path = check_suffix(path, SUFFIXES)
    if not (2 <= frames <= _MAX_FRAMES and 0.1 <= seconds <= 600):
        expected = f"2 to {_MAX_FRAMES} frames, 0.1 to 600 s"
        raise UserError("sweep", f"{frames} frames in {seconds:g} s", expected=expected)
    encode = _encode_gif if path.suffix.lower() == ".gif" else _mp4_encoder()
    document = session.displayed_document

    def work(control: JobControl) -> Path:
        forward = list(_frames(document, frames, control))
        control.report(frames, frames, "encoding")
        backward = forward[-2:0:-1]
        with atomic_write(path) as temporary:
            encode(temporary, [*forward, *backward], (len(forward) + len(backward)) / seconds)
        return path

    return session.jobs.start(
        "Focal sweep", work, lambda written: session.messages.post(f"focal sweep written to {written}")
    )


def _frames(document: Document, count: int, control: JobControl) -> Iterator[NDArray[np.uint8]]:
    far, near = float(document.system.planes_m.min()), float(document.system.planes_m.max())
    if far == near:
        raise UserError("focal sweep", "the bench has one focal plane", expected="two or more", remedy="add planes")
    planes_m = [float(z) for z in np.linspace(far, near, count)]
    for written, xyz in enumerate(render_planes(document.system, document.drive, planes_m, control.check), start=1):
        yield _crop_to_even(tone_map(xyz, document.view_settings))
        control.report(written, count, f"plane {written} of {count}")


def _crop_to_even(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Crops to an even number of rows and columns, which video codecs require."""
    rows, columns = pixels.shape[:2]
    return pixels[: rows - rows % 2, : columns - columns % 2]


def _encode_gif(path: Path, frames: list[NDArray[np.uint8]], rate: float) -> None:
    first, *others = [Image.fromarray(frame) for frame in frames]
    first.save(path, format="GIF", save_all=True, append_images=others, duration=1000.0 / rate, loop=0)


def _mp4_encoder() -> Callable[[Path, list[NDArray[np.uint8]], float], None]:
    """A function that writes MP4 by imageio and PyAV, which imageio loads. Raises UserError if one isn't installed."""
    import_optional("av", "an .mp4 file")
    writer = import_optional("imageio.v3", "an .mp4 file")

    def encode(path: Path, frames: list[NDArray[np.uint8]], rate: float) -> None:
        writer.imwrite(path, np.stack(frames), plugin="pyav", codec="libx264", fps=max(round(rate), 1))

    return encode
