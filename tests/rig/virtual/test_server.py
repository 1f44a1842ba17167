"""The process of a virtual bench: who may ask it, what it answers, and when it ends."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from holoview.bench.rig import RigDescription, open_rig, read_rig
from holoview.bench.rig.devices import DeviceError, DeviceGone, Devices
from holoview.bench.rig.virtual.client import Connection, Disconnected, Packet, VirtualBenchProcess, ask, connect
from holoview.bench.rig.virtual.server import Drift, FaultInjector, FaultSettings, read_virtual_settings
from holoview.util.errors import UserError
from tests.child_process import child_process
from tests.patience import PATIENCE_S
from tests.rig.conftest import CAMERA_SHAPE, LASERS_M, DirectBench, MakeRig, write_rig


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
    with socket.create_connection(bench.address, timeout=PATIENCE_S) as other:
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
    with socket.create_connection(bench.address, timeout=PATIENCE_S) as plain:
        other = Connection(plain)
        ask(other, {"token": bench.token})
        plain.sendall(b"\xff" * 100 + b"\n")
        with pytest.raises(Disconnected):
            other.receive()
        other.close()
    assert bench.ask({"do": "time"}).table["time"] >= 0


def test_an_answer_that_ctrl_c_left_behind_isnt_taken_for_the_next(
    bench: VirtualBenchProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lasers would pass as switched off when it is their switching on that was confirmed."""

    def interrupted(_: Connection) -> Packet:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Connection, "receive", interrupted)
        with pytest.raises(KeyboardInterrupt):
            bench.ask({"do": "laser", "wavelength": LASERS_M[0], "power": 1.0})
    assert "time" in bench.ask({"do": "time"}).table


@pytest.mark.long
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


@pytest.mark.long
def test_the_process_ends_with_the_one_that_started_it(rig: RigDescription) -> None:
    """When a process is killed, the system closes its end of the pipe."""
    command = [sys.executable, "-m", "holoview.bench.rig.virtual.server", str(rig.path)]
    with child_process(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write("token\n")
        process.stdin.flush()
        port = int(process.stdout.readline().removeprefix("port "))
        connection = connect(("127.0.0.1", port), "token")
        process.stdin.close()
        assert process.wait(PATIENCE_S) == 0
        with pytest.raises(DeviceError, match=r"virtual bench: is gone.*run the command again"):
            ask(connection, {"do": "time"})
        connection.close()


@pytest.mark.long
def test_wrong_settings_are_told_when_it_starts(tmp_path: Path) -> None:
    rig = read_rig(write_rig(tmp_path / "rig.toml", {"virtual": {"seede": 3}}))
    with pytest.raises(DeviceError, match=r"virtual\.seede: unknown key"):
        open_rig(rig)


@pytest.fixture
def ends() -> Iterator[tuple[socket.socket, Connection]]:
    """A bare socket, and the connection at its other end."""
    one, other = socket.socketpair()
    one.settimeout(PATIENCE_S)
    other.settimeout(PATIENCE_S)
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
    sender.send(Packet({"do": "show", "slm": 1, "name": "µ"}, array))
    received = ends[1].receive()
    assert received.table["slm"] == 1 and received.table["name"] == "µ"
    assert received.array is not None and received.array.dtype == kind and np.array_equal(received.array, array)


def test_an_array_is_sent_in_little_endian_wherever_it_comes_from(ends: tuple[socket.socket, Connection]) -> None:
    Connection(ends[0]).send(Packet({}, np.array([[1, 258]], dtype=">u2")[:, ::-1]))
    received = ends[1].receive().array
    assert received is not None and received.tolist() == [[258, 1]] and received.dtype == np.uint16


def test_arrays_of_other_kinds_arent_sent(ends: tuple[socket.socket, Connection]) -> None:
    with pytest.raises(ValueError, match="float64"):
        ends[1].send(Packet({}, np.zeros(2)))


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
            ends[1].send(Packet({}, np.zeros((64, 64), np.uint8)))


COUNT = 2000


def _answers(shares: dict[str, float], seed: int = 0) -> tuple[list[str], list[str]]:
    """What became of pictures that are all different, one after the other: each holds its number in every row."""
    number, offs = 0, list[str]()

    def answer(message: Packet) -> Packet:
        nonlocal number
        if message.table["do"] == "wait":
            return Packet({})
        number += 1
        return Packet({}, np.full((16, 4), number, np.uint16))

    injector = FaultInjector(FaultSettings(seed, shares), lambda: offs.append("off"))
    seen: list[str] = []
    last = 0
    for _ in range(COUNT):
        try:
            found = injector.answer(Packet({"do": "take"}), answer)
        except Disconnected:
            seen.append("disconnect")
            continue
        if found.array is None:
            seen.append("timeout")
        elif len(found.array) < 16:
            seen.append("short")
        elif int(found.array[0, 0]) == last:
            seen.append("repeated")
        else:
            seen.append("torn" if int(found.array[-1, 0]) != number else "right")
        last = last if found.array is None else int(found.array[0, 0])
    return seen, offs


@pytest.mark.parametrize("fault", ["timeout", "short", "torn", "repeated", "disconnect"])
def test_a_fault_happens_as_often_as_its_share(fault: str) -> None:
    seen, offs = _answers({fault: 0.1})
    assert set(seen) == {fault, "right"} and offs == []
    assert seen.count(fault) == pytest.approx(0.1 * COUNT, abs=5 * (0.09 * COUNT) ** 0.5)


def test_the_power_goes_as_often_as_its_share() -> None:
    _, offs = _answers({"power_off": 0.1})
    assert len(offs) == pytest.approx(0.1 * COUNT, abs=5 * (0.09 * COUNT) ** 0.5)


def test_without_shares_nothing_happens_and_equal_seeds_fail_alike() -> None:
    assert _answers({})[0] == ["right"] * COUNT
    some = {"torn": 0.05, "timeout": 0.05}
    assert _answers(some, 3) == _answers(some, 3) != _answers(some, 4)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"timeot": 0.1}, r"faults\.timeot: unknown key; did you mean timeout"),
        ({"timeout": 2.0}, r"faults\.timeout: 2 is out of range"),
        ({"seed": 0.5}, r"faults\.seed"),
        ("many", "a table"),
    ],
)
def test_wrong_faults_are_named(make_rig: MakeRig, table: Any, words: str) -> None:
    with pytest.raises(UserError, match=words):
        read_virtual_settings(make_rig({"virtual.faults": table}))


