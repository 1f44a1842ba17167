"""Processes that share one optimisation: each propagates some of the lasers, and all of them see the same picture.

A picture is the sum of the lasers' intensities, so nobody needs another's fields. At each plane the partial pictures
are added up; after the planes, the patterns' gradients and the eyebox's light; and where laser amplitudes are solved,
the intensities pass by once, for the products of lasers that live apart. Then every process takes the same step with
the same numbers, from a drive that all of them hold.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
import torch
import torch.distributed as dist

from holoview.model.plan import Plan
from holoview.util.errors import UserError

Tensor = torch.Tensor
Laser = tuple[int, int]
"""Frame and wavelength, by index."""

_RANK, _SIZE, _LOCAL_RANK = "RANK", "WORLD_SIZE", "LOCAL_RANK"  # torchrun sets them


@dataclass(frozen=True)
class ProcessGroup:
    """This process's place among `size` of them; alone, nothing is sent. device: where what is sent has to be."""

    rank: int = 0
    size: int = 1
    device: str = "cpu"

    @property
    def is_main(self) -> bool:
        """Whether this is the one process that talks and writes files."""
        return self.rank == 0

    def shard(self, total: int, rank: int | None = None) -> slice:
        """Which of `count` things a process has (this one when None): neighbours, as equally many as can be."""
        mine = self.rank if rank is None else rank
        return slice(total * mine // self.size, total * (mine + 1) // self.size)

    def all_reduce_sum(self, *tensors: Tensor) -> None:
        """Each becomes its sum over the processes, in place."""
        if self.size == 1:
            return
        for tensor in tensors:
            total = tensor.to(self.device).contiguous()
            dist.all_reduce(total)
            if total is not tensor:
                tensor.copy_(total)

    def broadcast_shards(self, own_rows: Tensor, total: int) -> Iterator[tuple[slice, Tensor]]:
        """Everybody's part of `count` rows, one process after the other: its place and its rows (n, …)."""
        if self.size == 1:
            yield slice(0, total), own_rows
            return
        for rank in range(self.size):
            place = self.shard(total, rank)
            length = place.stop - place.start
            rows = own_rows.contiguous() if rank == self.rank else own_rows.new_empty(length, *own_rows.shape[1:])
            dist.broadcast(rows, src=rank)
            yield place, rows

    def any_rank(self, flag: bool) -> bool:
        """Whether it holds for any process: what they have to agree on, such as when to stop."""
        count = torch.tensor([float(flag)])
        self.all_reduce_sum(count)
        return bool(count > 0)


SINGLE_PROCESS = ProcessGroup()
"""One process that does everything."""


def shard_lasers(plan: Plan, group: ProcessGroup) -> list[list[Laser]]:
    """The lasers that are on, process by process. Raises UserError for more processes than lasers.

    Those of one wavelength stay together, because transfer functions take the most memory; frame by frame in each part,
    as a model has them.
    """
    lit = sorted(((int(frame), int(λ)) for frame, λ in np.argwhere(plan.weights > 0)), key=lambda laser: laser[1])
    if len(lit) < group.size:
        raise UserError(
            "processes", f"{group.size} of them for {len(lit)} lasers", expected="a laser for each at least"
        )
    return [sorted(lit[group.shard(len(lit), rank)]) for rank in range(group.size)]


def with_only_lasers(plan: Plan, lasers: Sequence[Laser]) -> Plan:
    """The plan with only some of its lasers on."""
    weights = np.zeros_like(plan.weights)
    for laser in lasers:
        weights[laser] = plan.weights[laser]
    return replace(plan, weights=weights)


@contextmanager
def torchrun_group(device: str) -> Iterator[ProcessGroup]:
    """This process as one of those that torchrun started, until the block ends; device: of torch, with its number.

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
    """Which of a machine's CUDA devices this process takes, unless one was chosen; others stay as they are."""
    return f"cuda:{os.environ.get(_LOCAL_RANK, '0')}" if device == "cuda" else device
