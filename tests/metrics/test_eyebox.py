"""Uniformity of the eyebox."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.holograms.metrics.image_quality import eyebox_uniformity
from holoview.util.errors import UserError


@pytest.mark.parametrize("shape", [(64, 64), (63, 100), (8, 8)])
def test_an_evenly_filled_eyebox_has_the_ideal_numbers(shape: tuple[int, int]) -> None:
    result = eyebox_uniformity(np.full(shape, 0.3))
    assert result.coefficient_of_variation == pytest.approx(0.0, abs=1e-14)
    assert result.uniformity == pytest.approx(1.0, abs=1e-14)
    assert result.centre_share == pytest.approx(1.0, abs=1e-14)


def test_light_in_the_central_spot_alone_is_sixty_four_times_too_much_there() -> None:
    spot = np.zeros((64, 64))
    spot[32, 32] = 5.0  # zero frequency, as fftshift puts it
    result = eyebox_uniformity(spot)
    assert result.centre_share == pytest.approx(64.0)
    assert result.uniformity == 0.0
    assert result.coefficient_of_variation == pytest.approx(np.sqrt(63))  # one block of 64 lit


def test_a_smooth_phase_empties_the_eyebox_and_a_random_one_fills_it() -> None:
    rng = np.random.default_rng(0)

    def filling(spread_rad: float) -> float:
        field = np.exp(1j * rng.uniform(0, spread_rad, (128, 128)))
        return eyebox_uniformity(np.fft.fftshift(np.abs(np.fft.fft2(field)) ** 2)).centre_share

    assert filling(2 * np.pi) == pytest.approx(1.0, abs=5.5 / 16)  # 256 samples of speckle in the centre: σ = 1/√256
    assert filling(1.0) > 50


def test_blocks_of_speckle_scatter_by_one_over_root_n() -> None:
    speckle = np.random.default_rng(1).exponential(size=(256, 256))
    result = eyebox_uniformity(speckle)
    # 64 blocks of 1024: σ of the estimate is 9 %, and by χ² half of it too much comes once in ten million
    assert result.coefficient_of_variation == pytest.approx(1 / 32, rel=0.5)


def test_an_envelope_is_divided_out() -> None:
    f = (np.arange(96) - 48) / 96
    envelope = np.sinc(f)[:, None] ** 2 * np.sinc(f)[None, :] ** 2
    assert eyebox_uniformity(envelope).uniformity < 0.5
    result = eyebox_uniformity(2 * envelope, envelope=envelope)
    assert result.uniformity == pytest.approx(1.0, abs=1e-14)


def test_rows_and_columns_are_not_confused() -> None:
    light = np.ones((16, 40))
    light[:8] = 3.0
    two = eyebox_uniformity(light, blocks=2)
    assert two.uniformity == pytest.approx(0.5)
    assert two.coefficient_of_variation == pytest.approx(0.5)
    assert eyebox_uniformity(light, blocks=1).coefficient_of_variation == 0.0


def test_what_makes_no_sense_is_refused() -> None:
    with pytest.raises(UserError, match="at least 8 samples"):
        eyebox_uniformity(np.ones((7, 64)))
    with pytest.raises(UserError, match="some light"):
        eyebox_uniformity(np.zeros((64, 64)))
    with pytest.raises(UserError, match="the eyebox's shape"):
        eyebox_uniformity(np.ones((64, 64)), envelope=np.ones((64, 63)))
    with pytest.raises(UserError, match="positive everywhere"):
        eyebox_uniformity(np.ones((64, 64)), envelope=np.zeros((64, 64)))
