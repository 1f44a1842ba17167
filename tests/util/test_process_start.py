"""A process is told apart from a later one with its id, also when somebody sets the clock."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from holoview.util.processes import process_start


def test_a_process_keeps_its_start_and_another_has_its_own() -> None:
    own = process_start(os.getpid())
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child:
        assert process_start(child.pid) != own == process_start(os.getpid())
    with pytest.raises(psutil.Error):
        process_start(child.pid)


def test_the_name_of_a_program_may_hold_anything(tmp_path: Path) -> None:
    (tmp_path / "sys" / "kernel" / "random").mkdir(parents=True)
    (tmp_path / "sys" / "kernel" / "random" / "boot_id").write_text("b00t\n", encoding="ascii")
    (tmp_path / "7").mkdir()
    fields = " ".join(str(n) for n in range(3, 53))  # of proc(5), by their numbers; starttime is 22
    (tmp_path / "7" / "stat").write_text(f"7 (a) S 1 (b c) {fields}\n", encoding="ascii")
    assert process_start(7, tmp_path) == "22 ticks of b00t"


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the system notes the clock's time")
def test_the_clock_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    own = process_start(os.getpid())
    monkeypatch.setattr(psutil.Process, "create_time", lambda self: 0.0)
    assert process_start(os.getpid()) == own
