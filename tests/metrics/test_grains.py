"""Independent grains of a region and the standard error of its contrast, on speckle whose statistics are known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from holoview.holograms.metrics.grains import PixelNoise, autocorrelation, contrast_estimate, estimate_contrast
from holoview.holograms.metrics.speckle import speckle_pattern
from holoview.util.errors import UserError

Floats = NDArray[np.float64]


def _speckle(
    side: int, grain: float, powers: tuple[float, ...] = (1.0,), seed: int = 0, pixel: float = 0.0, round_: bool = False
) -> Floats:
    """Sum of independent speckle patterns behind a square (or round) pupil, whose grains λ/D are `grain` samples.

    Part of a four times larger periodic field. pixel: width in samples of square pixels that average.
    """
    rng, n = np.random.default_rng(seed), 4 * side
    f = np.fft.fftfreq(n)
    y, x = np.abs(f)[:, None], np.abs(f)[None, :]
    pupil = np.hypot(y, x) < 0.5 / grain if round_ else (y < 0.5 / grain) & (x < 0.5 / grain)
    total = np.zeros((n, n))
    for power in powers:
        noise = rng.normal(size=(2, n, n))
        field = np.fft.ifft2(np.fft.fft2(noise[0] + 1j * noise[1]) * pupil)
        intensity = np.abs(field) ** 2
        total += power * intensity / intensity.mean()
    damped = np.fft.ifft2(np.fft.fft2(total) * np.outer(np.sinc(f * pixel), np.sinc(f * pixel))).real
    return np.asarray(damped[:side, :side])


@pytest.mark.parametrize(
    ("powers", "known"),
    [((1.0,), 1.0), ((1.0,) * 3, 3**-0.5), ((1.0, 4.0, 1.0), 2**-0.5), ((1.0, 1.0), 2**-0.5)],
    ids=["one laser", "three", "1 : 4 : 1, as two", "depolarised"],
)
def test_contrast_is_known_within_its_standard_error(powers: tuple[float, ...], known: float) -> None:
    """1/√N_eff with N_eff = (ΣP)²/ΣP²; one laser in two polarisations is two equal patterns: 1/√2."""
    found = estimate_contrast(_speckle(160, 4.0, powers))
    assert abs(found.contrast - known) < 5 * found.standard_error
    n = found.grains.count
    # of a sum of equal patterns; the measured ⟨ψ²⟩ scatters by √(⟨ψ⁴⟩/⟨ψ²⟩²/n): of one pattern ⟨ψ⁴⟩ = 61
    assert found.standard_error == pytest.approx(known * np.sqrt((1 + known**2) / (2 * n)), rel=5 * np.sqrt(61 / n))


def test_grains_behind_a_square_pupil_are_counted_by_the_square_of_the_autocorrelation() -> None:
    """ρ = sinc²·sinc² of displacements over λ/D, and ∬ρ² = (2/3)² of (λ/D)²: 9/4 grains each.

    Σρ² of a region of n grains is wrong by about 2/√n of itself: 8 % at 3 600 grains, five times the deviation that 40
    draws showed.
    """
    found = estimate_contrast(_speckle(160, 4.0)).grains
    assert found.count == pytest.approx(160**2 / 4.0**2 * 9 / 4, rel=0.08 * 1.5)
    # sinc² falls to a half at 0.443 λ/D; the slope there is 1.4/(λ/D), and ρ scatters by 1/√n, of which five
    assert np.allclose(found.width_px, 2 * 0.443 * 4.0, atol=2 * 5 / np.sqrt(3600) / 1.4 * 4.0 + 0.05)


def test_the_standard_error_is_that_of_repeated_draws() -> None:
    """60 draws: their deviation is known to 1/√120 = 9 %, of which five; so is the mean of the errors, better."""
    found = [estimate_contrast(_speckle(48, 4.0, (1.0, 1.0), seed)) for seed in range(60)]
    deviation = np.std([one.contrast for one in found], ddof=1)
    assert deviation == pytest.approx(np.mean([one.standard_error for one in found]), rel=5 * 0.0913)


def test_a_square_pixel_as_wide_as_a_grain_lowers_the_contrast_to_0_65() -> None:
    """Variance of a mean over a pixel of width λ/D, square pupil: (2∫(1 − x)·sinc²(x) dx)² 0 to 1; its root is C."""
    x = np.linspace(0.0, 1.0, 100_001)
    known = float(2 * np.trapezoid((1 - x) * np.sinc(x) ** 2, x))
    assert known == pytest.approx(0.656, abs=0.0005)
    found = estimate_contrast(_speckle(320, 8.0, pixel=8.0))
    assert abs(found.contrast - known) < 5 * found.standard_error


def test_samples_that_are_independent_are_grains_themselves() -> None:
    drawn = np.random.default_rng(1).exponential(size=(128, 128))
    found = estimate_contrast(drawn).grains
    assert found.count == pytest.approx(128**2, rel=0.02)  # noise of (2·8 + 1)² displacements: each 1/n, √(2·289)/n
    assert np.allclose(found.width_px, 1.0, atol=0.05)


def test_autocorrelation_leaves_out_what_does_not_count() -> None:
    """A mask of random holes hardly changes the grains of a square pupil but for their number."""
    values = _speckle(160, 4.0, seed=3)
    target = np.where(np.random.default_rng(0).random(values.shape) < 0.3, 0.0, 1.0)
    pattern = speckle_pattern(values, target=target)
    correlation, overlap = autocorrelation(pattern)
    assert correlation[160, 160] == pytest.approx(1.0)
    assert overlap[160, 160] == pattern.usable.sum() == (target > 0).sum()
    whole, holed = estimate_contrast(values), estimate_contrast(values, target=target)
    assert holed.grains.width_px == pytest.approx(whole.grains.width_px, rel=0.05)


def test_an_even_region_has_no_contrast_and_no_error() -> None:
    found = estimate_contrast(np.full((16, 16), 0.25))
    assert (found.contrast, found.standard_error, found.has_few_grains) == (0.0, 0.0, True)


@pytest.mark.parametrize("values", [np.zeros((8, 8)), np.ones((1, 1))], ids=["black", "one pixel"])
def test_a_contrast_that_is_not_defined_is_a_sentence(values: Floats) -> None:
    with pytest.raises(UserError, match="two or more pixels with light"):
        estimate_contrast(values)


def test_the_noise_of_pixels_is_taken_off() -> None:
    """Speckle of mean 50 counts, 2 electrons each, and 6 electrons of read noise, C = 1/2: noise adds 0.014 to C²."""
    rng, gain = np.random.default_rng(5), 2.0
    light = 50 * _speckle(160, 4.0, (1.0,) * 4, seed=2) / 4
    counts = np.rint((rng.poisson(light * gain) + 6 * rng.standard_normal(light.shape)) / gain)
    noise = PixelNoise(gain, float(np.hypot(6 / gain, 12**-0.5)))
    clean, plain, freed = (
        estimate_contrast(light),
        estimate_contrast(counts),
        contrast_estimate(speckle_pattern(counts), noise),
    )
    share = (50 / gain + 9 + 1 / 12) / 50**2
    assert freed.noise_share == pytest.approx(share, rel=0.05)  # the mean of 3 700 grains
    # of 25 600 pixels: Var of σ_noise² is 2σ⁴/n, the mixed term 4·σ_noise²·σ²·(1 + 2C²)/n, as noise grows with the
    # light, and the mean's (2C²)²·σ_noise²/n
    scatter = np.sqrt(2 * share**2 + 4 * share * 0.25 * 1.5 + 0.25 * share) / 160 / (2 * 0.5)
    assert freed.contrast == pytest.approx(clean.contrast, abs=5 * scatter)
    assert plain.contrast - clean.contrast > 5 * scatter


def test_noise_alone_leaves_no_contrast() -> None:
    rng = np.random.default_rng(6)
    counts = rng.poisson(1000.0, (64, 64)).astype(float)
    found = contrast_estimate(speckle_pattern(counts), PixelNoise(1.0, 0.0))
    assert found.contrast <= 5 * found.standard_error and found.standard_error > 0
