"""Moved seeds and other noise: what `--reseed` and `--other-noise` change, and what they leave."""

from __future__ import annotations

import random

import numpy as np
import pytest
import torch

from tests.randomness import SeedMover, draw_other_noise


@pytest.fixture
def generators(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is replaced by the test is put back."""
    for module, name in (
        (np.random, "default_rng"),
        (np.random, "SeedSequence"),
        (torch, "manual_seed"),
        (torch.random, "manual_seed"),
        (torch, "Generator"),
        (random, "Random"),
    ):
        monkeypatch.setattr(module, name, getattr(module, name))


def _numbers() -> list[float]:
    """One number of each kind of generator, from equal seeds at each call."""
    torch.manual_seed(3)
    return [
        np.random.default_rng(3).random(),
        np.random.default_rng((3, 1)).random(),
        np.random.default_rng(np.array([3, 2])).random(),
        float(np.random.SeedSequence(3).generate_state(1)[0]),
        float(torch.rand(())),
        float(torch.rand((), generator=torch.Generator().manual_seed(3))),
        random.Random(3).random(),
    ]


@pytest.mark.usefixtures("generators")
def test_every_seed_is_moved_and_counted() -> None:
    before = _numbers()
    mover = SeedMover(1)
    mover.install()
    assert not np.equal(before, _numbers()).any()
    assert mover.moved == len(before)
    assert _numbers() == _numbers(), "equal seeds stay equal"


@pytest.mark.usefixtures("generators")
def test_what_is_no_seed_stays() -> None:
    mover = SeedMover(1)
    mover.install()
    for value in (None, True, -1, 1.5, "3", [], [1, -1]):
        assert mover.move(value) is value
    generator = np.random.default_rng(3)
    assert np.random.default_rng(generator) is generator
    with pytest.raises(ValueError, match="non-negative"):
        np.random.default_rng(-1)


@pytest.mark.usefixtures("generators")
def test_other_noise_leaves_what_is_drawn_uniformly_before_it() -> None:
    before, noise_before = _patterns_and_noise(np.random.Generator(np.random.PCG64(5)))
    draw_other_noise()
    after, noise = _patterns_and_noise(np.random.default_rng(np.random.PCG64(5)))
    assert np.array_equal(before, after)
    # independent: the correlation of 10 000 pairs has the standard deviation 0.01, and 5 of it are passed once in 10⁶
    assert abs(np.corrcoef(noise_before, noise)[0, 1]) < 0.05


def _patterns_and_noise(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return rng.random(100), rng.poisson(50.0, 10_000) + rng.standard_normal(10_000)
