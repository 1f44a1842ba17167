"""Smooth surfaces by few numbers: Zernike polynomials on a disc, and thin-plate splines through nodes.

Zernike polynomials are in the order and normalisation of Noll, J. Opt. Soc. Am. 66, 207 (1976): each has an r.m.s. of 1
over the unit disc, so that a coefficient in metres is an r.m.s. optical path. Thin-plate splines: Duchon 1977;
Bookstein, IEEE PAMI 11, 567 (1989).
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import torch


def zernike(noll: int, radius: torch.Tensor, angle: torch.Tensor) -> torch.Tensor:
    """The polynomial Z_j of Noll index j ≥ 1.

    radius: distance from the centre in units of the disc's radius; any shape.
    angle: azimuth in radians, of the same shape.

    Returns a tensor of that shape. Beyond the disc the polynomial goes on.
    """
    n, m = noll_to_nm(noll)
    radial = torch.zeros_like(radius)
    for k in range((n - abs(m)) // 2 + 1):
        numerator = (-1) ** k * math.factorial(n - k)
        half_sum, half_difference = (n + abs(m)) // 2 - k, (n - abs(m)) // 2 - k
        denominator = math.factorial(k) * math.factorial(half_sum) * math.factorial(half_difference)
        radial = radial + numerator / denominator * radius ** (n - 2 * k)
    if m == 0:
        return math.sqrt(n + 1) * radial
    wave = torch.cos(m * angle) if m > 0 else torch.sin(-m * angle)
    return math.sqrt(2 * (n + 1)) * radial * wave


def zernike_sum(terms: Iterable[tuple[int, float]], radius: torch.Tensor, angle: torch.Tensor) -> torch.Tensor:
    """Σ_j c_j·Z_j of pairs (Noll index j, coefficient c_j), in the unit of the coefficients."""
    total = torch.zeros_like(radius)
    for noll, coefficient in terms:
        total = total + coefficient * zernike(noll, radius, angle)
    return total


def noll_to_nm(noll: int) -> tuple[int, int]:
    """The radial order n and the azimuthal order m of a Noll index ≥ 1: m > 0 is a cosine, m < 0 a sine."""
    n = 0
    while (n + 1) * (n + 2) // 2 < noll:
        n += 1
    rest = noll - n * (n + 1) // 2 - 1
    m = 2 * ((rest + 1) // 2) if n % 2 == 0 else 2 * (rest // 2) + 1
    return n, m if noll % 2 == 0 else -m


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
