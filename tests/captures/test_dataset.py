"""Captures are taken apart and put together again."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from holoview.bench.captures.dataset import Captures, join_captures

Make = Callable[..., Captures]


def test_joined_captures_keep_the_patterns_that_each_was_taken_after(make_captures: Make) -> None:
    """Of subsets, and of a part whose patterns follow from its order."""
    captures = make_captures(6)
    parts = [captures.subset([4, 1]), captures.subset([5, 0])]
    joined = join_captures(parts)
    for number, k in enumerate((4, 1, 5, 0)):
        assert np.array_equal(joined.drive_before(number), captures.drive_before(k))
    mixed = join_captures([captures.subset([4]), dataclasses.replace(captures.subset([1, 2]), levels_before=None)])
    assert np.array_equal(mixed.drive_before(1), captures.drive(4)) and np.array_equal(
        mixed.drive_before(2), captures.drive(1)
    )
