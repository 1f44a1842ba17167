"""How far each parameter may be off before a measure is worse by a tolerance, and which pairs are worst together.

A measure m at the bench's own values is m₀. The loss at a point is the largest of (how much worse m is than m₀) over
its tolerance; the limits of a parameter are the roots of loss = 1 on both sides of its own value, all others being at
theirs. Each is bracketed by the points of the range and refined by false position (Illinois). Of each pair the four
corners of their limits are measured: where errors add up, the loss there is above 1.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from holoview.evidence.sweep.axes import Axis, Point, is_of_optimiser, own_value
from holoview.evidence.sweep.measures import MEASURES
from holoview.light.model.system import System
from holoview.util.errors import UserError

Evaluate = Callable[[Point, Sequence[Point]], list[dict[str, float]]]
"""The measures of points about that of the bench's own values."""

_TEXT = re.compile(r"\s*(\w+)\s*=\s*([0-9.]+(?:[eE][-+]?[0-9]+)?)\s*(dB|%)?\s*")
_CLOSE = 0.01  # of the tolerance
_MOST_STEPS = 8
_NARROW = 1e-4  # of the range


@dataclass(frozen=True)
class Tolerance:
    """By how much a measure of `MEASURES` may be worse."""

    measure: str
    amount: float

    def loss(self, own: Mapping[str, float], found: Mapping[str, float]) -> float:
        """How much worse a measure is than at the bench's own values, in units of the tolerance."""
        worse = own[self.measure] - found[self.measure]
        return (worse if MEASURES[self.measure].is_better_high else -worse) / self.amount


@dataclass(frozen=True)
class Limits:
    """The limits of a parameter, in SI units. low, high: None where the range that was swept doesn't reach one."""

    axis: Axis
    own: float
    low: float | None
    high: float | None

    @property
    def ends(self) -> tuple[float, float]:
        """The limits; the end of the range where it doesn't reach one."""
        first, last = self.axis.values[0], self.axis.values[-1]
        return (first if self.low is None else self.low), (last if self.high is None else self.high)


@dataclass(frozen=True)
class Corner:
    """Two parameters at their limits together: the point, its measures and their loss."""

    axes: tuple[Axis, Axis]
    point: Point
    measures: Mapping[str, float]
    loss: float


@dataclass(frozen=True)
class ToleranceTable:
    """own: the measures at the bench's own values. corners: of each pair its worst, the worst pair first."""

    tolerances: tuple[Tolerance, ...]
    own: Mapping[str, float]
    limits: tuple[Limits, ...]
    corners: tuple[Corner, ...]


def parse_tolerance(text: str) -> Tolerance:
    """The tolerance of a text such as "psnr=0.5dB" or "light=1%". Raises UserError for any other text."""
    match = _TEXT.fullmatch(text)
    where, expected = "--tolerance", "MEASURE=AMOUNT such as psnr=0.5dB, contrast=0.02 or light=1%"
    if match is None or match[2].count(".") > 1 or match[2] == ".":
        raise UserError(where, f'"{text}"', expected=expected)
    name, amount, unit = match[1], float(match[2]), match[3] or ""
    if name not in MEASURES:
        raise UserError(where, f'"{name}" is no measure', expected=", ".join(MEASURES))
    if (unit == "dB") != (MEASURES[name].unit == "dB") and unit:
        raise UserError(where, f'"{text}" has the unit {unit}', expected=expected)
    if not 0 < amount < 1e9:
        raise UserError(where, f'"{text}"', expected="an amount above 0")
    return Tolerance(name, amount / 100 if unit == "%" else amount)


def centred_axes(axes: Sequence[Axis], system: System) -> list[Axis]:
    """The axes with the bench's own value among their points.

    Raises UserError for an axis that isn't a range of a parameter that varies continuously, or doesn't hold that value.
    """
    centred = []
    for axis in axes:
        where = f"--set {axis.key}"
        if not axis.is_range or is_of_optimiser(axis.key):
            raise UserError(where, "has no tolerance", expected="a range of a parameter of the bench or of an effect")
        own = own_value(system, axis.key)
        first, last = axis.values[0], axis.values[-1]
        if not first <= own <= last:
            found = f"{axis.text(first)} to {axis.text(last)} without the bench's own {axis.text(own)}"
            raise UserError(where, found, expected="a range about it")
        span = last - first
        near = {float(value) for value in axis.values if abs(value - own) > 1e-9 * span}
        centred.append(Axis(axis.key, tuple(sorted(near | {own})), axis.unit, is_range=True))
    return centred


