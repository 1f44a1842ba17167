"""Brightness falls by the stated share at the edges' middles; a part of a larger picture falls off to one side."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from holoview.light.model import preset
from holoview.light.model.effects.hook_contexts import CameraContext
from holoview.light.model.effects.registry import get_effect

Floats = NDArray[np.float64]


def test_the_edges_lose_their_share() -> None:
    effect = get_effect("vignetting")
    found = effect.image(
        torch.ones(201, 301).double(),
        CameraContext(4e-6, (201, 301)),
        effect.parameter_values({"fall_y": 0.2, "fall_x": 0.4}),
    )
    assert float(found[100, 150]) == 1.0
    assert float(found[0, 150]) == pytest.approx(0.8, abs=0.003)
    assert float(found[100, -1]) == pytest.approx(0.6, abs=0.003)


@pytest.mark.parametrize(
    ("bend", "expected"),
    [(1.0, lambda q: np.exp(-q)), (1.5, lambda q: np.cos(np.arctan(np.sqrt(q / 2))) ** 4), (0.0, lambda q: 1 - q)],
    ids=["Gaussian", "cos⁴", "parabola"],
)
def test_the_bend_makes_other_known_fall_offs(bend: float, expected: Callable[[Floats], Floats]) -> None:
    effect, shape = get_effect("vignetting"), (64, 80)
    values = effect.parameter_values({"fall_y": 0.2, "fall_x": 0.3, "bend": bend})
    found = effect.image(torch.ones(shape, dtype=torch.float64), CameraContext(4e-6, shape), values).numpy()
    y, x = (np.arange(n) - (n - 1) / 2 for n in shape)
    q = 0.2 * (y[:, None] / 32) ** 2 + 0.3 * (x / 40) ** 2
    np.testing.assert_allclose(found, expected(q), rtol=1e-12)


def test_the_bend_is_continuous_at_the_gaussian() -> None:
    """Where the series begins, it differs from the power by 1e-6·q⁴/4 at most, here for q up to 0.5."""
    effect, shape = get_effect("vignetting"), (64, 80)
    at = []
    for bend in (0.99, 0.990001, 1.009999, 1.01):
        values = effect.parameter_values({"fall_y": 0.2, "fall_x": 0.3, "bend": bend})
        at.append(effect.image(torch.ones(shape, dtype=torch.float64), CameraContext(4e-6, shape), values))
    for power, series in ((at[0], at[1]), (at[3], at[2])):
        slope = 1e-6 * 0.5**2 / 2  # of the way between the bends
        assert float((power - series).abs().max()) < slope + 1e-6 * 0.5**4 / 4


def test_a_part_of_a_larger_picture_is_the_same_fall_off_with_slopes() -> None:
    """A fall-off of 0.4 (y) and 0.3 (x), cut out about (0.2, −0.4) with half its height and width, up to a factor."""
    effect = get_effect("vignetting")
    whole = effect.image(
        torch.ones(200, 300).double(),
        CameraContext(4e-6, (200, 300)),
        effect.parameter_values({"fall_y": 0.4, "fall_x": 0.3}),
    )
    part = whole[70:170, 15:165]  # its middle is 20 rows below and 60 columns left of the whole's
    centre = 1 - 0.4 * 0.2**2 - 0.3 * 0.4**2
    values = {
        "fall_y": 0.4 * 0.5**2 / centre,
        "fall_x": 0.3 * 0.5**2 / centre,
        "slope_y": -2 * 0.4 * 0.5 * 0.2 / centre,
        "slope_x": 2 * 0.3 * 0.5 * 0.4 / centre,
    }
    found = effect.image(
        torch.full((100, 150), centre, dtype=torch.float64),
        CameraContext(4e-6, (100, 150)),
        effect.parameter_values(values),
    )
    torch.testing.assert_close(found, part, rtol=1e-12, atol=0)
    text = effect.format_finding(preset.load("simultaneous"), values)
    assert text.endswith(
        "towards its edges, and is brighter on one side: by -0.0855 at the lower, 0.128 at the right edge."
    )
