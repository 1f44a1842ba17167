"""How to optimise."""

from __future__ import annotations

import math
from dataclasses import dataclass

from holoview.errors import UserError


@dataclass(frozen=True)
class Settings:
    """How to optimise. step_rad: Adam's first step, as phase at the middle wavelength; it falls to zero as a cosine.

    Raises UserError for counts below 1, a step that isn't positive, and betas outside 0…1.
    """

    iterations: int = 60
    step_rad: float = 1.0
    betas: tuple[float, float] = (0.9, 0.99)
    amplitudes_every: int = 10
    seed: int = 0

    def __post_init__(self) -> None:
        for key, count in (("iterations", self.iterations), ("amplitudes_every", self.amplitudes_every)):
            if not isinstance(count, int) or count < 1:
                raise UserError(key, str(count), expected="at least 1")
        if not 0 < self.step_rad < math.inf:
            raise UserError("step", str(self.step_rad), expected="a positive phase step")
        if not all(0 <= beta < 1 for beta in self.betas):
            raise UserError("betas", str(self.betas), expected="numbers from 0 to below 1")