def find_limits(
    axes: Sequence[Axis], system: System, tolerances: Sequence[Tolerance], evaluate: Evaluate
) -> ToleranceTable:
    """The limits of every parameter of `centred_axes`, and the worst pairs.

    Raises UserError for a measure that isn't finite at the bench's own values.
    """
    own = own_point(axes, system)
    lines = {axis.key: [dict(own) | {axis.key: value} for value in axis.values] for axis in axes}
    points = [point for line in lines.values() for point in line]
    found = dict(zip(map(repr, points), evaluate(own, points), strict=True))
    at_own = found[repr(own)]
    if odd := next((t.measure for t in tolerances if not abs(at_own[t.measure]) < float("inf")), None):
        found_here = f"{odd} is {at_own[odd]:g} at the bench's own values"
        raise UserError("--tolerance", found_here, expected="a finite number")

    def loss(numbers: Mapping[str, float]) -> float:
        return max(tolerance.loss(at_own, numbers) for tolerance in tolerances)

    brackets: dict[tuple[str, int], _Bracket] = {}
    for axis in axes:
        curve = [(point[axis.key], loss(found[repr(point)])) for point in lines[axis.key]]
        middle = axis.values.index(own[axis.key])
        for side, values in ((-1, curve[middle::-1]), (1, curve[middle:])):
            for inner, outer in itertools.pairwise(values):
                if outer[1] > 1:
                    brackets[axis.key, side] = _Bracket(inner, outer)
                    break
    _refine(brackets, {axis.key: axis for axis in axes}, own, loss, evaluate)
    limits = tuple(
        Limits(axis, own[axis.key], *(brackets[axis.key, side].root if (axis.key, side) in brackets else None
               for side in (-1, 1)))
        for axis in axes
    )  # fmt: skip
    return ToleranceTable(tuple(tolerances), at_own, limits, _corners(limits, own, loss, evaluate))


def own_point(axes: Sequence[Axis], system: System) -> dict[str, Any]:
    """The bench's own values of the axes' parameters."""
    return {axis.key: own_value(system, axis.key) for axis in axes}


class _Bracket:
    """A root of loss = 1 between a value whose loss is at most 1 and one whose loss is above."""

    def __init__(self, inner: tuple[float, float], outer: tuple[float, float]) -> None:
        self._inner, self._outer = (inner[0], inner[1] - 1), (outer[0], outer[1] - 1)
        self._last_side = 0
        self.root = self.guess()

    def guess(self) -> float:
        """Where the line through both ends is zero."""
        (a, f), (b, g) = self._inner, self._outer
        return a + (b - a) * f / (f - g) if f < 0 else a

    def is_narrow(self, span: float) -> bool:
        """Whether the ends are as close as can be told apart."""
        return abs(self._outer[0] - self._inner[0]) < _NARROW * span

    def narrow(self, value: float, loss: float) -> bool:
        """Takes a value in; returns whether it is the root. An end that stays twice counts half (Illinois)."""
        excess, self.root = loss - 1, value
        if abs(excess) < _CLOSE:
            return True
        side = 1 if excess > 0 else -1
        if side > 0:
            self._outer = value, excess
            self._inner = (self._inner[0], self._inner[1] / 2) if self._last_side == side else self._inner
        else:
            self._inner = value, excess
            self._outer = (self._outer[0], self._outer[1] / 2) if self._last_side == side else self._outer
        self._last_side = side
        return False


def _refine(
    brackets: Mapping[tuple[str, int], _Bracket],
    axes: Mapping[str, Axis],
    own: Point,
    loss: Callable[[Mapping[str, float]], float],
    evaluate: Evaluate,
) -> None:
    """Narrows all brackets together, a point of each at a time."""
    waiting = dict(brackets)
    for _ in range(_MOST_STEPS):
        if not waiting:
            return
        points = [dict(own) | {key: bracket.guess()} for (key, _), bracket in waiting.items()]
        for (place, bracket), point, numbers in zip(list(waiting.items()), points, evaluate(own, points), strict=True):
            values = axes[place[0]].values
            if bracket.narrow(point[place[0]], loss(numbers)) or bracket.is_narrow(values[-1] - values[0]):
                del waiting[place]


def _corners(
    limits: Sequence[Limits], own: Point, loss: Callable[[Mapping[str, float]], float], evaluate: Evaluate
) -> tuple[Corner, ...]:
    """The worst corner of each pair, the worst pair first."""
    pairs = list(itertools.combinations(limits, 2))
    points = [
        dict(own) | {one.axis.key: x, other.axis.key: y}
        for one, other in pairs
        for x, y in itertools.product(one.ends, other.ends)
    ]
    if not points:
        return ()
    found = evaluate(own, points)
    worst = []
    for number, (one, other) in enumerate(pairs):
        four = range(4 * number, 4 * number + 4)
        place = max(four, key=lambda n: loss(found[n]))
        worst.append(Corner((one.axis, other.axis), points[place], found[place], loss(found[place])))
    return tuple(sorted(worst, key=lambda corner: -corner.loss))
