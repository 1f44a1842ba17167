"""The application context: the objects that panels, overlays, menus and commands of the viewer share.

It holds the editing session, the GPU device, the renderers, the commands and the drawing services, and imports no
panel: panels import it, and `App` owns both.

`CommandRegistry` has the commands of the viewer with their keys, for menus and scripts; `HelpOverlay` shows a sheet of
all keys, and a palette with search.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from imgui_bundle import hello_imgui, imgui
from numpy.typing import NDArray

from holoview.light.gpu.device import Device
from holoview.util.errors import UserError, suggest_matches
from holoview.util.text import printable
from holoview.viewer.app import theme
from holoview.viewer.app.user_input import Chord
from holoview.viewer.app.window import Window
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.file_loader import FileLoader, most_samples_for
from holoview.viewer.document.focus_edits import PupilMotion
from holoview.viewer.document.measurements import LimitNotes, LiveMeasurement, LiveScore, ShownImage
from holoview.viewer.document.optimisation_job import RetinalCurves, last_optimisation
from holoview.viewer.document.received_fields import ReceivedFields
from holoview.viewer.document.recording_edits import RecordingEditor
from holoview.viewer.document.session_store import SessionStore
from holoview.viewer.render.kept_pictures import KeptPictures
from holoview.viewer.render.page_images import PageImages
from holoview.viewer.render.planes import PlanePreviews
from holoview.viewer.render.point_probe import PointProbe
from holoview.viewer.render.progressive_renderer import ProgressiveRenderer, SideRenderers
from holoview.viewer.render.view_settings import NOW, TARGET

if TYPE_CHECKING:
    from holoview.viewer.document.rig_session import RigSession


Action = Callable[[], None]


@dataclass(frozen=True)
class Command:
    """A command: a unique name, the action, the group (menu) it belongs to, its keys and a sentence of help.

    repeats: whether the action is called again while a key is held down. is_urgent: whether its keys work while text is
    typed, too. shares_keys: whether its keys may be those of another such command, never enabled at the same time.
    """

    name: str
    action: Action
    group: str
    keys: tuple[Chord, ...] = ()
    help: str = ""
    repeats: bool = False
    is_enabled: Callable[[], bool] = field(default=lambda: True)
    is_urgent: bool = False
    shares_keys: bool = False


class CommandRegistry:
    """All commands, in the order in which they were added."""

    def __init__(self) -> None:
        self._by_name: dict[str, Command] = {}

    def __iter__(self) -> Iterator[Command]:
        return iter(self._by_name.values())

    def get(self, name: str) -> Command | None:
        """The command of a name; None where this viewer hasn't got it."""
        return self._by_name.get(name)

    def add(
        self,
        group: str,
        name: str,
        action: Action,
        keys: str = "",
        help: str = "",
        *,
        repeats: bool = False,
        is_enabled: Callable[[], bool] = lambda: True,
        is_urgent: bool = False,
        shares_keys: bool = False,
    ) -> Command:
        """Adds a command. keys: chords such as "Ctrl+Z", separated by spaces. Other arguments: see `Command`.

        Raises ValueError when the name or one of the keys belongs to another command.
        """
        chords = tuple(Chord(text) for text in keys.split())
        others = [command for command in self if not (shares_keys and command.shares_keys)]
        taken = {chord.code: command.name for command in others for chord in command.keys}
        clash = next((taken[chord.code] for chord in chords if chord.code in taken), None)
        if name in self._by_name or clash is not None:
            raise ValueError(f"command {name}: {clash or 'its name'} is taken")
        command = Command(name, action, group, chords, help, repeats, is_enabled, is_urgent, shares_keys)
        self._by_name[name] = command
        return command

    def run(self, name: str) -> None:
        """Runs a command by its name, if it is enabled. Raises UserError for an unknown name, with near matches."""
        if name not in self._by_name:
            raise UserError("command", f'"{name}"', remedy=suggest_matches(name, self._by_name))
        command = self._by_name[name]
        if command.is_enabled():
            command.action()

    def of_group(self, group: str) -> list[Command]:
        """The commands of a group; none while none of them can be used."""
        found = [command for command in self if command.group == group]
        return found if any(command.is_enabled() for command in found) else []

    def is_repeating(self) -> bool:
        """Whether a key of a repeating command is held down."""
        return any(chord.is_down() for command in self if command.repeats for chord in command.keys)

    def pressed(self, *, is_typing: bool = False, taken: Collection[int] = ()) -> Iterator[Command]:
        """The enabled commands whose keys were pressed since the last frame.

        is_typing: only the urgent ones. taken: codes of keys that, without modifiers, are for others.
        """
        for command in self:
            if is_typing and not command.is_urgent:
                continue
            keys = [chord for chord in command.keys if chord.code not in taken]
            if any(chord.was_pressed(command.repeats) for chord in keys) and command.is_enabled():
                yield command


