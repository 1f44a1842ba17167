"""Serves the viewer to a browser by HTTP and WebSocket, protected by a token in the address.

rendercanvas streams images and receives events. Whoever has the token can open and write files as the user who started
the viewer, unless it is served to look at. Therefore it is served to this machine only, unless another address is
given; requests under other names are refused, and so are WebSocket connections from pages of other sites, although the
browser would send them the cookie with the token. docs/security.md has the whole threat model.
"""

from __future__ import annotations

import asyncio
import secrets
import socket
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from holoview.app.serve_guard import Address, Application, HostGuard, Receive, Scope, Send, ServeOptions, TokenGuard
from holoview.util.errors import UserError
from holoview.util.packages import import_optional


def guarded(application: Application, token: str, cookie: str, address: Address, options: ServeOptions) -> Application:
    """An application behind all guards: names, token and origin, and the number of clients.

    cookie: the name of the cookie that holds the token.
    """
    places = ClientPlaces(application, options.clients, 60 * options.idle_min)
    return HostGuard(TokenGuard(places, token, cookie, options.host_names), partial(options.answers_to, address))


def serve(
    address: Address,
    began: Callable[[str], None],
    is_over: Callable[[], bool] = lambda: False,
    options: ServeOptions | None = None,
) -> None:
    """Serves the canvas of `rendercanvas.http` until it is interrupted or `is_over` returns true.

    began: called with the URL, which has a random token, and before that with a warning if other machines can reach the
    address. options: `ServeOptions()` when None. Raises UserError if a library isn't installed or the address is taken.
    """
    require_serving_libraries()
    from rendercanvas.http import asgi

    options = options or ServeOptions()
    token = secrets.token_urlsafe(18)
    with _listening(address) as listener:
        port = listener.getsockname()[1]
        cookie = f"holoview-{port}"  # cookies know hosts, not ports
        application = guarded(asgi, token, cookie, address, options)
        server = make_server(application, options.clients, options.certificate, options.key, is_over=is_over)
        if warning := options.warning(address):
            began(warning)
        began(address.url(port, token, options.scheme))
        with suppress(KeyboardInterrupt):
            server.run(sockets=[listener])


def require_serving_libraries() -> None:
    """Raises UserError if a library of the extra "serve" isn't installed."""
    for library in ("uvicorn", "websockets"):
        import_optional(library, "--serve")


def _listening(address: Address) -> socket.socket:
    family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
    try:
        return socket.create_server((address.host, address.port), family=family)
    except OSError as error:
        remedy = "choose another port; 0 takes a free one"
        raise UserError("--serve", f"{address.host}:{address.port}: {error.strerror}", remedy=remedy) from error


# --- The server of the viewer: uvicorn with deadlines for connections that are slow, silent or don't read ---
#
# uvicorn belongs to the extra "serve": what is added to its classes is written without them, and joined to them when a
# server is made.


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


# --- Limits the pages that use the served viewer at a time, and closes those that nobody uses ---


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
