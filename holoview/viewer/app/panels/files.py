"""The panel of files and background jobs, and that of the undo history, where a click on an edit goes to it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from imgui_bundle import imgui
from numpy.typing import NDArray

from holoview.holograms.files.readers.registry import all_readers
from holoview.holograms.targets.focal_stack import SUFFIXES
from holoview.holograms.targets.live_pictures import CAMERA
from holoview.util.errors import UserError
from holoview.util.text import plain_name
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.desktop import copy_picture, paste_picture
from holoview.viewer.app.file_dialog import AnimationOffer, FileDialog, FileRequest, RecoveryDialog
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.widgets import (
    coloured,
    command_button,
    label_of,
    most_across,
    next_item,
    pale,
    share_of_width,
    tooltip,
)
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.exports import (
    save_figure,
    save_hologram,
    save_light,
    save_page,
    save_path,
    save_path_animation,
    save_path_pictures,
    save_planes,
    save_preset,
    save_pupil_sheet,
    save_sweep,
    save_view,
)
from holoview.viewer.document.jobs import format_job
from holoview.viewer.document.legend import with_notes
from holoview.viewer.document.optimisation_job import chosen_optimisation, start_live_optimisation
from holoview.viewer.document.region_table import save_profile, save_regions
from holoview.viewer.render.tone_mapping import compose_comparison
from holoview.viewer.render.view_settings import DERIVED_PAGES, displayed_side

_OPEN_SUFFIXES = (
    *(".safetensors", ".toml", ".png", ".jpg", ".jpeg", ".webp", ".avif", ".heic", ".heif", ".gif", ".tif", ".tiff"),
    *(".exr", ".hdr", ".csv", ".html"),
)
_CANCEL_EM = 4.7  # of the room beside the progress of a job, in heights of the font


@dataclass(frozen=True)
class _Save:
    """Something that can be saved: a name, possible suffixes, the function that writes it, a help text, and keys."""

    name: str
    suffixes: tuple[str, ...]
    write: Callable[[Path], object]
    help: str
    keys: str = ""


class FilesPanel(Panel):
    """Buttons for all files that are read or written, and the progress of jobs.

    frames: of an animation. seconds: of a focal sweep.
    """

    title = "Files"
    dock = "Low right"

    def __init__(self) -> None:
        self.frames, self.seconds = 24, 3.0

    def set_up(self, context: AppContext) -> None:
        """Adds the commands of the File menu, the file dialog, and the dialog that recovers sessions after a crash."""
        self.dialog = FileDialog(context.session)
        self.recovery = RecoveryDialog(context.session, context.store)
        offer = AnimationOffer(context.loader, partial(_follow, context), context.session)
        context.overlays += [offer, self.recovery, self.dialog]
        self._saves = [] if context.is_read_only else self._all_saves(context)
        if context.is_read_only:
            return
        add = partial(context.commands.add, "File")
        add("Open…", lambda: self._open(context), "Ctrl+O", "A preset, hologram, patterns, or picture.")
        beside = "A hologram or bench, to look at beside the present one; keys 1 … 9 switch between them."
        add("Open beside…", lambda: self._open_beside(context), "Ctrl+Shift+O", beside)
        for save in self._saves:
            add(f"{save.name}…", partial(self._save, context, save), save.keys, save.help)
        light = "A complex field in place of the plane wave before modulator 1."
        add("Light from a field…", partial(self._ask_light, context), help=light)
        target = "The light of a complex field is what the hologram should show."
        add("Target from a field…", partial(self._ask_target, context), help=target)
        live = "The hologram follows a film, the newest picture of a folder, or a camera, until it is kept."
        add("Live target from a film or folder…", partial(self._ask_live, context), help=live)
        add("Live target from the camera", partial(_follow, context, CAMERA), help=live)
        add("Copy image", lambda: _copy(context), "Ctrl+Shift+C", "The image as it is seen, to the clipboard.")
        add("Paste picture", lambda: _paste(context), "Ctrl+V", "The clipboard's picture becomes the target.")

    def _all_saves(self, context: AppContext) -> list[_Save]:
        session = context.session

        def save(name: str, suffixes: str, write: Callable[..., object], help: str, keys: str = "") -> _Save:
            return _Save(f"Save {name}", tuple(suffixes.split()), partial(write, session), help, keys)

        def view(session: EditingSession, path: Path) -> None:
            save_view(session, path, _export_pixels(context))

        def regions(session: EditingSession, path: Path) -> None:
            save_regions(session, path, context.shown_images())

        def profile(session: EditingSession, path: Path) -> None:
            save_profile(session, path, context.shown_images())

        def sweep(session: EditingSession, path: Path) -> object:
            return save_sweep(session, path, frames=self.frames, seconds=self.seconds)

        def along_path(write: Callable[..., object], session: EditingSession, path: Path) -> object:
            return write(session, path, frames=self.frames)

        animation, pictures = partial(along_path, save_path_animation), partial(along_path, save_path_pictures)
        return [
            save("hologram", ".safetensors", save_hologram, "Patterns, lasers and bench in one file.", "Ctrl+S"),
            save("page", ".html", save_page, "One file that any browser shows live."),
            save("preset", ".toml", save_preset, "The bench, to start from again."),
            save("view", ".png", view, "The image as it is seen.", "Ctrl+E"),
            save(
                "light", ".exr .npz .tif .npy", save_light, "The numbers of all planes: intensities, XYZ, linear RGB."
            ),
            save("all planes", ".png", save_planes, "A picture for each focal plane."),
            save("pupil sheet", ".png", save_pupil_sheet, "What the eye sees from nine places of the eyebox."),
            save("focal sweep", ".gif .png .mp4", sweep, "An animation through the focal planes and back."),
            save("pupil path", ".csv", save_path, "Where the pupil was, and when: a table."),
            save("path animation", ".png .gif .mp4", animation, "What the eye sees along the path of its pupil."),
            save("path pictures", ".png", pictures, "The same as pictures."),
            save("regions", ".csv", regions, "The table of regions and their figures, of all images that are shown."),
            save("profile", ".csv", profile, "The light along the line, of all images that are shown."),
            save("figure", ".png .pdf", save_figure, "With scale bar, wavelengths and speckle contrast."),
        ]

    def draw(self, context: AppContext) -> None:
        """Draws the buttons, the settings of the sweep, and the jobs."""
        if context.is_read_only:
            imgui.text_wrapped("This viewer is served to look at: files can't be opened, saved or exported.")
            _draw_jobs(context)
            return
        command_button(context, "Open…", width=-1)
        imgui.separator_text("save")
        labels = [f"{save.name.removeprefix('Save ').capitalize()}…" for save in self._saves]
        across = most_across(labels, 2)
        width = share_of_width(across)
        for number, (save, label) in enumerate(zip(self._saves, labels, strict=True)):
            if number % across:
                imgui.same_line()
            command_button(context, f"{save.name}…", label, width=width, name=f"file: {save.name}")
        width = 0.35 * share_of_width(1)
        _, frames = imgui.input_int(next_item("frames of an animation", width), self.frames, 1, 10)
        self.frames = min(max(frames, 2), 600)
        _, seconds = imgui.input_float(next_item("seconds of the sweep", width), self.seconds, 0.5, 1.0, "%.1f")
        self.seconds = min(max(seconds, 0.1), 600.0)
        _draw_watch(context)
        _draw_jobs(context)

    def _open(self, context: AppContext) -> None:
        suffixes = (*_OPEN_SUFFIXES, *_field_suffixes())
        self.dialog.ask(FileRequest("Open", suffixes, lambda path: context.loader.open(path), takes_folders=True))

    def _open_beside(self, context: AppContext) -> None:
        suffixes = (".safetensors", ".toml", ".html", *_field_suffixes())
        self.dialog.ask(FileRequest("Open beside", suffixes, context.loader.open_beside))

    def _ask_light(self, context: AppContext) -> None:
        def use(path: Path) -> None:
            context.change("Light from a field", "effects.source_field.file", str(path.resolve()))

        self.dialog.ask(FileRequest("Light from a field", _field_suffixes(), use))

    def _ask_target(self, context: AppContext) -> None:
        self.dialog.ask(FileRequest("Target from a field", _field_suffixes(), context.loader.open_field_as_target))

    def _ask_live(self, context: AppContext) -> None:
        def use(path: Path) -> None:
            _follow(context, str(path))

        self.dialog.ask(FileRequest("Live target from a film or folder", SUFFIXES, use, takes_folders=True))

    def _save(self, context: AppContext, save: _Save) -> None:
        session = context.session
        of = session.system.name if save.suffixes == (".toml",) else Path(session.document.title).stem
        name = f"{plain_name(of, 'hologram')}{save.suffixes[0]}"
        self.dialog.ask(FileRequest(save.name, save.suffixes, save.write, name, is_save=True))


def _field_suffixes() -> tuple[str, ...]:
    """Of all files that may hold a complex field."""
    return tuple(sorted({suffix for reader in all_readers() for suffix in reader.suffixes}))


def _follow(context: AppContext, source: str) -> None:
    """Optimises for the pictures of a source as is chosen in the panel *Optimise*."""
    session = context.session
    start_live_optimisation(session, source, chosen_optimisation(session.optimisation_choices, session.system))


def _draw_watch(context: AppContext) -> None:
    path = context.session.document.path
    if path is None:
        return
    changed, watches = imgui.checkbox("read again when rewritten", context.loader.watched_path is not None)
    tooltip(f"{path} is read again when another program has written it.")
    if changed:
        context.loader.set_watching(watches)


def _draw_jobs(context: AppContext) -> None:
    for number, job in enumerate(context.session.jobs.active):
        imgui.push_id(number)
        imgui.progress_bar(job.fraction, imgui.ImVec2(-_CANCEL_EM * imgui.get_font_size(), 0), format_job(job))
        imgui.same_line()
        if imgui.button("Cancel", imgui.ImVec2(-1, 0)):
            job.cancel()
        imgui.pop_id()


def _export_pixels(context: AppContext) -> NDArray[np.uint8]:
    """The image at its own resolution, with the comparison; derived pages at the resolution of the screen."""
    view = context.session.view_settings
    if view.page == "planes":
        raise UserError("view", "shows all planes", remedy="save all planes, or go to one of them first")
    if view.page in DERIVED_PAGES:
        pixels = context.displayed_pixels()
        if pixels is None:
            raise UserError("image", "is still being computed", remedy="try again in a moment")
        return pixels
    b = view.b if view.compare != "off" and view.page == "image" else None
    xyz, other = context.side_renderers.xyz(displayed_side(view)), None if b is None else context.side_renderers.xyz(b)
    if xyz is None or (b is not None and other is None):
        raise UserError("image", "is still being computed", remedy="try again in a moment")
    return with_notes(compose_comparison(xyz, other, view), context.session.previewed_document)


def _copy(context: AppContext) -> None:
    copy_picture(_export_pixels(context))
    context.session.messages.post("copied the image")


def _paste(context: AppContext) -> None:
    picture = paste_picture()
    if picture is None:
        raise UserError("clipboard", "holds no picture", remedy="copy one, or open a file")
    context.loader.paste(picture)


# --- history ----------------------------------------------------------------------------------------------------------


class HistoryPanel(Panel):
    """Lists all edits, oldest first."""

    title = "History"
    dock = "Left"

    def __init__(self) -> None:
        self._scrolled_to = -1

    def draw(self, context: AppContext) -> None:
        """Draws buttons for undo and redo, and all steps, undone ones in grey."""
        session = context.session
        width = share_of_width(2)
        command_button(context, "Undo", width=width)
        imgui.same_line()
        command_button(context, "Redo", width=width)
        imgui.begin_child("steps", child_flags=imgui.ChildFlags_.nav_flattened)
        for index, step in enumerate(session.history):
            self._draw_step(context, index, step.label, step.when)
        imgui.end_child()

    def _draw_step(self, context: AppContext, index: int, label: str, when: float) -> None:
        position = context.session.history_position
        with coloured(imgui.Col_.text, pale() if index > position else None):  # those that were undone
            clicked, _ = imgui.selectable(f"{label_of(label)}##{index}", index == position)
        tooltip(f"{time.strftime('%H:%M:%S', time.localtime(when))}; click to go here")
        if clicked:
            context.attempt(context.session.go_to_step, index)
        if index == position != self._scrolled_to:
            imgui.set_scroll_here_y()
            self._scrolled_to = position
