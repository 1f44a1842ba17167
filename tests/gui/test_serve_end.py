"""The server of the viewer ends soon, whatever its clients do."""

from __future__ import annotations

import socket
from contextlib import ExitStack, suppress

from tests.gui.test_serve_sockets import connected, running, upgrade


def test_a_page_that_reads_nothing_doesnt_hold_the_end_of_the_server() -> None:
    """Of a machine that sleeps, for instance: what it was sent lies in the server for ever."""
    with ExitStack() as clients, running() as server:  # `running` checks that the server has ended
        silent = clients.enter_context(connected(server))
        silent.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        silent.sendall(upgrade())
        assert b"101" in silent.recv(4096)
        silent.settimeout(1.0)
        with suppress(TimeoutError):  # until the echoes fill all buffers, and the server takes no more
            while True:
                silent.sendall(_message(b"x" * 60_000))


def _message(data: bytes) -> bytes:
    """A WebSocket's frame of text of a page, with a mask of zeros."""
    return b"\x81\xfe" + len(data).to_bytes(2, "big") + bytes(4) + data
