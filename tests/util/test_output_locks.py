"""Who writes a file keeps others from it until the end, also an end by `kill -9`."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from holoview.util.errors import UserError
from holoview.util.file_writer import OutputLocks
from tests.child_process import child_process

HOLD = """
import sys, time
from pathlib import Path
from holoview.util.file_writer import OutputLocks
with OutputLocks(Path(sys.argv[1])) as locks:
    locks.hold(Path(sys.argv[2]))
    print("held", flush=True)
    time.sleep(600)
"""


def test_a_name_is_held_once_and_free_again_after_the_end(tmp_path: Path) -> None:
    folder, file = tmp_path / "locks", tmp_path / "o.png"
    with OutputLocks(folder) as first, OutputLocks(folder) as second:
        first.hold(file)
        first.hold(file)
        second.hold(tmp_path / "other.png")
        with pytest.raises(UserError, match=rf"o.png: is being written by another holoview \(process {os.getpid()}\)"):
            second.hold(tmp_path / "." / "o.png")
    assert not list(folder.iterdir())
    with OutputLocks(folder) as third:
        third.hold(file)


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX links and signals")
def test_links_are_followed_and_a_killed_program_holds_nothing(tmp_path: Path) -> None:
    folder, file, link = tmp_path / "locks", tmp_path / "o.png", tmp_path / "link.png"
    link.symlink_to(file)
    words = [sys.executable, "-c", HOLD, str(folder), str(file)]
    with child_process(words, stdout=subprocess.PIPE, text=True) as program, OutputLocks(folder) as locks:
        assert program.stdout is not None and program.stdout.readline() == "held\n"
        with pytest.raises(UserError, match=f"process {program.pid}"):
            locks.hold(link)
        program.send_signal(signal.SIGKILL)
        program.wait()
        locks.hold(link)


def test_without_a_place_for_locks_nothing_is_locked(tmp_path: Path) -> None:
    (tmp_path / "locks").write_text("a file", encoding="utf-8")
    with OutputLocks(tmp_path / "locks") as first, OutputLocks(tmp_path / "locks") as second:
        first.hold(tmp_path / "o.png")
        second.hold(tmp_path / "o.png")