# --- the sheet of keys and the palette ---


_PALETTE_ROWS = 12
_COLUMN_EM = 18.0  # the least width of a column of keys, in heights of the font


class HelpOverlay:
    """The sheet of keys and the command palette; at most one of them is open.

    run: runs a command. recent: commands that open the recent files, which the palette alone has. page: "keys",
    "palette", or "" while both are closed. query: the words typed into the palette.
    """

    title = "Keys and commands"

    def __init__(
        self, commands: CommandRegistry, run: Callable[[Command], None], recent: Callable[[], Sequence[Command]]
    ) -> None:
        self._commands, self._run, self._recent = commands, run, recent
        self.page = ""
        self.query, self._chosen = "", 0
        self._is_new = False

    def toggle(self, name: str) -> None:
        """Opens "keys" or "palette", or closes it."""
        self.page = "" if self.page == name else name
        self.query, self._chosen, self._is_new = "", 0, True

    def close(self) -> None:
        """Closes what is open."""
        self.page = ""

    def draw(self) -> None:
        """Draws the page that is open."""
        if not self.page:
            return
        place = imgui.get_main_viewport()
        is_sheet = self.page == "keys"
        width = min(place.work_size.x - 40, (57.3 if is_sheet else 34.7) * imgui.get_font_size())
        middle = imgui.ImVec2(place.work_pos.x + place.work_size.x / 2, place.work_pos.y + 50)
        imgui.set_next_window_pos(middle, imgui.Cond_.always, imgui.ImVec2(0.5, 0.0))
        imgui.set_next_window_size_constraints(imgui.ImVec2(width, 0), imgui.ImVec2(width, place.work_size.y - 100))
        if self._is_new:
            imgui.set_next_window_focus()
        is_shown, is_open = imgui.begin("Keys" if is_sheet else "Commands", True, theme.CARD)
        if is_shown:
            self._draw_sheet() if is_sheet else self._draw_palette()
        imgui.end()
        self._is_new = False
        if not is_open or imgui.is_key_pressed(imgui.Key.escape):
            self.close()

    def matches(self) -> list[Command]:
        """Commands whose group or name contains every word of the query; names that start with it come first."""
        words = self.query.lower().split()
        known = (*self._commands, *self._recent())
        matches = [c for c in known if all(word in f"{c.group} {c.name}".lower() for word in words)]
        return sorted(matches, key=lambda c: not c.name.lower().startswith(self.query.lower()))

    def _draw_sheet(self) -> None:
        shown = (c for c in self._commands if c.keys and self._commands.of_group(c.group))
        commands = sorted(shown, key=lambda c: c.group)
        groups = [(name, list(some)) for name, some in groupby(commands, key=lambda c: c.group)]
        columns = min(max(int(imgui.get_content_region_avail().x / (_COLUMN_EM * imgui.get_font_size())), 1), 3)
        if not imgui.begin_table("keys", columns, imgui.TableFlags_.sizing_stretch_same):
            return
        imgui.table_next_row()
        heights = [0.0] * columns
        piles: list[list[tuple[str, list[Command]]]] = [[] for _ in range(columns)]
        for name, some in sorted(groups, key=lambda group: -len(group[1])):
            shortest = heights.index(min(heights))
            heights[shortest] += len(some) + 2
            piles[shortest].append((name, some))
        for pile in piles:
            imgui.table_next_column()
            for name, some in pile:
                _draw_group(name, some)
        imgui.end_table()
        imgui.push_text_wrap_pos()
        imgui.text_disabled(
            "On the image: wheel zooms about the pointer, Ctrl+wheel changes the focal plane, "
            "drag pans, Shift+drag draws a region, Ctrl+click places the cursor, double click fits."
        )
        imgui.pop_text_wrap_pos()

    def _draw_palette(self) -> None:
        if self._is_new:
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(-1)
        changed, self.query = imgui.input_text_with_hint("##query", "type a command", self.query)
        self._chosen = 0 if changed else self._chosen
        found = self.matches()
        step = int(imgui.is_key_pressed(imgui.Key.down_arrow)) - int(imgui.is_key_pressed(imgui.Key.up_arrow))
        self._chosen = min(max(self._chosen + step, 0), max(len(found) - 1, 0))
        first = max(self._chosen - _PALETTE_ROWS + 1, 0)
        for number, command in enumerate(found[first : first + _PALETTE_ROWS], start=first):
            keys = command.keys[0].text if command.keys else ""
            label = f"{command.group}: {command.name}"
            clicked, _ = imgui.selectable(label, number == self._chosen, imgui.SelectableFlags_.allow_overlap)
            if keys:
                imgui.same_line(imgui.get_content_region_avail().x - imgui.calc_text_size(keys).x)
                imgui.text_disabled(keys)
            if clicked or (number == self._chosen and imgui.is_key_pressed(imgui.Key.enter)):
                self.close()
                self._run(command)
        if not found:
            imgui.text_disabled("no command has these words")


