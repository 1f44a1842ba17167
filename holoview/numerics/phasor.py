"""Complex exponentials of phases that are given in turns."""

from __future__ import annotations

import math

import torch


def phasor_of_turns(turns: torch.Tensor) -> torch.Tensor:
    """exp(2πi·turns) of a real tensor of any shape, complex of the same precision.

    The turns are reduced modulo 1 first, so that thousands of turns cost no precision in the sine and cosine.
    """
    phase = (2 * math.pi) * torch.remainder(turns, 1.0)
    return torch.polar(torch.ones_like(phase), phase)
