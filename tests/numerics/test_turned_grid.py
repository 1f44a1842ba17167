"""The power of waves at the points of a turned grid, against sums over every wave at every point."""

from __future__ import annotations

import math

import pytest
import torch

from holoview.light.numerics.turned_grid import band_limited_rows, turned_power

SIDE, WAVES = 160, 30


def waves(seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Amplitudes, and frequencies (wave, 2) within the circle of a quarter of the sampling frequency."""
    random = torch.Generator().manual_seed(seed)
    radius, angle = torch.rand(2, WAVES, generator=random, dtype=torch.float64)
    frequencies = torch.stack([(2 * math.pi * angle).sin(), (2 * math.pi * angle).cos()], dim=-1)
    return torch.randn(WAVES, generator=random, dtype=torch.complex128), radius.sqrt()[:, None] * frequencies / 4


def summed(amplitudes: torch.Tensor, frequencies: torch.Tensor, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    turns = y[..., None] * frequencies[:, 0] + x[..., None] * frequencies[:, 1]
    return (amplitudes * torch.polar(torch.ones_like(turns), 2 * math.pi * turns)).sum(-1)


def grid(shape: tuple[int, int]) -> tuple[torch.Tensor, ...]:
    """Coordinates from the centre."""
    return torch.meshgrid(*(torch.arange(n, dtype=torch.float64) - (n - 1) / 2 for n in shape), indexing="ij")


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, -0.02, 0.2, -0.5])
@pytest.mark.parametrize("dtype", [torch.complex64, torch.complex128])
@pytest.mark.parametrize("nodes", [((0.0, 1.0),), ((-0.3, 0.6), (0.4, 0.4))])
def test_the_power_of_waves_at_turned_points(
    angle: float, dtype: torch.dtype, nodes: tuple[tuple[float, float], ...]
) -> None:
    """Against the sum over every wave at every point."""
    generator = torch.Generator().manual_seed(4)
    values = torch.randn(9, 12, generator=generator, dtype=torch.complex128)
    c, s = 1.7 * math.cos(angle), 1.7 * math.sin(angle)
    shape, turns = (10, 14), ((0.1, 0.02), (-0.3, -0.03))

    def factor(y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        return 1 + 0.1 * torch.cos(0.05 * y) + 0.1 * torch.sin(0.04 * x)

    def power(row: torch.Tensor, column: torch.Tensor) -> torch.Tensor:
        y, x = c * row - s * column + 0.3, s * row + c * column - 0.7
        (m, n), ((y0, y1), (x0, x1)) = grid((9, 12)), turns
        phase = (y0 + y1 * y[..., None, None]) * m + (x0 + x1 * x[..., None, None]) * n
        light = (values * torch.polar(torch.ones_like(phase), -2 * math.pi * phase)).sum((-2, -1))
        return light.abs().square() * factor(y, x)

    row, column = grid(shape)
    expected = sum(v * w * power(row + y, column + x) for y, v in nodes for x, w in nodes)
    found = turned_power(values.to(dtype), ((c, -s, 0.3), (s, c, -0.7)), shape, turns, factor, nodes)
    # It ripples by 1.2e-4 of the power's waves at most, and all may do so at one place.
    assert float((found - expected).abs().max()) < 1.2e-4 * 1.2 * float(values.abs().sum()) ** 2


def test_gradients_of_power_at_turned_points_pass() -> None:
    values = torch.randn(4, 5, generator=torch.Generator().manual_seed(5), dtype=torch.complex128).requires_grad_()
    source, turns = ((0.9, -0.1, 0.2), (0.1, 0.9, 0.1)), ((0.0, 0.05), (0.1, -0.04))
    assert torch.autograd.gradcheck(
        lambda v: turned_power(v, source, (3, 4), turns, lambda y, x: torch.ones_like(y)), (values,)
    )


@pytest.mark.long
@pytest.mark.parametrize(("stride", "nodes"), [(1, ((0.0, 1.0),)), (2, ((-0.289, 0.5), (0.289, 0.5)))])
def test_rows_are_read_from_a_place_of_their_own_each(stride: int, nodes: tuple[tuple[float, float], ...]) -> None:
    amplitudes, frequencies = waves(3)
    values = summed(amplitudes, frequencies, *grid((9, SIDE))).real.requires_grad_()
    first = 20.3 + 1.37 * torch.arange(9, dtype=torch.float64)
    found = band_limited_rows(values, first, stride, 12, nodes)
    x = (first - (SIDE - 1) / 2)[:, None] + stride * torch.arange(12, dtype=torch.float64)
    y = (torch.arange(9, dtype=torch.float64) - 4)[:, None].expand(9, 12)
    expected = sum(weight * summed(amplitudes, frequencies, y, x + stride * at).real for at, weight in nodes)
    # One pass ripples by 1.2e-4 of a wave at most.
    assert float((found - expected).detach().abs().max()) < 1.3e-4 * float(amplitudes.abs().sum())
    assert torch.autograd.gradcheck(lambda v: band_limited_rows(v, first, stride, 12, nodes), (values,))