def _keys_text(command: Command) -> str:
    texts = [chord.text for chord in command.keys]
    return "  ".join(texts) if len(texts) < 4 else f"{texts[0]} … {texts[-1]}"


def _draw_group(name: str, commands: list[Command]) -> None:
    imgui.separator_text(name)
    left = imgui.get_cursor_pos_x()
    for command in commands:
        keys = _keys_text(command)
        right = left + imgui.get_content_region_avail().x - imgui.calc_text_size(keys).x
        imgui.text(command.name)
        imgui.same_line()
        imgui.set_cursor_pos_x(right)
        imgui.text_disabled(keys)


# --- what panels share ------------------------------------------------------------------------------------------------


Rect = tuple[float, float, float, float]
"""Left, top, right, bottom in logical pixels of the window."""


class Overlay(Protocol):
    """Something that is drawn above all panels while it is open: a dialog, or help."""

    title: str

    def draw(self) -> None:
        """Draws it, if it is open."""


class AppContext:
    """The objects that panels, overlays, menus and commands share.

    Edits go through `attempt`, `change` and `edit_view`, which report errors to the user. store: the user's preferences
    and saved sessions; None where nothing is stored.

    renderer: that of the displayed document, if it has been started already. is_read_only: whether the user can't open,
    save or export files nor end the viewer; commands and buttons for these aren't there. drag_tool: the mark that a
    drag on the image draws, "region" or "line"; "" pans. chosen_element: the name of the element that is edited, of the
    first if it isn't there. wants_measurement: set by a panel in each frame in which it
    shows measurements of the image. item_rects: where items were drawn in the last frame, by name. picture_place: where
    the image panel drew its picture in this frame, if it did. displayed_pixels:
    returns what the image panel shows, 8-bit sRGB (y, x, 3), or None before anything is shown.
    """

    def __init__(
        self,
        session: EditingSession,
        device: Device,
        window: Window,
        store: SessionStore | None,
        renderer: ProgressiveRenderer | None = None,
        *,
        is_read_only: bool = False,
    ) -> None:
        self.session, self.device, self.window, self.store = session, device, window, store
        self.is_read_only = is_read_only
        self.commands, self.item_rects = CommandRegistry(), dict[str, Rect]()
        self.drag_tool, self.wants_measurement = "", False
        self._chosen_element = ""
        self.picture_place: Rect | None = None
        self.kept_pictures = KeptPictures(device)
        self.side_renderers = SideRenderers(device, session, renderer, self.kept_pictures)
        self.plane_previews = PlanePreviews(device)
        self.page_images = PageImages(device, session.call_on_owner, session.messages.post_error)
        self.recording_editor = RecordingEditor(session)
        self.point_probe = PointProbe(device, session.call_on_owner, session.messages.post_error)
        self.live_measurement = LiveMeasurement(session, window.wake)
        self.live_psnr = LiveScore("psnr", session, window.wake)
        self.live_score = LiveScore("score", session, window.wake)
        self.limit_notes = LimitNotes(session)
        self.pupil_motion = PupilMotion(session)
        self._rig: RigSession | None = None
        self.retinal_curves = RetinalCurves(session)
        remember = store.preferences.add_recent_file if store is not None else lambda path: None
        binding_bytes = device.limits["max-storage-buffer-binding-size"]
        self.loader = FileLoader(session, remember=remember, most_samples=most_samples_for(binding_bytes))
        self.received_fields = ReceivedFields(session, lambda: not self.side_renderers.is_busy)
        stored_theme = store.preferences.get("theme", "") if store is not None else ""
        self.theme = stored_theme if stored_theme in theme.THEMES else theme.THEMES[0]
        stored_size = store.preferences.get("text_size", 1.0) if store is not None else 1.0
        self.text_size = stored_size if stored_size in theme.TEXT_SIZES else 1.0
        self._has_optimised = store is not None and store.preferences.get("has_optimised", False) is True
        self.help_overlay = HelpOverlay(self.commands, self._run_command, self._recent_files)
        self.overlays: list[Overlay] = [self.help_overlay]
        self.displayed_pixels: Callable[[], NDArray[np.uint8] | None] = lambda: None

    @property
    def chosen_element(self) -> str:
        names = self.session.system.element_names
        return self._chosen_element if self._chosen_element in names else names[0]

    @chosen_element.setter
    def chosen_element(self, name: str) -> None:
        self._chosen_element = name

    @property
    def is_busy(self) -> bool:
        """Whether an image, a target or measurements are still being computed."""
        return (
            self.side_renderers.is_busy
            or self.plane_previews.is_busy
            or self.kept_pictures.is_busy
            or self.page_images.is_busy
            or self.point_probe.is_busy
            or self.recording_editor.is_busy
            or self.session.target_builder.is_building
            or self.live_measurement.is_busy
            or self.live_psnr.is_busy
            or self.live_score.is_busy
        )

    @property
    def has_old_figures(self) -> bool:
        """Whether figures are those of an earlier image than the one that is asked for."""
        return self.side_renderers.now.is_busy or self.live_measurement.is_busy

    def shown_images(self) -> list[ShownImage]:
        """The full images that are shown: that of the document, then those beside it; none before the first."""
        session, view = self.session, self.session.view_settings
        now = self.side_renderers.xyz(NOW)
        images = []
        if now is not None:
            images.append(ShownImage(session.document.title, now, session.target_at(), session.other_targets()))
        beside = (view.shown,) if view.compare == "off" else (view.a, view.b)
        for side in dict.fromkeys(beside) if images else ():
            other = None if side in (NOW, TARGET) else self.side_renderers.xyz(side)
            if other is not None:
                images.append(ShownImage(side.label, other, session.target_for(side)))
        return images

    @property
    def rig(self) -> RigSession:
        """The rig of the session, which may not have been opened; `opened_rig` tells whether it has."""
        if self._rig is None:
            from holoview.viewer.document.rig_session import RigSession  # slow start: most sessions open no rig

            self._rig = RigSession(self.session)
        return self._rig

    @property
    def opened_rig(self) -> RigSession | None:
        """The rig that was opened; None while there is none."""
        return None if self._rig is None or self._rig.rig is None else self._rig

    def attempt(self, edit: Callable[..., Any], *arguments: Any, **keywords: Any) -> None:
        """Calls `edit`; an error becomes a message to the user, and the document stays as it was."""
        with self.session.report_errors():
            edit(*arguments, **keywords)

    def change(self, label: str, key: str, value: Any, *, is_held: bool = False) -> None:
        """Changes a key of the system, as `System.edit` does. Edits while `is_held` merge into one step of undo."""
        self.attempt(self.session.change, label, {key: value}, merge_key=key)
        if not is_held:
            self.session.end_gesture()

    def edit_view(self, label: str, **fields: Any) -> None:
        """Changes fields of the view settings; successive edits of the same fields are one step of undo."""
        self.attempt(self.session.edit_view, label, merge_key=tuple(sorted(fields)), **fields)

    def show_panel(self, title: str) -> None:
        """Opens a panel's window and brings it to the front."""
        window = hello_imgui.get_runner_params().docking_params.dockable_window_of_name(title)
        if window is not None:
            window.is_visible = window.focus_window_at_next_frame = True
        self.window.wake()

    def record_item_rect(self, name: str) -> None:
        """Stores the rectangle of the item that ImGui drew last, for scripts and tests."""
        low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        self.item_rects[name] = (low.x, low.y, high.x, high.y)

    @property
    def wants_better_patterns(self) -> bool:
        """Whether a quick look at the target is all there is, by a user who has never optimised."""
        job = last_optimisation(self.session)
        if self._has_optimised or job is None or job.status != "done" or job.request.only_plane_m is None:
            return False
        return job.start_document.target_spec is self.session.target_spec

    def set_optimised(self) -> None:
        """Keeps that the user has optimised, and needs no hint any more."""
        if not self._has_optimised and self.store is not None:
            self.attempt(self.store.preferences.set, "has_optimised", True)
        self._has_optimised = True

    def set_theme(self, name: str) -> None:
        """Applies a theme of `theme.THEMES` and stores the choice."""
        self.theme = name
        theme.apply(name, self.text_size)
        if self.store is not None:
            self.attempt(self.store.preferences.set, "theme", name)

    def set_text_size(self, size: float) -> None:
        """Applies a size of `theme.TEXT_SIZES` and stores the choice."""
        self.text_size = size
        theme.apply(self.theme, size)
        self.window.wake()
        if self.store is not None:
            self.attempt(self.store.preferences.set, "text_size", size)

    @property
    def has_rig(self) -> bool:
        """Whether there may be devices to close."""
        return self._rig is not None

    def close_rig(self) -> str:
        """Switches the lasers off and closes the devices; returns why lasers may be on, or ""."""
        return "" if self._rig is None else self._rig.close()

    def close(self) -> None:
        """Ends the threads of the renderers, the loader, the listener and the measurement."""
        self.received_fields.close()
        self.loader.close()
        self.live_measurement.close()
        self.live_psnr.close()
        self.live_score.close()
        self.side_renderers.close()
        self.kept_pictures.close()
        self.page_images.close()
        self.point_probe.close()
        self.recording_editor.close()

    def _run_command(self, command: Command) -> None:
        if command.is_enabled():
            self.attempt(command.action)

    def _recent_files(self) -> list[Command]:
        paths = self.store.preferences.recent_files if self.store is not None else ()

        def open_file(path: Path) -> None:
            self.loader.open(path)

        names = (printable(f"{path.name}, in {path.parent}") for path in paths)
        return [Command(name, partial(open_file, path), "Recent") for name, path in zip(names, paths, strict=True)]
