"""The server of the viewer: uvicorn with deadlines for connections that are slow, silent or don't read.

Imported only with the extra "serve".
"""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from holoview.app.serve_guard import Application

_REQUEST_S = 10.0
_PING_S = 20.0
_LARGEST_MESSAGE = 1 << 18  # bytes of an event, such as text that is pasted
_SPARE_CONNECTIONS = 32  # of requests for pages and scripts, beside those of the clients


class TimedRequests(H11Protocol):  # type: ignore[misc]
    """Closes a connection on which no whole request arrives in time, or whose answer isn't read."""

    request_s = _REQUEST_S
    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        """Starts the time for the first request."""
        super().connection_made(transport)
        self._start_deadline()

    def on_response_complete(self) -> None:
        """Starts the time for the next request."""
        super().on_response_complete()
        self._start_deadline()

    def handle_websocket_upgrade(self, event: Any) -> None:
        """Ends the time: pings watch over WebSockets."""
        self._end_deadline()
        super().handle_websocket_upgrade(event)

    def connection_lost(self, exc: Exception | None) -> None:
        """Ends the time."""
        self._end_deadline()
        super().connection_lost(exc)

    def _start_deadline(self) -> None:
        self._end_deadline()
        self._deadline = self.loop.call_later(self.request_s, self._close_if_late)

    def _end_deadline(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()

    def _close_if_late(self) -> None:
        if self.conn.their_state is not h11.DONE:  # a request that is being answered is done
            self.transport.abort()


class WatchedWebSocket(WebSocketsSansIOProtocol):  # type: ignore[misc]
    """Drops a client that doesn't answer pings at once, rather than when it has read all that it was sent."""

    def keepalive_timeout(self) -> None:
        """Called when a ping wasn't answered in time."""
        super().keepalive_timeout()
        self.transport.abort()


def make_server(
    application: Application,
    clients: int,
    certificate: Path | None = None,
    key: Path | None = None,
    *,
    request_s: float = _REQUEST_S,
    ping_s: float = _PING_S,
) -> uvicorn.Server:
    """A server of an application for a number of clients, with TLS if there is a certificate.

    request_s: in which a request has to arrive. ping_s: after which a WebSocket is pinged, and in which it has to
    answer.
    """
    config = uvicorn.Config(
        application,
        http=type("TimedRequests", (TimedRequests,), {"request_s": request_s}),
        ws=WatchedWebSocket,
        ws_max_size=_LARGEST_MESSAGE,
        ws_ping_interval=ping_s,
        ws_ping_timeout=ping_s,
        log_level="warning",
        lifespan="on",
        server_header=False,
        timeout_notify=1,
        limit_concurrency=clients + _SPARE_CONNECTIONS,
        ssl_certfile=certificate,
        ssl_keyfile=key,
    )
    return uvicorn.Server(config)
