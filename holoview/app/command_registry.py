"""The commands of the viewer with their keys, for menus, key bindings, the command palette and scripts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

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
