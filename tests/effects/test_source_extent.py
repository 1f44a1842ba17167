"""A disc of directions has the mean and the variance of a disc, and washes out speckle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from holoview.captures.dataset import Captures
from holoview.effects.illumination import spot_directions
from holoview.model.bench_parts import Relay
from holoview.model.effects.registry import get_effect

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


def test_as_many_directions_as_the_speckle_asks_for(make_session: Make, make_fourier: Make) -> None:
    """Near by, it moves by 4 mm × 2 × 2 mrad over speckle of 520 nm/0.06; behind a lens by the aperture over λ.

    16 µm / 8.7 µm = 1.85 and 2 × 2 mrad × 28 × 8 µm / 520 nm = 1.72: two directions more than either.
    """
    effect = get_effect("source_extent")
    assert effect.directions_per_side(make_session().nominal_system(), 2e-3) == 4
    assert effect.directions_per_side(make_fourier().nominal_system(), 2e-3) == 4


def test_a_square_stop_counts_by_its_corners(make_session: Make) -> None:
    """4 mm × 2 × 10 mrad of movement over speckle of 520 nm/(2·s); a wide stop passes no more than the modulator."""
    effect, modulator = get_effect("source_extent"), 28 * 8e-6 / 2 / 4e-3
    for square, sine in ((0.005, 0.005 * 2**0.5), (0.012, 0.012 * 2**0.5), ("first order", modulator)):
        system = make_session(relay1=Relay(), relay2=Relay(square=square)).nominal_system()
        assert effect.directions_per_side(system, 10e-3) == np.ceil(4e-3 * 20e-3 * 2 * sine / 520e-9) + 2


def test_speckle_washes_out(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(1)
    pictures = (predicted(captures, {"source_extent": {"radius": r}})[0, 10:-10, 10:-10] for r in (0.0, 3e-3))
    contrast = [float(picture.std() / picture.mean()) for picture in pictures]
    assert contrast[1] < 0.7 * contrast[0]
