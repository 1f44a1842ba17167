"""Gives Dear ImGui the steps of input one after another, so that none is lost when frames are slow.

ImGui reads its input once in a frame, and what a click or a key does may show its effect some frames later: an item
under another one is hovered from the second frame on, a dialog has the keyboard after three. At 60 frames a second
nobody is faster than that. At 2 frames a second a whole sentence arrives within one frame. If ImGui got it at once, a
click that came with the movement before it would miss its item, Ctrl+P and the word after it would run the commands
whose keys the letters are, and two keys would run in the order of the menus.

A frame therefore gets movements, or turns of the wheel, or text, or a single press or release; before each of these it
gets the changes of modifiers and releases of keys that come first. A press, a release, a turn of the wheel or text
waits until the interface has settled after the action before it. What a sequence of events does then doesn't depend on
how it falls on frames. The frames in between need not be drawn: `Window` draws only the last one.

While a text field has the keyboard, text goes to it as a whole and keys that type characters are left out, since their
characters arrive as text. While none has it, keys are commands and their characters are left out.
"""

from __future__ import annotations

from collections import deque
from typing import Any

from imgui_bundle import imgui

from holoview.app.input_steps import (
    ButtonChange,
    EventReader,
    KeyPress,
    KeyRelease,
    ModifierChange,
    Move,
    Step,
    Text,
    Wheel,
)
from holoview.app.keys import key_named, modifier_named

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
