"""Candidates on captures that no fit has seen, all by the same frozen weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from holoview.diagnose.bench import Bench
from holoview.diagnose.comparison import Comparison
from holoview.diagnose.screen import mismatch
from holoview.diagnose.search import Trial, cost_of

NEARLY = 1.3  # χ²/n from which a cause is worth judging at once
ALARM = 25.0  # Δχ² of held-out captures below which nothing has been found (5 σ)


@dataclass(frozen=True)
class Judged:
    """A trial and its χ²/n on held-out captures, in total and for each; rank: the same by weights that forgive."""

    trial: Trial
    chi2: float
    per_capture: tuple[float, ...]
    rank: float

    @property
    def causes(self) -> tuple[str, ...]:
        """The effects that are on."""
        return self.trial.causes

    @property
    def excess(self) -> float:
        """χ²/n beyond the noise floor."""
        return self.chi2 - 1.0


@dataclass(frozen=True)
class Selection:
    """What a search found: candidates, best first, all judged by the same frozen weights; the nominal bench's χ²."""

    nominal: Judged
    candidates: tuple[Judged, ...]
    comparison: Comparison
    forgiving: Comparison

    @property
    def best(self) -> Judged:
        """The best candidate; the nominal bench where there is none."""
        return self.candidates[0] if self.candidates else self.nominal

    @property
    def pixels(self) -> float:
        """How many held-out pixels judge."""
        return self.comparison.count


NOTHING = Trial((), {}, float("inf"))

Named = TypeVar("Named", Trial, Judged)


def judge(bench: Bench, trials: Sequence[Trial]) -> Selection:
    """All trials on the held-out captures, with weights frozen at the prediction of the best of them.

    Weights at a wrong prediction favour what is wrong alike. So as long as the best is far off, the order is by weights
    that forgive as much as that.
    """
    indices = bench.split.held_out
    rough = bench.coarse_comparison(indices, 1.0)
    first = min([NOTHING, *trials], key=lambda t: cost_of(rough, t.values))
    forgiving = bench.coarse_comparison(indices, min(mismatch(bench, first.values, indices), 1.0))
    first = min([NOTHING, *trials], key=lambda t: cost_of(forgiving, t.values))
    comparison = bench.judged_by(indices, first.values)
    found = [judged(t, comparison, forgiving) for t in trials]
    near = min((j.chi2 for j in found), default=np.inf) < NEARLY
    ordered = sorted(found, key=lambda j: j.chi2 if near else j.rank)
    candidates = distinct(_simpler_first(ordered, comparison.count) if near else ordered)
    return Selection(judged(NOTHING, comparison, forgiving), tuple(candidates), comparison, forgiving)


def judged(trial: Trial, comparison: Comparison, forgiving: Comparison) -> Judged:
    """One trial by weights that a selection froze."""
    squares = comparison.fit(trial.values).squares
    per_capture = squares / np.maximum(comparison.pixels, 1.0)
    rank = cost_of(forgiving, trial.values) / forgiving.count
    return Judged(trial, float(squares.sum() / comparison.count), tuple(float(c) for c in per_capture), rank)


def distinct(items: Sequence[Named]) -> list[Named]:
    """The first of each set of causes."""
    seen: dict[frozenset[str], Named] = {}
    for one in items:
        seen.setdefault(frozenset(one.causes), one)
    return list(seen.values())


def _simpler_first(found: Sequence[Judged], pixels: float) -> list[Judged]:
    """Sorted by χ²; of the leaders, those within 0.02 + 0.02·excess and noise of the best, fewer numbers come first."""
    if not found:
        return []
    best = found[0]
    excess = max(best.excess, 0.0)
    limit = best.chi2 + 0.02 * excess + min(0.02, 0.1 * excess) + ALARM / pixels
    leaders = [j for j in found if j.chi2 <= limit]
    rest = [j for j in found if j.chi2 > limit]
    return sorted(leaders, key=lambda j: (len(j.causes), j.trial.free, j.chi2)) + rest
