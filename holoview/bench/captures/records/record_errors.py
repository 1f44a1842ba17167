"""Finds wrong records: the corrections under which predicted and seen speckle correlate, and the order of laser powers.

choose    a few captures with smooth pictures, and others that confirm the findings
screen    every correction alone, on two smooth captures
compare   the best corrections on several captures, with the best order of columns that are mixed up
decide    a correction is named only if it beats the records as they are beyond chance, and no other capture contradicts
pairs     are tried where one correction leaves the captures badly predicted
repeat    on the corrected records, until nothing more is found
exchange  where nothing more is found, corrections that came close are tried in place of those found, with one more each

Units come first (`units_of_lengths`) and the order of the powers last (`find_power_order`): pictures show neither. The
gain of a capture is the light seen over the light predicted for its recorded power and exposure. All gains of one
wavelength are equal if the records are right. Another order of the powers is named if it makes them equal: the ratio of
the two spreads is compared with that of random numbers (F distribution), for as many orders as are tried.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.stats import f as f_distribution
from scipy.stats import norm

from holoview.bench.captures.dataset import Captures, Floats
from holoview.bench.captures.records.corrections import (
    COLUMNS,
    Column,
    Correction,
    Hypothesis,
    PatternOffset,
    ValueOrder,
    Words,
    apply_corrections,
    column_values,
    cyclic_orders,
    hypothesis,
    moves_only,
    pairs,
    preference,
    single_corrections,
    units_of_lengths,
    value_indices,
)
from holoview.bench.captures.records.light import measure_light
from holoview.bench.captures.records.trials import (
    FALSE_ALARMS,
    Trials,
    TrialScore,
    Values,
    central_captures,
    central_region,
)
from holoview.util.errors import UserError

POWER_SPREAD = 0.02
"""[1] Spread of the gains from which the order of the powers is checked. Evidence: jitter of ordinary laboratories is
0.003."""

POWER_LEFT = 0.5
"""[1] Another order of the powers must leave less than this share of the spread. Evidence: derivation: while the light
rises with the recorded power, by whatever law, no other order leaves less of the spread than the recorded order (the
rearrangement inequality). Half is a margin for noise."""

_ROUNDS = 20  # of sorting, after which the order doesn't change any more
_STARTS = 256  # of sorting: 16 find every order of 18 powers at three wavelengths, 256 nearly all of 128 at eight
_DARK = 0.01  # of the gain of most captures of its wavelength: less says nothing about the laser


@dataclass(frozen=True)
class PowerOrder(Correction):
    """The powers are recorded for the wrong captures.

    source: for each capture, the index of the capture whose record holds its power. way: the mistake, in words.
    spreads: r.m.s. of the logarithm of the gains about the mean of their wavelength, as recorded and as corrected.
    """

    source: tuple[int, ...]
    way: str
    spreads: tuple[float, float] = (0.0, 0.0)

    def words(self) -> Words:
        how = {"reversed": "from the last capture to the first"}.get(self.way, f"for the wrong captures ({self.way})")
        return Words("power_order", self.way, f"The laser powers are recorded {how}.")

    def apply(self, captures: Captures) -> Captures:
        return dataclasses.replace(captures, power=captures.power[np.array(self.source)])


def find_power_order(captures: Captures, corrections: Hypothesis, effects: Values) -> list[Correction]:
    """The order of the powers that makes the gains equal, if there is one beyond chance; at most one correction."""
    corrected = apply_corrections(captures, corrections)
    if len(np.unique(corrected.power)) < 2:
        return []
    groups = np.unique(corrected.wavelength_m, return_inverse=True)[1]
    log_gain, log_power = _log_gains(corrected, effects), np.log(corrected.power)
    lit = np.isfinite(log_gain)
    freedom = int(lit.sum()) - len(np.unique(groups[lit]))
    if freedom < 2:
        return []
    spread = _spread(log_gain[lit], groups[lit])
    if not (math.isfinite(spread) and spread > POWER_SPREAD):
        return []
    implied = log_gain + log_power  # of the true powers, beside one number for each wavelength
    tried = [*_simple_orders(len(corrected)), *([_sorted_order(implied, log_power, groups)] if lit.all() else [])]
    passed: list[tuple[float, Correction]] = []
    for order, trials_log in tried:
        left = _spread((implied - log_power[np.array(order.source)])[lit], groups[lit])
        chance_log = float(f_distribution.logsf((spread / max(left, 1e-12)) ** 2, freedom, freedom)) + trials_log
        if left < POWER_LEFT * spread and chance_log < math.log(FALSE_ALARMS):
            passed.append((left, dataclasses.replace(order, spreads=(spread, left))))
    # an order of many free numbers always leaves least; a simple order that leaves about as little explains the powers
    least = min((left for left, _ in passed), default=math.inf)
    return [order for left, order in passed if left <= 2 * least + POWER_SPREAD / 10][:1]


def _log_gains(captures: Captures, effects: Values) -> Floats:
    """Logarithm of the light seen over the light predicted of each capture; NaN of dark captures."""
    gain = measure_light(captures, effects).gain
    for wavelength in captures.wavelengths_m:
        same = captures.wavelength_m == wavelength
        if np.isfinite(gain[same]).any():
            gain[same & ~(gain > _DARK * np.nanmedian(gain[same]))] = np.nan
    return np.asarray(np.log(gain))


def _spread(values: Floats, groups: NDArray[np.intp]) -> float:
    """R.m.s. deviation from the mean of each group."""
    return float(np.sqrt(np.square(values - _group_means(values, groups)).mean()))


def _group_means(values: Floats, groups: NDArray[np.intp]) -> Floats:
    means = np.bincount(groups, values) / np.maximum(np.bincount(groups), 1)
    return np.asarray(means[groups], dtype=np.float64)


def _simple_orders(count: int) -> list[tuple[PowerOrder, float]]:
    """The reversed and the shifted orders, with the logarithm of their number."""
    index = np.arange(count)
    found = [PowerOrder(tuple(index[::-1].tolist()), "reversed")]
    for n in range(1, count // 2 + 1):
        found += [PowerOrder(tuple(np.roll(index, -s).tolist()), f"offset:{s:+d}") for s in (n, -n)]
    return [(order, math.log(count)) for order in found]


def _sorted_order(implied: Floats, log_power: Floats, groups: NDArray[np.intp]) -> tuple[PowerOrder, float]:
    """The order of least spread, and the logarithm of the number of different orders.

    Sorting pairs implied and recorded powers best for given numbers of the wavelengths; both are found in turns. The
    turns end in a local optimum, which is mostly not the best where records are far from the truth: so they begin from
    the recorded order, and from random orders.
    """
    by_power, rng = np.argsort(log_power, kind="stable"), np.random.default_rng(0)
    best, least = np.arange(len(implied)), math.inf
    for start in range(_STARTS):
        source = rng.permutation(len(implied)) if start else best
        for _ in range(_ROUNDS):
            scale, before = _group_means(implied - log_power[source], groups), source
            source = np.empty(len(implied), dtype=np.intp)
            source[np.argsort(implied - scale, kind="stable")] = by_power
            if np.array_equal(source, before):
                break
        left = _spread(implied - log_power[source], groups)
        if left < least:
            best, least = source, left
    repeats = Counter(log_power.tolist()).values()
    orders_log = math.lgamma(len(implied) + 1) - sum(math.lgamma(n + 1) for n in repeats)
    way = "permutation:" + ",".join(map(str, best.tolist()))
    return PowerOrder(tuple(best.tolist()), way), orders_log


# --- findings ---


_PREFIX = "Records: "


@dataclass(frozen=True)
class RecordFindings:
    """The wrong records of a file.

    corrections: of wrong records; empty where none was found. rivals: other corrections that predict the same.
    correlation: of predicted and measured speckle on the compared captures, as recorded and as corrected. undecided:
    corrections that these captures can't show. captures: number of compared captures. seconds: of the search.
    """

    corrections: Hypothesis = ()
    rivals: tuple[Hypothesis, ...] = ()
    correlation: tuple[float, float] = (float("nan"), float("nan"))
    undecided: Hypothesis = ()
    captures: int = 0
    seconds: float = 0.0

    def corrected(self, captures: Captures) -> Captures:
        """The captures as they should have been recorded, with a note of each correction."""
        noted = (*captures.corrections, *(f"{c.label}: {c.sentence}" for c in self.corrections))
        return dataclasses.replace(apply_corrections(captures, self.corrections), corrections=noted)

    @property
    def lines(self) -> list[str]:
        """The findings in words, one line at least."""
        wrong = [f"{c.label}: {c.sentence}" for c in self.corrections] or ["nothing found that is recorded wrongly"]
        return [*wrong, *(note.removeprefix(_PREFIX) for note in self.notes)]

    @property
    def notes(self) -> list[str]:
        """Rivals and undecided corrections, in sentences for people."""
        found = [
            f"{_PREFIX}{' and '.join(c.label for c in rival)} would predict the same as "
            f"{' and '.join(c.label for c in self.corrections)}; these captures can't tell which."
            for rival in self.rivals
        ]
        if self.undecided:
            doubts = " ".join(dict.fromkeys(c.doubt for c in self.undecided))
            found.append(
                f"{_PREFIX}these captures can't show whether the following is so, and are predicted the same if it is: "
                f"{doubts}"
            )
        return found

    def as_json(self) -> dict[str, Any]:
        """The findings as JSON values."""
        return {
            "wrong": [{"effect": c.effect, "choice": c.choice, "sentence": c.sentence} for c in self.corrections],
            "rivals": [[{"effect": c.effect, "choice": c.choice} for c in rival] for rival in self.rivals],
            "correlation": {
                name: round(value, 6) if math.isfinite(value) else None
                for name, value in zip(("as_recorded", "as_corrected"), self.correlation, strict=True)
            },
            "undecided": [c.label for c in self.undecided],
            "captures": self.captures,
            "seconds": round(self.seconds, 3),
        }


# --- the search ---


TESTED = 8
"""[captures] Most captures on which the best corrections are compared; more with more wavelengths. Evidence: the cost;
eight smooth pictures have thousands of grains."""

SCREENED = 2
"""[captures] On which every correction is tried first. Evidence: the cost; two, so that one bad picture doesn't
decide."""

CONFIRMED = 8
"""[captures] Other captures, from smooth to rough, which a correction mustn't predict worse. Evidence: measured: with
an aberration of 50 nm, exchanged modulators were better on smooth captures (0.97 → 0.996), worse on rough captures (0.6
→ 0.2)."""

PROMISING = 96
"""[corrections] So many of the best on the first screened capture are screened on further captures. Evidence: the cost;
as many as there are single corrections."""

KEPT = 16
"""[corrections] Best of the screening, which are compared on all tested captures. Evidence: more than the number of
corrections that are the same physics, such as a mirrored modulator and the other two parts mirrored."""

MIN_GAIN = 0.15
"""[z] Mean gain that a correction must bring beside being significant. Evidence: derivation: a correlation of 0.5 rises
to 0.6, of 0.9 to 0.93; a wrong record changes the whole picture, it doesn't only spoil the prediction a little."""

