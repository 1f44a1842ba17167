"""Pictures too small to show speckle are refused; the smallest that aren't are compared."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from holoview.bench.captures.records import find_record_errors
from holoview.bench.diagnose.pipeline import diagnose
from holoview.util.errors import UserError
from tests.captures.conftest import pictures


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (3, 40)])
def test_a_picture_without_speckle_is_refused(shape: tuple[int, int]) -> None:
    images = np.random.default_rng(1).integers(200, 1500, (8, *shape)).astype(np.uint16)
    captures = dataclasses.replace(pictures(8), images=images)
    for use in (find_record_errors, diagnose):
        with pytest.raises(UserError, match=f"pictures of {shape[0]} × {shape[1]} pixels; expected 4 rows"):
            use(captures)


def test_four_rows_are_compared() -> None:
    images = np.random.default_rng(1).integers(200, 1500, (4, 4, 4)).astype(np.uint16)
    assert not find_record_errors(dataclasses.replace(pictures(4), images=images)).corrections
