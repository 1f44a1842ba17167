"""Which share of the processor this thread has got of what it was ready for, on a machine that others use as well."""

from __future__ import annotations

from pathlib import Path

_SCHEDSTAT = Path("/proc/thread-self/schedstat")


def processor_share() -> float:
    """Seconds that this thread ran over those in which it ran or waited for a processor, since it began; 0 < share ≤ 1.

    1 where the system doesn't tell: outside Linux (Documentation/scheduler/sched-stats.rst, /proc/<pid>/schedstat).
    """
    try:
        ran_ns, waited_ns = (int(word) for word in _SCHEDSTAT.read_text(encoding="ascii").split()[:2])
    except (OSError, ValueError):
        return 1.0
    return ran_ns / (ran_ns + waited_ns) if ran_ns > 0 else 1.0
