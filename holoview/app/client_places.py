"""Limits the pages that use the served viewer at a time, and closes those that nobody uses."""

from __future__ import annotations

import asyncio
from typing import Any

from holoview.app.serve_guard import Application, Receive, Scope, Send

TRY_AGAIN_LATER = 1013
"""Code of the close of a page for which there is no place; the registry of RFC 6455, 11.7."""
NOT_USED = 4001
"""Code of the close of a page that nobody used for a while; the page says so and doesn't connect by itself."""
_NO_USE = '"_framefeedback"'  # of messages that a page sends by itself


class ClientPlaces:
    """Passes at most `most` WebSocket connections at a time to an application.

    idle_s: seconds without input after which a connection is closed; 0 for never.
    """

    def __init__(self, application: Application, most: int, idle_s: float = 0.0) -> None:
        self._application, self._most, self._idle_s = application, most, idle_s
        self.taken = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """An ASGI application."""
        if scope["type"] != "websocket":
            await self._application(scope, receive, send)
        elif self.taken >= self._most:
            await receive()  # websocket.connect
            await send({"type": "websocket.accept"})  # a connection that isn't accepted can't say why
            others = f"{self.taken} pages are" if self.taken > 1 else "another page is"
            await send({"type": "websocket.close", "code": TRY_AGAIN_LATER, "reason": f"{others} connected already"})
        else:
            self.taken += 1
            try:
                await self._application(scope, self._timed(receive, send) if self._idle_s else receive, send)
            finally:
                self.taken -= 1

    def _timed(self, receive: Receive, send: Send) -> Receive:
        """Receives until there was no input for too long; then the connection is closed."""
        loop = asyncio.get_running_loop()
        used = loop.time()

        async def receive_used() -> Any:
            nonlocal used
            try:
                message = await asyncio.wait_for(receive(), max(used + self._idle_s - loop.time(), 0.0))
            except TimeoutError:
                reason = f"not used for {self._idle_s / 60:g} minutes"
                await send({"type": "websocket.close", "code": NOT_USED, "reason": reason})
                return {"type": "websocket.disconnect", "code": NOT_USED}
            if _NO_USE not in (message.get("text") or ""):
                used = loop.time()
            return message

        return receive_used
