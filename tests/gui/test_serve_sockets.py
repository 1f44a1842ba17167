"""The guards of the served viewer over real sockets: names, origins, slow and idle connections, places, TLS."""

from __future__ import annotations

import shutil
import socket
import ssl
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from holoview.util.errors import UserError
from holoview.viewer.app.serve import NOT_USED, TRY_AGAIN_LATER, Address, ServeOptions, guarded, make_server
from tests.patience import PATIENCE_S, wait_until

_COOKIE = {"Cookie": "holoview=right"}


async def _echo(scope: Any, receive: Any, send: Any) -> None:
    """An application that answers every request, and sends back what it receives."""
    if scope["type"] == "lifespan":
        while (message := await receive())["type"] != "lifespan.shutdown":
            await send({"type": f"{message['type']}.complete"})
        await send({"type": "lifespan.shutdown.complete"})
    elif scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.accept"})
        while (message := await receive())["type"] == "websocket.receive":
            await send({"type": "websocket.send", "text": message["text"]})
    else:
        await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"5")]})
        await send({"type": "http.response.body", "body": b"inner"})


@dataclass(frozen=True)
class Running:
    """A server that runs. port: on this machine."""

    port: int

    def answer(self, head: str, wait_s: float = PATIENCE_S) -> str:
        """What comes back for the lines of a request until the connection is closed or silent."""
        with socket.create_connection(("127.0.0.1", self.port), timeout=wait_s) as connection:
            connection.sendall(head.replace("\n", "\r\n").encode())
            return connection.recv(4096).decode("latin-1")

    def websocket(self, **options: Any) -> ClientConnection:
        """A connection as a page with the token makes it."""
        headers = _COOKIE | options.pop("headers", {})
        return connect(f"ws://127.0.0.1:{self.port}/", additional_headers=headers, open_timeout=PATIENCE_S, **options)


@contextmanager
def running(options: ServeOptions | None = None, **times: float) -> Iterator[Running]:
    """A guarded server on a thread of its own, on a free port of this machine."""
    options = options or ServeOptions()
    application = guarded(_echo, "right", "holoview", Address(), options)
    server = make_server(application, options.clients, options.certificate, options.key, **times)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, name="server")
        thread.start()
        try:
            wait_until(lambda: server.started)
            yield Running(listener.getsockname()[1])
        finally:
            server.should_exit = True
            thread.join(PATIENCE_S)
    assert not thread.is_alive()


def _get(path: str = "/", host: str = "127.0.0.1", more: str = "cookie: holoview=right\n") -> str:
    return f"GET {path} HTTP/1.1\nhost: {host}\n{more}connection: close\n\n"


def _status(answer: str) -> int:
    return int(answer.split(" ", 2)[1])


# --- names and origins ----------------------------------------------------------------------------------------------


def test_a_name_that_was_made_to_point_here_is_refused() -> None:
    """DNS rebinding: the browser believes that the viewer belongs to the other site, and says its name."""
    with running() as server:
        for host in ("evil.example", f"evil.example:{server.port}", "127.0.0.1.evil.example", "", "[::1", "192.0.2.1"):
            answer = server.answer(_get(host=host))
            assert _status(answer) in (400, 421) and "<title>" not in answer, host
        with pytest.raises(InvalidStatus, match="403"):
            connect(
                "ws://evil.example/",
                sock=socket.create_connection(("127.0.0.1", server.port)),
                additional_headers=_COOKIE,
            )
        for host in ("127.0.0.1", f"localhost:{server.port}", "LOCALHOST", "[::1]:80", "localhost."):
            assert _status(server.answer(_get(host=host))) == 200, host
        assert _status(server.answer("GET / HTTP/1.0\n\n")) == 421, "without any name"


def test_a_page_of_another_origin_is_refused() -> None:
    with running() as server:
        origin = f"http://127.0.0.1:{server.port}"
        for wrong in ("http://evil.example", "null", "http://127.0.0.1:1", f"{origin}.evil.example", "http://[::1"):
            with pytest.raises(InvalidStatus, match="403"):
                server.websocket(origin=wrong).close()
        for right in (origin, None):
            with server.websocket(origin=right) as page:
                page.send("hello")
                assert page.recv(PATIENCE_S) == "hello"


