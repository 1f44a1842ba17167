"""PNG files of what is seen, and bytes for the clipboard. Text chunks hold the setting that made a picture."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from holoview import preset, units
from holoview.pictures import numbered, write_png
from holoview.session.export.documents import with_suffix
from holoview.session.jobs import Control, Job
from holoview.session.rendering import planes_seen
from holoview.session.session import Session
from holoview.session.state import State
from holoview.session.tone import pixels


def texts_of(state: State, plane_m: float | None = None) -> dict[str, str]:
    """What a picture of a state says of how it was made."""
    look = state.look
    return {
        "holoview.preset": state.system.name,
        "holoview.patterns": state.origin,
        "holoview.plane": units.text(look.plane_m if plane_m is None else plane_m, "mm"),
        "holoview.exposure": f"{look.exposure_stops:g} stops",
        "holoview.channel": look.channel,
        "holoview.system": preset.dumps(state.system),
    }


def save_view(session: Session, path: Path, seen: NDArray[np.uint8]) -> None:
    """Writes 8-bit pixels (y, x, 3), as they are on the screen. Raises UserError."""
    file = with_suffix(path, ".png")
    write_png(file, seen, texts_of(session.shown))
    session.messages.post(f"view written to {file}")


def save_planes(session: Session, path: Path) -> Job:
    """Writes every focal plane of the bench as PATH-10mm.png … in the background, toned as the look says."""
    state, path = session.shown, with_suffix(path, ".png")

    def work(control: Control) -> list[Path]:
        planes_m = [float(z) for z in np.unique(state.system.planes_m)]
        written = []
        for xyz, plane_m in zip(planes_seen(state.system, state.drive, planes_m, control.check), planes_m, strict=True):
            plane = units.text(plane_m, "mm").replace(" ", "")
            written.append(numbered(path, plane))
            write_png(written[-1], pixels(xyz, state.look), texts_of(state, plane_m))
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
