"""What an optimisation shows after each iteration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from holoview.io.hologram import Hologram
from holoview.optimise.checkpoint import Checkpoint


@dataclass(frozen=True)
class IterationState:
    """Where the optimisation stands after an iteration; `best` is the hologram of least loss so far.

    psnr_db: of linear sRGB clipped to 0…1, mean over planes (of luminance where only that is optimised).
    eyebox: coefficient of variation of the eyebox's filling when it was last judged, at most `amplitudes_every`
    iterations ago. picture(): the middle plane as it is now, linear sRGB (y, x, 3). checkpoint(): all that continues
    from here. Call both before the next state is asked for.
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
