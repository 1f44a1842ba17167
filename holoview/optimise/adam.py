"""Adam (Kingma & Ba, arXiv:1412.6980) on tensors that the caller owns, and its falling step."""

from __future__ import annotations

import math

import torch

Tensor = torch.Tensor

_EPSILON = 1e-20  # beside gradients, whose scale is that of the loss: about 1e-9 a pixel


class Adam:
    """The two moments of a gradient, and the step they advise.

    floor: elements whose gradients are below this share of the r.m.s. of all take smaller steps, instead of full ones
    along nothing but noise.
    """

    def __init__(self, like: Tensor, betas: tuple[float, float], rms_floor: float = 0.0) -> None:
        self.betas, self.rms_floor = betas, rms_floor
        self.first_moment, self.second_moment = torch.zeros_like(like), torch.zeros_like(like)
        self.step_count = 0

    def unit_step(self, gradient: Tensor) -> Tensor:
        """The advised step at unit rate (to be subtracted), after one more gradient."""
        beta1, beta2 = self.betas
        self.step_count += 1
        self.first_moment.mul_(beta1).add_(gradient, alpha=1 - beta1)
        self.second_moment.mul_(beta2).addcmul_(gradient, gradient, value=1 - beta2)
        spread = self.second_moment.div(1 - beta2**self.step_count).sqrt_().add_(_EPSILON)
        if self.rms_floor:
            spread.clamp_min_(self.rms_floor * float(spread.square().mean().sqrt()))
        return self.first_moment.div(1 - beta1**self.step_count).div_(spread)

    def reset(self) -> None:
        """Begins anew."""
        self.first_moment.zero_()
        self.second_moment.zero_()
        self.step_count = 0


def sqrt_decay(done: int, total: int) -> float:
    """Falls from 1 to 0 while `done` goes from 0 to `total`: the root of the share that is left."""
    return math.sqrt(1 - min(done, total) / total)


def cosine_decay(done: float, total: int) -> float:
    """Falls from 1 to 0 while `done` goes from 0 to `total`."""
    return 0.5 * (1 + math.cos(math.pi * min(done, total) / total))
