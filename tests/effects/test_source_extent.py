"""A disc of directions has the mean and the variance of a disc, and washes out speckle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from holoview.bench.captures.dataset import Captures
from holoview.light.effects.illumination import directions_per_side, spot_directions
from holoview.light.model.bench_parts import Relay
from holoview.light.model.effects.registry import get_effect

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


@pytest.mark.parametrize("radius", [0.2e-3, 2e-3, 5e-3])
@pytest.mark.parametrize("outline", [-1.0, -0.3, 0.0, 0.5, 1.0])
def test_directions_have_the_mean_and_variance_of_a_disc(radius: float, outline: float, make_session: Make) -> None:
    effect = get_effect("source_extent")
    system = effect.actual_system(
        make_session().nominal_system(), effect.parameter_values({"radius": radius, "outline": outline})
    )
    found = system.source.directions_rad
    assert np.abs(found.mean(axis=0)).max() < 1e-12
    assert (found**2).mean(axis=0) == pytest.approx([radius**2 / 4] * 2, rel=1e-9)  # ∫y²·2πr dr/(πR²)
    assert 9 <= len(found) <= 121


def test_outlines_are_what_they_are_called() -> None:
    side = 41
    disc, square, gauss = (spot_directions(side, outline) for outline in (0.0, 1.0, -1.0))
    assert np.hypot(*disc.T).max() == pytest.approx(1.0, abs=1.5 / side)
    assert np.abs(square).max() == pytest.approx(0.75**0.5, abs=1 / side)  # half a side: its square over 3 is 1/4
    inner = np.hypot(*disc.T) < 0.5
    assert inner.mean() == pytest.approx(0.25, abs=0.02)  # equal areas
    kurtosis = (gauss[:, 0] ** 4).mean() / (gauss[:, 0] ** 2).mean() ** 2
    assert kurtosis == pytest.approx(3.0, abs=0.3)  # its tail ends with the grid's cells; a disc has 2.0, a square 1.8


@pytest.mark.parametrize(
    ("radius", "side"),
    [(1e-5, 3), (2e-3, 5), (5e-3, 8), (20e-3, 9)],  # 2 × 2 mrad × 28 × 8 µm / 400 nm = 2.2: 3 and two more
)
def test_as_many_directions_as_grains_of_speckle_pass(
    make_session: Make, make_fourier: Make, radius: float, side: int
) -> None:
    for captures in (make_session(), make_fourier(), make_session(relay2=Relay(square="first order"))):
        for λ in (450e-9, 650e-9):
            for distance_m in (1e-3, 30e-3):
                system = captures.nominal_system([λ], [distance_m])
                assert directions_per_side(system, radius) == side


@pytest.mark.long
def test_the_mean_is_that_of_a_disc(make_session: Make, predicted: Predicted) -> None:
    """Against 15 rings of equal area with 15 directions each.

    The finest speckle, u = 2 × 0.03/520 nm, turns by κ = 2π·u·z·radius = 1.45 behind 4 mm. 3 × 3 directions keep 0.3 %
    of its amplitude too much, and less of all other light.
    """
    captures, radius = make_session(1), 0.5e-3
    found = predicted(captures, {"source_extent": {"radius": radius}})[0]
    rings = [(((k + 0.5) / 15) ** 0.5, 2 * np.pi * (m + k % 2 / 2) / 15) for k in range(15) for m in range(15)]
    tilts = ({"tilt": {"tilt_y": radius * r * np.sin(a), "tilt_x": radius * r * np.cos(a)}} for r, a in rings)
    expected = torch.stack([predicted(captures, tilt)[0] for tilt in tilts]).mean(dim=0)
    error = float((found - expected).norm() / expected.norm())
    assert error < 0.003


def test_speckle_washes_out(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(1)
    pictures = (predicted(captures, {"source_extent": {"radius": r}})[0, 10:-10, 10:-10] for r in (0.0, 3e-3))
    contrast = [float(picture.std() / picture.mean()) for picture in pictures]
    assert contrast[1] < 0.7 * contrast[0]
