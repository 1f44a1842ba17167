"""Steps of input: the events of windows and browsers as Dear ImGui needs them, one change at a time.

An event states more than what its name says: where the pointer is, which buttons and which modifiers are held. The
reader compares this with what it has seen and adds the steps that it missed, such as the second button of a drag, which
browsers report only in `buttons`, or a Ctrl key that went down while another window had the keyboard.

The name of a key depends on Shift: where "=" is Shift+0, a user who releases Shift first presses "=" and releases "0".
A release that fits no held key therefore releases all of them, and a press of a held key releases it first. Otherwise
the key would stay down, would repeat, and its next press would be none.

ImGui reads its input once in a frame, and what a click or a key does may show its effect some frames later: an item
under another one is hovered from the second frame on, a dialog has the keyboard after three. At 60 frames a second
nobody is faster than that. At 2 frames a second a whole sentence arrives within one frame. If ImGui got it at once, a
click that came with the movement before it would miss its item, Ctrl+P and the word after it would run the commands
whose keys the letters are, and two keys would run in the order of the menus.

A frame therefore gets movements, or turns of the wheel, or text, or a single press or release; before each of these it
gets the changes of modifiers and releases of keys that come first. A press, a release, a turn of the wheel or text
waits until the interface has settled after the action before it. The effect of a sequence of events then doesn't depend
on how the events fall on frames. The frames in between need not be drawn: `Window` draws only the last one.

While a text field has the keyboard, text goes to it as a whole and keys that type characters are left out, since
their characters arrive as text. While none has it, keys are commands and their characters are left out.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from imgui_bundle import imgui

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


_HOVER_FRAMES = 2  # after a movement, until an item that lies above another one is hovered
_SETTLING_FRAMES = 5  # after an action, until what it opens has its place and the keyboard


class ImguiInputQueue:
    """Forwards events to ImGui in their order. Call `begin_frame` before each frame."""

    def __init__(self) -> None:
        self._reader, self._waiting = EventReader(), deque[Step]()
        self._since_move = self._since_action = _SETTLING_FRAMES
        self._sent: type[Step] | None = None  # what this frame has got, after modifiers and released keys
        self._last_action: type[Step] | None = None
        self._was_command = False  # whether the last key was pressed as a command, so that its characters aren't text

    @property
    def has_pending(self) -> bool:
        """Whether events wait here or in ImGui."""
        return bool(self._waiting) or _imgui_has_pending()

    def enqueue(self, event: dict[str, Any]) -> None:
        """Adds an event; types that aren't in EVENT_TYPES are ignored."""
        self._waiting.extend(self._reader.read(event))

    def begin_frame(self) -> None:
        """Forwards what the next frame may process."""
        self._since_move += 1
        self._since_action += 1
        self._sent = None
        if not _imgui_has_pending():
            while self._waiting and self._may_take(self._waiting[0]):
                self._take(self._waiting.popleft())

    def _may_take(self, step: Step) -> bool:
        kind = _kind_of(step)
        if isinstance(step, Text) and self._was_command:
            return True
        if kind is KeyRelease:
            return self._sent in (None, Text)
        if self._sent is not None:
            return kind is self._sent and kind in (Move, Wheel, Text)
        if kind in (Move, ModifierChange):
            return True
        continues = kind is self._last_action and kind in (Wheel, Text)
        return self._since_move >= _HOVER_FRAMES and (continues or self._since_action >= _SETTLING_FRAMES)

    def _take(self, step: Step) -> None:
        kind = _kind_of(step)
        if isinstance(step, Text) and self._was_command:
            return
        if isinstance(step, KeyPress):
            self._was_command = kind is KeyPress and step.types
        elif not isinstance(step, Text | ModifierChange):
            self._was_command = False
        if isinstance(step, Text) or kind is not Text:
            _send_to_imgui(step)
        if kind is Move:
            self._sent, self._since_move = Move, 0
        elif kind not in (ModifierChange, KeyRelease):
            self._sent, self._since_action, self._last_action = kind, 0, kind


def _kind_of(step: Step) -> type[Step]:
    """A key that types is text while a text field has the keyboard."""
    is_text = isinstance(step, KeyPress) and step.types and imgui.get_io().want_text_input
    return Text if is_text else type(step)


def _send_to_imgui(step: Step) -> None:
    io = imgui.get_io()
    match step:
        case Move(x, y):
            io.add_mouse_pos_event(x, y)
        case ButtonChange(number, is_down):
            io.add_mouse_button_event(number - 1, is_down)
        case Wheel(dx, dy):
            io.add_mouse_wheel_event(dx, dy)
        case KeyPress(key) if key is not None:
            io.add_key_event(key, True)
        case KeyRelease(key):
            io.add_key_event(key, False)
        case ModifierChange(name, is_down):
            for key in (modifier_named(name), key_named(name)):
                if key is not None:
                    io.add_key_event(key, is_down)
        case Text(text):
            io.add_input_characters_utf8(text)


