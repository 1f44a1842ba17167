"""What the optimisation yields after each iteration: loss, PSNR and the best hologram so far."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from holoview.io.hologram import Hologram
from holoview.optimise.checkpoint import Checkpoint


@dataclass(frozen=True)
class IterationState:
    """The state of an optimisation after an iteration.

    iteration, iterations: number of this iteration, from 0, and of the last one. loss: with the eyebox's penalty.
    psnr_db: of linear sRGB clipped to 0…1, mean over planes (of luminance where only that is optimised).
    best_psnr_db, best: PSNR and hologram of the smallest loss so far; the latest where pupils are drawn.
    eyebox: coefficient of variation of the light in the eyebox, measured at most `amplitudes_every` iterations ago.
    seconds: time spent, including that before a checkpoint.
    picture(): the present image at the middle plane, linear sRGB (y, x, 3). checkpoint(): everything that is needed to
    continue. Both must be called before the next state is requested.
    """

    iteration: int
    iterations: int
    loss: float
    psnr_db: float
    best_psnr_db: float
    eyebox: float
    seconds: float
    best: Hologram
    picture: Callable[[], NDArray[np.floating]] = field(repr=False, compare=False)
    checkpoint: Callable[[], Checkpoint] = field(repr=False, compare=False)
