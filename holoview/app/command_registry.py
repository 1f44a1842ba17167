"""What a user can do by name: each command once, for menus, keys, the palette, the sheet of keys and scripts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from holoview.app.keys import Chord
from holoview.util.errors import UserError, suggest_matches

Action = Callable[[], None]


@dataclass(frozen=True)
class Command:
    """A name such as "Exposure up", what it does, its keys, and the group under which people look for it.

    is_held: called with every repeat of a key that is held down.
    """

    name: str
    action: Action
    group: str
    keys: tuple[Chord, ...] = ()
    help: str = ""
    repeats: bool = False
    is_enabled: Callable[[], bool] = field(default=lambda: True)


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
        is_held: bool = False,
        is_possible: Callable[[], bool] = lambda: True,
    ) -> Command:
        """Adds a command; keys are written "Ctrl+Z" and several are parted by spaces.

        Raises ValueError when the name or one of the keys is taken: keys have one meaning.
        """
        chords = tuple(Chord(text) for text in keys.split())
        taken = {chord.code: command.name for command in self for chord in command.keys}
        clash = next((taken[chord.code] for chord in chords if chord.code in taken), None)
        if name in self._by_name or clash is not None:
            raise ValueError(f"command {name}: {clash or 'its name'} is taken")
        command = Command(name, action, group, chords, help, is_held, is_possible)
        self._by_name[name] = command
        return command

    def run(self, name: str) -> None:
        """Runs a command by its name. Raises UserError for an unknown one, with near matches."""
        if name not in self._by_name:
            raise UserError("command", f'"{name}"', remedy=suggest_matches(name, self._by_name))
        command = self._by_name[name]
        if command.is_enabled():
            command.action()

    def is_repeating(self) -> bool:
        """Whether a key is held down whose command is called again and again."""
        return any(chord.is_down() for command in self if command.repeats for chord in command.keys)

    def pressed(self) -> Iterator[Command]:
        """The commands whose keys were pressed since the last frame."""
        for command in self:
            if any(chord.was_pressed(command.repeats) for chord in command.keys) and command.is_enabled():
                yield command