WELL_PREDICTED = 0.9
"""[1] Mean correlation from which no pair of corrections is tried. Evidence: one of two wrong records, put right alone,
leaves the speckle of the other."""

UNDECIDED_SIGMAS = 4.0
"""[σ] A gain above it that chance could still give is measured on the confirming captures too. Evidence: measured:
wavelengths mixed up beside a displaced modulator gained 6.1 σ where chance gives 6.5, and 14.1 σ with these."""

EXCHANGED = 4
"""[corrections] Of those next to the ones found, how many are tried in their place with another beside them. Evidence:
measured: of patterns out of step and distances mixed up, the patterns alone came second."""

EQUAL_GAIN = 0.05
"""[z] Two predictions whose gains differ by less than this are taken as equal. Evidence: a third of `MIN_GAIN`."""

EQUAL_SIGMAS = 3.0
"""[σ] Two predictions are also taken as equal if they differ by fewer standard deviations than this. Evidence:
derivation: 0.3 % by chance."""

SORTED_ORDERS = 4
"""[corrections] Hypotheses for which the best order of a mixed-up column is found. Evidence: the cost."""

MOST_CORRECTIONS = 3
"""[corrections] Named at most, beside the order of the powers. Evidence: two mistakes in one evening happen, and one
more."""

CERTAIN_SIGMAS = 6.0
"""[σ] Significance of the prediction above which undecided corrections are named, and of the loss of one
capture that contradicts a correction. Evidence: as `FALSE_ALARMS`."""

