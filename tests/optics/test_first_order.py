"""The first diffraction order: its bins, the envelope of a pixel, and means of blocks."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from holoview.holograms.metrics.image_quality import eyebox_uniformity
from holoview.light.model.plan import Grid
from holoview.light.optics.slm import EYEBOX_BLOCKS, first_order, pixel_spectrum

SHAPES = [(32, 48), (40, 54), (50, 18)]


def _grid(padded: tuple[int, int], upsample: int = 2) -> Grid:
    padded = (padded[0] // upsample * upsample, padded[1] // upsample * upsample)
    return Grid(shape=padded, padded=padded, offset=(0, 0), pitch_m=8e-6 / upsample, upsample=upsample)


@pytest.mark.parametrize("upsample", [1, 2, 3])
@pytest.mark.parametrize("padded", SHAPES, ids=str)
def test_the_bins_are_those_of_the_modulators_own_band_in_rising_order(padded: tuple[int, int], upsample: int) -> None:
    grid = _grid(padded, upsample)
    for n, bins in zip(grid.padded, first_order(grid).bins, strict=True):
        frequencies = np.fft.fftfreq(n, grid.pitch_m)
        half = 1 / (2 * grid.pitch_m * upsample)
        found = frequencies[bins]
        assert len(bins) == n // upsample == len(set(bins))
        assert (np.diff(found) > 0).all()
        assert np.abs(found).max() <= half * (1 + 1e-12)
        assert found[len(bins) // 2] == 0


@pytest.mark.parametrize("upsample", [1, 2, 3])
def test_the_envelope_is_the_power_spectrum_of_a_pixel(upsample: int) -> None:
    grid = _grid((36, 60), upsample)
    order = first_order(grid)
    for n, bins, envelope in zip(grid.padded, order.bins, order.envelopes, strict=True):
        power = pixel_spectrum(n, upsample, 0.0).abs().square().numpy()[bins] / upsample**2
        np.testing.assert_allclose(envelope, power, rtol=1e-12)
        edge = 1.0 if upsample == 1 else (1 / (upsample * math.sin(math.pi / (2 * upsample)))) ** 2
        assert envelope.min() == pytest.approx(edge, rel=0.1)  # at the order's edge, less half a bin


@pytest.mark.parametrize("blocks", [1, 4, EYEBOX_BLOCKS])
@pytest.mark.parametrize("padded", SHAPES, ids=str)
def test_blocks_are_plain_means_without_the_envelope(padded: tuple[int, int], blocks: int) -> None:
    grid = _grid(padded)
    order = first_order(grid)
    power = np.random.default_rng(0).random(grid.padded)
    found = order.block_matrix(0, blocks) @ power[np.ix_(*order.bins)] @ order.block_matrix(1, blocks).T
    light = power[np.ix_(*order.bins)] / np.outer(*order.envelopes)
    edges = [[k * n // blocks for k in range(blocks + 1)] for n in light.shape]
    for row in range(blocks):
        for column in range(blocks):
            rows, columns = slice(*edges[0][row : row + 2]), slice(*edges[1][column : column + 2])
            assert found[row, column] == pytest.approx(light[rows, columns].mean(), rel=1e-12)


@pytest.mark.parametrize("padded", SHAPES, ids=str)
def test_blocks_are_those_of_the_metric(padded: tuple[int, int]) -> None:
    order = first_order(_grid(padded))
    power = np.random.default_rng(1).random([len(bins) for bins in order.bins])
    blocks = order.block_matrix(0) @ power @ order.block_matrix(1).T
    expected = eyebox_uniformity(power, EYEBOX_BLOCKS, np.outer(*order.envelopes)).coefficient_of_variation
    assert blocks.std() / blocks.mean() == pytest.approx(expected, rel=1e-12)


def test_one_bright_pixel_fills_the_order_evenly() -> None:
    grid = _grid((32, 48))
    field = torch.zeros(grid.padded, dtype=torch.complex128)
    field[6:8, 10:12] = 1  # a pixel of two by two samples
    order = first_order(grid)
    power = torch.fft.fft2(field).abs().square().numpy()[np.ix_(*order.bins)]
    blocks = order.block_matrix(0) @ power @ order.block_matrix(1).T
    np.testing.assert_allclose(blocks, 16.0, rtol=1e-12)


def test_an_order_of_fewer_bins_than_blocks_has_a_block_a_bin() -> None:
    order = first_order(_grid((12, 10)))
    down, across = order.block_matrix(0), order.block_matrix(1)
    np.testing.assert_allclose(down * order.envelopes[0], np.eye(6), rtol=1e-14)
    np.testing.assert_allclose(across * order.envelopes[1], np.eye(5), rtol=1e-14)
