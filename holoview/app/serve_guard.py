"""Lets requests pass to the served viewer that name it rightly, have the token and come from its own page.

    HostGuard ─▶ TokenGuard ─▶ the page and its scripts, or the application

Applications are those of ASGI, https://asgi.readthedocs.io.
"""

from __future__ import annotations

import ipaddress
import re
import secrets
import socket
import ssl
from collections.abc import Awaitable, Callable, Collection, MutableMapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from holoview.util.errors import UserError

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


# --- Where and to whom the viewer is served: address, names it answers to, clients, what they may do, and TLS ---


CLIENTS = 8
"""Clients at a time unless told."""
_MOST_CLIENTS = 1000
_LONGEST_IDLE_MIN = 7 * 24 * 60.0
ANY_ADDRESS = ("0.0.0.0", "::")
"""Addresses that can be listened at, but not opened in a browser."""
_LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
_HOST_NAME = re.compile(r"[a-z0-9]([a-z0-9-]*[a-z0-9])?(\.[a-z0-9]([a-z0-9-]*[a-z0-9])?)*")


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


@dataclass(frozen=True)
class ServeOptions:
    """To whom the viewer is served.

    clients: the most connections of pages at a time. idle_min: minutes without input after which one is closed, 0 for
    never. is_read_only: whether pages can't open, save or export files nor end the viewer. host_names: names beside
    those of the address by which browsers reach it, as behind a reverse proxy. certificate, key: PEM files for TLS, or
    none; the key may stand in the file of the certificate.

    Raises UserError for values out of range and for files that don't make a certificate with its key.
    """

    clients: int = CLIENTS
    idle_min: float = 60.0
    is_read_only: bool = False
    host_names: tuple[str, ...] = ()
    certificate: Path | None = None
    key: Path | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.clients <= _MOST_CLIENTS:
            raise UserError("--clients", f"{self.clients}", expected=f"from 1 to {_MOST_CLIENTS}")
        if not 0 <= self.idle_min <= _LONGEST_IDLE_MIN:
            raise UserError("--idle", f"{self.idle_min:g}", expected=f"minutes from 0 (never) to {_LONGEST_IDLE_MIN:g}")
        for name in self.host_names:
            if not _HOST_NAME.fullmatch(name.lower()):
                raise UserError(
                    "--host-name", f'"{name}"', expected="a name without scheme and port: viewer.example.org"
                )
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
