"""The number of CPUs that this process may use."""

from __future__ import annotations

import math
import os
from pathlib import Path

from holoview.util.control_groups import MEMBERSHIP, MOUNT, group_folders


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
