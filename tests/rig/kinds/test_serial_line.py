"""Lasers and a stage at a serial line, against an instrument that answers at a socket (pyserial's socket://)."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator

import pytest

from holoview.bench.rig import open_rig
from holoview.bench.rig.devices import DeviceError
from holoview.util.errors import UserError
from tests.rig.kinds.conftest import WriteRig


class Instrument:
    """Answers lines. received: what it was sent. answer: the answer to a line, "" for none."""

    def __init__(self, answer: Callable[[str], str]) -> None:
        self.received: list[str] = []
        self.answer = answer
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = f"socket://127.0.0.1:{self._listening.getsockname()[1]}"
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        try:
            connected, _ = self._listening.accept()
        except OSError:
            return
        with connected, connected.makefile("rw", encoding="utf-8", newline="\n") as stream:
            try:
                for line in stream:
                    self.received.append(line.strip())
                    stream.write(self.answer(line.strip()))
                    stream.flush()
            except OSError:
                pass

    def close(self) -> None:
        self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        self._thread.join()


@pytest.fixture
def instrument() -> Iterator[Callable[[Callable[[str], str]], Instrument]]:
    made: list[Instrument] = []

    def make(answer: Callable[[str], str]) -> Instrument:
        made.append(Instrument(answer))
        return made[-1]

    yield make
    for one in made:
        one.close()


MakeInstrument = Callable[[Callable[[str], str]], Instrument]


def _lasers(port: str, more: str = "") -> str:
    return (
        f'device = "serial"\nport = "{port}"\nstart = "*CLS\\n"\n'
        'on = ["L{number}:POW {power:.1f}\\n", "L{number}:ON {nm:.0f}\\n"]\noff = "ALL:OFF\\n"\n'
        f'full_power = 20.0\ndone = "OK"\nfailed = "ERR"\n{more}'
    )


def _stage(port: str, more: str = "") -> str:
    return (
        f'device = "serial"\nport = "{port}"\nmove = "G0 X{{mm:.4f}}\\n"\ndone = "ok"\nask = "M114\\n"\n'
        f'position = "X:([-+0-9.]+)"\n{more}'
    )


def test_lasers_are_off_when_opened_one_is_on_at_a_time_and_all_are_off_at_the_end(
    write_rig: WriteRig, instrument: MakeInstrument
) -> None:
    device = instrument(lambda line: "echo\nOK\n")
    with open_rig(write_rig(lasers=_lasers(device.port))) as devices:
        assert device.received == ["*CLS", "ALL:OFF"]
        devices.lasers.switch_on(638e-9, 0.5)
        with pytest.raises(UserError, match=r"power: 0\.9"):
            devices.lasers.switch_on(450e-9, 0.9)
        assert device.received[2:] == ["ALL:OFF", "L2:POW 10.0", "L2:ON 638"]
    assert device.received[-1] == "ALL:OFF"


def test_a_refusal_is_named_and_the_lasers_are_off_then(write_rig: WriteRig, instrument: MakeInstrument) -> None:
    device = instrument(lambda line: "ERR 17: interlock\n" if "ON" in line else "OK\n")
    message = r"lasers: refused 'L1:ON 450\\n': ERR 17: interlock"
    with pytest.raises(DeviceError, match=message), open_rig(write_rig(lasers=_lasers(device.port))) as devices:
        devices.lasers.switch_on(450e-9, 0.5)
    assert device.received[-1] == "ALL:OFF"


def test_lasers_whose_start_is_refused_are_off_too(write_rig: WriteRig, instrument: MakeInstrument) -> None:
    device = instrument(lambda line: "ERR\n" if "CLS" in line else "OK\n")
    with pytest.raises(DeviceError, match=r"lasers: refused '\*CLS\\n': ERR"):
        open_rig(write_rig(lasers=_lasers(device.port)))
    assert device.received == ["*CLS", "ALL:OFF"]


@pytest.mark.long
def test_lasers_that_cannot_be_switched_off_say_to_do_it_by_hand(
    write_rig: WriteRig, instrument: MakeInstrument
) -> None:
    device = instrument(lambda line: "" if "OFF" in line else "OK\n")
    with pytest.raises(DeviceError, match=r"lasers: didn't answer 'ALL:OFF\\n' within 1 s; make sure by hand that all"):
        open_rig(write_rig(lasers=_lasers(device.port, "timeout = 1.0")))


def test_a_stage_reports_where_it_is(write_rig: WriteRig, instrument: MakeInstrument) -> None:
    device = instrument(lambda line: "X:7.0020 Y:0\nok\n" if line == "M114" else "ok\n")
    options = _stage(device.port, 'zero = "12 mm"\nreversed = true')
    with open_rig(write_rig(stage=options)) as devices:
        assert devices.stage.move_to(5e-3) == pytest.approx(4.998e-3, abs=1e-12)  # 12 mm − 7.002 mm
        with pytest.raises(UserError, match=r"stage: 15\.5 mm"):
            devices.stage.move_to(15.5e-3)
    assert device.received == ["G0 X7.0000", "M114"]


def test_a_stage_that_stops_elsewhere_is_an_error(write_rig: WriteRig, instrument: MakeInstrument) -> None:
    device = instrument(lambda line: "X:4.9\n" if line == "M114" else "ok\n")
    with (
        pytest.raises(DeviceError, match=r"stage: stopped at 4\.9 mm; expected 5 mm"),
        open_rig(write_rig(stage=_stage(device.port, 'tolerance = "50 um"'))) as devices,
    ):
        devices.stage.move_to(5e-3)


@pytest.mark.long
def test_silence_and_other_answers_are_told(write_rig: WriteRig, instrument: MakeInstrument) -> None:
    device = instrument(lambda line: "busy\n")
    with (
        pytest.raises(DeviceError, match=r"stage: didn't answer 'G0 X5\.0000\\n' within 1 s, but sent 'busy'"),
        open_rig(write_rig(stage=_stage(device.port, "timeout = 1.0"))) as devices,
    ):
        devices.stage.move_to(5e-3)


def test_a_port_that_is_not_there_is_named(write_rig: WriteRig) -> None:
    with pytest.raises(DeviceError, match=r'stage: didn\'t open "/dev/no-such-port": .*; see that it is on'):
        open_rig(write_rig(stage=_stage("/dev/no-such-port")))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ('device = "serial"\nport = "loop://"', r"stage\.move: is missing"),
        ('device = "serial"\nport = "loop://"\nmove = "X{inch}"', r"stage\.move: .*KeyError.*knows {mm}, {um}, {m}"),
        ('device = "serial"\nport = "loop://"\nmove = "X"\nask = "?"', r"stage\.ask: stands without its partner"),
        (
            'device = "serial"\nport = "loop://"\nmove = "X"\nask = "?"\nposition = "X"',
            r"stage\.position: has 0 groups",
        ),
        (
            'device = "serial"\nport = "loop://"\nmove = "X"\nask = "?"\nposition = "("',
            r"stage\.position: .*unterminated",
        ),
        ('device = "serial"\nport = "loop://"\nmove = "X"\nbaut = 9600', r"stage\.baut: unknown .*did you mean baud\?"),
        ('device = "serial"\nport = 3\nmove = "X"', r"stage\.port: 3 is not text"),
    ],
)
def test_wrong_options_are_named_before_anything_is_opened(write_rig: WriteRig, options: str, message: str) -> None:
    with pytest.raises(UserError, match=message):
        open_rig(write_rig(stage=options))


def test_a_stage_without_answers_is_believed(write_rig: WriteRig) -> None:
    """loop:// sends back what it is sent, which nobody waits for here."""
    with open_rig(write_rig(stage='device = "serial"\nport = "loop://"\nmove = "X{um:.0f}\\n"')) as devices:
        assert devices.stage.move_to(5e-3) == 5e-3
