"""Settings of a calibration, and the learning rate of each tensor."""

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
"""First step of Adam for each tensor, in the tensor's unit; `CalibrationSettings.rate` multiplies all of them."""

ADAM_BETAS = (0.9, 0.95)

ADAM_FLOOR = 0.1
"""Lower bound of Adam's denominator as a share of its r.m.s. over a tensor (`rms_floor`).

Elements that the captures hardly determine, whose gradients are mostly noise, then move less than the others.
"""

_MIN_EPOCHS, _MIN_STEPS = 40, 300  # of a calibration without --epochs


def default_epochs(captures: int, batch: int) -> int:
    """Epochs for a number of training captures: at least 300 steps and at least 40 epochs."""
    return max(_MIN_EPOCHS, math.ceil(_MIN_STEPS / math.ceil(captures / batch)))


@dataclass(frozen=True)
class CalibrationSettings:
    """How to train. The field names are keys of checkpoints and appear in error messages.

    epochs: number of passes over the training captures.
    batch: captures per step.
    rate: factor on all LEARNING_RATES.
    seed: of the order of the captures and of the choice of validation captures.
    share: of the captures that is held out for validation, see `split_captures`.
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
