"""Adam (Kingma & Ba, arXiv:1412.6980): moments and step, and two learning-rate schedules.

The caller owns the variables, so that they can be projected after each step or live in numpy.
"""

from __future__ import annotations

import math

import torch

Tensor = torch.Tensor

_EPSILON = 1e-20  # small beside gradients, which scale with the loss: about 1e-9 for one pixel


class Adam:
    """The exponential means m of a gradient g and v of its square, and the step that they give.

        m ← β₁·m + (1 − β₁)·g,   v ← β₂·v + (1 − β₂)·g²,   step = m/(1 − β₁ᵗ) / (√(v/(1 − β₂ᵗ)) + ε)

    variable: a tensor whose shape, type and device the moments take. betas: β₁ and β₂.
    rms_floor: lower bound of the denominator, as a fraction of its root mean square over all elements. Elements whose
    gradients are mostly noise then take smaller steps than the others, instead of equal ones.
    """

    def __init__(self, variable: Tensor, betas: tuple[float, float], rms_floor: float = 0.0) -> None:
        self.betas, self.rms_floor = betas, rms_floor
        self.first_moment, self.second_moment = torch.zeros_like(variable), torch.zeros_like(variable)
        self.step_count = 0

    def unit_step(self, gradient: Tensor) -> Tensor:
        """Updates the moments with a gradient and returns the step for learning rate 1, to be subtracted."""
        return self.corrected_step(gradient, *self.count_step())

    def count_step(self) -> tuple[float, float]:
        """Counts a step; its 1 − β₁ᵗ and 1 − β₂ᵗ."""
        self.step_count += 1
        beta1, beta2 = self.betas
        return 1 - beta1**self.step_count, 1 - beta2**self.step_count

    def corrected_step(self, gradient: Tensor, first: float | Tensor, second: float | Tensor) -> Tensor:
        """`unit_step` for a step that is counted already, with its 1 − β₁ᵗ and 1 − β₂ᵗ."""
        beta1, beta2 = self.betas
        self.first_moment.mul_(beta1).add_(gradient, alpha=1 - beta1)
        self.second_moment.mul_(beta2).addcmul_(gradient, gradient, value=1 - beta2)
        denominator = self.second_moment.div(second).sqrt_().add_(_EPSILON)
        if self.rms_floor:
            denominator.clamp_min_(self.rms_floor * float(denominator.square().mean().sqrt()))
        return self.first_moment.div(first).div_(denominator)

    def reset(self) -> None:
        """Sets the moments and the number of steps to zero."""
        self.first_moment.zero_()
        self.second_moment.zero_()
        self.step_count = 0


def sqrt_decay(done: int, total: int) -> float:
    """√(1 − done/total): falls from 1 to 0, most steeply at the end."""
    return math.sqrt(1 - min(done, total) / total)


def cosine_decay(done: float, total: int) -> float:
    """(1 + cos(π·done/total))/2: falls from 1 to 0, flat at both ends."""
    return 0.5 * (1 + math.cos(math.pi * min(done, total) / total))
