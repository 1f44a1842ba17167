"""Laser powers that are recorded for the wrong captures: the gains of the captures tell, not the pictures' speckle.

The gain of a capture is the light seen over the light predicted for its recorded power and exposure. All gains of one
wavelength are equal if the records are right. Another order of the powers is named if it makes them equal: the ratio of
the two spreads is compared with that of random numbers (F distribution), for as many orders as are tried.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as f_distribution

from holoview.captures.dataset import Captures, Floats
from holoview.captures.predictor import Predictor
from holoview.captures.prepared_captures import prepare_captures
from holoview.captures.records.corrections import Correction, Hypothesis, apply_corrections
from holoview.captures.records.trials import FALSE_ALARMS, Values

POWER_SPREAD = 0.02
"""[1] Spread of the gains from which the order of the powers is checked. Evidence: jitter of ordinary laboratories is
0.003."""

POWER_LEFT = 0.5
"""[1] Another order of the powers must leave less than this share of the spread. Evidence: a reason: a law of the
laser's power keeps the order, and half of the spread is more than it leaves by chance."""

_ROUNDS = 20  # of sorting, after which the order doesn't change any more
_CACHE_MB = 64
_DARK = 0.01  # of the light of most captures: less tells nothing of the laser


@dataclass(frozen=True)
class PowerOrder(Correction):
    """The powers are recorded for the wrong captures.

    source: for each capture, the index of the capture whose record holds its power. way: how that came about.
    spreads: r.m.s. of the logarithm of the gains about those of their wavelength, as recorded and as corrected.
    """

    source: tuple[int, ...]
    way: str
    spreads: tuple[float, float] = (0.0, 0.0)

    effect = "power_order"

    @property
    def choice(self) -> str:
        return self.way

    @property
    def sentence(self) -> str:
        how = {"reversed": "from the last capture to the first"}.get(self.way, f"for the wrong captures ({self.way})")
        return f"The laser powers are recorded {how}."

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
    # an order of many free numbers always leaves least; a simple one that leaves about as little explains it
    least = min((left for left, _ in passed), default=math.inf)
    return [order for left, order in passed if left <= 2 * least + POWER_SPREAD / 10][:1]


def _log_gains(captures: Captures, effects: Values) -> Floats:
    """Logarithm of the light seen over the light predicted of each capture; NaN of dark ones."""
    data = prepare_captures(captures)
    seen = np.where(data.usable, data.light, 0.0).sum(axis=(1, 2), dtype=np.float64)
    predictor, expected = Predictor(captures, cache_mb=_CACHE_MB), np.empty(len(captures))
    for k in range(len(captures)):
        expected[k] = float(predictor([k], effects).signal[0].numpy()[data.usable[k]].sum(dtype=np.float64))
    lit = (seen > _DARK * np.median(seen)) & (seen > 0) & (expected > 0)
    return np.log(np.divide(seen, expected, where=lit, out=np.full(len(captures), np.nan)))


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

    Sorting pairs implied and recorded powers best for given numbers of the wavelengths; both are found in turns.
    """
    by_power = np.argsort(log_power, kind="stable")
    scale = _group_means(implied - log_power, groups)
    source = np.arange(len(implied))
    for _ in range(_ROUNDS):
        source = np.empty(len(implied), dtype=np.intp)
        source[np.argsort(implied - scale, kind="stable")] = by_power
        scale = _group_means(implied - log_power[source], groups)
    repeats = Counter(log_power.tolist()).values()
    orders_log = math.lgamma(len(implied) + 1) - sum(math.lgamma(n + 1) for n in repeats)
    way = "permutation:" + ",".join(map(str, source.tolist()))
    return PowerOrder(tuple(source.tolist()), way), orders_log