def test_names_of_a_reverse_proxy_are_allowed_when_told() -> None:
    with running(ServeOptions(host_names=("viewer.example.org",))) as server:
        assert _status(server.answer(_get(host="Viewer.example.org"))) == 200
        assert _status(server.answer(_get(host="other.example.org"))) == 421
        with server.websocket(origin="https://viewer.example.org") as page:  # the proxy passes its own name for Host
            page.send("hello")
            assert page.recv(PATIENCE_S) == "hello"
        with pytest.raises(InvalidStatus, match="403"):
            server.websocket(origin="https://viewer.example.org.evil.example").close()


def test_every_answer_forbids_other_sites_to_show_or_load_it() -> None:
    with running() as server:
        for path in ("/", "/inner"):
            answer = server.answer(_get(path)).lower()
            assert "frame-ancestors 'none'" in answer and "nosniff" in answer and "no-referrer" in answer
            assert "server:" not in answer
        assert _status(server.answer(_get().replace("GET", "POST"))) == 405


def test_the_cookie_is_for_encrypted_connections_where_a_proxy_encrypts() -> None:
    with running() as server:
        plain = server.answer(_get("/?token=right", more=""))
        assert "SameSite=Strict\r\n" in plain
        assert "SameSite=Strict; Secure\r\n" in server.answer(_get("/?token=right", more="x-forwarded-proto: https\n"))


# --- slow and idle connections --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "sent", ["", "GET / HTTP/1.1\r\nhost: 127.0", "POST / HTTP/1.1\r\nhost: x\r\ncontent-length: 9\r\n\r\n"]
)
def test_a_connection_that_sends_no_whole_request_is_closed(sent: str) -> None:
    with running(request_s=0.3) as server, connected(server) as slow:
        slow.sendall(sent.encode())
        assert _reads_to_its_end(slow)


def test_a_request_that_comes_byte_by_byte_is_closed_too() -> None:
    with (
        running(request_s=0.5) as server,
        connected(server) as slow,
        pytest.raises(OSError, match=r"reset|pipe|abort"),
    ):
        slow.sendall(b"GET / HTTP/1.1\r\nx: ")
        for _ in range(2000):  # many times longer than it may take
            slow.sendall(b"y")
            time.sleep(0.02)


def test_after_an_answer_the_next_request_has_its_own_time() -> None:
    with running(request_s=0.5) as server, connected(server) as slow:
        slow.sendall(_get().replace("connection: close\n", "").replace("\n", "\r\n").encode())
        assert b"200" in slow.recv(1 << 16)
        slow.sendall(b"GET / HT")
        assert _reads_to_its_end(slow)


def test_a_page_that_answers_no_ping_is_dropped_and_its_place_is_free() -> None:
    with running(ServeOptions(clients=1), ping_s=0.3) as server:
        with socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE_S) as silent:
            silent.sendall(upgrade())
            assert b"101" in silent.recv(4096)
            assert _reads_to_its_end(silent)
        with server.websocket() as page:
            page.send("hello")
            assert page.recv(PATIENCE_S) == "hello"


@pytest.mark.long
def test_a_page_that_nobody_uses_is_closed_and_one_in_use_is_not() -> None:
    with running(ServeOptions(idle_min=3 / 60)) as server, server.websocket() as used, server.websocket() as idle:
        idle.send('{"type": "_framefeedback"}')  # pages send these by themselves
        with pytest.raises(ConnectionClosed) as closed:
            while True:
                used.send('{"type": "pointer_move"}')
                used.recv(PATIENCE_S)
                with suppress(TimeoutError):
                    idle.recv(0.05)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == NOT_USED and "not used for" in closed.value.rcvd.reason
        used.send("hello")
        assert used.recv(PATIENCE_S) == "hello"


def test_messages_that_are_too_long_end_a_connection() -> None:
    with running() as server, server.websocket() as page:
        page.send("x" * (1 << 18))
        assert len(page.recv(PATIENCE_S)) == 1 << 18
        with pytest.raises(ConnectionClosed):
            page.send("x" * ((1 << 18) + 1))
            page.recv(PATIENCE_S)


# --- places ---------------------------------------------------------------------------------------------------------


def test_one_client_too_many_is_told_and_gets_the_place_that_becomes_free() -> None:
    with running(ServeOptions(clients=2)) as server:
        with server.websocket() as first, server.websocket():
            with server.websocket() as third, pytest.raises(ConnectionClosed) as refused:
                third.recv(PATIENCE_S)
            assert refused.value.rcvd is not None
            assert refused.value.rcvd.code == TRY_AGAIN_LATER
            assert refused.value.rcvd.reason == "2 pages are connected already"
            first.send("hello")
            assert first.recv(PATIENCE_S) == "hello", "those that are there stay"
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until:
            with server.websocket() as again:
                again.send("hello")
                try:
                    assert again.recv(PATIENCE_S) == "hello"
                    return
                except ConnectionClosed:
                    time.sleep(0.05)
        raise AssertionError("the place didn't become free")


