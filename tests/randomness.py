"""Other random numbers for the same tests: every seed moved, or the noise drawn from another place of its stream.

A test that holds for one seed only is tuned to it. It fails on another processor too: a last digit that differs there
sends a rejection sampler (Poisson, normal, gamma) down another way, and all later noise is other noise.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

_STEP = 1_000_003  # a prime far above the seeds that tests count through: no moved seed meets another test's
_SEEDS_OF_TORCH = 1 << 64
_JUMP = 0x9E3779B97F4A7C15F39CC0605CEDC835  # of numpy's `PCG64.jumped`: φ − 1 of the period 2¹²⁸
# Of numpy's samplers those that reject candidates: how much of the stream they use depends on last digits.
_SAMPLERS = (
    "beta",
    "binomial",
    "chisquare",
    "exponential",
    "gamma",
    "lognormal",
    "multivariate_normal",
    "normal",
    "poisson",
    "rayleigh",
    "standard_exponential",
    "standard_gamma",
    "standard_normal",
    "standard_t",
)


class SeedMover:
    """Adds `number` × 1 000 003 to every seed given to numpy, torch and `random`, and counts how many it moved.

    Moved are whole numbers, and the first of several, given to `numpy.random.default_rng`, `numpy.random.SeedSequence`,
    `torch.manual_seed`, `torch.Generator.manual_seed` and `random.Random`, by tests and by what they call in their
    own process. Equal seeds stay equal, and different ones different.
    """

    def __init__(self, number: int) -> None:
        self.moved = 0
        self._shift = number * _STEP

    def install(self) -> None:
        """Puts it in place, for the life of the process."""
        move, move_for_torch = self.move, self._move_for_torch
        default_rng, manual_seed, own_seed = np.random.default_rng, torch.manual_seed, torch.Generator.manual_seed

        class SeedSequence(np.random.SeedSequence):
            def __init__(self, entropy: Any = None, **options: Any) -> None:
                super().__init__(move(entropy), **options)

        class Generator(torch.Generator):
            def manual_seed(self, seed: int) -> torch.Generator:
                return own_seed(self, move_for_torch(seed))

        class Random(random.Random):
            def __init__(self, x: Any = None) -> None:
                super().__init__(move(x))

        _replace(np.random, "default_rng", lambda seed=None: default_rng(move(seed)))
        _replace(np.random, "SeedSequence", SeedSequence)
        _replace(torch, "manual_seed", lambda seed: manual_seed(move_for_torch(seed)))
        _replace(torch.random, "manual_seed", torch.manual_seed)
        _replace(torch, "Generator", Generator)
        _replace(random, "Random", Random)

    def move(self, seed: Any) -> Any:
        """The moved seed; whatever isn't one (None, another generator, a number refused anyway) stays as it is."""
        if _is_seed(seed):
            self.moved += 1
            return int(seed) + self._shift
        if isinstance(seed, (list, tuple, np.ndarray)) and len(seed) and all(map(_is_seed, seed)):
            self.moved += 1
            return [int(seed[0]) + self._shift, *map(int, seed[1:])]
        return seed

    def _move_for_torch(self, seed: Any) -> Any:
        return self.move(seed) % _SEEDS_OF_TORCH if _is_seed(seed) else seed


class _OtherNoise(np.random.Generator):
    """A generator whose samplers first jump to another place of the stream: the same distributions, other noise."""


def draw_other_noise() -> None:
    """Generators of `numpy.random.default_rng` draw noise as `_OtherNoise`, for the life of the process.

    What is drawn uniformly before any noise (patterns, powers) stays as it was, as with another mathematical library.
    """
    default_rng = np.random.default_rng
    for name in _SAMPLERS:
        setattr(_OtherNoise, name, _elsewhere(getattr(np.random.Generator, name)))

    def elsewhere(seed: Any = None) -> np.random.Generator:
        return seed if isinstance(seed, np.random.Generator) else _OtherNoise(default_rng(seed).bit_generator)

    _replace(np.random, "default_rng", elsewhere)


def _elsewhere(sampler: Callable[..., Any]) -> Callable[..., Any]:
    def sample(self: np.random.Generator, *arguments: Any, **options: Any) -> Any:
        self.bit_generator.advance(_JUMP)
        return sampler(self, *arguments, **options)

    return sample


def _is_seed(seed: Any) -> bool:
    return isinstance(seed, (int, np.integer)) and not isinstance(seed, bool) and seed >= 0


def _replace(module: Any, name: str, value: Any) -> None:
    setattr(module, name, value)
