"""Writes the displayed hologram as a page that any browser shows live, in the background."""

from __future__ import annotations

from pathlib import Path

from holoview.document.editing_session import EditingSession
from holoview.document.export.suffix import check_suffix, with_default_suffix
from holoview.document.jobs import BackgroundJob, JobControl
from holoview.io.hologram import Hologram
from holoview.page.page import export_html


def save_page(session: EditingSession, path: Path) -> BackgroundJob:
    """Writes the hologram and its bench, opened at the present focal plane. Raises UserError for another suffix."""
    document, file = session.displayed_document, check_suffix(with_default_suffix(path, ".html"), [".html"])
    hologram = Hologram(document.drive, document.system)

    def work(control: JobControl) -> Path:
        def progress(done: int, total: int) -> None:
            control.check()
            control.report(done, total, "pictures of the planes")

        name = document.system.name or file.stem
        return export_html(file, {name: hologram}, plane_m=document.view_settings.plane_m, progress=progress)

    return session.jobs.start("Page", work, lambda written: session.messages.post(f"page written to {written}"))
