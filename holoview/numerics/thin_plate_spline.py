"""Thin-plate splines through values at equidistant nodes (Duchon 1977; Bookstein, IEEE PAMI 11, 567 (1989))."""

from __future__ import annotations

import torch


def thin_plate_spline_matrix(nodes: tuple[int, int], lattice: tuple[int, int], aspect: float) -> torch.Tensor:
    """The matrix (point, node) float64 from values at equidistant nodes to their thin-plate spline at a lattice.

    nodes: (rows, columns) of nodes, the outermost on the edges of the area.
    lattice: (rows, columns) of equal cells, at whose centres the spline is evaluated.
    aspect: width of the area over its height.

    f(r) = Σ_i w_i·U(|r − r_i|) + a + b·r with U = ρ²·log ρ and Σ w_i = Σ w_i·r_i = 0, linear in the nodes' values.
    """
    knots, points = _lattice(nodes, aspect, corners=True), _lattice(lattice, aspect, corners=False)
    count = len(knots)
    equations = torch.zeros(count + 3, count + 3, dtype=torch.float64)
    equations[:count, :count] = _kernel(torch.cdist(knots, knots))
    equations[:count, count:] = _affine(knots)
    equations[count:, :count] = _affine(knots).T
    solution = torch.linalg.inv(equations)[:, :count]
    return torch.cat([_kernel(torch.cdist(points, knots)), _affine(points)], dim=1) @ solution


def _lattice(shape: tuple[int, int], aspect: float, *, corners: bool) -> torch.Tensor:
    """Points (n, 2) on a rectangle of height 2 and width 2·aspect, up to its edges or at the centres of equal cells."""
    sides = []
    for n in shape:
        ends = 1.0 if corners else 1 - 1 / n
        sides.append(torch.linspace(-ends, ends, n, dtype=torch.float64))
    y, x = torch.meshgrid(sides[0], sides[1] * aspect, indexing="ij")
    return torch.stack([y.flatten(), x.flatten()], dim=1)


def _affine(points: torch.Tensor) -> torch.Tensor:
    """Rows (1, y, x)."""
    return torch.cat([torch.ones(len(points), 1, dtype=points.dtype), points], dim=1)


def _kernel(distance: torch.Tensor) -> torch.Tensor:
    """ρ²·log ρ."""
    return distance.square() * distance.clamp_min(1e-30).log()
