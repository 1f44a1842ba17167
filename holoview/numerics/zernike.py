"""Zernike polynomials in Noll's order (J. Opt. Soc. Am. 66, 207 (1976)), with unit r.m.s. over the unit disc."""

from __future__ import annotations

import math

import torch


def zernike(noll: int, radius: torch.Tensor, angle: torch.Tensor) -> torch.Tensor:
    """Zernike polynomial Z_j (Noll index ≥ 1) with unit r.m.s. over the unit disc; zero outside it."""
    n, m = noll_to_nm(noll)
    radial = torch.zeros_like(radius)
    for k in range((n - abs(m)) // 2 + 1):
        numerator = (-1) ** k * math.factorial(n - k)
        half_sum, half_difference = (n + abs(m)) // 2 - k, (n - abs(m)) // 2 - k
        denominator = math.factorial(k) * math.factorial(half_sum) * math.factorial(half_difference)
        radial = radial + numerator / denominator * radius ** (n - 2 * k)
    if m == 0:
        term = math.sqrt(n + 1) * radial
    else:
        wave = torch.cos(m * angle) if m > 0 else torch.sin(-m * angle)
        term = math.sqrt(2 * (n + 1)) * radial * wave
    return torch.where(radius <= 1, term, torch.zeros_like(term))


def noll_to_nm(noll: int) -> tuple[int, int]:
    """Radial order n and azimuthal order m of Noll's index: m > 0 is a cosine, m < 0 a sine."""
    n = 0
    while (n + 1) * (n + 2) // 2 < noll:
        n += 1
    rest = noll - n * (n + 1) // 2 - 1
    m = 2 * ((rest + 1) // 2) if n % 2 == 0 else 2 * (rest // 2) + 1
    return n, m if noll % 2 == 0 else -m
