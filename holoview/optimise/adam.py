"""Adam (Kingma & Ba, arXiv:1412.6980) on tensors that the caller owns, and its falling step."""

from __future__ import annotations

import math

import torch

Tensor = torch.Tensor

_LEAST = 1e-20  # beside gradients, whose scale is that of the loss: about 1e-9 a pixel


class Adam:
    """The two moments of a gradient, and the step they advise.

    floor: elements whose gradients are below this share of the r.m.s. of all take smaller steps, instead of full ones
    along nothing but noise.
    """

    def __init__(self, like: Tensor, betas: tuple[float, float], floor: float = 0.0) -> None:
        self.betas, self.floor = betas, floor
        self.first, self.second = torch.zeros_like(like), torch.zeros_like(like)
        self.count = 0

    def direction(self, gradient: Tensor) -> Tensor:
        """The advised step at unit rate (to be subtracted), after one more gradient."""
        beta1, beta2 = self.betas
        self.count += 1
        self.first.mul_(beta1).add_(gradient, alpha=1 - beta1)
        self.second.mul_(beta2).addcmul_(gradient, gradient, value=1 - beta2)
        spread = self.second.div(1 - beta2**self.count).sqrt_().add_(_LEAST)
        if self.floor:
            spread.clamp_min_(self.floor * float(spread.square().mean().sqrt()))
        return self.first.div(1 - beta1**self.count).div_(spread)

    def forget(self) -> None:
        """Begins anew."""
        self.first.zero_()
        self.second.zero_()
        self.count = 0


def fall(done: int, total: int) -> float:
    """Falls from 1 to 0 while `done` goes from 0 to `total`: the root of the share that is left."""
    return math.sqrt(1 - min(done, total) / total)


def cosine(done: float, total: int) -> float:
    """Falls from 1 to 0 while `done` goes from 0 to `total`."""
    return 0.5 * (1 + math.cos(math.pi * min(done, total) / total))
