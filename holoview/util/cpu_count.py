"""How much of the machine is ours."""

from __future__ import annotations

import os


def process_cpu_count() -> int:
    """CPU cores that this process may use: batch systems give a job some of a machine's."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
