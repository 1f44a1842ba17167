"""How well predicted speckle stands in pictures, as sums over their bright pixels that have derivatives.

The measure is that of `numerics.speckle_match`, the correlation of local contrasts, without shifts. A quarter of the
bright pixels, in squares, is held out of a search.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.picture_geometry import bright_window, zero_order_mask
from holoview.bench.captures.prepared_captures import PreparedCaptures
from holoview.bench.captures.records.trials import cut_pictures
from holoview.light.numerics.speckle_match import LOCAL_MEAN_PX

Tensor = torch.Tensor

_LOW_PASS_PX = 0.6
_HELD_SIDE_PX = 64  # at most, of the squares of which a quarter is held out
_HELD_SQUARES = 6  # at least, along the shorter side
_BLOCK_PX = 32  # at most, of the blocks by whose scatter a gain is judged: independent of each other
_DARK, _BRIGHT, _LEAST_LIGHT = 0.02, 0.99, 0.05
"""Quantiles of the local mean of dark and of the brightest pixels, and how far between them light has to be to count:
in near fields most of a picture may be dark, and a contrast of noise there."""
_MOST_VALUES = 100_000  # of which quantiles are taken
_BLOCK_ROWS = 64  # of the matrix of a mean, that are multiplied together


def window_of(captures: Captures, size: tuple[int, int]) -> Captures:
    """The brightest window of the pictures of a Fourier bench, without the zero order; near fields as they are."""
    if not captures.is_fourier:
        return captures
    brightest = captures.images.max(axis=0).astype(np.float64) - captures.camera.black_level
    usable = ~zero_order_mask(captures.images.max(axis=0), captures.camera.saturation)
    counted = np.stack([captures.usable_pixels(k) & usable for k in range(len(captures))])
    window = bright_window(np.maximum(brightest, 0.0), np.asarray(counted.any(axis=0)), size)
    return cut_pictures(dataclasses.replace(captures, usable=counted), window)


class SpeckleMeasure:
    """The speckle of measured pictures (capture, y, x), to which predicted ones are compared.

    fitted, held_out: bright pixels by which light is sought, and by which it is judged. contrast: local contrasts.
    mean: local means. Pixels that aren't usable, as of a saturated zero order, count as their surroundings.
    """

    def __init__(self, data: PreparedCaptures) -> None:
        shape = data.captures.shape
        self._low = [_window(n, _LOW_PASS_PX) for n in shape]
        self._windows = [_window(n, LOCAL_MEAN_PX) for n in shape]
        self._usable = torch.from_numpy(data.usable)
        self._share = _blurred(self._usable.float(), self._windows).clamp_min(1e-3)
        light = torch.from_numpy(np.maximum(data.light, 0.0))
        self.mean = self._local_mean(light)
        values = self.mean.flatten()[:: max(1, self.mean.numel() // _MOST_VALUES)]
        dark, median, brightest = (float(values.quantile(share)) for share in (_DARK, 0.5, _BRIGHT))
        bright = self._usable & (self.mean > max(median, dark + _LEAST_LIGHT * (brightest - dark)))
        side = max(8, min(_HELD_SIDE_PX, min(shape) // _HELD_SQUARES))
        y, x = np.mgrid[: shape[0], : shape[1]]
        held = torch.from_numpy((y // side + x // side) % 4 == 0)
        self.fitted, self.held_out = bright & ~held, bright & held
        self.contrast = self._local_contrast(light)
        block_px = max(1, min(_BLOCK_PX, side // 2))
        blocks = (y // block_px) * shape[1] + x // block_px
        stacked = np.stack([blocks + number * blocks.size for number in range(len(light))])
        self._bright = bright
        self._blocks = np.unique(stacked[bright.numpy()], return_inverse=True)[1]

    def correlation(self, predicted: Tensor, pixels: Tensor) -> Tensor:
        """The correlation of local contrasts over some pixels."""
        a, b = self._compared(predicted, pixels)
        return (a * b).sum()

    def missing_by_block(self, predicted: Tensor) -> NDArray[np.float64]:
        """What each block of bright pixels, held out or not, lacks of a correlation of 1: half of the squared
        differences of contrasts, whose squares add up to 1."""
        a, b = self._compared(predicted, self._bright)
        return np.asarray(np.bincount(self._blocks, ((a - b).square() / 2).double().numpy()), np.float64)

    def _compared(self, predicted: Tensor, pixels: Tensor) -> tuple[Tensor, Tensor]:
        """Local contrasts on some pixels, measured and predicted, without their means, each of unit norm."""
        both = self.contrast[pixels], self._local_contrast(predicted)[pixels]
        a, b = (one - one.mean() for one in both)
        return a / torch.sqrt(a.square().sum() + 1e-12), b / torch.sqrt(b.square().sum() + 1e-12)

    def _local_mean(self, pictures: Tensor) -> Tensor:
        return _blurred(pictures * self._usable, self._windows) / self._share

    def _local_contrast(self, pictures: Tensor) -> Tensor:
        mean = self._local_mean(pictures)
        low = _blurred(torch.where(self._usable, pictures, mean), self._low)
        return low / (low + mean + 1e-9 * mean.max())


_Window = list[tuple[slice, Tensor]]
"""Blocks of rows of the matrix of a mean, each with the samples whose weights aren't nothing."""


def _blurred(pictures: Tensor, windows: list[_Window]) -> Tensor:
    for window in windows:  # along y, then along x
        pictures = torch.cat([block @ pictures[..., near, :] for near, block in window], dim=-2).transpose(-2, -1)
    return pictures


def _window(count: int, sigma: float) -> _Window:
    """The matrix (count, count) of a Gaussian mean that is normalised at the edges; single precision needs no more than
    six standard deviations of it."""
    index = torch.arange(count, dtype=torch.float32)
    weights = torch.exp(-0.5 * ((index[:, None] - index[None, :]) / sigma).square())
    weights = weights / weights.sum(dim=1, keepdim=True)
    reach, blocks = math.ceil(6 * sigma), []
    for first in range(0, count, _BLOCK_ROWS):
        near = slice(max(0, first - reach), min(count, first + _BLOCK_ROWS + reach))
        blocks.append((near, weights[first : first + _BLOCK_ROWS, near].contiguous()))
    return blocks
