"""Thin-plate splines: exact at their nodes, exact for planes, and those of scipy."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.interpolate import RBFInterpolator

from holoview.numerics.surfaces import thin_plate_spline_matrix

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
