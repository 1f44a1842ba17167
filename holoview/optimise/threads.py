"""CPU threads: one for torch where fields are small, and several that each compute a part of large ones."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from threading import Barrier
from typing import TypeVar

import torch

Item = TypeVar("Item")
Result = TypeVar("Result")

MIN_SAMPLES_FOR_THREADS = 1 << 17
"""Samples of a padded field below which starting threads takes longer than they save."""


@contextmanager
def limit_torch_threads(samples: int) -> Iterator[None]:
    """One torch thread inside the block for fields of few samples, unless OMP_NUM_THREADS is set; else no change."""
    before = torch.get_num_threads()
    chosen = 1 if samples < MIN_SAMPLES_FOR_THREADS and "OMP_NUM_THREADS" not in os.environ else before
    if chosen != before:
        torch.set_num_threads(chosen)
    try:
        yield
    finally:
        if chosen != before:
            torch.set_num_threads(before)


class ThreadTeam:
    """Calls a function for each of some items, in as many threads as torch would use for one operation.

    Each thread takes the next item when it is free and computes it alone, so that the data of an item stay in the cache
    of one core and no operation waits for other cores. Results are in the order of the items, whoever computes them.
    On other devices than the CPU the calling thread computes all items.
    """

    def __init__(self, device: torch.device) -> None:
        self._device = device
        self._pools: dict[int, ThreadPoolExecutor] = {}

    def map(self, function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        """The results (item,) of a function that may be called in several threads at a time."""
        size = min(torch.get_num_threads(), len(items))
        if size <= 1 or self._device.type != "cpu":
            return [function(item) for item in items]
        return list(self._pool(size).map(function, items))

    def _pool(self, size: int) -> ThreadPoolExecutor:
        if size not in self._pools:
            self._pools[size] = _single_threaded_pool(size)
        return self._pools[size]


def _single_threaded_pool(size: int) -> ThreadPoolExecutor:
    """Threads in which torch uses no others. They are all started here, since torch's setting is also that of new ones.

    The threads end when the pool is no longer referred to.
    """
    pool, barrier, before = ThreadPoolExecutor(size), Barrier(size), torch.get_num_threads()

    def set_up() -> None:
        torch.get_num_threads()  # a thread's first question sets its number to the common one; ours comes after it
        torch.set_num_threads(1)
        barrier.wait()  # so that no thread takes the task of another

    for task in [pool.submit(set_up) for _ in range(size)]:
        task.result()
    torch.set_num_threads(before)
    return pool
