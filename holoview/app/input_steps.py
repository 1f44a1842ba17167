"""Steps of input: what the events of windows and browsers mean for Dear ImGui, one change at a time.

An event states more than what its name says: where the pointer is, which buttons and which modifiers are held. The
reader compares this with what it has seen and adds the steps that it missed, such as the second button of a drag, which
browsers report only in `buttons`, or a Ctrl key that went down while another window had the keyboard.

The name of a key depends on Shift: where "=" is Shift+0, a user who releases Shift first presses "=" and releases "0".
A release that fits no held key therefore releases all of them, and a press of a held key releases it first. Otherwise
the key would stay down, would repeat, and its next press would be none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from imgui_bundle import imgui

from holoview.app.keys import key_named, modifier_named

WHEEL_NOTCH = 100.0
"""One notch of the wheel in rendercanvas's units."""
EVENT_TYPES = ("pointer_move", "pointer_down", "pointer_up", "wheel", "key_down", "key_up", "char")
"""The event types of rendercanvas that are read."""
_COMPOSITION = ("insertCompositionText", "insertFromComposition")


@dataclass(frozen=True)
class Move:
    """The pointer is at (x, y), in logical pixels of the window."""

    x: float
    y: float


@dataclass(frozen=True)
class ButtonChange:
    """A button of the pointer goes down or up: 1 left, 2 right, 3 middle."""

    number: int
    is_down: bool


@dataclass(frozen=True)
class Wheel:
    """The wheel turns by some notches, positive to the left and away from the user."""

    dx: float
    dy: float


@dataclass(frozen=True)
class KeyPress:
    """A key goes down; None is a key that ImGui doesn't know. types: whether characters may follow from it."""

    key: imgui.Key | None
    types: bool


@dataclass(frozen=True)
class KeyRelease:
    """A key goes up."""

    key: imgui.Key


@dataclass(frozen=True)
class ModifierChange:
    """A modifier goes down or up; `name` is that of its key in events."""

    name: str
    is_down: bool


@dataclass(frozen=True)
class Text:
    """Characters that were typed."""

    text: str


Step = Move | ButtonChange | Wheel | KeyPress | KeyRelease | ModifierChange | Text


class EventReader:
    """Turns events into steps. It remembers what is held down."""

    def __init__(self) -> None:
        self._position: tuple[float, float] | None = None
        self._buttons: set[int] = set()
        self._keys: set[imgui.Key] = set()
        self._modifiers: set[str] = set()
        self._inferred: set[str] = set()  # modifiers whose key events went elsewhere

    def read(self, event: dict[str, Any]) -> Iterator[Step]:
        """The steps of an event; none for types that aren't in EVENT_TYPES."""
        kind = event["event_type"]
        if kind in ("pointer_move", "pointer_down", "pointer_up"):
            yield from self._infer_modifiers(event)
            yield from self._move(event)
            yield from self._change_buttons(event)
        elif kind == "wheel":
            yield from self._infer_modifiers(event)
            yield from self._move(event)
            yield Wheel(event["dx"] / WHEEL_NOTCH, -event["dy"] / WHEEL_NOTCH)
        elif kind in ("key_down", "key_up") and modifier_named(event["key"]) is not None:
            yield self._change_modifier(event["key"], kind == "key_down")
        elif kind == "key_down":
            yield from self._infer_modifiers(event)
            yield from self._press_key(event["key"])
        elif kind == "key_up":
            yield from self._release_key(event["key"])
        elif kind == "char" and event.get("data") and not _is_unfinished(event):
            yield Text(event["data"])

    def _move(self, event: dict[str, Any]) -> Iterator[Step]:
        position = (event["x"], event["y"])
        if position != self._position:
            self._position = position
            yield Move(*position)

    def _change_buttons(self, event: dict[str, Any]) -> Iterator[Step]:
        held = set(event["buttons"])
        if event["event_type"] == "pointer_down":
            held.add(event["button"])
        elif event["event_type"] == "pointer_up":
            held.discard(event["button"])
        for number in sorted(self._buttons - held):
            yield ButtonChange(number, False)
        for number in sorted(held - self._buttons - {0}):
            yield ButtonChange(number, True)
        self._buttons = held - {0}

    def _infer_modifiers(self, event: dict[str, Any]) -> Iterator[Step]:
        stated = set(event.get("modifiers", ()))
        for name in sorted(self._inferred - stated):
            yield ModifierChange(name, False)
        for name in sorted(stated - self._modifiers - self._inferred):
            yield ModifierChange(name, True)
        self._inferred = stated - self._modifiers

    def _change_modifier(self, name: str, is_down: bool) -> Step:
        self._inferred.discard(name)
        (self._modifiers.add if is_down else self._modifiers.discard)(name)
        return ModifierChange(name, is_down)

    def _press_key(self, name: str) -> Iterator[Step]:
        key = key_named(name)
        if key is not None and key in self._keys:
            yield KeyRelease(key)
        elif key is not None:
            self._keys.add(key)
        is_chord = bool((self._modifiers | self._inferred) & {"Control", "Alt", "Meta"})
        yield KeyPress(key, types=not is_chord and (key is None or len(name) == 1))

    def _release_key(self, name: str) -> Iterator[Step]:
        key = key_named(name)
        released = {key} if key in self._keys else set(self._keys)
        yield from (KeyRelease(held) for held in sorted(released, key=lambda key: key.value))
        self._keys -= released


def _is_unfinished(event: dict[str, Any]) -> bool:
    """Whether an input method is still composing the characters; it sends the final ones as plain text."""
    return bool(event.get("is_composing")) or event.get("input_type") in _COMPOSITION
