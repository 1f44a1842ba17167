"""PNG files of what is seen, and bytes for the clipboard. Text chunks hold the setting that made a picture."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from holoview.io.png import path_with_suffix, write_png
from holoview.model import preset
from holoview.session.document import Document
from holoview.session.editing_session import EditingSession
from holoview.session.export.hologram_files import with_default_suffix
from holoview.session.jobs import BackgroundJob, JobControl
from holoview.session.rendering import render_planes
from holoview.session.tone_mapping import tone_map
from holoview.util import units


def png_metadata(state: Document, plane_m: float | None = None) -> dict[str, str]:
    """What a picture of a state says of how it was made."""
    look = state.view_settings
    return {
        "holoview.preset": state.system.name,
        "holoview.patterns": state.origin,
        "holoview.plane": units.format_exact(look.plane_m if plane_m is None else plane_m, "mm"),
        "holoview.exposure": f"{look.exposure_stops:g} stops",
        "holoview.channel": look.channel,
        "holoview.system": preset.dumps(state.system),
    }


def save_view(session: EditingSession, path: Path, seen: NDArray[np.uint8]) -> None:
    """Writes 8-bit pixels (y, x, 3), as they are on the screen. Raises UserError."""
    file = with_default_suffix(path, ".png")
    write_png(file, seen, png_metadata(session.displayed_document))
    session.messages.post(f"view written to {file}")


def save_planes(session: EditingSession, path: Path) -> BackgroundJob:
    """Writes every focal plane of the bench as PATH-10mm.png … in the background, toned as the look says."""
    state, path = session.displayed_document, with_default_suffix(path, ".png")

    def work(control: JobControl) -> list[Path]:
        planes_m = [float(z) for z in np.unique(state.system.planes_m)]
        written = []
        for xyz, plane_m in zip(
            render_planes(state.system, state.drive, planes_m, control.check), planes_m, strict=True
        ):
            plane = units.format_exact(plane_m, "mm").replace(" ", "")
            written.append(path_with_suffix(path, plane))
            write_png(written[-1], tone_map(xyz, state.view_settings), png_metadata(state, plane_m))
            control.report(len(written), len(planes_m), written[-1].name)
        return written

    def tell(written: list[Path]) -> None:
        session.messages.post(f"{len(written)} planes written to {path.parent}")

    return session.jobs.start("Save planes", work, tell)


def png_bytes(seen: NDArray[np.uint8]) -> bytes:
    """A PNG file of 8-bit pixels, as clipboards take it."""
    buffer = io.BytesIO()
    Image.fromarray(seen).save(buffer, format="PNG")
    return buffer.getvalue()
