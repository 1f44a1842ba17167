"""Pictures and modulators that are too large for the memory of a laboratory's computer are cut to their middle."""

from __future__ import annotations

import math
from dataclasses import replace

from holoview.captures.dataset import Captures
from holoview.captures.records.central_region import central_region, speckle_px
from holoview.diagnose.config import RegionConfig
from holoview.diagnose.sampling_config import SamplingConfig
from holoview.util.errors import UserError

_STEP = 0.95  # between two sizes that are tried
_COMPLEX64 = 8  # bytes


def within_limits(captures: Captures, sampling: SamplingConfig, config: RegionConfig) -> tuple[Captures, list[str]]:
    """The session, or its middle if whole pictures are beyond the limits of `config`; with a note on what was cut.

    Raises UserError, with the numbers, where even the smallest middle that a search works with is too large.
    """
    cut, side_px = captures, float(max(captures.levels.shape[2:]))
    if captures.is_fourier:
        side_px = max(n / px for n, px in zip(captures.shape, speckle_px(captures), strict=True))
    while not _fits(cut, sampling, config):
        side_px *= _STEP
        if side_px < config.side_px:
            raise _too_large(cut, sampling, config)
        cut = central_region(captures, math.floor(side_px))
    if cut is captures:
        return captures, []
    shapes = "{1} × {0} of {3} × {2} camera pixels".format(*cut.shape, *captures.shape)
    gigabytes = grid_samples(captures, sampling) * _COMPLEX64 / 1e9
    pixels = math.prod(captures.shape) / 1e6
    note = (
        f"Only the middle of the pictures was diagnosed, {shapes}: whole ones have {pixels:.3g} million pixels, and a "
        f"light field takes {gigabytes:.2g} GB of memory; up to {config.max_picture_pixels / 1e6:.3g} million and "
        f"{config.max_grid_samples * _COMPLEX64 / 1e9:.2g} GB are taken whole."
    )
    return replace(cut, images=cut.images.copy()), [note]


def grid_samples(captures: Captures, sampling: SamplingConfig) -> int:
    """Samples of the largest grid on which light fields are computed."""
    rows, columns = captures.levels.shape[2:]
    if captures.is_fourier:
        seen_rows, seen_columns = captures.shape
        return max(columns * (rows + seen_rows), seen_rows * (columns + seen_columns))
    return rows * columns * (captures.upsample * sampling.finer * sampling.padding) ** 2


def _fits(captures: Captures, sampling: SamplingConfig, config: RegionConfig) -> bool:
    is_small = math.prod(captures.shape) <= config.max_picture_pixels
    return is_small and grid_samples(captures, sampling) <= config.max_grid_samples


def _too_large(captures: Captures, sampling: SamplingConfig, config: RegionConfig) -> UserError:
    rows, columns = captures.levels.shape[2:]
    needed, most = (n * _COMPLEX64 / 1e9 for n in (grid_samples(captures, sampling), config.max_grid_samples))
    return UserError(
        "captures",
        f"a light field takes {needed:.2g} GB of memory, even with {columns} x {rows} pixels of each modulator, of "
        "which light walks off to the camera's middle",
        expected=f"at most {most:.2g} GB",
        remedy="bin the camera's pixels, or take planes nearer to the modulators",
    )
