"""Which corrections are tried: each alone, and those of two different kinds together."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from holoview.captures.dataset import Captures
from holoview.captures.records.capture_order import PatternOffset, offset_candidates
from holoview.captures.records.correction import ORDER, Correction, Hypothesis, hypothesis
from holoview.captures.records.orientation import orientation_candidates
from holoview.captures.records.pattern_levels import level_candidates
from holoview.captures.records.settings import RecordSettings
from holoview.captures.records.value_order import (
    Column,
    ColumnReversal,
    column_values,
    exchanges,
    unit_candidates,
)

COLUMNS: tuple[Column, ...] = ("wavelength", "distance")


def single_corrections(captures: Captures, screened: Sequence[int], settings: RecordSettings) -> list[Correction]:
    """Every correction that these captures can need; of mixed-up columns those that the screened captures see."""
    found = [*orientation_candidates(captures), *level_candidates(captures)]
    found += offset_candidates(captures, settings.largest_offset)
    for column in COLUMNS:
        if len(column_values(captures, column)) > 1:
            found += [*exchanges(captures, column, screened), ColumnReversal(column)]
    return [*found, *unit_candidates(captures, "distance")] if not captures.is_fourier else found


def pairs(singles: Sequence[Correction], settings: RecordSettings) -> list[Hypothesis]:
    """Two corrections of different kinds; of the offsets those of all patterns alone, and the smaller ones."""
    most = settings.paired_offset
    few = [c for c in singles if not isinstance(c, PatternOffset) or c.is_plain or abs(c.offset) <= most]
    return [hypothesis(pair) for pair in combinations(few, 2) if pair[0].effect != pair[1].effect]


def preference(corrections: Hypothesis) -> tuple[object, ...]:
    """Sorts explanations that predict alike: fewer corrections first, then modulators before the camera.

    The last part makes the order of equals definite.
    """
    kinds = sorted(ORDER.index(c.effect) for c in corrections)
    involved = sum(isinstance(c, PatternOffset) and not c.is_plain for c in corrections)
    reversal = sum(isinstance(c, ColumnReversal) for c in corrections)
    return len(corrections), involved, reversal, kinds, [c.choice for c in corrections]
