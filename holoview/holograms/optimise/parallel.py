"""The hardware of an optimisation: processes or GPUs that share its lasers, threads of the CPU, the torch device.

The image is the sum of the lasers' intensities, so that no process needs the fields of another (torch.distributed). The
processes sum their images at each plane, then the gradients of the patterns and the light in the eyebox. To solve for
laser amplitudes, each broadcasts its intensities once, for the products of lasers of different processes. Every process
holds all patterns, and takes the same step with the same numbers.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Barrier, Condition
from typing import TypeVar

import torch
import torch.distributed as dist

from holoview.holograms.optimise.lasers import Laser, lit_lasers
from holoview.light.model.plan import Plan
from holoview.util.errors import UserError

Tensor = torch.Tensor
Item = TypeVar("Item")
Result = TypeVar("Result")

_RANK, _SIZE, _LOCAL_RANK = "RANK", "WORLD_SIZE", "LOCAL_RANK"  # environment variables that torchrun sets


@dataclass(frozen=True)
class ProcessGroup:
    """Number `rank` of `size` processes; a single one sends nothing. device: where tensors have to be to be sent."""

    rank: int = 0
    size: int = 1
    device: str = "cpu"

    @property
    def is_main(self) -> bool:
        """Whether this is the process that prints and writes files."""
        return self.rank == 0

    def shard(self, total: int, rank: int | None = None) -> slice:
        """Indices of the items, out of `total`, of a process (this one when None): consecutive, equal shares."""
        chosen = self.rank if rank is None else rank
        return slice(total * chosen // self.size, total * (chosen + 1) // self.size)

    def all_reduce_sum(self, *tensors: Tensor) -> None:
        """Replaces each tensor by its sum over the processes, in place."""
        if self.size == 1:
            return
        for tensor in tensors:
            total = tensor.to(self.device).contiguous()
            dist.all_reduce(total)
            if total is not tensor:
                tensor.copy_(total)

    def broadcast_shards(self, own_rows: Tensor, total: int) -> Iterator[tuple[slice, Tensor]]:
        """The rows (n, …) of each process in turn, and their indices among all `total` rows."""
        if self.size == 1:
            yield slice(0, total), own_rows
            return
        for rank in range(self.size):
            indices = self.shard(total, rank)
            count = indices.stop - indices.start
            rows = own_rows.contiguous() if rank == self.rank else own_rows.new_empty(count, *own_rows.shape[1:])
            dist.broadcast(rows, src=rank)
            yield indices, rows

    def any_rank(self, flag: bool) -> bool:
        """Whether the flag is set in any process: for decisions in which all must agree, such as when to stop."""
        count = torch.tensor([float(flag)])
        self.all_reduce_sum(count)
        return bool(count > 0)


SINGLE_PROCESS = ProcessGroup()
"""The group of a process that computes alone."""


def shard_lasers(plan: Plan, group: ProcessGroup) -> list[list[Laser]]:
    """The lasers of each process, sorted by frame. Raises UserError for more processes than lasers.

    Lasers of one wavelength stay together, because they share transfer functions, which take the most memory.
    """
    lit = sorted(lit_lasers(plan), key=lambda laser: laser[1])
    if len(lit) < group.size:
        raise UserError(
            "processes", f"{group.size} of them for {len(lit)} lasers", expected="a laser for each at least"
        )
    return [sorted(lit[group.shard(len(lit), rank)]) for rank in range(group.size)]


@contextmanager
def torchrun_group(device: str) -> Iterator[ProcessGroup]:
    """This process's group among those that torchrun started, until the block ends. device: of torch, with its index.

    Raises UserError when it was started alone.
    """
    missing = [name for name in (_RANK, _SIZE) if name not in os.environ]
    if missing:
        raise UserError(
            "--sharded",
            "this process was started alone",
            expected="torchrun --nproc-per-node N -m holoview optimise … --sharded",
            remedy="start it so, or leave --sharded out",
        )
    on_cuda = device.startswith("cuda")
    dist.init_process_group("nccl" if on_cuda else "gloo")
    try:
        yield ProcessGroup(dist.get_rank(), dist.get_world_size(), device if on_cuda else "cpu")
    finally:
        dist.destroy_process_group()


def device_for_rank(device: str) -> str:
    """The CUDA device with this process's local rank for "cuda"; any other device unchanged."""
    return f"cuda:{os.environ.get(_LOCAL_RANK, '0')}" if device == "cuda" else device


# --- threads ---------------------------------------------------------------------------------------------------------

