"""Pixels that can't be trusted are left out of comparisons: saturated, stuck, and those at the border."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from holoview.captures.dataset import Captures
from holoview.captures.prepared_captures import BORDER_PX, prepare_captures

Make = Callable[..., Captures]


def test_what_cant_be_trusted_is_left_out(make_captures: Make) -> None:
    captures = make_captures(count=6)
    images = captures.images.copy()
    images[2, 30, 30] = captures.camera.saturation
    images[:, 25, 33] = 700  # a stuck pixel
    usable = prepare_captures(dataclasses.replace(captures, images=images)).usable
    assert not usable[2, 30, 30] and usable[1, 30, 30]
    assert not usable[:, 25, 33].any()
    rows, columns = captures.shape
    inner = usable[:, BORDER_PX : rows - BORDER_PX, BORDER_PX : columns - BORDER_PX]
    assert not usable[:, :BORDER_PX, :].any() and not usable[:, :, -BORDER_PX:].any()
    assert inner.size - np.count_nonzero(inner) == 1 + 6
