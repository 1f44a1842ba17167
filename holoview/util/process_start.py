"""When a process began, by a clock that nobody sets: tells a process apart from a later one with the same id."""

from __future__ import annotations

from pathlib import Path

import psutil

_PROC = Path("/proc")
_AFTER_NAME = (
    19  # number of the field "starttime" of /proc/PID/stat behind the name, which may hold spaces and brackets
)


def process_start(pid: int, proc: Path = _PROC) -> str:
    """When the process with this id began. Raises psutil.Error if there is none.

    On Linux in ticks since the machine was started, with that start's name: a clock that is set while programs run
    changes neither. Elsewhere in seconds of the clock, as the system noted it. proc: the folder of the processes.
    """
    try:
        boot = (proc / "sys" / "kernel" / "random" / "boot_id").read_text(encoding="ascii").strip()
        text = (proc / str(pid) / "stat").read_text(encoding="utf-8", errors="replace")
        return f"{text.rpartition(')')[2].split()[_AFTER_NAME]} ticks of {boot}"
    except (OSError, IndexError):
        return f"{psutil.Process(pid).create_time():.2f} s"
