"""A point becomes a line of that length and direction; its light and its centre stay."""

from __future__ import annotations

import pytest
import torch

from holoview.model.effects.hook_contexts import CameraContext
from holoview.model.effects.registry import get_effect


def _smeared(image: torch.Tensor, y: float, x: float) -> torch.Tensor:
    effect = get_effect("motion_blur")
    context = CameraContext(4e-6, (image.shape[0], image.shape[1]))
    return effect.image(image, context, effect.parameter_values({"length_y": y, "length_x": x}))


def test_whole_pixels_are_the_mean_of_shifted_pictures_with_halves_at_the_ends() -> None:
    """Of a picture whose spectrum ends at a tenth of Nyquist the line's integral is the trapezoidal sum, but for the
    rule's first error, (π·f)²/3 with f = 0.05 cycles per pixel."""
    x = torch.arange(200).double()
    image = (1 + (2 * torch.pi * 0.05 * x).cos()).expand(60, -1)
    found = _smeared(image, 0.0, 6.0)[30, 40:160]
    weights = {shift: 0.5 if abs(shift) == 3 else 1.0 for shift in range(-3, 4)}
    mean = sum(w * image[30].roll(shift) for shift, w in weights.items())[40:160] / 6
    assert float((found - mean).abs().max()) < 1.01 * (torch.pi * 0.05) ** 2 / 3


@pytest.mark.parametrize(("y", "x"), [(0.0, 5.0), (4.0, -3.0), (0.7, 0.2)])
def test_a_spot_spreads_by_the_moments_of_a_line(y: float, x: float) -> None:
    """Of a Gaussian spot, which has no frequencies that the pixels don't resolve: second moments grow by length²/12."""
    at = (torch.arange(61) - 30).double()
    spot = torch.exp(-(at[:, None] ** 2 + at[None, :] ** 2) / (2 * 2.0**2))
    found = _smeared(spot, y, x)
    assert float(found.sum()) == pytest.approx(float(spot.sum()))

    def moment(image: torch.Tensor, first: torch.Tensor, second: torch.Tensor) -> float:
        return float((image * first * second).sum() / image.sum())

    rows, columns = at[:, None].expand(61, 61), at[None, :].expand(61, 61)
    assert moment(found, rows, rows) - moment(spot, rows, rows) == pytest.approx(y**2 / 12, abs=1e-6)
    assert moment(found, columns, columns) - moment(spot, columns, columns) == pytest.approx(x**2 / 12, abs=1e-6)
    assert moment(found, rows, columns) == pytest.approx(y * x / 12, abs=1e-6)


def test_motion_there_and_back_is_the_same() -> None:
    image = torch.rand(20, 30, generator=torch.Generator().manual_seed(1)).double()
    assert torch.allclose(_smeared(image, 2.0, 3.0), _smeared(image, -2.0, -3.0), rtol=1e-12)


def test_lengths_have_gradients() -> None:
    from holoview.numerics.resample import line_blur

    image = torch.rand(12, 10, generator=torch.Generator().manual_seed(2)).double()
    length = tuple(torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in (1.3, -0.4))
    assert torch.autograd.gradcheck(lambda y, x: line_blur(image, (y, x)), length)
