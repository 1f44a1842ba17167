"""Multi-scale structural similarity (MS-SSIM) of images, differentiable.

With means μ, variances σ² and the covariance σ_xy of two images x and y in a Gaussian window about each sample, of
which all samples lie inside the image, and ⟨·⟩ the mean over these windows,

    S = ⟨l·s⟩_M^w_M · Π_{j<M} ⟨s⟩_j^w_j,    l = (2·μ_x·μ_y + C₁)/(μ_x² + μ_y² + C₁),
                                             s = (2·σ_xy + C₂)/(σ_x² + σ_y² + C₂)

where scale j is the image after j − 1 times averaging blocks of 2 × 2 samples (an odd last row or column is left out),
l compares luminance, and s contrast and structure. S is 1 for equal images alone. The window has 11 × 11 samples and
a standard deviation of 1.5, C₁ = (0.01·range)² and C₂ = (0.03·range)², and five scales have the weights `WEIGHTS`, as
in Z. Wang, E. P. Simoncelli and A. C. Bovik, "Multiscale structural similarity for image quality assessment", Asilomar
Conference on Signals, Systems and Computers, 1398 (2003). A coarsest scale needs a whole window: images with fewer than
176 rows or columns have fewer scales, whose weights are scaled to a sum of 1; one scale is SSIM (Wang et al., IEEE
Trans. Image Process. 13, 600 (2004)). Values of different numbers of scales can't be compared.

A convolution of torch takes seconds for one channel of a large image on a processor. The window's mean is therefore a
sum of shifted images, along y and then along x.
"""

from __future__ import annotations

import math
from typing import Any

import torch
from torch.nn import functional

Tensor = torch.Tensor

WEIGHTS = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)
"""Weights of the scales, from the finest to the coarsest (Wang et al. 2003, from a psychophysical experiment)."""

WINDOW = 11
"""Samples of the window along y and x, and of the smallest image."""

_SIGMA, _K1, _K2 = 1.5, 0.01, 0.03
_LEAST = 1e-6  # of a scale's mean: a power of less has no finite slope, and of less than 0 no value


def scale_count(shape: tuple[int, int]) -> int:
    """The number of scales of an image of (rows, columns): at most five, 0 where the window doesn't fit."""
    sides = [min(shape) >> scale for scale in range(len(WEIGHTS))]
    return sum(side >= WINDOW for side in sides)


def multi_scale_similarity(image: Tensor, target: Tensor, data_range: float = 1.0) -> Tensor:
    """MS-SSIM of each channel, (channel,).

    image, target: (channel, y, x) of equal shape. data_range: difference between black and white.

    Raises ValueError for other shapes, and for images that are smaller than the window.
    """
    scales = scale_count((image.shape[-2], image.shape[-1]))
    if image.ndim != 3 or image.shape != target.shape or scales == 0:
        raise ValueError(f"images {tuple(image.shape)}, {tuple(target.shape)}: expected equal, {WINDOW} samples wide")
    weights, similarity = WEIGHTS[:scales], image.new_ones(len(image))
    total = 1.0 if scales == len(WEIGHTS) else sum(weights)  # the published weights sum up to 1.0001
    for scale, weight in enumerate(weights):
        if scale > 0:
            image, target = (functional.avg_pool2d(one, 2) for one in (image, target))
        luminance, structure = _comparisons(image, target, data_range)
        is_coarsest = scale == scales - 1
        mean = (luminance * structure if is_coarsest else structure).mean(dim=(1, 2))
        similarity = similarity * mean.clamp_min(_LEAST) ** (weight / total)
    return similarity


def similarity(image: Tensor, target: Tensor, data_range: float = 1.0) -> Tensor:
    """SSIM of each channel, (channel,): the mean of l·s at the finest scale alone.

    image, target: (channel, y, x) of equal shape, at least as large as the window. data_range: between black and white.
    """
    luminance, structure = _comparisons(image, target, data_range)
    return (luminance * structure).mean(dim=(1, 2))


def _comparisons(image: Tensor, target: Tensor, data_range: float) -> tuple[Tensor, Tensor]:
    """l and s of every window, (channel, y − 10, x − 10)."""
    c1, c2 = (_K1 * data_range) ** 2, (_K2 * data_range) ** 2
    products = torch.stack([image, target, image * image + target * target, image * target])
    mean_x, mean_y, power, product = _WindowMeans.apply(products)  # type: ignore[no-untyped-call]
    power_of_means, product_of_means = mean_x * mean_x + mean_y * mean_y, mean_x * mean_y
    structure = (2 * (product - product_of_means) + c2) / (power - power_of_means + c2)
    return (2 * product_of_means + c1) / (power_of_means + c1), structure


class _WindowMeans(torch.autograd.Function):
    """Means (…, y − 10, x − 10) of images (…, y, x) in the Gaussian window, and their adjoint."""

    @staticmethod
    def forward(ctx: Any, images: Tensor) -> Tensor:
        return _window_means(images)

    @staticmethod
    def backward(ctx: Any, *slopes: Tensor) -> Tensor:
        rim = WINDOW - 1
        return _window_means(functional.pad(slopes[0], (rim, rim, rim, rim)))


def _window_means(images: Tensor) -> Tensor:
    """Means of images (…, y, x) in the Gaussian window, (…, y − 10, x − 10)."""
    return _filter(_filter(images, -2), -1)


def _filter(images: Tensor, axis: int) -> Tensor:
    """Means along an axis, shorter by 10 samples."""
    size = images.shape[axis] - WINDOW + 1
    weights = [math.exp(-((k - WINDOW // 2) ** 2) / (2 * _SIGMA**2)) for k in range(WINDOW)]
    means = images.narrow(axis, 0, size) * (weights[0] / sum(weights))
    for k in range(1, WINDOW):
        means.add_(images.narrow(axis, k, size), alpha=weights[k] / sum(weights))
    return means
