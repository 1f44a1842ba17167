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

from holoview.app.context import AppContext
from holoview.app.desktop import copy_picture, paste_picture
from holoview.app.file_dialog import FileDialog, FileRequest, RecoveryDialog
from holoview.app.panel import Panel
from holoview.app.parameter_widgets import tooltip
from holoview.document.exports import (
    save_figure,
    save_hologram,
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
from holoview.document.jobs import format_job
from holoview.render.tone_mapping import compose_comparison
from holoview.render.view_settings import DERIVED_PAGES, displayed_side
from holoview.util.errors import UserError
from holoview.util.text import plain_name
from holoview.wavefield.readers.registry import all_readers

_OPEN_SUFFIXES = (".safetensors", ".toml", ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr", ".csv", ".html")


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
        context.overlays += [self.recovery, self.dialog]
        self._saves = [] if context.is_read_only else self._all_saves(context)
        if context.is_read_only:
            return
        add = context.commands.add
        add("Open…", lambda: self._open(context), "File", "Ctrl+O", "A preset, hologram, patterns, or picture.")
        for save in self._saves:
            add(f"{save.name}…", partial(self._save, context, save), "File", save.keys, save.help)
        light = partial(self._ask_light, context)
        add("Light from a field…", light, "File", help="A complex field in place of the plane wave before modulator 1.")
        target = partial(self._ask_target, context)
        add(
            "Target from a field…",
            target,
            "File",
            help="The light of a complex field is what the hologram should show.",
        )
        add("Copy image", lambda: _copy(context), "File", "Ctrl+Shift+C", "The image as it is seen, to the clipboard.")
        add("Paste picture", lambda: _paste(context), "File", "Ctrl+V", "The clipboard's picture becomes the target.")

    def _all_saves(self, context: AppContext) -> list[_Save]:
        session = context.session
        return [
            _Save(
                "Save hologram",
                (".safetensors",),
                partial(save_hologram, session),
                "Patterns, lasers and bench in one file.",
                "Ctrl+S",
            ),
            _Save("Save page", (".html",), partial(save_page, session), "One file that any browser shows live."),
            _Save("Save preset", (".toml",), partial(save_preset, session), "The bench, to start from again."),
            _Save(
                "Save view",
                (".png",),
                lambda path: save_view(session, path, _export_pixels(context)),
                "The image as it is seen.",
                "Ctrl+E",
            ),
            _Save("Save all planes", (".png",), partial(save_planes, session), "A picture for each focal plane."),
            _Save(
                "Save pupil sheet",
                (".png",),
                partial(save_pupil_sheet, session),
                "What the eye sees from nine places of the eyebox.",
            ),
            _Save(
                "Save focal sweep",
                (".gif", ".png", ".mp4"),
                lambda path: save_sweep(session, path, frames=self.frames, seconds=self.seconds),
                "An animation through the focal planes and back.",
            ),
            _Save("Save pupil path", (".csv",), partial(save_path, session), "Where the pupil was, and when: a table."),
            _Save(
                "Save path animation",
                (".png", ".gif", ".mp4"),
                lambda path: save_path_animation(session, path, frames=self.frames),
                "What the eye sees along the path of its pupil.",
            ),
            _Save(
                "Save path pictures",
                (".png",),
                lambda path: save_path_pictures(session, path, frames=self.frames),
                "The same as pictures.",
            ),
            _Save(
                "Save figure",
                (".png", ".pdf"),
                partial(save_figure, session),
                "With scale bar, wavelengths and speckle contrast.",
            ),
        ]

    def draw(self, context: AppContext) -> None:
        """Draws the buttons, the settings of the sweep, and the jobs."""
        if context.is_read_only:
            imgui.text_wrapped("This viewer is served to look at: files can't be opened, saved or exported.")
            _draw_jobs(context)
            return
        if imgui.button("Open…", imgui.ImVec2(-1, 0)):
            context.attempt(self._open, context)
        width = (imgui.get_content_region_avail().x - imgui.get_style().item_spacing.x) / 2
        for number, save in enumerate(self._saves):
            if imgui.button(f"{save.name}…", imgui.ImVec2(width, 0)):
                context.attempt(self._save, context, save)
            tooltip(save.help)
            if number % 2 == 0:
                imgui.same_line()
        imgui.set_next_item_width(0.7 * width)
        _, frames = imgui.input_int("frames of an animation", self.frames, 1, 10)
        self.frames = min(max(frames, 2), 600)
        imgui.set_next_item_width(0.7 * width)
        _, seconds = imgui.input_float("seconds of the sweep", self.seconds, 0.5, 1.0, "%.1f")
        self.seconds = min(max(seconds, 0.1), 600.0)
        _draw_watch(context)
        _draw_jobs(context)

    def _open(self, context: AppContext) -> None:
        suffixes = (*_OPEN_SUFFIXES, *_field_suffixes())
        self.dialog.ask(FileRequest("Open", suffixes, lambda path: context.loader.open(path), takes_folders=True))

    def _ask_light(self, context: AppContext) -> None:
        def use(path: Path) -> None:
            context.change("Light from a field", "effects.source_field.file", str(path.resolve()))

        self.dialog.ask(FileRequest("Light from a field", _field_suffixes(), use))

    def _ask_target(self, context: AppContext) -> None:
        self.dialog.ask(FileRequest("Target from a field", _field_suffixes(), context.loader.open_field_as_target))

    def _save(self, context: AppContext, save: _Save) -> None:
        name = f"{plain_name(context.session.system.name, 'hologram')}{save.suffixes[0]}"
        self.dialog.ask(FileRequest(save.name, save.suffixes, save.write, name, is_save=True))


def _field_suffixes() -> tuple[str, ...]:
    """Of all files that may hold a complex field."""
    return tuple(sorted({suffix for reader in all_readers() for suffix in reader.suffixes}))


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
        imgui.progress_bar(job.fraction, imgui.ImVec2(-70, 0), format_job(job))
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
    return compose_comparison(xyz, other, view)


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
        """Draws buttons for undo and redo, and all steps; those that were undone are grey."""
        session = context.session
        width = (imgui.get_content_region_avail().x - imgui.get_style().item_spacing.x) / 2
        for name, act, is_possible in (
            ("Undo", session.undo, session.can_undo),
            ("Redo", session.redo, session.can_redo),
        ):
            imgui.begin_disabled(not is_possible)
            if imgui.button(name, imgui.ImVec2(width, 0)):
                context.attempt(act)
            imgui.end_disabled()
            if name == "Undo":
                imgui.same_line()
        imgui.begin_child("steps")
        for index, step in enumerate(session.history):
            self._draw_step(context, index, step.label, step.when)
        imgui.end_child()

    def _draw_step(self, context: AppContext, index: int, label: str, when: float) -> None:
        position = context.session.history_position
        is_undone = index > position
        if is_undone:
            imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(imgui.Col_.text_disabled))
        clicked, _ = imgui.selectable(f"{label}##{index}", index == position)
        if is_undone:
            imgui.pop_style_color()
        tooltip(f"{time.strftime('%H:%M:%S', time.localtime(when))}; click to go here")
        if clicked:
            context.attempt(context.session.go_to_step, index)
        if index == position != self._scrolled_to:
            imgui.set_scroll_here_y()
            self._scrolled_to = position
