"""An animated focal sweep: from the nearest plane to the farthest and back, as GIF or MP4."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.session.document import Document
from holoview.session.editing_session import EditingSession
from holoview.session.jobs import BackgroundJob, JobControl
from holoview.session.rendering import render_planes
from holoview.session.tone_mapping import tone_map
from holoview.util.errors import UserError
from holoview.util.files import atomic_write

SUFFIXES = (".gif", ".mp4")
_MOST_FRAMES = 600


def save_sweep(session: EditingSession, path: Path, *, frames: int = 24, seconds: float = 3.0) -> BackgroundJob:
    """Writes `frames` planes, evenly from nearest to farthest, played there and back in `seconds`, in the background.

    Raises UserError for another suffix than .gif and .mp4, numbers that make no sense, and where a library is missing.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise UserError(str(path), f'the suffix "{path.suffix}"', expected=" or ".join(SUFFIXES))
    if not (2 <= frames <= _MOST_FRAMES and 0.1 <= seconds <= 600):
        raise UserError(
            "sweep", f"{frames} frames in {seconds:g} s", expected=f"2 to {_MOST_FRAMES} frames, 0.1 to 600 s"
        )
    writer = _import_imageio(path.suffix.lower())
    state = session.displayed_document

    def work(control: JobControl) -> Path:
        there = list(_frames(state, frames, control))
        control.report(frames, frames, "encoding")
        back = there[-2:0:-1]
        with atomic_write(path) as temporary:
            _encode(writer, temporary, [*there, *back], (len(there) + len(back)) / seconds)
        return path

    return session.jobs.start("Focal sweep", work, lambda done: session.messages.post(f"focal sweep written to {done}"))


def _frames(state: Document, count: int, control: JobControl) -> Iterator[NDArray[np.uint8]]:
    near, far = float(state.system.planes_m.min()), float(state.system.planes_m.max())
    if near == far:
        raise UserError("focal sweep", "the bench has one focal plane", expected="two or more", remedy="add planes")
    planes_m = [float(z) for z in np.linspace(near, far, count)]
    for done, xyz in enumerate(render_planes(state.system, state.drive, planes_m, control.check), start=1):
        yield _crop_to_even(tone_map(xyz, state.view_settings))
        control.report(done, count, f"plane {done} of {count}")


def _crop_to_even(seen: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Even sides, which video asks for: a last odd row or column is left out."""
    rows, columns = seen.shape[:2]
    return seen[: rows - rows % 2, : columns - columns % 2]


def _import_imageio(suffix: str) -> Any:
    """imageio, with PyAV for video. Raises UserError where one is missing, with how to install it."""
    try:
        if suffix == ".mp4":
            importlib.import_module("av")
        return importlib.import_module("imageio.v3")
    except ImportError as error:
        raise UserError(
            f"a {suffix} file",
            f"{error.name} isn't installed",
            remedy='install it with `pip install "holoview[export]"`',
        ) from error


def _encode(writer: Any, path: Path, frames: list[NDArray[np.uint8]], rate: float) -> None:
    stack = np.stack(frames)
    if path.suffix.lower() == ".gif":
        writer.imwrite(path, stack, duration=1000.0 / rate, loop=0)
    else:
        writer.imwrite(path, stack, plugin="pyav", codec="libx264", fps=max(round(rate), 1))
