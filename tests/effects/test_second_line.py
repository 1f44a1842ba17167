"""Two lines have the mean and the variance of two points, and add in intensity."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.bench.captures.dataset import Captures
from holoview.light.model.effects.registry import get_effect

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


@pytest.mark.parametrize(("share", "offset"), [(0.1, 2e-9), (0.5, -6e-9), (0.45, 20e-9)])
def test_each_laser_becomes_two_lines(share: float, offset: float) -> None:
    effect, system = get_effect("second_line"), hv.load("holochrome-8")
    found = effect.actual_system(system, effect.parameter_values({"share": share, "offset": offset}))
    lines, power = found.wavelengths_m.reshape(8, 2), found.amplitudes[0].reshape(8, 2)
    assert power.sum(axis=1) == pytest.approx(system.amplitudes[0])
    weight = power / power.sum(axis=1, keepdims=True)
    mean = (weight * lines).sum(axis=1)
    assert mean == pytest.approx(system.wavelengths_m + share * offset)
    variance = (weight * (lines - mean[:, None]) ** 2).sum(axis=1)
    assert variance == pytest.approx(np.full(8, share * (1 - share) * offset**2))


def test_the_picture_is_the_mean_of_those_of_both_lines(make_session: Make, predicted: Predicted) -> None:
    captures, share, offset = make_session(1), 0.3, 4e-9
    first, second = predicted(captures), predicted(captures, {"wavelength_offset": {"offset": offset}})
    both = predicted(captures, {"second_line": {"share": share, "offset": offset}})
    torch.testing.assert_close(both, (1 - share) * first + share * second, rtol=1e-12, atol=0)


@pytest.mark.parametrize("values", [{"share": 0.0, "offset": 9e-9}, {"share": 0.4, "offset": 0.0}])
def test_a_line_without_light_or_on_the_first_changes_no_bit(
    make_session: Make, predicted: Predicted, values: dict[str, float]
) -> None:
    captures = make_session(1)
    assert torch.equal(predicted(captures, {"second_line": values}), predicted(captures))
