"""Pixels that can't be trusted are left out; variances of pixels; unequal sensitivity."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import binom

from holoview.bench.captures.dataset import Camera, Captures
from holoview.bench.captures.prepared_captures import (
    BORDER_PX,
    add_model_error,
    estimate_prnu,
    neighbour_variance,
    prepare_captures,
)

CAMERA = Camera(4e-6, 12, 4.0, 3.0, 64.0)
STUCK_BY_CHANCE = 1e-4
"""A bound of the share of pixels that vary by chance as little as a stuck one in six random pictures: 88 of 1.2e6."""


def _counts(rng: np.random.Generator, signal: np.ndarray, camera: Camera = CAMERA) -> np.ndarray:
    electrons = rng.poisson(signal * camera.electrons_per_count) + camera.read_noise * rng.standard_normal(signal.shape)
    return np.rint(electrons / camera.electrons_per_count)


@pytest.mark.parametrize("signal", [0.0, 5.0, 2000.0])
def test_the_variance_is_that_of_poisson_read_noise_and_quantisation(signal: float) -> None:
    """σ² of a variance from n samples is 2/n of it: 5 σ."""
    n = 200_000
    drawn = _counts(np.random.default_rng(0), np.full(n, signal))
    assert float(CAMERA.noise_variance(np.array(signal, np.float32))) == pytest.approx(
        drawn.var(), rel=5 * (2 / n) ** 0.5
    )


@pytest.mark.parametrize(("black_level", "is_usable"), [(64.0, False), (2.0, True)])
def test_a_pixel_that_reads_nothing_says_little_unless_noise_takes_it_there(
    make_captures: Make, black_level: float, is_usable: bool
) -> None:
    captures = make_captures()
    images = captures.images.copy()
    images[0, 20, 20] = 0
    camera = dataclasses.replace(CAMERA, black_level=black_level)
    usable = prepare_captures(dataclasses.replace(captures, images=images, camera=camera)).usable
    assert (usable[0, 19:22, 19:22] == is_usable).all() and usable[0, 20, 22] and usable[1, 20, 20]


def test_a_pixel_says_nothing_about_its_own_weight(make_captures: Make) -> None:
    captures = make_captures()
    images = captures.images.copy()
    images[0, 20, 20] += 3000
    raised = dataclasses.replace(captures, images=images)
    before, after = (neighbour_variance(prepare_captures(c), np.array([0]))[0] for c in (captures, raised))
    changed = np.abs(after / before - 1) > 1e-4  # running sums in float32 differ in their last digits
    assert not changed[20, 20] and np.count_nonzero(changed) == 8


def test_a_model_that_is_off_is_forgiven_its_share_of_the_mean_light() -> None:
    light = np.full((2, 4, 4), 100.0, np.float32)
    light[1] = 300.0
    found = add_model_error(np.ones((2, 4, 4), np.float32), light, 0.1)
    assert found[0] == pytest.approx(np.full((4, 4), 1 + 10.0**2)) and found[1, 0, 0] == pytest.approx(1 + 30.0**2)


def _fixed(pattern: float, error: float, seed: int = 0, fringes: float = 0.0) -> float:
    """The pattern found in 2 × 8 noisy captures of speckle with pixels that differ and a model that errs at random.

    fringes: depth of a plane wave, 6.3 pixels from crest to crest, that multiplies all captures.
    """
    rng = np.random.default_rng(seed)
    y, x = np.indices((80, 100))
    sensitivity = 1 + pattern * rng.standard_normal((80, 100)) + fringes * np.cos(0.6 * y + 0.8 * x)
    sets = []
    for _ in range(2):
        expected = 500 * rng.exponential(size=(8, 80, 100)) + 50
        true = expected * (1 + error * rng.standard_normal(expected.shape))
        sets.append((_counts(rng, true * sensitivity) - expected, expected))
    usable = [np.ones((8, 80, 100), bool)] * 2
    return estimate_prnu([r.astype(np.float32) for r, _ in sets], [e.astype(np.float32) for _, e in sets], usable)


def test_pixels_that_differ_are_measured() -> None:
    """8000 pixels, two maps whose noise is about the pattern's size: its variance is known to a few per cent."""
    assert _fixed(0.01, 0.0) == pytest.approx(0.01, rel=0.1)


@pytest.mark.parametrize("error", [0.0, 0.05])
def test_noise_and_errors_that_change_with_the_pattern_are_no_fixed_pattern(error: float) -> None:
    """What counts is beyond 5 σ of chance, so none of three seeds passes; a chance of 1e-6."""
    assert [_fixed(0.0, error, seed) for seed in range(3)] == [0.0] * 3


def test_fringes_are_no_noise_of_the_pixels() -> None:
    """Their variance, fringes²/2, is 50 times that of the pixels in the second case.

    Feet of the fringes' peak leave 0.4 σ (40 seeds) of the 5 σ that count: the first fails once in 500 000 seeds.
    """
    assert _fixed(0.0, 0.0, fringes=0.1) == 0.0
    assert _fixed(0.01, 0.0, fringes=0.1) == pytest.approx(0.01, rel=0.1)


Make = Callable[..., Captures]


def test_what_cant_be_trusted_is_left_out(make_captures: Make) -> None:
    captures = make_captures(count=6)
    images = captures.images.copy()
    images[2, 30, 30] = captures.camera.saturation
    images[:, 25, 33] = 700  # a stuck pixel
    usable = prepare_captures(dataclasses.replace(captures, images=images)).usable
    assert not usable[2, 30, 30] and usable[1, 30, 30]
    assert not usable[:, 25, 33].any()
    rows, columns = captures.shape
    inner = usable[:, BORDER_PX : rows - BORDER_PX, BORDER_PX : columns - BORDER_PX]
    assert not usable[:, :BORDER_PX, :].any() and not usable[:, :, -BORDER_PX:].any()
    others, rest = divmod(inner.size - np.count_nonzero(inner) - 1 - 6, len(captures))
    assert rest == 0 and 0 <= others <= binom.isf(1e-6, inner[0].size, STUCK_BY_CHANCE)
