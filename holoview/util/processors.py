"""How many processors this process may use, and how its threads share them with other programs.

process_cpu_count   processors of the affinity mask, fewer where a container grants less of their time
group_folders       Linux's control groups, which limit what a process may take
share_the_machine   how torch's threads wait for each other: to be set before torch is loaded
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, MutableMapping
from pathlib import Path


def process_cpu_count() -> int:
    """The number of CPUs in this process's affinity mask, or fewer where a container grants it less of their time.

    Python 3.13's `os.process_cpu_count` knows the mask alone.
    """
    quota = cpu_quota()
    return affine_cpu_count() if quota is None else min(affine_cpu_count(), max(1, math.ceil(quota)))


def affine_cpu_count() -> int:
    """The number of CPUs in this process's affinity mask, which batch systems restrict; else all of the machine."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def cpu_quota(root: Path = Path("/")) -> float | None:
    """How many CPUs' time Linux grants this process's control groups, the least of all; None without a limit.

    root: of the file system. Reads cgroup 2 (`cpu.max`) and cgroup 1 (`cpu.cfs_quota_us`).
    """
    quotas = [
        quota
        for folder in group_folders(root / MOUNT, root / MEMBERSHIP, "cpu")
        if (quota := _quota_of(folder)) is not None
    ]
    return min(quotas, default=None)


def _quota_of(folder: Path) -> float | None:
    """The limit that one group states, in CPUs."""
    try:
        if (folder / "cpu.max").exists():
            quota, period = (folder / "cpu.max").read_text(encoding="utf-8").split()
        else:
            names = ("cpu.cfs_quota_us", "cpu.cfs_period_us")
            quota, period = (str(int((folder / name).read_text(encoding="utf-8"))) for name in names)
        return None if quota in ("max", "-1") else int(quota) / int(period)
    except (OSError, ValueError, ZeroDivisionError):
        return None


# --- control groups ---------------------------------------------------------------------------------------------------


MOUNT = Path("sys/fs/cgroup")
MEMBERSHIP = Path("proc/self/cgroup")


def group_folders(mount: Path, membership: Path, controller: str) -> Iterator[Path]:
    """The folders of this process's groups of a controller, versions 1 and 2, and of those that contain them.

    mount: where the groups are mounted. membership: the file that names them. controller: such as "memory". In a
    container, the folders above its own group aren't seen, and its own is the root of the mount.
    """
    for line in read_lines(membership):
        _, controllers, name = line.split(":", 2)
        if controllers and controller not in controllers.split(","):
            continue
        top = mount / controllers if (mount / controllers).is_dir() else mount / controller
        folder = top / name.lstrip("/")
        yield from (group for group in (folder, *folder.parents) if group == top or top in group.parents)


def read_lines(path: Path) -> list[str]:
    """The lines of a file of the kernel; none where it can't be read."""
    try:
        return path.read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError):
        return []


# --- OpenMP -----------------------------------------------------------------------------------------------------------

# An operation of torch ends when all of its threads have done their part. GNU's OpenMP lets those that are ready spin
# for about 10 ms before they sleep, which is the fastest where each has a core of its own. Where other programs run,
# the threads that spin take the time of those that they wait for.


SPIN_COUNT = 1000
"""Turns of the waiting loop before a thread sleeps: some tens of microseconds, as long as waking it takes."""


def share_the_machine(environment: MutableMapping[str, str] = os.environ) -> None:
    """Lets OpenMP's threads sleep early, and starts no more of them, and of Mesa's, than a container grants CPUs.

    environment: where to set this; variables that are set already stay as they are.
    """
    if "OMP_WAIT_POLICY" not in environment:
        environment.setdefault("GOMP_SPINCOUNT", str(SPIN_COUNT))
    granted = process_cpu_count()
    if granted < affine_cpu_count():
        environment.setdefault("OMP_NUM_THREADS", str(granted))
        environment.setdefault("LP_NUM_THREADS", str(granted))  # of Mesa's renderer on the processor
