"""Writes what an eye sees from nine places of the eyebox as a contact sheet."""

from __future__ import annotations

from pathlib import Path

from holoview.document.editing_session import EditingSession
from holoview.document.export.png_images import png_metadata
from holoview.document.export.suffix import with_default_suffix
from holoview.document.eye_edits import dioptres_text, eye_of, eyebox_half_m, pupil_diameter_m
from holoview.document.jobs import BackgroundJob, JobControl
from holoview.io.pictures import write_png
from holoview.model.focus import with_pupil_at
from holoview.numerics.sampling import positions
from holoview.render.plane_images import render_each
from holoview.render.tone_mapping import tone_map
from holoview.report.images import CaptionedTile, contact_sheet

_SIDE = 3  # places along each axis
_SPACING = 0.5  # between places, over half the side of the eyebox at the shortest wavelength


def save_pupil_sheet(session: EditingSession, path: Path) -> BackgroundJob:
    """Writes a contact sheet as PNG: 3 x 3 places around the pupil, at the displayed plane, in the background.

    The places are a quarter of the eyebox of the shortest wavelength apart. Raises UserError without an eye.
    """
    document, path = session.displayed_document, with_default_suffix(path, ".png")
    system, eye = document.system, eye_of(document.system)
    steps = positions(_SIDE, _SPACING * eyebox_half_m(system, float(system.wavelengths_m.min()))).tolist()
    places = [(eye.pupil_y_m + y, eye.pupil_x_m + x) for y in steps for x in steps]
    plane_m = document.view_settings.plane_m
    dioptres = dioptres_text(system, plane_m)
    title = f"Through a pupil of {pupil_diameter_m(system) * 1e3:.3g} mm, focused at {dioptres}, from nine places"

    def work(control: JobControl) -> Path:
        views = [(with_pupil_at(system, place), plane_m) for place in places]
        tiles = []
        for xyz, (y, x) in zip(render_each(views, document.drive, control.check), places, strict=True):
            caption = f"y {y * 1e3:+.2f}, x {x * 1e3:+.2f} mm"
            tiles.append(CaptionedTile(tone_map(xyz, document.view_settings), caption))
            control.report(len(tiles), len(views), caption)
        rows = [tiles[i : i + _SIDE] for i in range(0, len(tiles), _SIDE)]
        write_png(path, contact_sheet(title, [""] * _SIDE, rows), png_metadata(document))
        return path

    return session.jobs.start("Save pupil sheet", work, lambda written: session.messages.post(f"{written} written"))
