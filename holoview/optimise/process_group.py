"""Splits the lasers of one optimisation over several processes or GPUs (torch.distributed).

The image is the sum of the lasers' intensities, so that no process needs the fields of another. The processes sum their
images at each plane, then the gradients of the patterns and the light in the eyebox. To solve for laser amplitudes,
each broadcasts its intensities once, for the products of lasers of different processes. Every process holds all
patterns, and takes the same step with the same numbers.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import torch
import torch.distributed as dist

from holoview.model.plan import Plan
from holoview.optimise.lasers import Laser, lit_lasers
from holoview.util.errors import UserError

Tensor = torch.Tensor

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
