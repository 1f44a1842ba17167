"""Finds wrong records: which corrections make predicted and seen speckle correlate.

screen   every correction alone, on two smooth captures
compare  the best ones on several captures, mixed-up columns with their best order
decide   named only if it beats the records as they are beyond chance, and other captures don't contradict
pairs    where one correction leaves the captures badly predicted
repeat   on the corrected records, until nothing more is found
exchange one that nearly was the best takes the place of what was found, with another beside it
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.stats import norm

from holoview.captures.dataset import Captures
from holoview.captures.records.candidates import COLUMNS, pairs, preference, single_corrections
from holoview.captures.records.capture_choice import choose_captures
from holoview.captures.records.capture_order import PatternOffset
from holoview.captures.records.central_region import central_captures, central_region
from holoview.captures.records.correction import Correction, Hypothesis, apply_corrections, hypothesis
from holoview.captures.records.findings import RecordFindings
from holoview.captures.records.power_order import find_power_order
from holoview.captures.records.settings import DEFAULT, RecordSettings
from holoview.captures.records.trial import Trials, TrialScore, Values
from holoview.captures.records.value_order import (
    Column,
    ValueOrder,
    column_values,
    cyclic_orders,
    units_of_lengths,
    value_indices,
)


def find_record_errors(
    captures: Captures, effects: Values | None = None, settings: RecordSettings = DEFAULT
) -> RecordFindings:
    """Which records of a session are wrong.

    effects: those that the nominal bench has, {id: {parameter: value}}. Raises UserError for lengths that no change of
    unit makes plausible.
    """
    began, units = time.monotonic(), units_of_lengths(captures)
    captures = apply_corrections(captures, units)
    region = central_region(captures, settings.region_px)
    found = _Search(central_captures(region, settings.most_captures), effects or {}, settings).run()
    changes = [_without_ends(c) if len(captures) > settings.most_captures else c for c in found.corrections]
    power = find_power_order(region, hypothesis(changes), effects or {}, settings)
    corrections = hypothesis([*units, *changes, *power])
    return RecordFindings(
        corrections, found.rivals, found.correlation, found.undecided, found.captures, time.monotonic() - began
    )


def _without_ends(correction: Correction) -> Correction:
    """The ends of a long session aren't looked at, so that it isn't known whether they have a pattern."""
    return correction.without_ends() if isinstance(correction, PatternOffset) else correction


def _labels(score: TrialScore) -> list[str]:
    return [correction.label for correction in score.hypothesis]


class _Search:
    """The search on one session, whose units are plausible."""

    def __init__(self, captures: Captures, effects: Values, settings: RecordSettings) -> None:
        self.trials, self._settings = Trials(captures, effects, settings), settings
        self._chosen = choose_captures(captures, self.trials.coarseness, settings)
        self._singles = single_corrections(captures, self._chosen.screened, settings)
        self._tried = 1
        self._runners_up: list[Hypothesis] = []

    def run(self) -> RecordFindings:
        before = best = self.trials.score([()], self._chosen.tested)[0]
        rivals: tuple[Hypothesis, ...] = ()
        while len(best.hypothesis) < self._settings.most_corrections:
            found = self._best_of(best, self._extended(best.hypothesis))
            if not best.hypothesis and (found or [best])[0].correlation < self._settings.well_predicted:
                found = self._best_of(found[0] if found else best, pairs(self._singles, self._settings)) or found
            found = found or self._best_of(best, self._exchanged(best.hypothesis))
            if not found:
                break
            added = [c for c in found[0].hypothesis if c not in best.hypothesis]
            rivals = (*(hypothesis([*rival, *added]) for rival in rivals), *(score.hypothesis for score in found[1:]))
            best = found[0]
        return RecordFindings(
            self._with_ends(best),
            rivals,
            (before.correlation, best.correlation),
            self._undecided(best),
            len(self._chosen.tested),
        )

    def _extended(self, base: Hypothesis) -> list[Hypothesis]:
        """The base with one more correction of another kind."""
        kinds = {c.effect for c in base}
        return [hypothesis([*base, c]) for c in self._singles if c.effect not in kinds]

    def _exchanged(self, base: Hypothesis) -> list[Hypothesis]:
        """Those that came next to a base, with one more correction of another kind.

        Of two wrong records, one that puts a part of both right may come before each alone: patterns out of step with
        their settings where patterns alone are, and distances are mixed up.
        """
        near = [one for one in self._runners_up if len(one) == len(base)][: self._settings.exchanged]
        return [wider for one in near for wider in self._extended(one) if not {*base} <= {*wider}]

    def _best_of(self, base: TrialScore, hypotheses: Sequence[Hypothesis]) -> list[TrialScore]:
        """The best hypothesis and those that predict the same, if it beats the base beyond chance; else nothing."""
        self._tried += len(hypotheses)
        screened = self._chosen.screened
        promising = self._most_significant(hypotheses, screened[:1], self._settings.promising)
        kept = self._sorted_out(self._most_significant(promising, screened, self._settings.kept))
        scores = [s for s in self.trials.score(kept, self._chosen.tested) if self._is_better(s, base)]
        if not scores:
            return []
        first = max(scores, key=lambda s: float(s.significance.max()))
        alike = sorted((s for s in scores if self._are_alike(s, first)), key=lambda s: preference(s.hypothesis))
        fewest = self._told_apart([s for s in alike if len(s.hypothesis) == len(alike[0].hypothesis)])
        if not self._is_confirmed(fewest[0].hypothesis, base.hypothesis):
            return []
        ranked = sorted(scores, key=lambda s: -s.significance.max())
        self._runners_up = [s.hypothesis for s in ranked if s is not fewest[0]]
        return fewest

    def _told_apart(self, alike: Sequence[TrialScore]) -> list[TrialScore]:
        """Those of some hypotheses that stay alike on captures for which they differ, which weren't tested."""
        best = [alike[0]]
        for other in alike[1:]:
            pair = [best[0].hypothesis, other.hypothesis]
            differing = self.trials.differing(*pair)
            if not differing and _labels(other) == _labels(best[0]):
                continue  # exchanged values may be those of the column from its end
            if not differing or set(differing) & set(self._chosen.tested):
                best.append(other)
                continue
            first, second = self.trials.score(pair, differing[: self._settings.confirmed])
            if self._are_alike(first, second):
                best.append(other)
            elif second.gain_over(first)[0] > 0:
                best = [other]
        return best

    def _are_alike(self, a: TrialScore, b: TrialScore) -> bool:
        gain, sigmas = b.gain_over(a)
        return abs(gain) < self._settings.equal_gain or abs(sigmas) < self._settings.equal_sigmas

    def _most_significant(
        self, hypotheses: Sequence[Hypothesis], indices: Sequence[int], count: int
    ) -> list[Hypothesis]:
        """The `count` hypotheses that predict these captures best."""
        scores = self.trials.score(hypotheses, indices)
        return [s.hypothesis for s in sorted(scores, key=lambda s: -s.significance.max())[:count]]

    def _sorted_out(self, hypotheses: Iterable[Hypothesis]) -> list[Hypothesis]:
        """Every mixed-up column gets the order that predicts the tested captures best."""
        result: dict[Hypothesis, None] = {}
        left = self._settings.sorted_orders
        for one in hypotheses:
            for column in COLUMNS:
                order = next((c for c in one if isinstance(c, ValueOrder) and c.column == column), None)
                if order is None:
                    continue
                others = [c for c in one if c is not order]
                if left:
                    left -= 1
                    one = self._best_order(others, column) or one
            result.setdefault(one)
        return list(result)

    def _best_order(self, others: Sequence[Correction], column: Column) -> Hypothesis | None:
        """The one-to-one order of a column's values that maximises Σ z; None if it is the recorded one."""
        captures, tested = self.trials.captures, self._chosen.tested
        orders = cyclic_orders(captures, column)
        recorded = np.array(value_indices(captures, column, tested))
        count = len(column_values(captures, column))
        scores = self.trials.score([hypothesis([*others, order]) for order in orders], tested)
        if len(scores) < count:
            return None
        blur = max(scores, key=lambda s: float(s.significance.max())).best_blur
        merit = np.zeros((count, count))
        for step, score in enumerate(scores):
            weighted = score.z[:, blur] * np.sqrt(score.grains[:, blur])
            np.add.at(merit, (recorded, (recorded + step) % count), weighted)
        permutation = tuple(int(j) for j in linear_sum_assignment(merit, maximize=True)[1])
        if permutation == tuple(range(count)):
            return None
        return hypothesis([*others, ValueOrder(column, permutation, orders[0].values)])

    def _is_better(self, score: TrialScore, base: TrialScore) -> bool:
        """Whether a hypothesis beats another by more than the best of all that were tried does by chance.

        Where the tested captures don't decide, rougher ones are asked too: smooth speckle looks much the same at
        another wavelength.
        """
        gain, sigmas = score.gain_over(base)
        if self._settings.undecided < sigmas < self._chance_sigmas(score):
            more = [*self._chosen.tested, *self._chosen.confirmed]
            wider, base = self.trials.score([score.hypothesis, base.hypothesis], more)
            gain, sigmas = wider.gain_over(base)
        if gain < self._settings.min_gain or sigmas < self._chance_sigmas(score):
            return False
        return all(self._improves_every_value(score, c) for c in score.hypothesis if isinstance(c, ValueOrder))

    def _chance_sigmas(self, score: TrialScore) -> float:
        trials = self._tried * score.z.shape[1] * self.trials.shift_count
        return float(norm.isf(self._settings.false_alarms / trials))

    def _improves_every_value(self, score: TrialScore, order: ValueOrder) -> bool:
        """Whether the captures of every value that an order moves are predicted better with it than without it.

        Another error, such as a wrong distance, may make some of them look better under a wrong order, but never all.
        """
        without = hypothesis([c for c in score.hypothesis if c is not order])
        base = self.trials.score([without], self._chosen.tested)[0]
        recorded = np.array(value_indices(self.trials.captures, order.column, self._chosen.tested))
        gain = score.z[:, score.best_blur] - base.z[:, score.best_blur]
        moved = [i for i, p in enumerate(order.permutation) if i != p]
        return all(gain[recorded == i].mean() > 0 for i in moved)

    def _is_confirmed(self, found: Hypothesis, base: Hypothesis) -> bool:
        """Whether none of the captures that took no part in the choice contradicts it.

        Rough ones among them needn't be predicted better: another error of the bench decorrelates their speckle.
        """
        if not self._chosen.confirmed:
            return True
        after, before = self.trials.score([found, base], self._chosen.confirmed)
        return float(after.gains_over(before).min()) > -self._settings.certain

    def _with_ends(self, best: TrialScore) -> Hypothesis:
        """Patterns out of step: without the captures at the end, if these aren't predicted like the others."""
        result: list[Correction] = []
        for c in best.hypothesis:
            if isinstance(c, PatternOffset):
                ends = np.flatnonzero(c.wrapped(len(self.trials.captures))).tolist()
                score = self.trials.score([best.hypothesis], ends)[0]
                blur = best.best_blur
                if score.z[:, blur].mean() < 0.5 * best.z[:, blur].mean():
                    c = c.without_ends()
            result.append(c)
        return tuple(result)

    def _undecided(self, best: TrialScore) -> tuple[str, ...]:
        """Further corrections with which the captures would be predicted as well."""
        base, *others = self.trials.score([best.hypothesis, *self._extended(best.hypothesis)], self._chosen.screened)
        if base.significance.max() < self._settings.certain:
            return ()
        added = set(best.hypothesis)
        alike = [s for s in others if self._are_alike(s, base)]
        return tuple(c.label for s in alike for c in s.hypothesis if c not in added)
