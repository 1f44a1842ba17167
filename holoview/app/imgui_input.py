"""Queues window events for Dear ImGui so that none is lost when frames are slow.

If the pointer moves and a button is released within one frame, ImGui doesn't apply the last movement of the drag,
because the widget is no longer active. A release therefore waits until a frame has processed the movement before it.

ImGui uses the state of the modifiers at the end of a frame's events: a quick Ctrl+S whose keys are released before the
frame would be read as S. A change of a modifier therefore waits until a frame has processed the actions before it.

Events behind a waiting one wait as well.
"""

from __future__ import annotations

from collections import deque
from typing import Any

from imgui_bundle import imgui

from holoview.app.keys import key_named, modifier_named

WHEEL_NOTCH = 100.0
"""One notch of the wheel in rendercanvas's units."""
EVENT_TYPES = ("pointer_move", "pointer_down", "pointer_up", "wheel", "key_down", "key_up", "char")
"""The event types of rendercanvas that are handled."""
_MODIFIED_TYPES = ("pointer_down", "pointer_up", "wheel", "key_down")  # whose meaning depends on modifiers


class ImguiInputQueue:
    """Forwards events to ImGui in their order. Call `after_frame` after each frame."""

    def __init__(self) -> None:
        self._waiting: deque[dict[str, Any]] = deque()
        self._position: tuple[float, float] | None = None
        self._has_moved = self._has_acted = False

    @property
    def has_pending(self) -> bool:
        """Whether events wait here or in ImGui, which processes one key press or character for each frame."""
        return bool(self._waiting) or _imgui_has_pending()

    def enqueue(self, event: dict[str, Any]) -> None:
        """Adds an event; types that aren't in EVENT_TYPES are ignored."""
        self._waiting.append(event)
        self._forward()

    def after_frame(self) -> None:
        """Forwards waiting events, once ImGui has processed those before."""
        if not _imgui_has_pending():
            self._has_moved = self._has_acted = False
            self._forward()

    def _forward(self) -> None:
        while self._waiting:
            event = self._waiting[0]
            if event["event_type"] == "pointer_up":
                self._move(event)
                if self._has_moved:
                    return
            is_modifier = _is_modifier(event)
            if is_modifier and self._has_acted:
                return
            _send_to_imgui(self._waiting.popleft())
            self._has_acted |= event["event_type"] in _MODIFIED_TYPES and not is_modifier
            if event["event_type"] in ("pointer_move", "pointer_down"):
                self._record_pointer(event)

    def _move(self, event: dict[str, Any]) -> None:
        if (event["x"], event["y"]) != self._position:
            imgui.get_io().add_mouse_pos_event(event["x"], event["y"])
            self._record_pointer(event)

    def _record_pointer(self, event: dict[str, Any]) -> None:
        self._position, self._has_moved = (event["x"], event["y"]), True


def _is_modifier(event: dict[str, Any]) -> bool:
    return event["event_type"] in ("key_down", "key_up") and modifier_named(event["key"]) is not None


def _send_to_imgui(event: dict[str, Any]) -> None:
    io, kind = imgui.get_io(), event["event_type"]
    if kind in ("pointer_move", "pointer_down", "pointer_up"):
        io.add_mouse_pos_event(event["x"], event["y"])
        if kind != "pointer_move" and event["button"] > 0:
            io.add_mouse_button_event(event["button"] - 1, kind == "pointer_down")
    elif kind == "wheel":
        io.add_mouse_wheel_event(event["dx"] / WHEEL_NOTCH, -event["dy"] / WHEEL_NOTCH)
    elif kind in ("key_down", "key_up"):
        _press(event["key"], kind == "key_down")
    elif kind == "char":
        io.add_input_characters_utf8(event.get("data") or "")


def _press(name: str, is_down: bool) -> None:
    io, key, modifier = imgui.get_io(), key_named(name), modifier_named(name)
    if modifier is not None:
        io.add_key_event(modifier, is_down)
    if key is not None:
        io.add_key_event(key, is_down)


def _imgui_has_pending() -> bool:
    return len(imgui.get_current_context().input_events_queue) > 0
