"""Serves the viewer to a browser by HTTP and WebSocket, protected by a token in the address.

rendercanvas streams images and receives events. Whoever has the token can open and write files as the user who started
the viewer, unless it is served to look at. Therefore it is served to this machine only, unless another address is
given; requests under other names are refused, and so are WebSocket connections from pages of other sites, although the
browser would send them the cookie with the token. docs/security.md has the whole threat model.

Only requests pass that name the viewer rightly, have the token and come from the viewer's own page:

    HostGuard ─▶ TokenGuard ─▶ the page and its scripts, or the application

Applications are those of ASGI, https://asgi.readthedocs.io.
"""

from __future__ import annotations

import asyncio
import ipaddress
import re
import secrets
import socket
import ssl
from collections.abc import Awaitable, Callable, Collection, MutableMapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from holoview.light.model.fields import (
    FileContent,
    Integer,
    Maybe,
    Number,
    Several,
    Truth,
    described_field,
    flag_of,
    validate,
    with_field_docs,
)
from holoview.util.errors import UserError
from holoview.util.packages import import_optional

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Any]]
Send = Callable[[Any], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]
Header = tuple[bytes, bytes]

_POLICY_VIOLATION = 1008  # RFC 6455, 7.4.1
_WEB = Path(__file__).parent / "web"
_FILES = {
    "/": ("page.html", b"text/html; charset=utf-8"),
    "/input.js": ("input.js", b"text/javascript; charset=utf-8"),
    "/client.js": ("client.js", b"text/javascript; charset=utf-8"),
}
"""The page and its scripts, by path: the file, and its type. The others are rendercanvas's own."""
_PROTECTION: tuple[Header, ...] = (
    (b"cache-control", b"no-store"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
    (
        b"content-security-policy",
        b"default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src blob: data:; "
        b"connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
)
"""Headers of every answer: nothing is kept, told to other sites, loaded from them, or shown inside their pages."""


class HostGuard:
    """Passes requests whose Host header names the viewer, which stops DNS rebinding.

    answers_to: whether a name or IP address, without its port, is the viewer's.
    """

    def __init__(self, application: Application, answers_to: Callable[[str], bool]) -> None:
        self._application, self._answers_to = application, answers_to

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """An ASGI application."""
        if scope["type"] == "lifespan" or self._answers_to(_host_of(_header(scope, b"host"))):
            await self._application(scope, receive, send)
        elif scope["type"] == "websocket":
            await _refuse_websocket(receive, send)
        elif scope["type"] == "http":
            told = b"The viewer doesn't answer to this name. --host-name NAME lets it answer to another one.\n"
            await _respond(send, 421, told)


class TokenGuard:
    """Passes requests to an application only with the right token: first in the URL, later in a cookie.

    cookie: its name. host_names: names of a reverse proxy, whose page has another origin than the Host header that
    arrives here may say.
    """

    def __init__(
        self, application: Application, token: str, cookie: str = "holoview", host_names: Collection[str] = ()
    ) -> None:
        self._application, self._token, self._cookie = application, token, cookie
        self._host_names = {name.lower() for name in host_names}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """An ASGI application."""
        if scope["type"] == "lifespan":
            await self._application(scope, receive, send)
        elif scope["type"] == "websocket":
            await self._on_websocket(scope, receive, send)
        elif scope["type"] == "http":
            await self._on_request(scope, receive, send)

    async def _on_request(self, scope: Scope, receive: Receive, send: Send) -> None:
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
        if scope.get("method", "GET") not in ("GET", "HEAD"):
            await _respond(send, 405, b"There is nothing to send to.\n", [(b"allow", b"GET, HEAD")])
        elif given and self._is_right(given):
            secure = "; Secure" if scope.get("scheme") == "https" else ""
            cookie = f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict{secure}"
            await _respond(send, 303, b"", [(b"location", b"/"), (b"set-cookie", cookie.encode())])
        elif not self._is_right(self._cookie_of(scope)):
            await _respond(send, 403, b"This address needs the token that `holoview view --serve` printed.\n")
        elif scope["path"] in _FILES:
            name, kind = _FILES[scope["path"]]
            await _respond(send, 200, (_WEB / name).read_bytes(), [(b"content-type", kind)])
        else:
            await self._application(scope, receive, _protected(send))

    async def _on_websocket(self, scope: Scope, receive: Receive, send: Send) -> None:
        if self._is_right(self._cookie_of(scope)) and self._is_own_page(scope):
            await self._application(scope, receive, send)
        else:
            await _refuse_websocket(receive, send)

    def _is_right(self, token: str) -> bool:
        return secrets.compare_digest(token.encode(), self._token.encode())

    def _is_own_page(self, scope: Scope) -> bool:
        """Whether a connection comes from the page itself, or from a program that sends no origin."""
        origin = _header(scope, b"origin")
        if not origin:
            return True
        try:
            parts = urlsplit(origin)
            name = (parts.hostname or "").lower()
        except ValueError:
            return False
        if scope.get("scheme") == "wss" and parts.scheme != "https":
            return False
        return name in self._host_names or parts.netloc == _header(scope, b"host")

    def _cookie_of(self, scope: Scope) -> str:
        """The token in the cookies; Python's own parser of cookies takes time as the square of their length."""
        pairs = (part.strip().partition("=") for part in _header(scope, b"cookie").split(";"))
        return next((value.strip('"') for name, _, value in pairs if name == self._cookie), "")


def _header(scope: Scope, name: bytes) -> str:
    return next((value.decode("latin-1") for key, value in scope["headers"] if key == name), "")


def _host_of(header: str) -> str:
    """The name or address in a Host header, without its port; empty if it is none."""
    try:
        return urlsplit(f"//{header}").hostname or ""
    except ValueError:
        return ""


def _protected(send: Send) -> Send:
    """Adds the protecting headers to the answers of an application."""

    async def send_protected(message: Any) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", ()), *_PROTECTION]}
        await send(message)

    return send_protected


async def _refuse_websocket(receive: Receive, send: Send) -> None:
    await receive()  # websocket.connect
    await send({"type": "websocket.close", "code": _POLICY_VIOLATION})


async def _respond(send: Send, status: int, body: bytes, headers: list[Header] | None = None) -> None:
    kind = [] if headers else [(b"content-type", b"text/plain; charset=utf-8")]
    common = [(b"content-length", str(len(body)).encode()), *_PROTECTION]
    await send({"type": "http.response.start", "status": status, "headers": [*(headers or kind), *common]})
    await send({"type": "http.response.body", "body": body})


# --- Where and to whom the viewer is served: address, names it answers to, clients, what they may do, and TLS ---


_LONGEST_IDLE_MIN = 7 * 24 * 60.0
ANY_ADDRESS = ("0.0.0.0", "::")
"""Addresses that can be listened at, but not opened in a browser."""
_LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
_HOST_LABEL = re.compile(r"[a-z0-9](?:[a-z0-9-]{0,61}[a-z0-9])?")
_LONGEST_HOST = 253  # characters


@dataclass(frozen=True)
class Address:
    """Where to serve: a host name or IP address, and a port; port 0 chooses a free one."""

    host: str = "127.0.0.1"
    port: int = 0

    @classmethod
    def parse(cls, text: str) -> Address:
        """Parses "HOST:PORT", ":PORT" or "PORT". Raises UserError for anything else."""
        host, _, port = text.strip().rpartition(":")
        if not (port.isdecimal() and len(port) < 6 and int(port) < 65536):
            raise UserError("--serve", f'"{text}"', expected="HOST:PORT, e.g. 127.0.0.1:8080")
        return cls(host.strip("[]") or "127.0.0.1", int(port))

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine can reach it."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"

    @property
    def warning(self) -> str:
        """The risk of serving to other machines without encryption; empty if only this machine can reach it."""
        if self.is_loopback:
            return ""
        return (
            f"warning: {self.host} can be reached from other machines, and the connection is not encrypted. Whoever "
            "listens on the network can read the token and all that is shown, and can then open and write files as "
            f"you. Safer: --serve 127.0.0.1:{self.port}, and from there ssh -L {self.port}:127.0.0.1:{self.port} HOST"
        )

    def url(self, port: int, token: str, scheme: str = "http") -> str:
        """The URL to open in a browser, for the port that was chosen."""
        host = socket.gethostname() if self.host in ANY_ADDRESS else self.host
        return f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}/?token={token}"


class HostName:
    """Type of a field: a name by which browsers reach the viewer."""

    metavar, is_appended = "NAME", True

    def parse(self, value: Any, where: str) -> str:
        name = str(value)
        if len(name) > _LONGEST_HOST or not all(map(_HOST_LABEL.fullmatch, name.lower().split("."))):
            raise UserError(where, f'"{name}"', expected=self.format_range())
        return name

    def format_range(self) -> str:
        """What is expected, for error messages."""
        return "a name without scheme and port: viewer.example.org"


@with_field_docs
@dataclass(frozen=True)
class ServeOptions:
    """To whom the viewer is served.

    Raises UserError for values out of range and for files that don't make a certificate with its key.

    Fields:
    """

    is_read_only: bool = described_field(
        Truth(), "To look at: no files are opened, saved or exported.", flag="look", default=False
    )
    clients: int = described_field(Integer(1, 1000), "The most pages that are connected at a time.", default=8)
    idle_min: float = described_field(
        Number(low=0.0, high=_LONGEST_IDLE_MIN, words=f"minutes from 0 (never) to {_LONGEST_IDLE_MIN:g}"),
        "Minutes after which a page without input is disconnected; 0: never.",
        flag="idle",
        default=60.0,
    )
    host_names: tuple[str, ...] = described_field(
        Several(HostName()),
        "A further name that it answers to, such as that of a reverse proxy; may be given several times.",
        flag="host-name",
        default=(),
    )
    certificate: Path | None = described_field(
        Maybe(FileContent()), "Encrypts connections (TLS) with this certificate, in PEM.", default=None
    )
    key: Path | None = described_field(
        Maybe(FileContent()), "Key of the certificate, if it isn't in the same file.", default=None
    )

    def __post_init__(self) -> None:
        validate(self, flag_of)
        _check_certificate(self.certificate, self.key)

    @property
    def scheme(self) -> str:
        """Of the URL: "https" with a certificate."""
        return "http" if self.certificate is None else "https"

    def warning(self, address: Address) -> str:
        """The risk of serving at an address, in words; empty if only this machine can reach it."""
        if address.is_loopback:
            return ""
        may = "see and change what is shown" if self.is_read_only else "open and write files as you"
        if self.certificate is None:
            return address.warning.replace("open and write files as you", may)
        return f"warning: {address.host} can be reached from other machines. Whoever has the token can {may}."

    def answers_to(self, address: Address, host: str) -> bool:
        """Whether a name or IP address by which a browser reached the viewer is one of its own.

        A page of another site that has its own name resolved to this machine (DNS rebinding) comes with that name. IP
        addresses can't be rebound, so that one that is listened at may have any.
        """
        host = host.lower().rstrip(".")
        if host in {name.lower() for name in self.host_names} or host == address.host.lower():
            return True
        if address.is_loopback:
            return host in _LOOPBACK_NAMES
        return address.host in ANY_ADDRESS and (host == socket.gethostname().lower() or _is_ip_address(host))


def _is_ip_address(text: str) -> bool:
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return False
    return True


def _check_certificate(certificate: Path | None, key: Path | None) -> None:
    if certificate is None:
        if key is not None:
            raise UserError("--key", "without --certificate", expected="--certificate with it")
        return
    for flag, path in (("--certificate", certificate), ("--key", key)):
        if path is not None and not path.is_file():
            raise UserError(flag, f"{path} isn't a file", expected="a file in PEM")
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password=lambda: "")
    except (ssl.SSLError, OSError) as error:
        raise UserError(
            "--certificate",
            f"{certificate} with {key or 'the key in it'}: {error}",
            expected="a certificate and its own key in PEM, the key without a password",
        ) from error


# --- the server -------------------------------------------------------------------------------------------------------


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
_LAST_S = 1.5  # that a client has at the end of the server to read what it was sent; also one on a busy machine
_SHUTDOWN_S = 2  # after which the server ends whatever still goes on, such as a handshake of TLS


class EndsInTime:
    """Drops a connection soon after the server has ended it, also where the client doesn't read.

    uvicorn waits for such a client without limit. To be joined to its protocols. last_s: the time that the client has.
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
