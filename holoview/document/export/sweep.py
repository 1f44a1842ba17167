"""Writes an animated focal sweep, from the farthest plane to the nearest and back, as PNG (APNG), GIF or MP4."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from holoview.document.document import Document
from holoview.document.editing_session import EditingSession
from holoview.document.export.png_images import png_metadata
from holoview.document.jobs import BackgroundJob, JobControl
from holoview.io.pictures import Pixels, open_encoder
from holoview.render.plane_images import render_planes
from holoview.render.tone_mapping import tone_map
from holoview.util.errors import UserError


def save_sweep(session: EditingSession, path: Path, *, frames: int = 24, seconds: float = 3.0) -> BackgroundJob:
    """Writes `frames` evenly spaced planes, played forwards and backwards in `seconds`, in the background.

    Raises UserError for less than two frames, and as `open_encoder` does.
    """
    if frames < 2:
        raise UserError("sweep", f"{frames} frames", expected="2 or more")
    write, document = open_encoder(path, 2 * frames - 2, seconds), session.displayed_document

    def work(control: JobControl) -> Path:
        forward = list(_frames(document, frames, control))
        control.report(frames, frames, "encoding")
        write([*forward, *forward[-2:0:-1]], png_metadata(document))
        return path

    return session.jobs.start(
        "Focal sweep", work, lambda written: session.messages.post(f"focal sweep written to {written}")
    )


def _frames(document: Document, count: int, control: JobControl) -> Iterator[Pixels]:
    far, near = float(document.system.planes_m.min()), float(document.system.planes_m.max())
    if far == near:
        raise UserError("focal sweep", "the bench has one focal plane", expected="two or more", remedy="add planes")
    planes_m = [float(z) for z in np.linspace(far, near, count)]
    for written, xyz in enumerate(render_planes(document.system, document.drive, planes_m, control.check), start=1):
        yield tone_map(xyz, document.view_settings)
        control.report(written, count, f"plane {written} of {count}")
