"""Messages over a socket: what is sent arrives; whatever isn't a message ends the connection without harm."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator

import numpy as np
import pytest

from holoview.rig.virtual.wire import Connection, Disconnected, Message


@pytest.fixture
def ends() -> Iterator[tuple[socket.socket, Connection]]:
    """A bare socket, and the connection at its other end."""
    one, other = socket.socketpair()
    one.settimeout(10)
    other.settimeout(10)
    connection = Connection(other)
    yield one, connection
    connection.close()
    one.close()


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(3, 4), (0, 5), (2, 1, 3), ()])
def test_a_message_arrives_as_it_was_sent(
    ends: tuple[socket.socket, Connection], kind: type[np.unsignedinteger], shape: tuple[int, ...]
) -> None:
    sender = Connection(ends[0])
    array = np.random.default_rng(0).integers(0, 256, shape).astype(kind)
    sender.send(Message({"do": "show", "slm": 1, "name": "µ"}, array))
    received = ends[1].receive()
    assert received.table["slm"] == 1 and received.table["name"] == "µ"
    assert received.array is not None and received.array.dtype == kind and np.array_equal(received.array, array)


def test_an_array_is_sent_in_little_endian_wherever_it_comes_from(ends: tuple[socket.socket, Connection]) -> None:
    Connection(ends[0]).send(Message({}, np.array([[1, 258]], dtype=">u2")[:, ::-1]))
    received = ends[1].receive().array
    assert received is not None and received.tolist() == [[258, 1]] and received.dtype == np.uint16


def test_arrays_of_other_kinds_arent_sent(ends: tuple[socket.socket, Connection]) -> None:
    with pytest.raises(ValueError, match="float64"):
        ends[1].send(Message({}, np.zeros(2)))


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"{}",
        b"\n",
        b"[1]\n",
        b"\xff\xfe\x00\n",
        b"{" * 60_000 + b"\n",
        b"a" * 70_000 + b"\n",
        b'{"a": 1e999999}\n{"shape"\n',
        b'{"shape": [2]}\n\0\0',
        b'{"shape": [2], "type": "uint8"}\n\0',
        b'{"shape": [2], "type": "object"}\n' + b"\0" * 16,
        b'{"shape": [2], "type": "float64"}\n' + b"\0" * 16,
        b'{"shape": [2], "type": ["uint8"]}\n\0\0',
        b'{"shape": [-2, -1], "type": "uint8"}\n\0\0',
        b'{"shape": "x", "type": "uint8"}\n',
        b'{"shape": 3, "type": "uint8"}\n',
        b'{"shape": null, "type": "uint8"}\n',
        b'{"shape": [1e400], "type": "uint8"}\n',
        json.dumps({"shape": [1 << 15, 1 << 15], "type": "uint8"}).encode() + b"\n",
        json.dumps({"shape": [1 << 62, 1 << 62], "type": "uint16"}).encode() + b"\n",
        json.dumps({"shape": [0, 1 << 70], "type": "uint16"}).encode() + b"\n",
        json.dumps({"shape": [1] * 100, "type": "uint8"}).encode() + b"\n\0",
    ],
)
def test_what_isnt_a_message_ends_the_connection(ends: tuple[socket.socket, Connection], data: bytes) -> None:
    ends[0].sendall(data)
    ends[0].shutdown(socket.SHUT_WR)
    with pytest.raises(Disconnected):
        while True:
            ends[1].receive()


def test_silence_ends_the_connection(ends: tuple[socket.socket, Connection]) -> None:
    one, other = socket.socketpair()
    other.settimeout(0.01)
    connection = Connection(other)
    with pytest.raises(Disconnected, match="timed out"):
        connection.receive()
    connection.close()
    connection.close()
    one.close()


def test_nothing_can_be_sent_to_who_is_gone(ends: tuple[socket.socket, Connection]) -> None:
    ends[0].close()
    with pytest.raises(Disconnected):
        for _ in range(3):
            ends[1].send(Message({}, np.zeros((64, 64), np.uint8)))
