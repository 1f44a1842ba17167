"""A tilted wave falls elsewhere: by angle × focal length behind a lens, by angle × distance near by."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from holoview.bench.captures.dataset import Captures
from holoview.light.model.bench_parts import Relay

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]
_ANGLE = 2e-3


def _centre(image: torch.Tensor) -> tuple[float, float]:
    """Centroid (y, x) in pixels from the middle."""
    weights = [image.sum(dim=1 - axis) / image.sum() for axis in (0, 1)]
    return tuple(float((w * (torch.arange(len(w)) - (len(w) - 1) / 2)).sum()) for w in weights)  # type: ignore[return-value]


def test_behind_a_lens_the_zero_order_moves(make_fourier: Make, predicted: Predicted) -> None:
    captures = make_fourier(1, levels=np.zeros((1, 1, 20, 28), np.uint8))
    image = predicted(captures, {"tilt": {"tilt_y": _ANGLE, "tilt_x": -_ANGLE}})[0]
    at = torch.tensor(np.unravel_index(int(image.argmax()), image.shape)) - torch.tensor([30, 40])
    assert at.tolist() == [20, -20]  # 0.1 m × 2 mrad in pixels of 10 µm


def test_near_by_the_shadow_moves(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(1, modulators=1, levels=np.zeros((1, 1, 20, 28), np.uint8), relay2=Relay())
    before, after = (_centre(predicted(captures, e)[0]) for e in ({}, {"tilt": {"tilt_x": _ANGLE}}))
    assert after[1] - before[1] > 0.5  # 1.5 pixels less what leaves the picture
    assert after[0] == pytest.approx(before[0], abs=1e-9)


_FINER = 32  # points along each side of a pixel


@pytest.mark.parametrize("beside", [{}, {"crosstalk": {"sigma": 1e-4}}], ids=["pixels", "samples"])
@pytest.mark.parametrize("rotation", [0.0, 0.05])
def test_behind_a_lens_a_tilted_wave_goes_on_across_each_pixel(
    make_fourier: Make, predicted: Predicted, beside: dict[str, dict[str, float]], rotation: float
) -> None:
    """Against the direct sum over a fine sampling of the aperture, exp(2πi·(s·r + path/λ − r·x/(λf))).

    The sum has N points along each side of a pixel for its continuum: light at ν − s = 0.4 cycles a pixel is too bright
    by (π·0.4/N)²/3, 5e-4. A blur by 1e-4 pixels has the pixels sampled. Interpolation for a rotated camera errs by 1e-4
    of the field.
    """
    captures, tilt = make_fourier(1), (15e-3, -20e-3)
    camera = {"camera_alignment": {"rotation": rotation}} if rotation else {}
    effects = {"tilt": {"tilt_y": tilt[0], "tilt_x": tilt[1]}, **beside, **camera}
    found = predicted(captures, effects)[0].numpy()
    λ, focal_m, p = 520e-9, 0.1, 8e-6
    path = np.repeat(np.repeat(captures.levels[0, 0] / 15 * 780e-9, _FINER, 0), _FINER, 1)
    y, x = ((np.arange(n) - (n - 1) / 2) * p / _FINER for n in path.shape)
    slope_y, slope_x = (np.sin(angle) / λ for angle in tilt)
    light = np.exp(2j * np.pi * (path / λ + slope_y * y[:, None] + slope_x * x[None, :]))
    rows, columns = ((np.arange(n) - (n - 1) / 2) * 10e-6 for n in (61, 81))
    at_y, at_x = np.meshgrid(rows, columns, indexing="ij")
    turned_y = np.cos(rotation) * at_y - np.sin(rotation) * at_x  # where a rotated camera's pixels are
    turned_x = np.sin(rotation) * at_y + np.cos(rotation) * at_x
    expected = np.array(
        [
            abs(np.exp(-2j * np.pi * v * y / (λ * focal_m)) @ light @ np.exp(-2j * np.pi * u * x / (λ * focal_m))) ** 2
            for v, u in zip(turned_y[::7, ::7].ravel(), turned_x[::7, ::7].ravel(), strict=True)
        ]
    ).reshape(found[::7, ::7].shape)
    found = found[::7, ::7]
    expected *= (found * expected).sum() / (expected**2).sum()
    assert np.linalg.norm(found - expected) < 1e-3 * np.linalg.norm(expected)
