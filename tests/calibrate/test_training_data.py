"""What is trained on is the lasers' light: known counts beside it are subtracted, and their noise stays."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from holoview.bench.calibrate.train import TrainingData
from holoview.bench.captures.dataset import Captures

KNOWN = {"camera_black": {"black": 5.0}, "ambient": {"level": 300.0, "slope_x": 60.0}}


def test_known_black_level_and_ambient_light_are_subtracted_and_no_weight_changes(small: Captures) -> None:
    plain, known = (TrainingData(small, effects).weighted_image(1) for effects in ({}, KNOWN))
    subtracted = (plain.light - known.light).numpy()
    rows, columns = small.shape
    x = (np.arange(columns) - (columns - 1) / 2) / (columns / 2)
    expected = 5.0 + (300 + 60 * x) * small.exposure_s[1]
    assert subtracted == pytest.approx(np.tile(expected, (rows, 1)), abs=2e-3)  # of 4095 counts in float32
    assert torch.equal(plain.weight, known.weight)
