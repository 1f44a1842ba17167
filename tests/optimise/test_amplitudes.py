"""Laser amplitudes in closed form: non-negative least squares of the image."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.optimize import nnls

from holoview.optimise.amplitudes import solve_amplitudes

PLANES, SHAPE = 2, (9, 11)


def _random(seed: int, *shape: int) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def _image(intensities: list[torch.Tensor], colours: torch.Tensor, amplitudes: torch.Tensor) -> torch.Tensor:
    return torch.einsum("jpyx,jc,j->pcyx", torch.stack(intensities), colours, amplitudes)


def _squared_error(intensities: list[torch.Tensor], colours: torch.Tensor, target: torch.Tensor, a: object) -> float:
    image = _image(intensities, colours, torch.as_tensor(np.asarray(a), dtype=torch.float64))
    return float((image - target).square().sum())


@pytest.mark.parametrize("channels", [1, 3])
def test_the_amplitudes_that_made_an_image_are_recovered(channels: int) -> None:
    intensities = list(_random(0, 5, PLANES, *SHAPE))
    colours = _random(1, 5, channels) - 0.2  # lasers lie outside the gamut: channels may be negative
    known = torch.tensor([0.3, 2.0, 0.0, 1.0, 0.7], dtype=torch.float64)
    found = solve_amplitudes(intensities, colours, _image(intensities, colours, known))
    np.testing.assert_allclose(found, known, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("scale", [1e-8, 1e6])
def test_very_bright_and_very_dim_lasers_are_solved_alike(scale: float) -> None:
    intensities = list(_random(0, 3, PLANES, *SHAPE))
    intensities[1] = intensities[1] * scale
    colours = _random(1, 3, 3)
    known = torch.tensor([0.3, 2.0 / scale, 1.0], dtype=torch.float64)
    found = solve_amplitudes(intensities, colours, _image(intensities, colours, known))
    np.testing.assert_allclose(found, known, rtol=1e-8)


def test_no_amplitude_is_negative_and_none_could_be_better() -> None:
    intensities, colours = list(_random(2, 6, PLANES, *SHAPE)), _random(3, 6, 3) - 0.3
    target = _random(4, PLANES, 3, *SHAPE)
    found = solve_amplitudes(intensities, colours, target)
    columns = np.stack(
        [
            _image([i], c[None], torch.ones(1, dtype=torch.float64)).numpy().ravel()
            for i, c in zip(intensities, colours, strict=True)
        ],
        axis=1,
    )
    expected, residual = nnls(columns, target.numpy().ravel())
    assert (found >= 0).all()
    assert (expected == 0).any()  # the bound matters in this case
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert _squared_error(intensities, colours, target, found) == pytest.approx(residual**2, rel=1e-9)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_nearly_parallel_intensities_still_give_the_best_image_and_finite_shares(dtype: torch.dtype) -> None:
    base = _random(5, PLANES, *SHAPE)
    intensities = [base + 1e-5 * _random(6 + i, PLANES, *SHAPE) for i in range(4)]
    colours = torch.ones(4, 1, dtype=torch.float64)
    target = (3 * base)[:, None]
    found = solve_amplitudes([i.to(dtype) for i in intensities], colours.to(dtype), target.to(dtype))
    assert (found >= 0).all() and np.isfinite(found).all()
    assert found.sum() == pytest.approx(3.0, rel=1e-3)
    power = float(target.square().sum())
    assert _squared_error(intensities, colours, target, found) <= 1e-6 * power


def test_a_black_target_switches_every_laser_off() -> None:
    intensities, colours = list(_random(7, 3, PLANES, *SHAPE)), _random(8, 3, 3)
    found = solve_amplitudes(intensities, colours, torch.zeros(PLANES, 3, *SHAPE, dtype=torch.float64))
    assert found.tolist() == [0.0, 0.0, 0.0]


def test_a_laser_that_sends_no_light_leaves_the_others_as_they_were() -> None:
    intensities, colours = list(_random(7, 3, PLANES, *SHAPE)), _random(8, 3, 3)
    intensities[1] = torch.zeros_like(intensities[1])
    known = torch.tensor([0.3, 0.0, 1.0], dtype=torch.float64)
    found = solve_amplitudes(intensities, colours, _image(intensities, colours, known))
    np.testing.assert_allclose(found[[0, 2]], [0.3, 1.0], rtol=1e-10)
    assert np.isfinite(found[1]) and found[1] >= 0


def test_where_no_light_arrives_at_all_the_result_is_finite() -> None:
    dark, colours = [torch.zeros(PLANES, *SHAPE, dtype=torch.float64)] * 2, _random(8, 2, 3)
    found = solve_amplitudes(dark, colours, _random(9, PLANES, 3, *SHAPE))
    assert np.isfinite(found).all() and (found >= 0).all()
