"""Dialogs for files: one to choose a file, and one that offers the sessions that a crash left."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from imgui_bundle import imgui

from holoview.util.errors import UserError
from holoview.util.files import expand_home
from holoview.util.text import printable
from holoview.viewer.app import theme
from holoview.viewer.app.widgets import label_of, pale, tooltip, wrapped_text
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.file_loader import FileLoader
from holoview.viewer.document.session_store import SavedSession, SessionStore

_ROWS = 12
_WIDTH_EM, _BUTTON_EM = 41.0, 8.0  # of dialogs and of their buttons, in heights of the font


@dataclass(frozen=True)
class FileRequest:
    """A request to the dialog: a file to open, which must exist, or a file to save with one of the suffixes.

    on_chosen: called with the path. name: the first content of the name field. takes_folders: offers a button that
    chooses the listed folder itself.
    """

    title: str
    suffixes: Sequence[str]
    on_chosen: Callable[[Path], object]
    name: str = ""
    is_save: bool = False
    takes_folders: bool = False


class FileDialog:
    """Lists a folder, with a field for a name; a typed path may be in any folder.

    A click selects a file or a folder, a double click opens it.

    title: of the dialog among the overlays. folder: the folder that is listed. name: the content of the field.
    problem: a sentence for the user, or "". advice: what to do about names that can't be drawn, or "".
    """

    def __init__(self, session: EditingSession, title: str = "File dialog") -> None:
        self._session, self.title = session, title
        self._request: FileRequest | None = None
        self._is_new = False
        self.folder = Path.cwd()
        self.name = ""
        self._entries: list[Path] = []
        self.problem = self.advice = ""
        self._overwritten: Path | None = None

    @property
    def is_open(self) -> bool:
        """Whether the dialog is shown."""
        return self._request is not None

    def ask(self, request: FileRequest) -> None:
        """Opens the dialog; `request.on_chosen` is called with the path, unless the user cancels."""
        self._request, self._is_new = request, True
        self.name, self.problem, self._overwritten = request.name, "", None
        self.list_folder(self.folder)

    def list_folder(self, folder: Path) -> None:
        """Lists another folder; where it can't be read, `problem` says why."""
        try:
            entries = sorted(folder.iterdir(), key=lambda path: (not path.is_dir(), path.name.lower()))
        except OSError as error:
            self.problem = f"{folder}: {error.strerror}"
            return
        self.folder, self.problem = folder, ""
        self._entries = [path for path in entries if not path.name.startswith(".") and self._is_listed(path)]
        self.advice = theme.font_advice(path.name for path in self._entries)

    def draw(self) -> None:
        """Draws the dialog while it is open."""
        if self._request is None:
            return
        if self._is_new:
            imgui.open_popup(self._request.title)
            self._is_new = False
        centre_next_window(_WIDTH_EM)
        is_shown, is_open = imgui.begin_popup_modal(self._request.title, True, theme.DIALOG)
        if is_shown:
            self._draw_inside(self._request)
            imgui.end_popup()
        if not is_open:
            self._request = None

    def _draw_inside(self, request: FileRequest) -> None:
        self._draw_entries()
        imgui.set_next_item_width(-1)
        entered, self.name = imgui.input_text("##name", self.name, imgui.InputTextFlags_.enter_returns_true)
        if imgui.is_window_appearing() or entered:
            imgui.set_keyboard_focus_here(-1)
        if request.is_save and len(request.suffixes) > 1:
            imgui.text_disabled(f"{', '.join(request.suffixes[:-1])} or {request.suffixes[-1]}: the name's end decides")
        if self.problem:
            wrapped_text(printable(self.problem), theme.signal_colour("error"))
        if self.advice:
            wrapped_text(self.advice, pale())
        accepted = imgui.button("Save##file" if request.is_save else "Open##file", _button_size()) or entered
        imgui.same_line()
        if request.takes_folders:
            if imgui.button("This folder", _button_size()):
                self._finish(request, self.folder)
                return
            tooltip("A focal stack, a picture a plane, or the patterns of a bench.")
            imgui.same_line()
        if imgui.button("Cancel##file", _button_size()) or imgui.is_key_pressed(imgui.Key.escape):
            self._close()
        elif accepted:
            self.accept()

    def _draw_entries(self) -> None:
        if imgui.button("Up"):
            self.list_folder(self.folder.parent)
        imgui.same_line()
        imgui.text_wrapped(printable(str(self.folder)))
        imgui.begin_child("entries", imgui.ImVec2(0, _ROWS * imgui.get_text_line_height_with_spacing()), True)
        is_chosen = False
        for path in self._entries:
            name = printable(path.name)
            label = label_of(f"{name}/" if path.is_dir() else name)
            flags = imgui.SelectableFlags_.no_auto_close_popups | imgui.SelectableFlags_.allow_double_click
            clicked, _ = imgui.selectable(label, name == self.name, flags)
            if clicked:
                self.name = name
                is_chosen = imgui.is_mouse_double_clicked(imgui.MouseButton_.left)
        imgui.end_child()
        if is_chosen:
            self.accept()

    def accept(self) -> None:
        """Takes the name in the field: a folder is listed, a file is chosen. Overwriting asks for a second time."""
        request = self._request
        if request is None or not self.name.strip():
            return
        typed = self.folder / expand_home(self.name.strip())
        path = next((entry for entry in self._entries if printable(entry.name) == self.name), typed)
        if path.is_dir():
            self.name = ""
            self.list_folder(path)
            return
        if request.is_save and path.suffix.lower() not in request.suffixes:
            path = path.with_name(path.name + request.suffixes[0])
        if not request.is_save and not path.exists():
            self.problem = f"{path.name} isn't there"
            return
        if request.is_save and path.exists() and path != self._overwritten:
            self._overwritten, self.problem = path, f"{path.name} is there already: once more replaces it"
            return
        self._finish(request, path)

    def _is_listed(self, path: Path) -> bool:
        suffixes = self._request.suffixes if self._request is not None else ()
        return path.is_dir() or not suffixes or path.suffix.lower() in suffixes

    def _finish(self, request: FileRequest, path: Path) -> None:
        self._close()
        with self._session.report_errors():
            request.on_chosen(path)

    def _close(self) -> None:
        self._request = None
        imgui.close_current_popup()


