"""A line has the mean and the variance of a Gaussian; a narrow one changes nothing to first order."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.bench.captures.dataset import Captures
from holoview.light.model.effects.registry import get_effect

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


@pytest.mark.parametrize("sigma", [0.5e-9, 4e-9, 9e-9])
@pytest.mark.parametrize("top", [0.0, 0.4, 1.0])
def test_each_wavelength_becomes_a_line_of_that_width(sigma: float, top: float) -> None:
    effect, system = get_effect("bandwidth"), hv.load("holochrome-8")
    found = effect.actual_system(system, effect.parameter_values({"sigma": sigma, "top": top}))
    lines = found.wavelengths_m.reshape(8, -1)
    weights = found.amplitudes[0].reshape(8, -1)
    assert weights.sum(axis=1) == pytest.approx(system.amplitudes[0])
    share = weights / weights.sum(axis=1, keepdims=True)
    mean = (share * lines).sum(axis=1)
    assert mean == pytest.approx(system.wavelengths_m, rel=1e-12)
    assert (share * (lines - mean[:, None]) ** 2).sum(axis=1) ** 0.5 == pytest.approx(np.full(8, sigma), rel=1e-6)


def test_what_changes_goes_by_the_square_of_the_width(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(1)
    plain = predicted(captures)
    single, double = (
        float((predicted(captures, {"bandwidth": {"sigma": s}}) - plain).norm()) for s in (0.1e-9, 0.2e-9)
    )
    assert double / single == pytest.approx(4.0, rel=0.02)
