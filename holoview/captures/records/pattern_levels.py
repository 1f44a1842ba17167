"""Patterns that are recorded for the other modulator, or with their levels inverted."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from holoview.captures.dataset import Captures
from holoview.captures.records.correction import Correction, with_levels


@dataclass(frozen=True)
class SlmExchange(Correction):
    """The patterns of the two modulators are exchanged."""

    effect = "slm_exchange"
    choice = ""
    sentence = "The patterns of the two modulators are exchanged in the records."

    def apply(self, captures: Captures) -> Captures:
        return dataclasses.replace(captures, levels=captures.levels[:, ::-1])

    def fits(self, captures: Captures) -> bool:
        """Not where a modulator lacks the levels of the other's patterns."""
        highest = captures.levels.max(axis=(0, 2, 3))[::-1]
        levels = [slm.num_levels for slm in captures.slms]
        return len(levels) == 2 and all(h < n for h, n in zip(highest, levels, strict=True))


@dataclass(frozen=True)
class SlmInversion(Correction):
    """The levels of one modulator are inverted: the highest stands for 0. slm: 0 or 1."""

    slm: int

    choice = ""

    @property
    def effect(self) -> str:
        return f"slm{self.slm + 1}_inverted"

    @property
    def sentence(self) -> str:
        return f"The levels of modulator {self.slm + 1} are recorded inverted: the highest level stands for 0."

    def apply(self, captures: Captures) -> Captures:
        levels = captures.levels[:, self.slm]
        return with_levels(captures, self.slm, (captures.slms[self.slm].num_levels - 1 - levels).astype(levels.dtype))


def level_candidates(captures: Captures) -> list[Correction]:
    """The exchange of the patterns, if there are two modulators, and each modulator's inversion."""
    inversions = [SlmInversion(slm) for slm in range(len(captures.slms))]
    return [*([SlmExchange()] if SlmExchange().fits(captures) else []), *inversions]
