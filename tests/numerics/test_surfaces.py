"""Zernike polynomials: Noll's table, orthonormal over the disc, polynomials beyond it."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.interpolate import RBFInterpolator

from holoview.light.numerics.surfaces import noll_to_nm, thin_plate_spline_matrix, zernike, zernike_sum

# Noll, J. Opt. Soc. Am. 66, 207 (1976), table I.
NOLL_TABLE = {
    1: lambda r, t: 1 + 0 * r,
    2: lambda r, t: 2 * r * np.cos(t),
    3: lambda r, t: 2 * r * np.sin(t),
    4: lambda r, t: math.sqrt(3) * (2 * r**2 - 1),
    5: lambda r, t: math.sqrt(6) * r**2 * np.sin(2 * t),
    6: lambda r, t: math.sqrt(6) * r**2 * np.cos(2 * t),
    7: lambda r, t: math.sqrt(8) * (3 * r**3 - 2 * r) * np.sin(t),
    8: lambda r, t: math.sqrt(8) * (3 * r**3 - 2 * r) * np.cos(t),
    9: lambda r, t: math.sqrt(8) * r**3 * np.sin(3 * t),
    10: lambda r, t: math.sqrt(8) * r**3 * np.cos(3 * t),
    11: lambda r, t: math.sqrt(5) * (6 * r**4 - 6 * r**2 + 1),
}


def _disc() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Quadrature nodes (radius, angle) and weights over the unit disc, exact for polynomials of degree ≤ 30."""
    nodes, weights = np.polynomial.legendre.leggauss(16)
    radius2, angle = (nodes + 1) / 2, np.arange(32) * np.pi / 16
    r, t = np.meshgrid(np.sqrt(radius2), angle, indexing="ij")
    return torch.from_numpy(r), torch.from_numpy(t), torch.from_numpy(np.repeat(weights[:, None] / 2 / 32, 32, axis=1))


@pytest.mark.parametrize("noll", NOLL_TABLE)
def test_the_first_terms_are_those_of_nolls_table(noll: int) -> None:
    radius, angle, _ = _disc()
    expected = NOLL_TABLE[noll](radius.numpy(), angle.numpy())
    np.testing.assert_allclose(zernike(noll, radius, angle).numpy(), expected, atol=1e-13)


def test_the_terms_that_a_preset_may_have_are_orthonormal_over_the_disc() -> None:
    radius, angle, weights = _disc()
    terms = torch.stack([zernike(noll, radius, angle).flatten() for noll in range(1, 38)])
    gram = (terms * weights.flatten()) @ terms.T
    torch.testing.assert_close(gram, torch.eye(37, dtype=torch.float64), rtol=0, atol=1e-12)


def test_every_pair_of_orders_has_one_index_and_cosines_are_even() -> None:
    orders = [noll_to_nm(noll) for noll in range(1, 67)]
    assert sorted(orders) == sorted((n, m) for n in range(11) for m in range(-n, n + 1, 2))
    assert all(noll % 2 == (m < 0) for noll, (_, m) in enumerate(orders, start=1) if m != 0)


@pytest.mark.parametrize("noll", range(1, 12))
def test_beyond_the_disc_the_polynomials_go_on(noll: int) -> None:
    radius, angle = torch.tensor([1.0, 1.0001, 1.5, 2.0]).double(), torch.tensor([0.3, 1.2, -2.0, 3.0]).double()
    expected = NOLL_TABLE[noll](radius.numpy(), angle.numpy())
    np.testing.assert_allclose(zernike(noll, radius, angle).numpy(), expected, rtol=1e-12)


def test_a_sum_is_that_of_its_terms() -> None:
    radius, angle, _ = _disc()
    expected = 3e-8 * zernike(4, radius, angle) - 1e-8 * zernike(7, radius, angle)
    torch.testing.assert_close(zernike_sum([(4, 3e-8), (7, -1e-8)], radius, angle), expected)
    assert not zernike_sum([], radius, angle).any()


NODES, POINTS, ASPECT = (4, 5), (7, 9), 1.5


def _grid(shape: tuple[int, int], *, corners: bool) -> np.ndarray:
    y, x = (np.linspace(-1, 1, n) * (1 if corners else 1 - 1 / n) for n in shape)
    return np.stack(np.meshgrid(y, x * ASPECT, indexing="ij"), axis=-1).reshape(-1, 2)


def test_the_spline_is_that_of_scipy() -> None:
    values = np.random.default_rng(0).standard_normal(NODES[0] * NODES[1])
    expected = RBFInterpolator(_grid(NODES, corners=True), values, kernel="thin_plate_spline")(
        _grid(POINTS, corners=False)
    )
    found = thin_plate_spline_matrix(NODES, POINTS, ASPECT) @ torch.from_numpy(values)
    assert found.numpy() == pytest.approx(expected, abs=1e-10)


def test_a_plane_is_reproduced() -> None:
    nodes, points = _grid(NODES, corners=True), _grid(POINTS, corners=False)
    found = thin_plate_spline_matrix(NODES, POINTS, ASPECT) @ torch.from_numpy(2 + nodes @ [3.0, -1.0])
    assert found.numpy() == pytest.approx(2 + points @ [3.0, -1.0], abs=1e-10)