REGION_PX = 128
"""[px] Modulator pixels across the centre of a near-field bench that are compared, beside the walk-off. Evidence: the
cost: captures of 128 × 96 pixels are compared whole."""

MOST_CAPTURES = 64
"""[captures] Of a larger number, those in the middle are considered. Evidence: the cost."""

_MIN_SIDE_PX = 4
"""[px] Of a picture. Evidence: a reason: a grain of speckle and its surroundings; fewer have no contrast to compare."""


def _require_speckle(captures: Captures) -> None:
    rows, columns = captures.shape
    if min(rows, columns) < _MIN_SIDE_PX:
        found, expected = f"pictures of {rows} × {columns} pixels", f"{_MIN_SIDE_PX} rows and columns or more"
        raise UserError("camera/images", found, expected=expected, remedy="smaller ones show no speckle")


def find_record_errors(
    captures: Captures,
    effects: Values | None = None,
    *,
    region_px: int = REGION_PX,
    most_captures: int = MOST_CAPTURES,
) -> RecordFindings:
    """Which records of these captures are wrong.

    effects: of the nominal bench, {id: {parameter: value}}. region_px, most_captures: how much of large
    captures, and of many, is compared. Raises UserError for lengths that no change of unit makes plausible, and for
    pictures that are too small to show speckle.
    """
    _require_speckle(captures)
    began, units = time.monotonic(), units_of_lengths(captures)
    captures = apply_corrections(captures, units)
    region = central_region(captures, region_px)
    found = _CorrectionSearch(central_captures(region, most_captures), effects or {}).run()
    changes = [_without_ends(c) if len(captures) > most_captures else c for c in found.corrections]
    power = find_power_order(region, hypothesis(changes), effects or {})
    corrections = hypothesis([*units, *changes, *power])
    return dataclasses.replace(found, corrections=corrections, seconds=time.monotonic() - began)


