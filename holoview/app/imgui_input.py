"""Events of a window for Dear ImGui, at the pace that it can take when frames are slow.

ImGui forgets a drag's last way when the pointer moves and is let go in the same frame: a widget that isn't held any
more doesn't look where the pointer is. So a release waits until a frame has seen the way to it. And it knows modifiers
as they are at the end of all that a frame is told: a quick Ctrl+S, let go before the frame, would read S. So a modifier
waits until a frame has seen what was done with the ones before. What follows waits too.
"""

from __future__ import annotations

from collections import deque
from typing import Any

from imgui_bundle import imgui

from holoview.app.keys import key_named, modifier_named

_NOTCH = 100  # of the wheel, in rendercanvas's units
EVENT_TYPES = ("pointer_move", "pointer_down", "pointer_up", "wheel", "key_down", "key_up", "char")
"""The events that are taken, of rendercanvas's."""
_ACTS = ("pointer_down", "pointer_up", "wheel", "key_down")  # what modifiers change the meaning of


class ImguiInputQueue:
    """Hands events to ImGui in their order; `after_frame` is called after each frame."""

    def __init__(self) -> None:
        self._later: deque[dict[str, Any]] = deque()
        self._at: tuple[float, float] | None = None
        self._has_moved = self._has_acted = False

    @property
    def has_pending(self) -> bool:
        """Whether events wait for their turn: ImGui takes a press or a letter a frame, however fast they come."""
        return bool(self._later) or _is_queued()

    def enqueue(self, event: dict[str, Any]) -> None:
        """Takes one of `KINDS`; other events change nothing."""
        self._later.append(event)
        self._forward()

    def after_frame(self) -> None:
        """Goes on with what waited, once ImGui has seen where the pointer went."""
        if not _is_queued():
            self._has_moved = self._has_acted = False
            self._forward()

    def _forward(self) -> None:
        while self._later:
            event = self._later[0]
            if event["event_type"] == "pointer_up":
                self._move(event)
                if self._has_moved:
                    return
            is_modifier = _is_modifier(event)
            if is_modifier and self._has_acted:
                return
            _send_to_imgui(self._later.popleft())
            self._has_acted |= event["event_type"] in _ACTS and not is_modifier
            if event["event_type"] in ("pointer_move", "pointer_down"):
                self._record_pointer(event)

    def _move(self, event: dict[str, Any]) -> None:
        if (event["x"], event["y"]) != self._at:
            imgui.get_io().add_mouse_pos_event(event["x"], event["y"])
            self._record_pointer(event)

    def _record_pointer(self, event: dict[str, Any]) -> None:
        self._at, self._has_moved = (event["x"], event["y"]), True


def _is_modifier(event: dict[str, Any]) -> bool:
    return event["event_type"] in ("key_down", "key_up") and modifier_named(event["key"]) is not None


def _send_to_imgui(event: dict[str, Any]) -> None:
    io, kind = imgui.get_io(), event["event_type"]
    if kind in ("pointer_move", "pointer_down", "pointer_up"):
        io.add_mouse_pos_event(event["x"], event["y"])
        if kind != "pointer_move" and event["button"] > 0:
            io.add_mouse_button_event(event["button"] - 1, kind == "pointer_down")
    elif kind == "wheel":
        io.add_mouse_wheel_event(event["dx"] / _NOTCH, -event["dy"] / _NOTCH)
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


def _is_queued() -> bool:
    return len(imgui.get_current_context().input_events_queue) > 0
