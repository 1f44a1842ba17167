"""How a calibration is run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from holoview.util.errors import UserError

LEARNING_RATES: Mapping[str, float] = {
    "lut_steps": 0.03,
    "fringing_px2": 0.01,
    "source_log_amplitude": 0.02,
    "source_opd_m": 5e-9,
    "warp_m": 0.25e-6,
    "zernike1_m": 5e-9,
    "zernike2_m": 5e-9,
    "pupil1_log_amplitude": 0.02,
    "pupil2_log_amplitude": 0.02,
}
"""The first step of each tensor, in its own unit."""

ADAM_BETAS = (0.9, 0.95)

ADAM_FLOOR = 0.1
"""Elements that the captures say little about move less: Adam would have them follow the noise in full steps."""

_EPOCHS, _STEPS = 40, 300  # at least, of a calibration that isn't told how many


def default_epochs(captures: int, batch: int) -> int:
    """Epochs that make enough steps of so many training captures."""
    return max(_EPOCHS, math.ceil(_STEPS / math.ceil(captures / batch)))


@dataclass(frozen=True)
class CalibrationSettings:
    """epochs: how often every capture is seen. batch: captures a step. rate: factor of all steps. seed: of the order of
    captures and of what is held out. share: of the captures that is held out.
    """

    epochs: int = 40
    batch: int = 4
    rate: float = 1.0
    seed: int = 0
    share: float = 0.2

    def __post_init__(self) -> None:
        for name, low, high in (("epochs", 1, 100_000), ("batch", 1, 10_000)):
            value = getattr(self, name)
            if not low <= value <= high:
                raise UserError(name, str(value), expected=f"{low} to {high}")
        if not 0 < self.rate <= 100:
            raise UserError("rate", f"{self.rate:g}", expected="above 0, at most 100")