MIN_SAMPLES_FOR_THREADS = 1 << 17
"""Samples of a padded field below which several threads for an operation of torch take longer than they save."""
MIN_SAMPLES_FOR_TEAM = 1 << 15
"""The same for the threads of a `ThreadTeam`, each of which does several operations with its part."""


def thread_count(samples: int, least: int = MIN_SAMPLES_FOR_THREADS) -> int:
    """Torch's number of threads, or one for fields of less than `least` samples, unless OMP_NUM_THREADS is set."""
    is_worthwhile = samples >= least or "OMP_NUM_THREADS" in os.environ
    return torch.get_num_threads() if is_worthwhile else 1


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """So many threads for an operation of torch inside the block.

    It is one while a `ThreadTeam` works: torch's own threads, when they have done their part of an operation, wait for
    the next one without giving their core away, for about as long as a thread of the team needs for a block.
    """
    before = torch.get_num_threads()
    if count != before:
        torch.set_num_threads(count)
    try:
        yield
    finally:
        if count != before:
            torch.set_num_threads(before)


class ThreadTeam:
    """Calls a function for each of some items, in several threads.

    Each thread takes the next item when it is free and computes it alone, so that the data of an item stay in the cache
    of one core and no operation waits for other cores. Results are in the order of the items, whoever computes them.
    On other devices than the CPU the calling thread computes all items.

    threads: as many as torch uses for one operation when None.
    """

    def __init__(self, device: torch.device, threads: int | None = None) -> None:
        self._threads = threads if device.type == "cpu" else 1
        self._pools: dict[int, ThreadPoolExecutor] = {}

    @property
    def size(self) -> int:
        """How many threads there are."""
        return torch.get_num_threads() if self._threads is None else self._threads

    def map(self, function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        """The results (item,) of a function that may be called in several threads at a time."""
        size = min(self.size, len(items))
        if size <= 1:
            return [function(item) for item in items]
        return list(self._pool(size).map(function, items))

    def add_up(self, function: Callable[[Item], Result], items: Sequence[Item], add: Callable[[Result], None]) -> None:
        """Calls `add` with the result of each item: in the order of the items, so that a sum is the same for any number
        of threads, and in the thread that computed it, before that takes another item."""
        turn, turns = 0, Condition()
        after_error = len(items)

        def compute(numbered: tuple[int, Item]) -> None:
            nonlocal turn
            number, item = numbered
            try:
                result = function(item)
                with turns:
                    turns.wait_for(lambda: turn in (number, after_error))
                    if turn == number:
                        add(result)
                        turn += 1
                        turns.notify_all()
            except BaseException:
                with turns:
                    turn = after_error
                    turns.notify_all()
                raise

        self.map(compute, list(enumerate(items)))

    def _pool(self, size: int) -> ThreadPoolExecutor:
        if size not in self._pools:
            self._pools[size] = _single_threaded_pool(size)
        return self._pools[size]


def _single_threaded_pool(size: int) -> ThreadPoolExecutor:
    """Threads in which torch uses no further threads. All are started here, since torch's setting also holds for new
    threads.

    They end when the pool is no longer referred to.
    """
    pool, barrier, before = ThreadPoolExecutor(size), Barrier(size), torch.get_num_threads()

    def set_up() -> None:
        torch.get_num_threads()  # a thread's first call sets its number to the common one; only then can it be changed
        torch.set_num_threads(1)
        barrier.wait()  # so that no thread takes the task of another

    for task in [pool.submit(set_up) for _ in range(size)]:
        task.result()
    torch.set_num_threads(before)
    return pool


# --- device ----------------------------------------------------------------------------------------------------------


def resolve_torch_device(name: str = "auto") -> str:
    """A torch device that works: "cpu", "cuda", "cuda:1" or "mps"; "auto" is CUDA, else MPS, else the CPU.

    Raises UserError that lists the available devices when this one isn't available or has no complex FFT.
    """
    available = _available_devices()
    if name == "auto":
        return available[0]
    if name.split(":")[0] not in available:
        raise UserError("device", f'"{name}" isn\'t available', expected=f"one of {', '.join(available)}")
    try:
        torch.fft.fft2(torch.ones(4, 4, dtype=torch.complex64, device=name))
    except (RuntimeError, AssertionError) as error:
        text = str(error).splitlines()[0]
        raise UserError(
            "device", f'"{name}" doesn\'t work: {text}', expected=f"one of {', '.join(available)}"
        ) from error
    return name


def _available_devices() -> list[str]:
    cuda = ["cuda"] if torch.cuda.is_available() else []
    mps = ["mps"] if torch.backends.mps.is_available() else []
    return [*cuda, *mps, "cpu"]
