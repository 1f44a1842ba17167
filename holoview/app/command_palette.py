"""The commands of the viewer with their keys, for menus and scripts; a sheet of all keys, and a palette with search."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import groupby

from imgui_bundle import imgui

from holoview.app import theme
from holoview.app.user_input import Chord
from holoview.util.errors import UserError, suggest_matches

Action = Callable[[], None]


@dataclass(frozen=True)
class Command:
    """A command: a unique name, the action, the group (menu) it belongs to, its keys and a sentence of help.

    repeats: whether the action is called again while a key is held down. is_urgent: whether its keys work while text is
    typed, too.
    """

    name: str
    action: Action
    group: str
    keys: tuple[Chord, ...] = ()
    help: str = ""
    repeats: bool = False
    is_enabled: Callable[[], bool] = field(default=lambda: True)
    is_urgent: bool = False


class CommandRegistry:
    """All commands, in the order in which they were added."""

    def __init__(self) -> None:
        self._by_name: dict[str, Command] = {}

    def __iter__(self) -> Iterator[Command]:
        return iter(self._by_name.values())

    def add(
        self,
        name: str,
        action: Action,
        group: str,
        keys: str = "",
        help: str = "",
        *,
        repeats: bool = False,
        is_enabled: Callable[[], bool] = lambda: True,
        is_urgent: bool = False,
    ) -> Command:
        """Adds a command. keys: chords such as "Ctrl+Z", separated by spaces. repeats, is_urgent: see `Command`.

        Raises ValueError when the name or one of the keys belongs to another command.
        """
        chords = tuple(Chord(text) for text in keys.split())
        taken = {chord.code: command.name for command in self for chord in command.keys}
        clash = next((taken[chord.code] for chord in chords if chord.code in taken), None)
        if name in self._by_name or clash is not None:
            raise ValueError(f"command {name}: {clash or 'its name'} is taken")
        command = Command(name, action, group, chords, help, repeats, is_enabled, is_urgent)
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

    def pressed(self, *, is_typing: bool = False) -> Iterator[Command]:
        """The enabled commands whose keys were pressed since the last frame. is_typing: only the urgent ones."""
        for command in self:
            if is_typing and not command.is_urgent:
                continue
            if any(chord.was_pressed(command.repeats) for chord in command.keys) and command.is_enabled():
                yield command


# --- the sheet of keys and the palette ---


_PALETTE_ROWS = 12


class HelpOverlay:
    """The sheet of keys and the command palette; at most one of them is open.

    run: runs a command by its name. page: "keys", "palette", or "" while both are closed. query: the words typed into
    the palette.
    """

    title = "Keys and commands"

    def __init__(self, commands: CommandRegistry, run: Callable[[str], None]) -> None:
        self._commands, self._run = commands, run
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
        width = min(place.work_size.x - 40, 860.0 if is_sheet else 520.0)
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
        matches = [c for c in self._commands if all(word in f"{c.group} {c.name}".lower() for word in words)]
        return sorted(matches, key=lambda c: not c.name.lower().startswith(self.query.lower()))

    def _draw_sheet(self) -> None:
        shown = (c for c in self._commands if c.keys and self._commands.of_group(c.group))
        commands = sorted(shown, key=lambda c: c.group)
        groups = [(name, list(some)) for name, some in groupby(commands, key=lambda c: c.group)]
        columns = 3 if imgui.get_content_region_avail().x > 700 else 2
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
        imgui.text_disabled(
            "On the image: wheel zooms about the pointer, Ctrl+wheel changes the focal plane, "
            "drag pans, Shift+drag draws a region, double click fits."
        )

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
                self._run(command.name)
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
