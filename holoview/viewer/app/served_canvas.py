"""The canvas of `holoview view --serve`: rendercanvas's canvas over HTTP, of which every page can be used."""

from __future__ import annotations

import math
from typing import Any

from rendercanvas.http import RenderCanvas, asgi, loop

__all__ = ["ServedCanvas", "loop"]
_USES = ("pointer_down", "key_down", "wheel")  # events by which a user takes over
_SERVER = 0  # the id under which rendercanvas tells of pages; theirs begin with 1
_MOST_PIXELS = 16384  # of a side of a page


class ServedCanvas(RenderCanvas):  # type: ignore[misc]
    """A canvas that several pages show; the one that was used last decides its size and sends its input.

    rendercanvas 2.7 listens to the page that was opened first and to no other, and doesn't close the connections.
    """

    _active_client: int

    def __init__(self, **options: Any) -> None:
        self._sizes: dict[int, dict[str, Any]] = {}
        super().__init__(**options)

    def _on_event(self, event: dict[str, Any], id: int) -> None:
        if id == _SERVER:
            self._change_pages(event)
            return
        if id not in self._frame_info_per_client or not _is_sound(event):
            return  # the connection is gone, or a program sends what no page does
        kind = event["type"]
        if kind == "resize":
            self._sizes[id] = dict(event)
        if kind in _USES and id != self._active_client:
            self._activate(id)
        super()._on_event(event, id)
        if kind == "resize":
            self._schedule_maybe_draw()

    def _maybe_draw(self) -> None:
        """Draws once a page has told its size: the panels would be laid out for a window of one pixel."""
        if self._sizes:
            super()._maybe_draw()
        else:
            self._pending_maybe_draw = False

    def _change_pages(self, event: dict[str, Any]) -> None:
        """Pages were opened or closed; the one that is used stays the active one."""
        active = self._active_client
        super()._on_event(event, 0)
        self._sizes = {id: size for id, size in self._sizes.items() if id in event["ids"]}
        if active in event["ids"]:
            self._active_client = active
            self._update_active_states()
        elif self._active_client:
            self._activate(self._active_client)

    def _activate(self, id: int) -> None:
        self._active_client = id
        self._update_active_states()
        if id in self._sizes:
            super()._on_event(dict(self._sizes[id]), id)
        self.request_draw()

    def _rc_close(self) -> None:
        for connection in asgi._websockets.values():
            connection._send_queue.put_nowait(None)  # ends the connection; rendercanvas forgets to await this
        self._is_closed = True


def _is_sound(event: Any) -> bool:
    """Whether an event is one that a page sends of its own: not of the connections, nor an end of the viewer."""
    if not isinstance(event, dict) or event.get("type") in (None, "_clients_change", "close"):
        return False
    numbers = [value for value in event.values() if isinstance(value, int | float)]
    if not all(math.isfinite(value) for value in numbers):
        return False
    return event["type"] != "resize" or all(0 <= event.get(side, -1) <= _MOST_PIXELS for side in ("pwidth", "pheight"))