def test_a_bench_with_faults_is_a_device_that_fails(make_rig: MakeRig) -> None:
    with pytest.raises(DeviceError, match="no picture within 1 s"):
        DirectBench(make_rig({"virtual.faults": {"timeout": 1.0}})).ask({"do": "take"})
    with pytest.raises(DeviceGone):
        DirectBench(make_rig({"virtual.faults": {"disconnect": 1.0}})).ask({"do": "time"})


def test_random_walks_spread_with_the_square_root_of_time() -> None:
    camera_m, power = 1e-6, 0.02
    for hours, step_s in ((1.0, 3600.0), (4.0, 600.0)):
        ends = []
        for seed in range(400):
            drift = Drift(camera_m, power, np.random.default_rng(seed))
            for time_s in np.arange(step_s, hours * 3600 + 1, step_s):
                drift.advance(float(time_s))
            ends.append((*drift.camera_m, 5e-5 * np.log(drift.power)))
        deviations = np.std(ends, axis=0)
        assert deviations == pytest.approx(np.full(3, 1e-6 * hours**0.5), rel=5 / (2 * 400) ** 0.5)


def test_time_that_doesnt_pass_moves_nothing() -> None:
    drift = Drift(1e-6, 0.1, np.random.default_rng(0))
    drift.advance(0.0)
    assert drift.camera_m == (0.0, 0.0) and drift.power == 1.0
    still = Drift(0.0, 0.0, np.random.default_rng(0))
    still.advance(1e6)
    assert still.camera_m == (0.0, 0.0) and still.power == 1.0


def test_the_lasers_of_a_bench_drift_while_its_time_passes(make_rig: MakeRig) -> None:
    light, count = [], 24
    for seed in range(count):
        bench = DirectBench(make_rig({"virtual": {"power_drift": 0.2, "seed": seed}})).light
        bench.switch_on(LASERS_M[0], 1.0)
        bench.expose(5e-3)
        first = bench.take().astype(float) - 64
        bench.wait(3600.0)
        light.append(np.log(((bench.take() - 64.0).sum()) / first.sum()))
    low, high = 0.2 * np.sqrt(chi2.ppf((1e-7, 1 - 1e-7), count - 1) / (count - 1))
    assert low < np.std(light, ddof=1) < high


def test_exposures_begin_late_by_the_trigger_s_jitter(make_rig: MakeRig) -> None:
    bench = DirectBench(make_rig({"virtual": {"trigger_jitter": 0.01, "readout": 0.0}})).light
    bench.expose(1e-3)
    late = []
    for _ in range(200):
        before = bench.time_s
        bench.take()
        late.append(bench.time_s - before - 1e-3)
    assert min(late) >= -1e-12
    assert np.sqrt(np.mean(np.square(late))) == pytest.approx(0.01, rel=5 / (2 * 200) ** 0.5)
