"""Settings of the search for stuck columns, rows and pixels of a modulator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class StuckConfig:
    """Places that stand out from others, round after round, and the levels that they show."""

    level_count: int = 24
    """[levels] Shares of the stroke from 0 to 1 that are tried. Evidence: a stroke of two waves advances by half a
    radian from one to the next."""

    line_segments: int = 8
    """[segments] The gain of a line is the median of so many parts of it, times their number. Evidence: a block of
    stuck pixels reaches over one part or two, and isn't taken for a line."""

    part_segments: int = 3
    """[segments] A part of a line, from one edge on, is looked for from so many on. Evidence: as for `line_segments`:
    the median of three bears one that a block reaches over."""

    end_moves: tuple[int, ...] = (-8, -4, -2, -1, 1, 2, 4, 8)
    """[pixels] By which the end of a part of a line is moved, again and again, while χ² falls. Evidence: derivation:
    gains tell the end to some pixels."""

    min_line_sigmas: float = 5.0
    """[σ] Lines that stand out from the others by less aren't taken. Evidence: none recorded."""

    min_pixel_sigmas: float = 8.0
    """[σ] The same of single pixels, of which there are a hundred times as many. Evidence: none recorded."""

    near_best: float = 0.5
    """[1] Lines of this share of the best one's significance are taken in the same round, where their neighbours have
    less. Evidence: none recorded."""

    near_best_pixels: float = 0.6
    """[1] The same of pixels, but with their neighbours, since stuck pixels come in groups. Evidence: none recorded."""

    max_pixels: int = 48
    """[pixels] Where more stand out in a round, none does: another fault spreads over the modulator. Evidence: with
    stuck pixels it were up to 20, with the pixels of the other modulator 18 to 107."""

    max_round_error: float = 0.95
    """[1] A round must leave less than this share of the model's error. Evidence: places on the wrong modulator took
    away 2 to 5 % in a round; the value: none recorded."""

    max_error_share: float = 0.7
    """[1] … and all of them together less than this. Evidence: none recorded."""

    explained_error_share: float = 0.1
    """[1] Where so little is left, the other modulator isn't searched. Evidence: none recorded."""

    rounds: int = 12
    """[rounds] At most. Evidence: neighbours are taken in different rounds; the value: none recorded."""

    level_iterations: int = 6
    """[1] Iterations of L-BFGS on the levels in a round. Evidence: a local fit follows; the value: none recorded."""

    last_iterations: int = 24
    """[1] … and at the end, for lists that are too long for a local fit. Evidence: none recorded."""

    min_gain: float = 25.0
    """[Δχ²] A place must gain so much, times χ²/n where that is above 1. Evidence: 5 σ for one number, as for a cause
    (`VerdictConfig.min_delta_chi2`)."""

    max_places: int = 160
    """[places] No more are looked for. Evidence: a modulator with more needs repair; the value: none recorded."""

    @property
    def levels(self) -> NDArray[np.float64]:
        """The shares of the stroke that are tried."""
        return np.linspace(0.0, 1.0, self.level_count)
