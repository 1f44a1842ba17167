"""Lasers go off when the program that had switched them on is killed; else the guard has nothing to do."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from holoview.bench.rig.devices import DeviceError
from holoview.bench.rig.guard_process import switch_off
from tests.patience import PATIENCE_S, wait_until
from tests.rig.conftest import write_rig

DEVICES = """
from pathlib import Path
LOG = Path(__file__).with_name("lasers.txt")

class Lasers:
    wavelengths_m = (450e-9, 638e-9)
    def note(self, text):
        with LOG.open("a", encoding="utf-8") as file:
            file.write(text + "\\n")
    def switch_on(self, wavelength_m, power):
        self.note("on")
    def switch_off(self):
        self.note("off")
    def close(self):
        pass
"""
PROGRAM = """
import sys, time
from holoview.bench.rig import open_rig, read_rig
with open_rig(read_rig("rig.toml")) as devices:
    devices.lasers.switch_on(450e-9, 0.5)
    print("on", flush=True)
    sys.stdin.readline()
"""


def _started(folder: Path) -> subprocess.Popen[str]:
    (folder / "devices.py").write_text(DEVICES, encoding="utf-8")
    write_rig(folder / "rig.toml", {"lasers.device": "python", "lasers.file": "devices.py", "lasers.class": "Lasers"})
    pipe = subprocess.PIPE
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM], cwd=folder, stdin=pipe, stdout=pipe, stderr=pipe, text=True
    )
    assert process.stdout is not None and process.stdout.readline() == "on\n"
    return process


def _log(folder: Path) -> list[str]:
    return (folder / "lasers.txt").read_text(encoding="utf-8").split()


@pytest.mark.long
def test_lasers_of_a_program_that_is_killed_go_off(tmp_path: Path) -> None:
    with _started(tmp_path) as process:
        assert _log(tmp_path)[-1] == "on"
        process.send_signal(signal.SIGKILL)
        wait_until(lambda: _log(tmp_path)[-1] == "off")
        _, said = process.communicate()  # of the guard, which had the same stderr
    assert said.endswith("lasers: switched off, since the program that used them is gone\n")


@pytest.mark.long
def test_a_program_that_switches_them_off_needs_no_guard(tmp_path: Path) -> None:
    with _started(tmp_path) as process:
        _, said = process.communicate("\n", timeout=PATIENCE_S)
    assert process.returncode == 0 and "switched off" not in said
    assert _log(tmp_path)[-2:] == ["on", "off"]


class _Port:
    """Lasers whose port is taken for the first attempts. log: what was asked."""

    def __init__(self, taken: int) -> None:
        self.taken, self.log, self.wavelengths_m = taken, list[str](), (450e-9,)

    def open(self) -> _Port:
        self.taken -= 1
        if self.taken >= 0:
            raise DeviceError("lasers", "the port is taken")
        return self

    def switch_on(self, wavelength_m: float, power: float) -> None:
        raise AssertionError

    def switch_off(self) -> None:
        self.log.append("off")

    def close(self) -> None:
        self.log.append("close")


@pytest.mark.parametrize(("taken", "code", "log"), [(0, 0, ["off", "close"]), (3, 0, ["off", "close"]), (99, 1, [])])
def test_the_guard_tries_for_some_seconds_and_then_asks_for_a_hand(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    taken: int,
    code: int,
    log: list[str],
) -> None:
    pauses: list[float] = []
    pause: Callable[[float], None] = pauses.append
    monkeypatch.setattr(time, "sleep", pause)
    port = _Port(taken)
    assert switch_off(port.open) == code and port.log == log
    assert len(pauses) == min(taken, 9)
    assert ("do it by hand" in capsys.readouterr().err) == (code == 1)
