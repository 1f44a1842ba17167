"""Laser amplitudes by non-negative least squares."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from scipy.optimize import nnls

from holoview.holograms.optimise.objective import AmplitudeLeastSquares

Noise = Callable[..., torch.Tensor]
PLANES, SHAPE = 2, (9, 11)


def _solve(
    intensity: torch.Tensor, colours: torch.Tensor, target: torch.Tensor, weights: tuple[float, ...] = (1.0, 1.0)
) -> np.ndarray:
    """Amplitudes for intensity (laser, plane, y, x), colours (laser, channel), target (plane, channel, y, x)."""
    problem = AmplitudeLeastSquares(colours.double().numpy())
    for plane, weight in enumerate(weights):
        problem.add(problem.normal_equations(intensity[:, plane], target[plane]), weight)
    return problem.solve()


def _image(intensity: torch.Tensor, colours: torch.Tensor, amplitudes: object) -> torch.Tensor:
    factors = torch.as_tensor(np.asarray(amplitudes), dtype=torch.float64)
    return torch.einsum("jpyx,jc,j->pcyx", intensity, colours, factors)


def _squared_error(intensity: torch.Tensor, colours: torch.Tensor, target: torch.Tensor, a: object) -> float:
    return float((_image(intensity, colours, a) - target).square().sum())


@pytest.mark.parametrize("channels", [1, 3])
def test_the_amplitudes_that_made_an_image_are_recovered(channels: int, noise: Noise) -> None:
    intensity = noise(0, 5, PLANES, *SHAPE)
    colours = noise(1, 5, channels) - 0.2  # lasers lie outside the gamut: channels may be negative
    known = [0.3, 2.0, 0.0, 1.0, 0.7]
    found = _solve(intensity, colours, _image(intensity, colours, known))
    np.testing.assert_allclose(found, known, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("scale", [1e-8, 1e6])
def test_very_bright_and_very_dim_lasers_are_solved_alike(scale: float, noise: Noise) -> None:
    intensity = noise(0, 3, PLANES, *SHAPE)
    intensity[1] *= scale
    colours, known = noise(1, 3, 3), [0.3, 2.0 / scale, 1.0]
    found = _solve(intensity, colours, _image(intensity, colours, known))
    np.testing.assert_allclose(found, known, rtol=1e-8)


@pytest.mark.parametrize("weights", [(1.0, 1.0), (0.5, 1.5)], ids=["equal planes", "weighted planes"])
def test_no_amplitude_is_negative_and_none_could_be_better(weights: tuple[float, ...], noise: Noise) -> None:
    intensity, colours = noise(2, 6, PLANES, *SHAPE), noise(3, 6, 3) - 0.3
    # Free of the bound the best are these six, so that with it one is zero at least.
    target = _image(intensity, colours, [-1.0, 0.3, 2.0, 0.5, 1.0, 0.7])
    root = torch.tensor(weights).double().sqrt().reshape(-1, 1, 1, 1)
    found = _solve(intensity, colours, target, weights)
    alone = [_image(i[None], c[None], [1.0]) * root for i, c in zip(intensity, colours, strict=True)]
    columns = np.stack([image.numpy().ravel() for image in alone], axis=1)
    expected, residual = nnls(columns, (target * root).numpy().ravel())
    assert (found >= 0).all()
    assert (expected == 0).any()
    np.testing.assert_allclose(found, expected, atol=1e-9)
    error = (_image(intensity, colours, found) - target) * root
    assert float(error.square().sum()) == pytest.approx(residual**2, rel=1e-9)


def test_a_plane_of_no_weight_has_no_say(noise: Noise) -> None:
    intensity, colours, target = noise(2, 3, PLANES, *SHAPE), noise(3, 3, 3), noise(4, PLANES, 3, *SHAPE)
    alone = _solve(intensity[:, :1], colours, target[:1], (1.0,))
    np.testing.assert_allclose(_solve(intensity, colours, target, (1.0, 0.0)), alone, rtol=1e-12)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_nearly_parallel_intensities_still_give_the_best_image_and_finite_shares(
    dtype: torch.dtype, noise: Noise
) -> None:
    base = noise(5, PLANES, *SHAPE)
    intensity = base + 1e-5 * noise(6, 4, PLANES, *SHAPE)
    colours = torch.ones(4, 1, dtype=torch.float64)
    target = (3 * base)[:, None]
    found = _solve(intensity.to(dtype), colours, target.to(dtype))
    assert (found >= 0).all() and np.isfinite(found).all()
    assert found.sum() == pytest.approx(3.0, rel=1e-3)
    power = float(target.square().sum())
    assert _squared_error(intensity, colours, target, found) <= 1e-6 * power


def test_a_black_target_switches_every_laser_off(noise: Noise) -> None:
    black = torch.zeros(PLANES, 3, *SHAPE, dtype=torch.float64)
    assert _solve(noise(7, 3, PLANES, *SHAPE), noise(8, 3, 3), black).tolist() == [0.0, 0.0, 0.0]


def test_a_laser_that_sends_no_light_leaves_the_others_as_they_were(noise: Noise) -> None:
    intensity, colours = noise(7, 3, PLANES, *SHAPE), noise(8, 3, 3)
    intensity[1] = 0
    found = _solve(intensity, colours, _image(intensity, colours, [0.3, 0.0, 1.0]))
    np.testing.assert_allclose(found[[0, 2]], [0.3, 1.0], rtol=1e-10)
    assert np.isfinite(found[1]) and found[1] >= 0


def test_where_no_light_arrives_at_all_no_laser_is_on(noise: Noise) -> None:
    dark = torch.zeros(2, PLANES, *SHAPE, dtype=torch.float64)
    assert _solve(dark, noise(8, 2, 3), noise(9, PLANES, 3, *SHAPE)).tolist() == [0.0, 0.0]
