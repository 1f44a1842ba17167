"""Writes images as PNG, with the settings that made them in text chunks; encodes PNG for the clipboard."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from holoview.document.document import Document
from holoview.document.editing_session import EditingSession
from holoview.document.export.suffix import with_default_suffix
from holoview.document.jobs import BackgroundJob, JobControl
from holoview.io.pictures import path_with_suffix, png_texts, write_png
from holoview.model import preset
from holoview.render.plane_images import render_planes
from holoview.render.tone_mapping import tone_map
from holoview.util import units
from holoview.util.errors import UserError


def png_metadata(document: Document, plane_m: float | None = None) -> dict[str, str]:
    """PNG text chunks for an image of a document; `plane_m` is its focal plane if not that of the view settings."""
    view = document.view_settings
    return {
        "holoview.preset": document.system.name,
        "holoview.patterns": document.origin,
        "holoview.plane": units.format_exact(view.plane_m if plane_m is None else plane_m, "mm"),
        "holoview.exposure": f"{view.exposure_stops:g} stops",
        "holoview.channel": view.channel,
        "holoview.system": preset.dumps(document.system),
    }


def save_view(session: EditingSession, path: Path, pixels: NDArray[np.uint8]) -> None:
    """Writes 8-bit sRGB pixels (y, x, 3). Raises UserError."""
    file = with_default_suffix(path, ".png")
    write_png(file, pixels, png_metadata(session.displayed_document))
    session.messages.post(f"view written to {file}")


def save_planes(session: EditingSession, path: Path) -> BackgroundJob:
    """Writes each focal plane of the system as PATH-10mm.png …, tone-mapped by the view settings, in the background.

    Raises UserError where one of these files is there already and isn't holoview's.
    """
    document, path = session.displayed_document, with_default_suffix(path, ".png")
    planes_m = [float(z) for z in np.unique(document.system.planes_m)]
    files = [path_with_suffix(path, units.format_exact(z, "mm").replace(" ", "")) for z in planes_m]
    for file in files:
        if file.exists() and not png_texts(file):
            raise UserError(str(file), "is there already, and isn't holoview's", remedy="choose another name")

    def work(control: JobControl) -> list[Path]:
        rendered = render_planes(document.system, document.drive, planes_m, control.check)
        for number, (xyz, plane_m, file) in enumerate(zip(rendered, planes_m, files, strict=True), start=1):
            write_png(file, tone_map(xyz, document.view_settings), png_metadata(document, plane_m))
            control.report(number, len(planes_m), file.name)
        return files

    def report(written: list[Path]) -> None:
        session.messages.post(f"{len(written)} planes written to {path.parent}")

    return session.jobs.start("Save planes", work, report)


def png_bytes(pixels: NDArray[np.uint8]) -> bytes:
    """The bytes of a PNG file of 8-bit sRGB pixels (y, x, 3)."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="PNG")
    return buffer.getvalue()
