"""The modulator: drive → optical path → phase, its levels, and its pixels on the simulation grid."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch

from holoview.light.model.bench_parts import Modulator
from holoview.light.numerics.resample import upsample_nearest
from holoview.light.optics.slm import (
    level_numbers,
    nearest_level,
    optical_path,
    phasor,
    pixel_spectrum,
    sum_pool,
    summed,
)


def _modulator(levels: Any = None) -> Modulator:
    return Modulator(pitch_m=8e-6, shape=(3, 4), stroke_m=825e-9, levels=levels)


def _random(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def _random_complex(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.complex(_random(*shape, seed=seed) - 0.5, _random(*shape, seed=seed + 100) - 0.5)


def test_a_continuous_modulator_delays_by_the_drives_share_of_its_stroke() -> None:
    drive = torch.tensor([0.0, 0.25, 1.0], dtype=torch.float64)
    torch.testing.assert_close(optical_path(drive, _modulator()), drive * 825e-9, rtol=1e-15, atol=0)


def test_phase_is_two_pi_turns_a_wavelength_of_path_so_that_it_scales_as_one_over_wavelength() -> None:
    opd = torch.tensor([0.0, 133e-9, 266e-9, 532e-9 * 1000], dtype=torch.float64)
    expected = torch.tensor([1, 1j, -1, 1], dtype=torch.complex128)
    # At 1000 turns the product keeps 1e-13 of a turn.
    torch.testing.assert_close(phasor(opd, 532e-9, torch.complex128), expected, rtol=0, atol=2e-12)
    twice = phasor(opd, 1064e-9, torch.complex128)
    torch.testing.assert_close(twice[:3] ** 2, expected[:3], rtol=0, atol=1e-14)


@pytest.mark.parametrize("count", [2, 4, 256])
def test_the_nearest_of_equal_levels_is_shown(count: int) -> None:
    drive = _random(200)
    shown = nearest_level(drive, _modulator(count))
    torch.testing.assert_close(shown, torch.round(drive * (count - 1)) / (count - 1), rtol=0, atol=1e-15)


def test_the_nearest_of_unequal_levels_is_shown() -> None:
    levels = [0, 0.05, 0.3, 0.35, 0.9, 1]
    drive = _random(500, seed=1)
    shown = nearest_level(drive, _modulator(levels))
    table = torch.tensor(levels, dtype=torch.float64)
    nearest = table[(drive[:, None] - table).abs().argmin(dim=1)]
    torch.testing.assert_close(shown, nearest, rtol=0, atol=0)


def test_a_level_shows_itself_exactly() -> None:
    levels = torch.tensor([0, 0.05, 0.3, 0.35, 0.9, 1], dtype=torch.float64)
    assert torch.equal(nearest_level(levels, _modulator(levels.tolist())), levels)


def test_a_batch_of_frames_is_quantised_without_a_warning() -> None:
    patterns = _random(3, 2, 3, 4)[:, 1]  # a view of one modulator of two, as the frames are stored
    torch.set_warn_always(True)  # some warnings are given once a process only
    try:
        shown = nearest_level(patterns, _modulator(4))
    finally:
        torch.set_warn_always(False)
    assert torch.equal(shown, nearest_level(patterns.clone(), _modulator(4)))


def test_gradients_pass_through_the_levels_as_if_the_modulator_were_continuous() -> None:
    drive = _random(20).requires_grad_()
    shown = nearest_level(drive, _modulator(4))
    assert torch.unique(shown.detach()).numel() <= 4
    (gradient,) = torch.autograd.grad((3 * shown).sum(), drive)
    torch.testing.assert_close(gradient, torch.full((20,), 3.0, dtype=torch.float64))


def test_a_pixel_is_a_square_of_equal_samples() -> None:
    pixels = torch.arange(6.0).reshape(2, 3)
    fine = upsample_nearest(pixels, 3)
    assert fine.shape == (6, 9)
    for y in range(6):
        for x in range(9):
            assert fine[y, x] == pixels[y // 3, x // 3]


@pytest.mark.parametrize("factor", [1, 2, 3])
@pytest.mark.parametrize("complex_", [False, True], ids=["real", "complex"])
def test_pooling_is_the_adjoint_of_upsampling(factor: int, complex_: bool) -> None:
    make = _random_complex if complex_ else _random
    x, y = make(2, 4, 5), make(2, 4 * factor, 5 * factor, seed=2)
    forward, back = (upsample_nearest(x, factor).conj() * y).sum(), (x.conj() * sum_pool(y, factor)).sum()
    torch.testing.assert_close(forward, back, rtol=1e-12, atol=0)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_sum_of_tensors_is_their_sum_and_leaves_them_alone(count: int) -> None:
    parts = [_random_complex(3, 4, seed=seed) for seed in range(count)]
    before = [part.clone() for part in parts]
    torch.testing.assert_close(summed(parts), torch.stack(parts).sum(dim=0), rtol=1e-14, atol=0)
    assert all(torch.equal(part, known) for part, known in zip(parts, before, strict=True))


@pytest.mark.parametrize("factor", [1, 2, 3, 5])
@pytest.mark.parametrize("slopes", [(0.0, 0.0), (0.013, -0.17)], ids=["on axis", "oblique"])
def test_the_spectrum_of_an_upsampled_pattern_is_that_of_its_pixels_repeated_times_the_pixels_own(
    factor: int, slopes: tuple[float, float]
) -> None:
    """With a wave exp(2πi·s·n) over the samples, of which the pixels see the first sample's phase."""
    pixels = _random_complex(6, 8)
    turns = [slope * torch.arange(n * factor, dtype=torch.float64) for n, slope in zip((6, 8), slopes, strict=True)]
    y, x = (torch.exp(2j * math.pi * t) for t in turns)
    expected = torch.fft.fft2(upsample_nearest(pixels, factor) * y[:, None] * x[None, :])
    seen = pixels * y[::factor, None] * x[None, ::factor]
    response = pixel_spectrum(6 * factor, factor, slopes[0])[:, None] * pixel_spectrum(8 * factor, factor, slopes[1])
    found = torch.fft.fft2(seen).repeat(factor, factor) * response
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-12 * float(expected.abs().max()))


def test_a_pixels_spectrum_on_the_axis_is_a_dirichlet_kernel_of_its_width() -> None:
    response = pixel_spectrum(12, 3, 0.0)
    f = torch.arange(12, dtype=torch.float64) / 12
    expected = torch.cat([torch.tensor([3.0]).double(), torch.sin(3 * math.pi * f[1:]) / torch.sin(math.pi * f[1:])])
    torch.testing.assert_close(response.abs(), expected.abs(), rtol=0, atol=1e-14)
    assert response.dtype == torch.complex128


@pytest.mark.parametrize("levels", [2, 5, [0, 0.05, 0.3, 0.35, 0.9, 1]], ids=str)
def test_a_levels_number_is_that_of_what_is_shown(levels: Any) -> None:
    drive, modulator = _random(3, 50, seed=4), _modulator(levels)
    assert modulator.levels is not None
    table = torch.tensor(modulator.levels)
    assert torch.equal(table[level_numbers(drive, modulator)], nearest_level(drive, modulator))


def test_a_phasor_has_modulus_one_in_single_precision_too() -> None:
    values = phasor(_random(100).float() * 5e-6, 532e-9, torch.complex64)
    assert values.dtype == torch.complex64
    assert float((values.abs() - 1).abs().max()) <= 2e-7  # two roundings of float32
    turns = math.tau * 0.25
    assert float(phasor(torch.tensor(133e-9), 532e-9, torch.complex64).angle()) == pytest.approx(turns, rel=1e-6)
