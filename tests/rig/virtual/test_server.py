"""The process of a virtual bench: who may ask it, what it answers, and when it ends."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from holoview.rig import RigDescription, open_rig, read_rig
from holoview.rig.devices import DeviceError, Devices
from holoview.rig.virtual.client import VirtualBenchProcess, ask, connect
from holoview.rig.virtual.wire import Connection, Disconnected
from tests.child_process import child_process
from tests.rig.conftest import CAMERA_SHAPE, LASERS_M, write_rig


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> RigDescription:
    return read_rig(write_rig(tmp_path_factory.mktemp("rig") / "rig.toml"))


@pytest.fixture(scope="module")
def bench(rig: RigDescription) -> Iterator[VirtualBenchProcess]:
    process = VirtualBenchProcess(rig.path)
    yield process
    process.close()


@pytest.mark.parametrize(
    "first",
    [
        b'{"token": "wrong"}\n',
        b'{"do": "take"}\n',
        b'{"token": 3}\n',
        b'{"token": "\\u00e9"}\n',
        b"GET / HTTP/1.1\r\n\r\n",
    ],
)
def test_nobody_is_answered_without_the_token(bench: VirtualBenchProcess, first: bytes) -> None:
    with socket.create_connection(bench.address, timeout=10) as other:
        other.sendall(first + b'{"do": "time"}\n')
        received = b""
        try:
            while data := other.recv(100):
                received += data
        except ConnectionError:
            pass
    assert received == b""
    assert bench.ask({"do": "time"}).table["time"] >= 0  # the others go on


def test_several_may_ask_with_the_token(bench: VirtualBenchProcess) -> None:
    other = connect(bench.address, bench.token)
    ask(other, {"do": "wait", "seconds": 2.0})
    assert bench.ask({"do": "time"}).table["time"] >= 2.0
    other.close()


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"do": "explode"}, "unknown message"),
        ({}, "unknown message"),
        ({"do": "show", "slm": 0}, "not understood: no levels"),
        ({"do": "expose"}, "not understood"),
        ({"do": "expose", "exposure": "long"}, "not understood"),
        ({"do": "move", "distance": None}, "not understood"),
        ({"do": "laser", "wavelength": 5e-7}, "not understood"),
        ({"do": "laser", "wavelength": 5e-7, "power": 1.0}, "no laser of 500 nm"),
        ({"do": "wait", "seconds": float("nan")}, "finite"),
        ({"do": "expose", "exposure": float("inf")}, "finite"),
        ({"do": "move", "distance": 1.0}, "out of reach"),
    ],
)
def test_what_cant_be_done_is_an_error_of_the_device(
    bench: VirtualBenchProcess, table: dict[str, object], words: str
) -> None:
    with pytest.raises(DeviceError, match=words):
        bench.ask(table)


@pytest.mark.parametrize(
    ("slm", "array", "words"),
    [
        (2, np.zeros((16, 24), np.uint8), "no modulator 2"),
        (-1, np.zeros((16, 24), np.uint8), "no modulator -1"),
        (0, np.zeros((16, 23), np.uint8), r"\(16, 23\)"),
        (0, np.full((16, 24), 256, np.uint16), "level 256"),
    ],
)
def test_patterns_that_dont_fit_are_refused(
    bench: VirtualBenchProcess, slm: int, array: np.ndarray[tuple[int, int], np.dtype[np.unsignedinteger]], words: str
) -> None:
    with pytest.raises(DeviceError, match=words):
        bench.ask({"do": "show", "slm": slm}, array)


def test_garbage_from_one_with_the_token_ends_its_connection_only(bench: VirtualBenchProcess) -> None:
    with socket.create_connection(bench.address, timeout=10) as plain:
        other = Connection(plain)
        ask(other, {"token": bench.token})
        plain.sendall(b"\xff" * 100 + b"\n")
        with pytest.raises(Disconnected):
            other.receive()
        other.close()
    assert bench.ask({"do": "time"}).table["time"] >= 0


def test_devices_of_a_virtual_rig_take_a_picture_and_close_with_lasers_off(rig: RigDescription) -> None:
    with open_rig(rig) as devices:
        assert isinstance(devices, Devices) and len(devices.modulators) == 2
        for modulator in devices.modulators:
            modulator.show(np.zeros(rig.slm_shape, np.uint8))
        assert devices.stage.move_to(4e-3) == 4e-3
        before = devices.clock.now()
        devices.clock.wait(0.5)
        assert devices.clock.now() == pytest.approx(before + 0.5)
        assert devices.camera.set_exposure(0.01) == 0.01
        devices.lasers.switch_on(LASERS_M[0], 1.0)
        lit = devices.camera.take()
        devices.lasers.switch_off()
        dark = devices.camera.take()
        assert lit.shape == dark.shape == CAMERA_SHAPE and lit.dtype == np.uint16
        assert lit.mean() > 2 * dark.mean()
    with pytest.raises(DeviceError, match="is gone"):
        devices.camera.take()


def test_the_process_ends_with_the_one_that_started_it(rig: RigDescription) -> None:
    """When a process is killed, the system closes its end of the pipe."""
    command = [sys.executable, "-m", "holoview.rig.virtual.server", str(rig.path)]
    with child_process(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write("token\n")
        process.stdin.flush()
        port = int(process.stdout.readline().removeprefix("port "))
        connection = connect(("127.0.0.1", port), "token")
        process.stdin.close()
        assert process.wait(10) == 0
        with pytest.raises(DeviceError, match=r"virtual bench: is gone.*run the command again"):
            ask(connection, {"do": "time"})
        connection.close()


def test_wrong_settings_are_told_when_it_starts(tmp_path: Path) -> None:
    rig = read_rig(write_rig(tmp_path / "rig.toml", {"virtual": {"seede": 3}}))
    with pytest.raises(DeviceError, match=r"virtual\.seede: unknown key"):
        open_rig(rig)