def _imgui_has_pending() -> bool:
    return len(imgui.get_current_context().input_events_queue) > 0


# --- Keys: from the names in events of browsers and windows to those of ImGui, and chords such as "Ctrl+Shift+Z" ---


Key = imgui.Key

_NAMED = {
    "ArrowDown": Key.down_arrow,
    "ArrowUp": Key.up_arrow,
    "ArrowLeft": Key.left_arrow,
    "ArrowRight": Key.right_arrow,
    "Backspace": Key.backspace,
    "Delete": Key.delete,
    "End": Key.end,
    "Enter": Key.enter,
    "Escape": Key.escape,
    "Home": Key.home,
    "Insert": Key.insert,
    "PageDown": Key.page_down,
    "PageUp": Key.page_up,
    "Tab": Key.tab,
    "Alt": Key.left_alt,
    "Control": Key.left_ctrl,
    "Shift": Key.left_shift,
    "Meta": Key.left_super,
    " ": Key.space,
    "=": Key.equal,
    "+": Key.equal,
    "-": Key.minus,
    "_": Key.minus,
    ",": Key.comma,
    "<": Key.comma,
    ".": Key.period,
    ">": Key.period,
    "/": Key.slash,
    "?": Key.slash,
    ";": Key.semicolon,
    "'": Key.apostrophe,
    "[": Key.left_bracket,
    "]": Key.right_bracket,
    "\\": Key.backslash,
    "`": Key.grave_accent,
    **{f"F{n}": Key(Key.f1.value + n - 1) for n in range(1, 13)},
    **{str(n): Key(Key._0.value + n) for n in range(10)},
    **{chr(ord("a") + n): Key(Key.a.value + n) for n in range(26)},
}
_MODIFIERS = {
    "Shift": Key.mod_shift,
    "Control": Key.mod_ctrl,
    "Ctrl": Key.mod_ctrl,
    "Alt": Key.mod_alt,
    "Meta": Key.mod_super,
}
_SPOKEN = {"Space": " ", "Left": "ArrowLeft", "Right": "ArrowRight", "Up": "ArrowUp", "Down": "ArrowDown"}


def key_named(name: str) -> Key | None:
    """ImGui's key for an event's key name; None for keys that aren't used."""
    return _NAMED.get(name) or _NAMED.get(name.lower())


def modifier_named(name: str) -> Key | None:
    """ImGui's modifier for the name of a modifier key; None for other keys."""
    return _MODIFIERS.get(name)


def digit_pressed() -> int:
    """The digit key 1…9 that was pressed since the last frame; 1 if a command was run by its name."""
    return next((n for n in range(1, 10) if imgui.is_key_pressed(Key(Key._0.value + n), False)), 1)


@dataclass(frozen=True)
class Chord:
    """A key with modifiers, written as "Ctrl+Z", "Shift+Left" or "?"."""

    text: str

    @cached_property
    def parts(self) -> tuple[tuple[str, ...], str]:
        """Names of the modifiers and of the key, as events have them."""
        *modifiers, key = self.text.split("+") if self.text != "+" else ["+"]
        return tuple("Control" if name == "Ctrl" else name for name in modifiers), _SPOKEN.get(key, key)

    @cached_property
    def code(self) -> int:
        """ImGui's code of the key chord."""
        modifiers, name = self.parts
        key = key_named(name)
        assert key is not None, f"no key is called {name}"
        extra = {Key.mod_shift.value} if name == "?" else set()
        return int(sum({_MODIFIERS[modifier].value for modifier in modifiers} | extra)) | key.value

    def is_down(self) -> bool:
        """Whether its key is held down, with any modifiers."""
        return imgui.is_key_down(Key(self.code & ~Key.mod_mask_.value))

    def was_pressed(self, repeat: bool = False) -> bool:
        """Whether exactly this chord was pressed since the last frame."""
        code = self.code
        io = imgui.get_io()
        held = sum(
            mask.value
            for is_down, mask in (
                (io.key_ctrl, Key.mod_ctrl),
                (io.key_shift, Key.mod_shift),
                (io.key_alt, Key.mod_alt),
                (io.key_super, Key.mod_super),
            )
            if is_down
        )
        mask = Key.mod_mask_.value
        return (code & mask) == held and imgui.is_key_pressed(Key(code & ~mask), repeat)
