"""The number of CPUs that this process may use."""

from __future__ import annotations

import os


def process_cpu_count() -> int:
    """The number of CPUs in this process's affinity mask, which batch systems restrict; all of the machine elsewhere.

    The same as `os.process_cpu_count` of Python 3.13.
    """
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
