"""Adam's step, its floor and the decay of the learning rate."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
import torch

from holoview.holograms.optimise.adam import Adam, sqrt_decay

BETAS = (0.9, 0.99)


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e6])
@pytest.mark.parametrize("betas", [BETAS, (0.0, 0.0), (0.5, 0.999)])
def test_the_first_step_has_unit_size_and_the_gradients_sign(size: float, betas: tuple[float, float]) -> None:
    gradient = size * torch.tensor([3.0, -0.2, 1.0], dtype=torch.float64)
    step = Adam(gradient, betas).unit_step(gradient)
    # √ of a gradient of 2e-10 squared stands beside 1e-20; the rest is rounding.
    torch.testing.assert_close(step, torch.sign(gradient), rtol=1e-9, atol=0)


def test_no_gradient_is_no_step() -> None:
    zero = torch.zeros(4)
    assert not Adam(zero, BETAS).unit_step(zero).any()


def test_the_steps_are_those_of_the_paper() -> None:
    """Algorithm 1 of arXiv:1412.6980, written out for one number."""
    gradients = np.random.default_rng(0).normal(size=20)
    adam = Adam(torch.zeros(1, dtype=torch.float64), BETAS)
    first = second = 0.0
    for t, g in enumerate(gradients, start=1):
        first = BETAS[0] * first + (1 - BETAS[0]) * g
        second = BETAS[1] * second + (1 - BETAS[1]) * g * g
        expected = (first / (1 - BETAS[0] ** t)) / math.sqrt(second / (1 - BETAS[1] ** t))
        assert float(adam.unit_step(torch.tensor([g]))) == pytest.approx(expected, rel=1e-12)


def test_what_is_forgotten_is_as_new() -> None:
    gradients = torch.rand(3, 5, generator=torch.Generator().manual_seed(1))
    used, fresh = Adam(gradients[0], BETAS), Adam(gradients[0], BETAS)
    for gradient in gradients:
        used.unit_step(gradient)
    used.reset()
    assert torch.equal(used.unit_step(gradients[1]), fresh.unit_step(gradients[1]))


def test_the_gradient_is_left_as_it_was() -> None:
    gradient = torch.tensor([1.0, -2.0])
    Adam(gradient, BETAS).unit_step(gradient)
    assert gradient.tolist() == [1.0, -2.0]


def test_the_fall_is_the_root_of_what_is_left() -> None:
    assert [sqrt_decay(done, 4) for done in (0, 3, 4, 5, 100)] == [1.0, 0.5, 0.0, 0.0, 0.0]
    values = [sqrt_decay(done, 20) for done in range(21)]
    assert all(later < earlier for earlier, later in pairwise(values))


def test_a_floor_slows_what_the_gradient_says_little_about_and_nothing_else() -> None:
    gradient = torch.tensor([1.0, -1.0, 1e-6])
    free, floored = Adam(gradient, (0.9, 0.95)), Adam(gradient, (0.9, 0.95), rms_floor=0.1)
    assert torch.allclose(free.unit_step(gradient), torch.tensor([1.0, -1.0, 1.0]))
    # the third is divided by a tenth of the r.m.s. gradient √(2/3) instead of its own
    assert torch.allclose(floored.unit_step(gradient), torch.tensor([1.0, -1.0, 1e-5 / (2 / 3) ** 0.5]))
