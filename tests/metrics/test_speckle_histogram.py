"""The histogram of speckle with known statistics."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import gamma

from holoview.metrics.speckle import speckle_density, speckle_histogram
from holoview.util.errors import UserError

WHOLE = (0, 0, 256, 256)


@pytest.mark.parametrize("patterns", [1, 4])
def test_the_histogram_follows_the_law_of_as_many_patterns(patterns: int) -> None:
    drawn = np.random.default_rng(2).gamma(patterns, 1 / patterns, (256, 256))
    histogram = speckle_histogram(drawn, WHOLE, patterns, bins=20)
    assert np.sum(histogram.density) * (histogram.edges[1] - histogram.edges[0]) == pytest.approx(1.0, abs=0.03)
    assert np.abs(histogram.density - histogram.expected_density).max() < 0.03
    assert np.allclose(histogram.fully_developed_density, np.exp(-histogram.centres), rtol=1e-12)


@pytest.mark.parametrize("patterns", [1.0, 2.5, 8.0])
def test_the_law_has_mean_1_and_contrast_1_over_the_root_of_the_patterns(patterns: float) -> None:
    at = np.linspace(0.0, 60.0, 600_001)
    density = speckle_density(at, patterns)
    mean, square = (np.trapezoid(density * at**power, at) for power in (1, 2))
    assert mean == pytest.approx(1.0, rel=1e-6)
    assert np.sqrt(square - mean**2) == pytest.approx(1 / np.sqrt(patterns), rel=1e-6)


@pytest.mark.parametrize("patterns", [0.7, 1.0, 1.3, 2.0, 8.0, 500.0])
def test_the_law_is_the_gamma_distribution(patterns: float) -> None:
    at = np.concatenate([[-1.0, 0.0], np.linspace(0.01, 8.0, 200)])
    np.testing.assert_allclose(
        speckle_density(at, patterns), gamma.pdf(at, patterns, scale=1 / patterns), rtol=1e-10, atol=1e-300
    )


def test_a_dark_region_has_no_histogram() -> None:
    with pytest.raises(UserError, match="no light"):
        speckle_histogram(np.zeros((4, 4)), (0, 0, 4, 4))
