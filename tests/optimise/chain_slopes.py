"""The derivative of a chain's loss along a drawn direction, as the tests of its optimiser measure it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import torch

from holoview.holograms.optimise.chain_loop import ChainProblem
from holoview.light.model.system import System

Tensors = dict[str, torch.Tensor]


def free_drives(patterns: Mapping[str, np.ndarray], rng: np.random.Generator) -> tuple[Tensors, Tensors]:
    """Patterns in double precision that have derivatives, and a drawn direction for each."""
    drives, ways = Tensors(), Tensors()
    for key, drive in patterns.items():
        is_complex = np.iscomplexobj(drive)
        drives[key] = torch.from_numpy(drive.astype(complex if is_complex else float)).requires_grad_()
        way = rng.normal(size=drive.shape)
        ways[key] = torch.from_numpy(way + 1j * rng.normal(size=drive.shape) if is_complex else way)
    return drives, ways


def slope_along(
    problem: ChainProblem, system: System, drives: Tensors, ways: Tensors
) -> tuple[float, Callable[[float], torch.Tensor]]:
    """The loss's derivative along the directions by torch, and the loss at a step along them."""

    def loss(step: float) -> torch.Tensor:
        moved = {key: drive + step * ways[key] for key, drive in drives.items()}
        return problem.loss(problem.evaluate(moved, system.amplitudes), system.amplitudes)[0]

    gradients = torch.autograd.grad(loss(0.0), list(drives.values()))
    pairs = zip(drives, gradients, strict=True)
    return sum(float((gradient.conj() * ways[key]).real.sum()) for key, gradient in pairs), loss
