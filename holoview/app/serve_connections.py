"""The server of the viewer: uvicorn with deadlines for connections that are slow, silent or don't read.

uvicorn belongs to the extra "serve": what is added to its classes is written without them, and joined to them when a
server is made.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

from holoview.app.serve_guard import Application
from holoview.util.packages import import_optional

_REQUEST_S = 10.0
_PING_S = 20.0
_LARGEST_MESSAGE = 1 << 18  # bytes of an event, such as text that is pasted
_SPARE_CONNECTIONS = 32  # of requests for pages and scripts, beside those of the clients
_LAST_S = 0.5  # that a client has at the end of the server to read what it was sent
_SHUTDOWN_S = 2  # after which the server ends whatever still goes on, such as a handshake of TLS


class EndsInTime:
    """Drops a connection soon after the server has ended it, also where the client doesn't read.

    uvicorn waits for such a client without limit. To be joined to its protocols. last_s: that the client has.
    """

    last_s = _LAST_S
    loop: Any
    transport: Any

    def shutdown(self) -> None:
        """Called when the server ends."""
        super().shutdown()  # type: ignore[misc]
        self.loop.call_later(self.last_s, self.transport.abort)


class TimedRequests:
    """Closes a connection on which no whole request arrives in time, or whose answer isn't read.

    To be joined to uvicorn's `H11Protocol`. done: the state of h11 in which a request has arrived.
    """

    request_s = _REQUEST_S
    done: Any = None
    loop: Any
    conn: Any
    transport: Any
    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        """Starts the time for the first request."""
        super().connection_made(transport)  # type: ignore[misc]
        self._start_deadline()

    def on_response_complete(self) -> None:
        """Starts the time for the next request."""
        super().on_response_complete()  # type: ignore[misc]
        self._start_deadline()

    def handle_websocket_upgrade(self, event: Any) -> None:
        """Ends the time: pings watch over WebSockets."""
        self._end_deadline()
        super().handle_websocket_upgrade(event)  # type: ignore[misc]

    def connection_lost(self, exc: Exception | None) -> None:
        """Ends the time."""
        self._end_deadline()
        super().connection_lost(exc)  # type: ignore[misc]

    def _start_deadline(self) -> None:
        self._end_deadline()
        self._deadline = self.loop.call_later(self.request_s, self._close_if_late)

    def _end_deadline(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()

    def _close_if_late(self) -> None:
        if self.conn.their_state is not self.done:  # a request that is being answered is done
            self.transport.abort()


class WatchedWebSocket:
    """Drops a client that doesn't answer pings at once, rather than when it has read all that it was sent.

    To be joined to uvicorn's `WebSocketsSansIOProtocol`.
    """

    transport: Any

    def keepalive_timeout(self) -> None:
        """Called when a ping wasn't answered in time."""
        super().keepalive_timeout()  # type: ignore[misc]
        self.transport.abort()


class EndsWhenOver:
    """Ends the server as soon as the viewer is over. To be joined to uvicorn's `Server`."""

    is_over: Callable[[], bool]

    async def on_tick(self, counter: int) -> bool:
        """Called ten times a second; returns whether to end."""
        return self.is_over() or bool(await super().on_tick(counter))  # type: ignore[misc]


def make_server(
    application: Application,
    clients: int,
    certificate: Path | None = None,
    key: Path | None = None,
    *,
    is_over: Callable[[], bool] = lambda: False,
    request_s: float = _REQUEST_S,
    ping_s: float = _PING_S,
) -> Any:
    """A `uvicorn.Server` of an application for a number of clients, with TLS if there is a certificate.

    is_over: whether it is to end. request_s: in which a request has to arrive. ping_s: after which a WebSocket is
    pinged, and in which it has to answer. Raises UserError without the extra "serve".
    """
    uvicorn = import_optional("uvicorn", "--serve")
    requests = import_optional("uvicorn.protocols.http.h11_impl", "--serve")
    sockets = import_optional("uvicorn.protocols.websockets.websockets_sansio_impl", "--serve")
    timed = {"request_s": request_s, "done": requests.h11.DONE}
    config = uvicorn.Config(
        application,
        http=type("TimedHttp", (TimedRequests, EndsInTime, requests.H11Protocol), timed),
        ws=type("WatchedHttp", (WatchedWebSocket, EndsInTime, sockets.WebSocketsSansIOProtocol), {}),
        ws_max_size=_LARGEST_MESSAGE,
        ws_ping_interval=ping_s,
        ws_ping_timeout=ping_s,
        log_level="warning",
        lifespan="on",
        server_header=False,
        timeout_graceful_shutdown=_SHUTDOWN_S,
        limit_concurrency=clients + _SPARE_CONNECTIONS,
        ssl_certfile=certificate,
        ssl_keyfile=key,
    )
    return type("ViewerServer", (EndsWhenOver, uvicorn.Server), {"is_over": staticmethod(is_over)})(config)
