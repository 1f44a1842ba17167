"""Serves the viewer to a browser by HTTP and WebSocket, protected by a token in the address.

rendercanvas streams images and receives events. Whoever has the token can open and write files as the user who started
the viewer. Therefore it is served to this machine only, unless another address is given, and WebSocket connections from
pages of other sites are refused by their origin, although the browser would send them the cookie with the token.
"""

from __future__ import annotations

import ipaddress
import secrets
import socket
from collections.abc import Awaitable, Callable, MutableMapping
from contextlib import suppress
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from holoview.util.errors import UserError
from holoview.util.optional_library import import_optional

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Any]]
Send = Callable[[Any], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]

_ANY_ADDRESS = ("0.0.0.0", "::")  # can be listened at, but not opened in a browser
_POLICY_VIOLATION = 1008  # RFC 6455, 7.4.1
_WEB = Path(__file__).parent / "web"
_FILES = {
    "/": ("page.html", b"text/html; charset=utf-8"),
    "/input.js": ("input.js", b"text/javascript; charset=utf-8"),
    "/client.js": ("client.js", b"text/javascript; charset=utf-8"),
}
"""The page and its scripts, by path: the file, and its type. The others are rendercanvas's own."""


@dataclass(frozen=True)
class Address:
    """Where to serve: a host name or IP address, and a port; port 0 chooses a free one."""

    host: str = "127.0.0.1"
    port: int = 0

    @classmethod
    def parse(cls, text: str) -> Address:
        """Parses "HOST:PORT", ":PORT" or "PORT". Raises UserError for anything else."""
        host, _, port = text.strip().rpartition(":")
        if not port.isdecimal() or not 0 <= int(port) < 65536:
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
        """The risk of serving to other machines, in words; empty if only this machine can reach the address."""
        if self.is_loopback:
            return ""
        return (
            f"warning: {self.host} can be reached from other machines, and the connection is not encrypted. Whoever "
            "listens on the network can read the token and all that is shown, and can then open and write files as "
            f"you. Safer: --serve 127.0.0.1:{self.port}, and from there ssh -L {self.port}:127.0.0.1:{self.port} HOST"
        )

    def url(self, port: int, token: str) -> str:
        """The URL to open in a browser, for the port that was chosen."""
        host = socket.gethostname() if self.host in _ANY_ADDRESS else self.host
        return f"http://{f'[{host}]' if ':' in host else host}:{port}/?token={token}"


class TokenGuard:
    """Passes requests to an application only with the right token: first in the URL, later in a cookie."""

    def __init__(self, application: Application, token: str, cookie: str = "holoview") -> None:
        self._application, self._token, self._cookie = application, token, cookie

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """An ASGI application, https://asgi.readthedocs.io."""
        if scope["type"] == "lifespan":
            await self._application(scope, receive, send)
        elif scope["type"] == "websocket":
            await self._on_websocket(scope, receive, send)
        elif scope["type"] == "http":
            await self._on_request(scope, receive, send)

    async def _on_request(self, scope: Scope, receive: Receive, send: Send) -> None:
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
        if given and self._is_right(given):
            cookie = f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict"
            await _respond(send, 303, b"", [(b"location", b"/"), (b"set-cookie", cookie.encode())])
        elif not self._is_right(self._cookie_of(scope)):
            await _respond(send, 403, b"This address needs the token that `holoview view --serve` printed.\n")
        elif scope["path"] in _FILES:
            name, kind = _FILES[scope["path"]]
            await _respond(send, 200, (_WEB / name).read_bytes(), [(b"content-type", kind)])
        else:
            await self._application(scope, receive, send)

    async def _on_websocket(self, scope: Scope, receive: Receive, send: Send) -> None:
        if self._is_right(self._cookie_of(scope)) and _is_same_origin(scope):
            await self._application(scope, receive, send)
        else:
            await receive()  # websocket.connect
            await send({"type": "websocket.close", "code": _POLICY_VIOLATION})

    def _is_right(self, token: str) -> bool:
        return secrets.compare_digest(token.encode(), self._token.encode())

    def _cookie_of(self, scope: Scope) -> str:
        try:
            found = SimpleCookie(_header(scope, b"cookie")).get(self._cookie)
        except CookieError:
            return ""
        return "" if found is None else found.value


def serve(
    address: Address,
    began: Callable[[str], None],
    is_over: Callable[[], bool] = lambda: False,
    token: str | None = None,
) -> None:
    """Serves the canvas of `rendercanvas.http` until it is interrupted or `is_over` returns true.

    began: called with the URL, and before that with a warning if other machines can reach the address. token: a random
    one when None. Raises UserError if a library isn't installed or the address is in use.
    """
    require_serving_libraries()
    uvicorn = import_optional("uvicorn", "--serve")
    from rendercanvas.http import asgi

    token = secrets.token_urlsafe(18) if token is None else token
    with _listening(address) as listener:
        port = listener.getsockname()[1]
        guard = TokenGuard(asgi, token, f"holoview-{port}")  # cookies know hosts, not ports
        config = uvicorn.Config(guard, log_level="warning", lifespan="on", timeout_notify=1)
        server = uvicorn.Server(config)

        async def check_is_over() -> None:
            """Called once a second: rendercanvas handles the keyboard interrupt itself and closes its canvas."""
            server.should_exit = server.should_exit or is_over()

        config.callback_notify = check_is_over
        if address.warning:
            began(address.warning)
        began(address.url(port, token))
        with suppress(KeyboardInterrupt):
            server.run(sockets=[listener])


def require_serving_libraries() -> None:
    """Raises UserError if a library of the extra "serve" isn't installed."""
    for library in ("uvicorn", "websockets"):  # uvicorn takes websockets by itself, and silently does without
        import_optional(library, "--serve")


def _listening(address: Address) -> socket.socket:
    family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
    try:
        return socket.create_server((address.host, address.port), family=family)
    except OSError as error:
        remedy = "choose another port; 0 takes a free one"
        raise UserError("--serve", f"{address.host}:{address.port}: {error.strerror}", remedy=remedy) from error


def _is_same_origin(scope: Scope) -> bool:
    """Whether a connection comes from the page itself, or from a program that sends no origin."""
    origin = _header(scope, b"origin")
    return not origin or urlsplit(origin).netloc == _header(scope, b"host")


def _header(scope: Scope, name: bytes) -> str:
    return next((value.decode("latin-1") for key, value in scope["headers"] if key == name), "")


async def _respond(send: Send, status: int, body: bytes, headers: list[tuple[bytes, bytes]] | None = None) -> None:
    common = [(b"content-length", str(len(body)).encode()), (b"cache-control", b"no-store")]
    kind = [] if headers else [(b"content-type", b"text/plain; charset=utf-8")]
    await send({"type": "http.response.start", "status": status, "headers": [*(headers or kind), *common]})
    await send({"type": "http.response.body", "body": body})
