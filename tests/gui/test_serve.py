"""The viewer is served to whoever knows the token and to nobody else."""

from __future__ import annotations

import asyncio
import socket
from typing import Any

import pytest

from holoview.util.errors import UserError
from holoview.viewer.app.serve import Address, TokenGuard, serve

TOKEN = "right"


async def _inner(scope: Any, receive: Any, send: Any) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
    else:
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b"inner"})


def _sent(kind: str, path: str = "/", query: str = "", **headers: str) -> list[dict[str, Any]]:
    """What the guard answers to a request."""
    sent: list[dict[str, Any]] = []

    async def receive() -> dict[str, Any]:
        return {"type": f"{kind}.connect"}

    async def send(message: dict[str, Any]) -> None:
        sent.append(message)

    scope = {
        "type": kind,
        "path": path,
        "query_string": query.encode(),
        "headers": [(name.encode(), value.encode()) for name, value in headers.items()],
    }
    asyncio.run(TokenGuard(_inner, TOKEN)(scope, receive, send))
    return sent


def test_the_token_becomes_a_cookie_that_scripts_and_other_sites_cannot_use() -> None:
    start, _ = _sent("http", query=f"token={TOKEN}")
    headers = dict(start["headers"])
    assert start["status"] == 303 and headers[b"location"] == b"/"
    assert headers[b"set-cookie"] == b"holoview=right; Path=/; HttpOnly; SameSite=Strict"


def test_with_the_cookie_the_page_and_its_parts_are_served() -> None:
    start, body = _sent("http", cookie="a=b; holoview=right")
    assert start["status"] == 200 and b"<title>holoview</title>" in body["body"]
    assert _sent("http", "/renderview.js", cookie="holoview=right")[1]["body"] == b"inner"


@pytest.mark.parametrize("headers", [{}, {"cookie": "holoview=wrong"}, {"cookie": "holoview=é; ="}])
@pytest.mark.parametrize("query", ["", "token=wrong", "token="])
def test_without_the_token_nothing_is_served(headers: dict[str, str], query: str) -> None:
    for path in ("/", "/renderview.js"):
        assert _sent("http", path, query, **headers)[0]["status"] == 403
    assert _sent("websocket", "/", query, **headers) == [{"type": "websocket.close", "code": 1008}]


def test_a_page_of_another_site_is_refused_though_the_browser_has_the_cookie() -> None:
    mine = {"cookie": "holoview=right", "host": "127.0.0.1:8080"}
    assert _sent("websocket", origin="http://127.0.0.1:8080", **mine) == [{"type": "websocket.accept"}]
    assert _sent("websocket", **mine) == [{"type": "websocket.accept"}], "programs say no origin"
    assert _sent("websocket", origin="http://evil.example", **mine)[0]["type"] == "websocket.close"


@pytest.mark.parametrize(
    ("text", "address", "is_loopback"),
    [
        ("127.0.0.1:80", Address("127.0.0.1", 80), True),
        (":8080", Address("127.0.0.1", 8080), True),
        ("8080", Address("127.0.0.1", 8080), True),
        ("localhost:1", Address("localhost", 1), True),
        ("[::1]:5", Address("::1", 5), True),
        ("0.0.0.0:5", Address("0.0.0.0", 5), False),
    ],
)
def test_addresses_are_this_machine_unless_told(text: str, address: Address, is_loopback: bool) -> None:
    assert Address.parse(text) == address and address.is_loopback == is_loopback


def test_whoever_serves_openly_is_told_that_the_token_can_be_read() -> None:
    said: list[str] = []
    serve(Address("0.0.0.0", 0), began=said.append, is_over=lambda: True)
    assert "not encrypted" in said[0] and "ssh -L" in said[0]
    assert said[1].startswith(f"http://{socket.gethostname()}:") and "?token=" in said[1]
    assert Address.parse("127.0.0.1:80").warning == ""


@pytest.mark.parametrize("text", ["", "host", "host:", "host:99999", "host:-1"])
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(UserError, match="HOST:PORT"):
        Address.parse(text)


def test_a_port_that_is_taken_is_a_users_mistake() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(UserError, match="choose another port"):
            serve(Address("127.0.0.1", port), began=lambda url: None)