def _without_ends(correction: Correction) -> Correction:
    """The ends of a long file aren't compared, so that it isn't known whether their pictures have a pattern."""
    return correction.without_ends() if isinstance(correction, PatternOffset) else correction


def _labels(score: TrialScore) -> list[str]:
    return [correction.label for correction in score.hypothesis]


class _CorrectionSearch:
    """The search on captures whose units are plausible."""

    def __init__(self, captures: Captures, effects: Values) -> None:
        self.trials = Trials(captures, effects)
        self._chosen = _choose_captures(captures, self.trials.coarseness)
        self._singles = single_corrections(captures, self._chosen.screened)
        self._tried = 1
        self._runners_up: list[Hypothesis] = []

    def run(self) -> RecordFindings:
        before = best = self.trials.score([()], self._chosen.tested)[0]
        rivals: tuple[Hypothesis, ...] = ()
        while len(best.hypothesis) < MOST_CORRECTIONS:
            found = self._best_of(best, self._extended(best.hypothesis))
            if not best.hypothesis and (found or [best])[0].correlation < WELL_PREDICTED:
                found = self._best_of(found[0] if found else best, pairs(self._singles)) or found
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
        """The hypotheses that came next to the base, each with one more correction of another kind.

        Where two records are wrong, a correction that puts a part of both right may predict better than the right one
        of either: patterns out of step together with their settings, where patterns alone are out of step and
        distances are mixed up.
        """
        near = [one for one in self._runners_up if len(one) == len(base)][:EXCHANGED]
        return [wider for one in near for wider in self._extended(one) if not {*base} <= {*wider}]

    def _best_of(self, base: TrialScore, hypotheses: Sequence[Hypothesis]) -> list[TrialScore]:
        """The best hypothesis, then those that predict the same; empty unless it beats the base beyond chance."""
        hypotheses = [one for one in hypotheses if not moves_only(one, self.trials.captures)]
        self._tried += len(hypotheses)
        screened = self._chosen.screened
        promising = self._most_significant(hypotheses, screened[:1], PROMISING)
        kept = self._sorted_out(self._most_significant(promising, screened, KEPT))
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
        """The best of hypotheses that predict the tested captures alike, by captures for which they differ."""
        best = [alike[0]]
        for other in alike[1:]:
            pair = [best[0].hypothesis, other.hypothesis]
            differing = self.trials.differing(*pair)
            if not differing and _labels(other) == _labels(best[0]):
                continue  # exchanged values may be those of the column from its end
            if not differing or set(differing) & set(self._chosen.tested):
                best.append(other)
                continue
            first, second = self.trials.score(pair, differing[:CONFIRMED])
            if self._are_alike(first, second):
                best.append(other)
            elif second.gain_over(first)[0] > 0:
                best = [other]
        return best

    def _are_alike(self, a: TrialScore, b: TrialScore) -> bool:
        gain, sigmas = b.gain_over(a)
        return abs(gain) < EQUAL_GAIN or abs(sigmas) < EQUAL_SIGMAS

    def _most_significant(
        self, hypotheses: Sequence[Hypothesis], indices: Sequence[int], count: int
    ) -> list[Hypothesis]:
        """The `count` hypotheses that predict these captures best."""
        scores = self.trials.score(hypotheses, indices)
        return [s.hypothesis for s in sorted(scores, key=lambda s: -s.significance.max())[:count]]

    def _sorted_out(self, hypotheses: Iterable[Hypothesis]) -> list[Hypothesis]:
        """Every mixed-up column gets the order that predicts the tested captures best."""
        result: dict[Hypothesis, None] = {}
        left = SORTED_ORDERS
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
        """The order of a column's values that maximises Σ z; None if the recorded order does."""
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
            weighted = score.fisher_z[:, blur] * np.sqrt(score.grains[:, blur])
            np.add.at(merit, (recorded, (recorded + step) % count), weighted)
        permutation = tuple(int(j) for j in linear_sum_assignment(merit, maximize=True)[1])
        if permutation == tuple(range(count)):
            return None
        return hypothesis([*others, ValueOrder(column, permutation, orders[0].values)])

    def _is_better(self, score: TrialScore, base: TrialScore) -> bool:
        """Whether a hypothesis beats another by more than the best of all that were tried does by chance.

        Where the tested captures don't decide, rougher captures are compared too: smooth speckle looks much the same at
        another wavelength.
        """
        gain, sigmas = score.gain_over(base)
        if UNDECIDED_SIGMAS < sigmas < self._chance_sigmas(score):
            more = [*self._chosen.tested, *self._chosen.confirmed]
            wider, base = self.trials.score([score.hypothesis, base.hypothesis], more)
            gain, sigmas = wider.gain_over(base)
        if gain < MIN_GAIN or sigmas < self._chance_sigmas(score):
            return False
        return all(self._improves_every_value(score, c) for c in score.hypothesis if isinstance(c, ValueOrder))

    def _chance_sigmas(self, score: TrialScore) -> float:
        trials = self._tried * score.fisher_z.shape[1] * self.trials.shift_count
        return float(norm.isf(FALSE_ALARMS / trials))

    def _improves_every_value(self, score: TrialScore, order: ValueOrder) -> bool:
        """Whether the captures of every value that an order moves are predicted better with it than without it.

        Another error, such as a wrong distance, may make some of them look better under a wrong order, but never all.
        """
        without = hypothesis([c for c in score.hypothesis if c is not order])
        base = self.trials.score([without], self._chosen.tested)[0]
        recorded = np.array(value_indices(self.trials.captures, order.column, self._chosen.tested))
        gain = score.fisher_z[:, score.best_blur] - base.fisher_z[:, score.best_blur]
        moved = [i for i, p in enumerate(order.permutation) if i != p]
        return all(gain[recorded == i].mean() > 0 for i in moved)

    def _is_confirmed(self, found: Hypothesis, base: Hypothesis) -> bool:
        """Whether no capture that took no part in the choice contradicts it.

        Rough captures needn't be predicted better: another error of the bench decorrelates their speckle.
        """
        if not self._chosen.confirmed:
            return True
        after, before = self.trials.score([found, base], self._chosen.confirmed)
        return float(after.gains_over(before).min()) > -CERTAIN_SIGMAS

    def _with_ends(self, best: TrialScore) -> Hypothesis:
        """The best corrections, where patterns are out of step without the ends if these are predicted worse."""
        result: list[Correction] = []
        for c in best.hypothesis:
            if isinstance(c, PatternOffset):
                ends = np.flatnonzero(c.wrapped(len(self.trials.captures))).tolist()
                score = self.trials.score([best.hypothesis], ends)[0]
                blur = best.best_blur
                if score.fisher_z[:, blur].mean() < 0.5 * best.fisher_z[:, blur].mean():
                    c = c.without_ends()
            result.append(c)
        return tuple(result)

    def _undecided(self, best: TrialScore) -> Hypothesis:
        """Further corrections with which the captures would be predicted as well."""
        base, *others = self.trials.score([best.hypothesis, *self._extended(best.hypothesis)], self._chosen.screened)
        if base.significance.max() < CERTAIN_SIGMAS:
            return ()
        added = set(best.hypothesis)
        alike = [s for s in others if self._are_alike(s, base)]
        return tuple(c for s in alike for c in s.hypothesis if c not in added)


