"""A disc of directions has the mean and the variance of a disc, and washes out speckle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from holoview.captures.session import Captures
from holoview.effects.registry import effect

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


@pytest.mark.parametrize("radius", [0.2e-3, 2e-3, 5e-3])
def test_directions_fill_a_disc(radius: float, make_session: Make) -> None:
    one = effect("source_extent")
    found = one.bench(make_session().system(), one.values({"radius": radius})).source.directions_rad
    assert np.abs(found.mean(axis=0)).max() < 1e-12
    assert (found**2).sum(axis=1).mean() == pytest.approx(radius**2 / 2, rel=0.03)  # ∫r²·2πr dr/(πR²)
    assert 7 <= len(found) <= 127


def test_speckle_washes_out(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(1)
    contrast = [
        float(p.std() / p.mean())
        for p in (predicted(captures, {"source_extent": {"radius": r}})[0, 10:-10, 10:-10] for r in (0.0, 3e-3))
    ]
    assert contrast[1] < 0.7 * contrast[0]
