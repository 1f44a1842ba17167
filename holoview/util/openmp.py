"""How torch's threads wait for each other: to be set before torch is loaded.

An operation of torch ends when all of its threads have done their part. GNU's OpenMP lets those that are ready spin for
about 10 ms before they sleep, which is the fastest where each has a core of its own. Where other programs run, the
threads that spin take the time of those that they wait for.
"""

from __future__ import annotations

import os
from collections.abc import MutableMapping

from holoview.util.cpu_count import affine_cpu_count, process_cpu_count

SPIN_COUNT = 1000
"""Turns of the waiting loop before a thread sleeps: some tens of microseconds, as long as waking it takes."""


def share_the_machine(environment: MutableMapping[str, str] = os.environ) -> None:
    """Lets OpenMP's threads sleep early, and starts no more of them, and of Mesa's, than a container grants CPUs.

    environment: where to set this; what it says already is kept.
    """
    if "OMP_WAIT_POLICY" not in environment:
        environment.setdefault("GOMP_SPINCOUNT", str(SPIN_COUNT))
    granted = process_cpu_count()
    if granted < affine_cpu_count():
        environment.setdefault("OMP_NUM_THREADS", str(granted))
        environment.setdefault("LP_NUM_THREADS", str(granted))  # of Mesa's renderer on the processor