# --- TLS ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A certificate of 127.0.0.1 that is signed by itself, and its key."""
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("needs openssl")
    folder = tmp_path_factory.mktemp("tls")
    names = ("-subj", "/CN=localhost", "-addext", "subjectAltName=IP:127.0.0.1,DNS:localhost")
    new = ("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-days", "2", "-nodes")
    out = ("-keyout", str(folder / "key.pem"), "-out", str(folder / "certificate.pem"))
    subprocess.run([openssl, *new, *names, *out], check=True, capture_output=True, timeout=PATIENCE_S)
    return folder / "certificate.pem", folder / "key.pem"


def test_with_a_certificate_connections_are_encrypted(certificate: tuple[Path, Path]) -> None:
    options = ServeOptions(certificate=certificate[0], key=certificate[1])
    assert options.scheme == "https" and Address().url(8443, "t", options.scheme) == "https://127.0.0.1:8443/?token=t"
    trust = ssl.create_default_context(cafile=certificate[0])
    with running(options) as server:

        def encrypted_answer(head: str) -> str:
            plain = socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE_S)
            with trust.wrap_socket(plain, server_hostname="127.0.0.1") as connection:
                assert connection.version() in ("TLSv1.2", "TLSv1.3")
                connection.sendall(head.replace("\n", "\r\n").encode())
                return connection.recv(4096).decode()

        answer = encrypted_answer(_get("/?token=right", more=""))
        assert _status(answer) == 303 and "SameSite=Strict; Secure" in answer
        secure = {"ssl": trust, "additional_headers": _COOKIE, "open_timeout": PATIENCE_S}
        own = f"https://127.0.0.1:{server.port}"
        with connect(f"wss://127.0.0.1:{server.port}/", origin=own, **secure) as page:  # type: ignore[arg-type]
            page.send("hello")
            assert page.recv(PATIENCE_S) == "hello"
        # By hand: websockets' client loses an answer behind which the server closes about once in a hundred times, when
        # its two threads meet (EOFError in its recv_events).
        upgrade = "upgrade: websocket\nsec-websocket-key: AAAAAAAAAAAAAAAAAAAAAA==\nsec-websocket-version: 13\n"
        origin = f"origin: {own.replace('https', 'http')}\ncookie: holoview=right\n"
        request = _get(host=f"127.0.0.1:{server.port}", more=upgrade + origin).replace(
            "connection: close", "connection: Upgrade"
        )
        assert _status(encrypted_answer(request)) == 403
        assert _status(encrypted_answer(request.replace("origin: http:", "origin: https:"))) == 101
        with socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE_S) as plain:
            plain.sendall(_get().replace("\n", "\r\n").encode())
            assert b"<title>" not in plain.recv(4096)


def test_files_that_make_no_certificate_are_a_users_mistake(certificate: tuple[Path, Path], tmp_path: Path) -> None:
    own, key = certificate
    locked = tmp_path / "locked.pem"
    subprocess.run(
        ["openssl", "ec", "-aes128", "-passout", "pass:secret", "-in", str(key), "-out", str(locked)],
        check=True,
        capture_output=True,
        timeout=PATIENCE_S,
    )
    with pytest.raises(UserError, match="--key: without --certificate"):
        ServeOptions(key=key)
    with pytest.raises(UserError, match="isn't a file"):
        ServeOptions(certificate=tmp_path / "none.pem", key=key)
    for pair in ((own, None), (key, own), (own, locked)):
        with pytest.raises(UserError, match="expected a certificate and its own key"):
            ServeOptions(certificate=pair[0], key=pair[1])


# --- helpers --------------------------------------------------------------------------------------------------------


def upgrade() -> bytes:
    lines = (
        "GET / HTTP/1.1",
        "host: 127.0.0.1",
        "cookie: holoview=right",
        "connection: upgrade",
        "upgrade: websocket",
        "sec-websocket-version: 13",
        "sec-websocket-key: AAAAAAAAAAAAAAAAAAAAAA==",
    )
    return "".join(f"{line}\r\n" for line in (*lines, "")).encode()


def connected(server: Running) -> socket.socket:
    return socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE_S)


def _reads_to_its_end(connection: socket.socket) -> bool:
    """Whether a connection is closed by the other side, in good order or not."""
    try:
        while connection.recv(4096):
            pass
    except ConnectionError:
        return True
    return True