@dataclass(frozen=True)
class _ChosenCaptures:
    """Indices of the captures on which the records are checked, chosen for the smoothest pictures.

    Records may be wrong, so the pictures decide, not the patterns. Smooth pictures come from smooth patterns, whose
    speckle an error of the bench decorrelates last. But smooth patterns hardly show which modulator they are on, and an
    error of the bench can look like a wrong record in them; so the choice is confirmed on pictures of all kinds.
    screened: a part of tested. confirmed: the others, from smooth to rough, or some of them.
    """

    screened: list[int]
    tested: list[int]
    confirmed: list[int]


def _choose_captures(captures: Captures, coarseness: Callable[[int], float]) -> _ChosenCaptures:
    """The smoothest pictures, at least one of each recorded wavelength and distance among those tested."""
    order = sorted(range(len(captures)), key=coarseness)
    tested: list[int] = []
    for values in (captures.wavelength_m, captures.distance_m):
        covered = {float(values[k]) for k in tested}
        for k in order:
            if float(values[k]) not in covered:
                covered.add(float(values[k]))
                tested.append(k)
    most = min(TESTED, len(captures) - len(captures) // 3)
    tested += [k for k in order if k not in tested][: max(0, most - len(tested))]
    tested.sort(key=order.index)
    other_settings = [k for k in tested if _setting(captures, k) != _setting(captures, tested[0])]
    screened = [tested[0], *(other_settings or tested[1:])[: SCREENED - 1]]
    rest = [k for k in order if k not in tested]
    evenly = np.unique(np.linspace(0, len(rest) - 1, min(CONFIRMED, len(rest))).round().astype(int))
    confirmed = [rest[n] for n in evenly.tolist()]
    return _ChosenCaptures(screened, tested, confirmed)


def _setting(captures: Captures, k: int) -> tuple[float, float]:
    return float(captures.wavelength_m[k]), float(captures.distance_m[k])
