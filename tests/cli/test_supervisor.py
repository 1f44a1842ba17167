"""The viewer's process is started again after a crash, with its work; signals reach it; and it ends with its parent."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import psutil
import pytest

from holoview.commands.console import EXIT_DEVICE_LOST
from holoview.commands.supervisor import MOST_CRASHES, is_crash, is_supervised, supervise
from tests.explored import explored
from tests.patience import PATIENCE_S, wait_until


def _program(words: Sequence[str]) -> int:
    """Notes its arguments in a file, and ends as that file's folder says: one line an end, the last one for all others.

    "N" is an exit code, "-N" a signal, "wait" waits for a signal.
    """
    folder = Path(words[1])
    try:
        return _end(folder, words)
    except KeyboardInterrupt:
        return 130


def _end(folder: Path, words: Sequence[str]) -> int:
    with (folder / "calls").open("a", encoding="utf-8") as calls:
        calls.write(" ".join(map(str, words[2:])) + f" in {os.getpid()}\n")
    ends = (folder / "ends").read_text(encoding="utf-8").split()
    end = ends[min(len(_calls(folder)), len(ends)) - 1]
    if end == "wait":
        time.sleep(PATIENCE_S)
    elif int(end) < 0:
        os.kill(os.getpid(), -int(end))
    return 0 if end == "wait" else int(end)


def _calls(folder: Path) -> list[str]:
    path = folder / "calls"
    return path.read_text(encoding="utf-8").splitlines() if path.exists() else []


def _supervise(folder: Path, *ends: object) -> int:
    (folder / "ends").write_text(" ".join(map(str, ends)), encoding="utf-8")
    return supervise(_program, ["view", str(folder)])


@pytest.mark.parametrize("code", explored([2, 0, 130], 1))
def test_what_ends_by_itself_isnt_started_again(tmp_path: Path, code: int) -> None:
    assert _supervise(tmp_path, code) == code
    assert len(_calls(tmp_path)) == 1


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
@pytest.mark.parametrize("end", explored([-signal.SIGABRT, EXIT_DEVICE_LOST, -signal.SIGSEGV], 2))
def test_after_a_crash_the_program_starts_again_with_the_work_of_the_process_that_crashed(
    tmp_path: Path, end: int, capfd: pytest.CaptureFixture[str]
) -> None:
    assert _supervise(tmp_path, int(end), 0) == 0
    first, second = _calls(tmp_path)
    assert second.startswith(f"--recover {first.rpartition(' ')[2]} in")
    (line,) = capfd.readouterr().err.splitlines()
    assert "starts again with your work" in line
    assert ("device was lost" in line) == (end == EXIT_DEVICE_LOST)


def test_crash_after_crash_ends_it(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert _supervise(tmp_path, EXIT_DEVICE_LOST) == EXIT_DEVICE_LOST
    assert len(_calls(tmp_path)) == MOST_CRASHES
    assert f"crashed {MOST_CRASHES} times" in capfd.readouterr().err


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_a_user_who_kills_it_means_it(tmp_path: Path) -> None:
    assert _supervise(tmp_path, -int(signal.SIGKILL), 0) == 128 + signal.SIGKILL
    assert len(_calls(tmp_path)) == 1


def test_exceptions_of_windows_are_crashes_and_ctrl_c_is_none() -> None:
    assert is_crash(0xC0000005) and not is_crash(0xC000013A) and not is_crash(1)


@pytest.mark.parametrize(
    ("words", "supervised"),
    [
        (["view"], True),
        (["view", "holochrome-8", "--serve", "127.0.0.1:0"], True),
        (["view", "--help"], False),
        (["view", "--offscreen", "--script", "a.txt"], False),
        (["view", "--until-image"], False),
        (["render", "view"], False),
        ([], False),
    ],
)
def test_only_a_viewer_that_a_person_works_with_is_supervised(words: list[str], supervised: bool) -> None:
    assert is_supervised(words) is supervised


def test_the_process_that_supervises_loads_neither_numpy_nor_the_command_line() -> None:
    """Nobody waits for them twice; the viewer's own process loads them."""
    program = "import sys, holoview.__main__, holoview.commands.supervisor; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], timeout=PATIENCE_S, check=False).returncode == 0


def _start(folder: Path) -> tuple[subprocess.Popen[bytes], psutil.Process]:
    """A process that supervises a program that waits, and the program's process."""
    (folder / "ends").write_text("wait", encoding="utf-8")
    code = (
        "import sys; from tests.cli.test_supervisor import _program, supervise; "
        f"sys.exit(supervise(_program, ['view', {str(folder)!r}]))"
    )
    process = subprocess.Popen([sys.executable, "-c", code])
    wait_until(lambda: _calls(folder) or process.poll() is not None)
    return process, psutil.Process(int(_calls(folder)[0].rpartition(" ")[2]))


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 128 + signal.SIGTERM)])
def test_signals_reach_the_program_once(tmp_path: Path, number: signal.Signals, code: int) -> None:
    process, _ = _start(tmp_path)
    process.send_signal(number)
    assert process.wait(PATIENCE_S) == code


@pytest.mark.long
@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_the_program_ends_when_the_process_that_supervises_is_killed(tmp_path: Path) -> None:
    process, program = _start(tmp_path)
    process.kill()
    process.wait(PATIENCE_S)
    program.wait(PATIENCE_S)
    assert not program.is_running()


def _work_on(words: Sequence[str]) -> int:
    """Ends while threads of a pool have work for a minute."""
    pool = ThreadPoolExecutor(1)
    for _ in range(60):
        pool.submit(time.sleep, PATIENCE_S / 60)
    print("ended", end="")
    return 5


def test_it_ends_although_threads_have_work_left(capfd: pytest.CaptureFixture[str]) -> None:
    began = time.monotonic()
    assert supervise(_work_on, ["view"]) == 5
    assert time.monotonic() - began < PATIENCE_S / 2
    assert capfd.readouterr().out == "ended"
