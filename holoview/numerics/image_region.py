"""Rectangular regions of an image: as slices, and setting everything outside to zero."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # torch takes seconds to import, and settings that hold a region are read without it
    import torch

Region = tuple[int, int, int, int]
"""x, y, width, height in samples; x counts along the last axis, and (0, 0) is the first sample."""


def region_slices(region: Region) -> tuple[slice, slice]:
    """The region as slices of the axes (y, x)."""
    x, y, width, height = region
    return slice(y, y + height), slice(x, x + width)


def zero_outside(images: torch.Tensor, rows: slice, columns: slice) -> None:
    """Sets the samples (…, y, x) outside two slices, each with a start and a stop, to zero in place."""
    images[..., : rows.start, :].zero_()
    images[..., rows.stop :, :].zero_()
    images[..., rows, : columns.start].zero_()
    images[..., rows, columns.stop :].zero_()