def centre_next_window(width_em: float) -> None:
    """Keeps the next window in the middle of the main one and inside it; width_em: in heights of the font.

    In every frame: a browser's page gets its size after the first ones, and changes it later.
    """
    viewport = imgui.get_main_viewport()
    width = min(width_em * imgui.get_font_size(), viewport.work_size.x - 20)
    imgui.set_next_window_pos(viewport.get_center(), imgui.Cond_.always, imgui.ImVec2(0.5, 0.5))
    imgui.set_next_window_size_constraints(imgui.ImVec2(width, 0), imgui.ImVec2(width, viewport.work_size.y))
    imgui.set_next_window_bg_alpha(1.0)


def _button_size() -> imgui.ImVec2:
    return imgui.ImVec2(_BUTTON_EM * imgui.get_font_size(), 0)


# --- The dialog that offers the sessions that a crash left ---


_RECOVER = "Recover your work"


class AnimationOffer:
    """Asks of an animation that was opened whether it is a film, or its first picture is the target.

    loader: which has opened it. follow: called with the path to show its pictures one after the other. It is a card, no
    dialog: work goes on, with the first picture.
    """

    title = "Animation"

    def __init__(self, loader: FileLoader, follow: Callable[[str], object], session: EditingSession) -> None:
        self._loader, self._follow, self._session = loader, follow, session

    def draw(self) -> None:
        """Draws the card while the question is open."""
        content = self._loader.animation
        if content is None:
            return
        place = imgui.get_main_viewport()
        middle = imgui.ImVec2(place.work_pos.x + place.work_size.x / 2, place.work_pos.y + 60)
        imgui.set_next_window_pos(middle, imgui.Cond_.always, imgui.ImVec2(0.5, 0.0))
        is_shown, is_open = imgui.begin("Animation", True, theme.CARD | imgui.WindowFlags_.no_focus_on_appearing)
        if is_shown:
            imgui.text(f"{printable(content.title)} is an animation of {content.pictures} pictures. Show it")
            if imgui.button("As a film"):
                self._loader.animation = None
                with self._session.report_errors():
                    self._follow(str(content.path))
            tooltip("The hologram follows its pictures, one after the other, until it is kept or cancelled.")
            imgui.same_line()
            if imgui.button("Its first picture"):
                with self._session.report_errors():
                    self._loader.take_first_picture()
        imgui.end()
        if not is_open:
            self._loader.animation = None


class RecoveryDialog:
    """Offers sessions that a crash left: each can be recovered into the open session, or deleted.

    saved: the sessions that are still offered.
    """

    title = "Recovery"

    def __init__(self, session: EditingSession, store: SessionStore | None) -> None:
        self._session, self._store = session, store
        self.saved = [] if store is None else store.crashed_sessions()
        self._is_new = bool(self.saved)

    @property
    def is_open(self) -> bool:
        """Whether a session is still offered."""
        return bool(self.saved)

    def draw(self) -> None:
        """Draws the dialog while a session is offered."""
        if not self.saved:
            return
        if self._is_new:
            imgui.open_popup(_RECOVER)
            self._is_new = False
        centre_next_window(_WIDTH_EM)
        is_shown, is_open = imgui.begin_popup_modal(_RECOVER, True, theme.DIALOG)
        if is_shown:
            imgui.text_wrapped("The viewer ended without closing. Your work up to then was saved:")
            for saved in list(self.saved):
                self._draw_one(saved)
            imgui.separator()
            if imgui.button("Later", _button_size()) or imgui.is_key_pressed(imgui.Key.escape):
                self.saved = []
            imgui.same_line()
            imgui.text_disabled("they are offered again at the next start")
            if not self.saved:
                imgui.close_current_popup()
            imgui.end_popup()
        if not is_open:
            self.saved = []

    def recover(self, saved: SavedSession) -> None:
        """Restores a saved session into the open one and closes the dialog."""
        session = self._session
        assert self._store is not None
        try:
            saved.restore_into(session)
            session.messages.post(f"recovered, with {len(session.history) - 1} edits to undo")
            self._store.discard(saved)
        except UserError as error:
            session.messages.post_error(error, "recovery")
            session.messages.post(self._store.set_aside(saved.folder), "warning")
        self.saved = []

    def discard(self, saved: SavedSession) -> None:
        """Deletes a saved session."""
        assert self._store is not None
        self._store.discard(saved)
        self.saved = [other for other in self.saved if other != saved]

    def _draw_one(self, saved: SavedSession) -> None:
        imgui.push_id(str(saved.folder))
        imgui.separator()
        imgui.text_wrapped(printable(saved.title))
        when = time.strftime("%d %B, %H:%M", time.localtime(saved.when))
        imgui.text_disabled(f"{when}, {saved.steps - 1} edits")
        if imgui.button("Recover", _button_size()):
            self.recover(saved)
        imgui.same_line()
        if imgui.button("Discard", _button_size()):
            self.discard(saved)
        imgui.pop_id()
