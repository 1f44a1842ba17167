"""A session with a rig of fake devices."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import cast

import pytest

from holoview.bench.experiment.rig_bench import system_of_rig
from holoview.bench.rig import live_devices
from holoview.bench.rig.open_rig import KINDS, Opener
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.rig_session import RigSession, random_pattern
from tests.document.conftest import small_system
from tests.experiment.live.fake_bench import FakeBench, write_rig
from tests.patience import wait_until

LASER_M = 638e-9


class Rigged:
    """A session, its rig, and the fake bench behind it."""

    def __init__(self, path: Path, bench: FakeBench) -> None:
        self.path, self.bench = path, bench
        self.session = EditingSession(system_of_rig(bench.rig))
        self.rig = RigSession(self.session)

    def wait(self, condition: Callable[[], object]) -> None:
        """Polls until something is so."""
        wait_until(condition, self.session.poll, 0.002)

    def open(self) -> None:
        """Opens the rig."""
        self.rig.open(self.path)
        self.wait(lambda: not self.rig.is_busy)

    def light_up(self) -> None:
        """Sets everything that a capture needs."""
        self.rig.send(random_pattern(self.bench.rig, 1.0, 0))
        self.rig.move_to(3e-3)
        self.rig.switch_on(LASER_M, 1.0)
        self.wait(lambda: not self.rig.is_busy)

    @property
    def messages(self) -> list[str]:
        """What the user was told."""
        return [message.text for message in self.session.messages.all]


@pytest.fixture
def session() -> Iterator[EditingSession]:
    made = EditingSession(small_system())
    yield made
    made.close()


@pytest.fixture
def rigged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Rigged]:
    path = write_rig(tmp_path)
    bench = FakeBench(path)
    monkeypatch.setitem(cast(dict[str, Opener], KINDS), "fake", bench.open)
    for name in ("_CALL_TIMEOUT_S", "_CLOSE_TIMEOUT_S"):
        monkeypatch.setattr(live_devices, name, 0.2)  # of devices that hang for good; lasers have as long as ever
    made = Rigged(path, bench)
    yield made
    bench.hangs.clear()
    bench.fails.clear()
    made.rig.close()
    made.session.close()
