"""A viewer ends soon after Ctrl-C, also while its window's thread can't be interrupted, with its work saved."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import signal
import sys
from pathlib import Path

import pytest

from holoview.util.processes import handled_signals
from holoview.viewer.app.run import ending_after_grace
from tests.patience import PATIENCE_S, wait_until

_GRACE_S = 0.2

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs signals")


def _work_in_a_library(folder: Path, saves: bool, closes: bool = False) -> None:
    """Is inside a library for several seconds while the signal comes, as in a driver; then goes on."""

    def save() -> bool:
        (folder / "saved").touch()
        return saves

    with handled_signals(lambda _: None), ending_after_grace(save, _GRACE_S) as window_is_closed:
        (folder / "begun").touch()
        if closes:
            window_is_closed()
        hashlib.pbkdf2_hmac("sha256", b"", b"", 6_000_000)
    (folder / "went on").touch()
    sys.exit(7)


def _interrupted(folder: Path, number: int, saves: bool = True) -> int | None:
    """The exit code of the process that works and gets a signal."""
    process = multiprocessing.get_context("spawn").Process(target=_work_in_a_library, args=(folder, saves))
    process.start()
    wait_until(lambda: (folder / "begun").exists() or not process.is_alive())
    assert process.pid is not None
    os.kill(process.pid, number)
    process.join(PATIENCE_S)
    return process.exitcode


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 143)])
def test_it_ends_while_a_library_works(tmp_path: Path, number: int, code: int) -> None:
    assert _interrupted(tmp_path, number) == code
    assert (tmp_path / "saved").exists() and not (tmp_path / "went on").exists()


def test_it_ends_when_the_window_is_closed_while_a_library_works(tmp_path: Path) -> None:
    work = multiprocessing.get_context("spawn").Process(target=_work_in_a_library, args=(tmp_path, True, True))
    work.start()
    work.join(PATIENCE_S)
    assert work.exitcode == 0
    assert (tmp_path / "saved").exists() and not (tmp_path / "went on").exists()


@pytest.mark.long
def test_it_goes_on_where_the_work_cant_be_saved_so(tmp_path: Path) -> None:
    assert _interrupted(tmp_path, signal.SIGINT, saves=False) == 7
    assert (tmp_path / "saved").exists() and (tmp_path / "went on").exists()


def test_a_process_that_nobody_supervises_is_left_alone() -> None:
    before = signal.set_wakeup_fd(-1)
    try:
        with ending_after_grace(lambda: False, _GRACE_S):
            assert signal.set_wakeup_fd(-1) == -1, "this process isn't supervised: its signals are its own"
    finally:
        signal.set_wakeup_fd(before)
