"""Lets requests pass to the served viewer that name it rightly, have the token and come from its own page.

    HostGuard ─▶ TokenGuard ─▶ the page and its scripts, or the application

Applications are those of ASGI, https://asgi.readthedocs.io.
"""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, Collection, MutableMapping
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

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
        try:
            found = SimpleCookie(_header(scope, b"cookie")).get(self._cookie)
        except CookieError:
            return ""
        return "" if found is None else found.value


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
