"""Writes the path of the pupil as a table, and what is seen along it as an animation or as pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from holoview.document.document import Document
from holoview.document.editing_session import EditingSession
from holoview.document.export.png_images import png_metadata
from holoview.document.export.suffix import check_suffix, with_default_suffix
from holoview.document.jobs import BackgroundJob, JobControl
from holoview.io.pictures import MAX_FRAMES, Pixels, open_encoder, path_with_suffix, write_png
from holoview.io.pupil_path_file import SUFFIX, save_pupil_path
from holoview.model.pupil_path import PupilPath, views_along
from holoview.render.plane_images import render_each
from holoview.render.tone_mapping import tone_map
from holoview.util.errors import UserError

_SHORTEST_S = 0.1  # of an animation


def save_path(session: EditingSession, path: Path) -> None:
    """Writes the path of the pupil as CSV. Raises UserError without one."""
    file = check_suffix(with_default_suffix(path, SUFFIX), (SUFFIX,))
    save_pupil_path(file, _path_of(session.document))
    session.messages.post(f"path of the pupil written to {file}")


def save_path_animation(session: EditingSession, path: Path, *, frames: int = 24) -> BackgroundJob:
    """Writes what is seen at `frames` equal steps along the path, as long as it takes, in the background.

    Raises UserError without a path or an eye, and as `open_encoder` does.
    """
    document = session.displayed_document
    write = open_encoder(path, frames, max(_path_of(document).duration_s, _SHORTEST_S))
    views = _views(document, frames)

    def work(control: JobControl) -> Path:
        pixels = list(_frames(views, control))
        control.report(frames, frames, "encoding")
        write(pixels, png_metadata(document))
        return path

    return _start(session, "Path animation", work)


def save_path_pictures(session: EditingSession, path: Path, *, frames: int = 24) -> BackgroundJob:
    """Writes what is seen at `frames` equal steps along the path as PATH-000.png …, in the background.

    Raises UserError without a path or an eye, and for a number out of range.
    """
    path = check_suffix(with_default_suffix(path, ".png"), (".png",))
    if not 1 <= frames <= MAX_FRAMES:
        raise UserError("pictures", str(frames), expected=f"1 to {MAX_FRAMES}")
    views = _views(session.displayed_document, frames)

    def work(control: JobControl) -> Path:
        for number, pixels in enumerate(_frames(views, control)):
            write_png(path_with_suffix(path, f"{number:03}"), pixels, png_metadata(views[number]))
        return path.parent

    return _start(session, "Path pictures", work)


def _start(session: EditingSession, title: str, work: Callable[[JobControl], Path]) -> BackgroundJob:
    def report(written: Path) -> None:
        session.messages.post(f"{title.lower()} written to {written}")

    return session.jobs.start(title, work, report)


def _path_of(document: Document) -> PupilPath:
    path = document.view_settings.pupil_path
    if path is None:
        raise UserError("pupil path", "there is none", expected="a path to write", remedy="record one, or open one")
    return path


def _views(document: Document, count: int) -> list[Document]:
    """The document as it is seen at some steps along its path."""
    view = document.view_settings
    _, seen = views_along(document.system, _path_of(document), count, view.plane_m)
    return [replace(document, system=system, view_settings=view.with_(plane_m=plane_m)) for system, plane_m in seen]


def _frames(views: list[Document], control: JobControl) -> Iterator[Pixels]:
    """What is seen, 8-bit sRGB, with the tone mapping of the view settings."""
    systems = [(view.system, view.view_settings.plane_m) for view in views]
    for done, xyz in enumerate(render_each(systems, views[0].drive, check=control.check), start=1):
        yield tone_map(xyz, views[0].view_settings)
        control.report(done, len(views), f"picture {done} of {len(views)}")
