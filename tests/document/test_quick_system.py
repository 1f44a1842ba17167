"""The lasers of the simplified system: those that scipy's decompositions choose, with the mean colour kept."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import qr
from scipy.optimize import nnls

from holoview.light.colour import observer_weights
from holoview.light.model import preset
from holoview.viewer.render.progressive_renderer import make_quick_system, reduced_amplitudes

SYSTEM = preset.load("holochrome-8")


def _weights() -> np.ndarray:
    return observer_weights(SYSTEM.observer, SYSTEM.wavelengths_m)


def test_three_lasers_keep_the_colour_of_a_uniform_image() -> None:
    reduced = reduced_amplitudes(SYSTEM, 3)
    assert np.count_nonzero(reduced) == 3
    np.testing.assert_allclose(reduced @ _weights(), SYSTEM.amplitudes @ _weights(), rtol=1e-9)


def test_few_lasers_stay_as_they_are() -> None:
    assert reduced_amplitudes(SYSTEM, 8) is SYSTEM.amplitudes
    assert np.array_equal(make_quick_system(SYSTEM).amplitudes, SYSTEM.amplitudes)


@pytest.mark.parametrize("seed", range(8))
def test_lasers_and_powers_are_those_of_a_pivoted_decomposition_and_of_least_squares(seed: int) -> None:
    """Any powers: the colour may lie outside the gamut of the three lasers, where some of them are dark."""
    drawn = np.random.default_rng(seed).exponential(size=SYSTEM.amplitudes.shape) ** 3
    reduced = reduced_amplitudes(SYSTEM.edit({"amplitudes": drawn}), 3)
    _, _, order = qr(_weights().T, pivoting=True)
    powers, _ = nnls(_weights()[order[:3]].T, (drawn @ _weights()).sum(axis=0))
    expected = np.zeros(drawn.shape[1])
    expected[order[:3]] = powers
    np.testing.assert_allclose(reduced[0], expected, rtol=1e-9, atol=1e-12 * expected.max())


def test_a_colour_outside_the_gamut_of_the_three_is_the_nearest_that_they_mix() -> None:
    weights = _weights()
    _, _, order = qr(weights.T, pivoting=True)
    dark = 0
    for laser in range(len(weights)):
        alone = np.zeros_like(SYSTEM.amplitudes)
        alone[:, :] = 1e-6
        alone[0, laser] = 1.0
        reduced = reduced_amplitudes(SYSTEM.edit({"amplitudes": alone}), 3)
        powers, _ = nnls(weights[order[:3]].T, (alone @ weights).sum(axis=0))
        np.testing.assert_allclose(reduced[0, order[:3]], powers, rtol=1e-7, atol=1e-9)
        dark += int(np.any(powers == 0))
    assert dark > 0
