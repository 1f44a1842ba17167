"""The points of a sweep as CSV and as a figure; the table of tolerances as text."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from holoview.evidence.sweep.axes import Axis, Point, point_text
from holoview.evidence.sweep.measures import MEASURES
from holoview.evidence.sweep.tolerance import Limits, ToleranceTable
from holoview.util import units
from holoview.util.figures import label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Rows = Sequence[tuple[Point, Mapping[str, float]]]
"""Points with their measures."""

_MOST_CURVES = 12
_WORST = 5


def as_csv(axes: Sequence[Axis], rows: Rows) -> str:
    """The points as a table: a column for each parameter, in its unit, and for each measure."""
    names = list(dict.fromkeys(name for _, numbers in rows for name in numbers))
    text = io.StringIO(newline="")
    table = csv.writer(text, lineterminator="\n")
    units = [MEASURES[name].unit if name in MEASURES else "" for name in names]
    headings = [f"{name} ({unit})" if unit else name for name, unit in zip(names, units, strict=True)]
    table.writerow([*(axis.heading for axis in axes), *headings])
    for point, numbers in rows:
        cells = [axis.shown(point[axis.key]) for axis in axes]
        table.writerow([*cells, *(repr(numbers[name]) if name in numbers else "" for name in names)])
    return text.getvalue()


def as_json(axes: Sequence[Axis], rows: Rows) -> list[dict[str, Any]]:
    """The points for programs, values in SI units; None for a measure that isn't finite."""
    return [
        {"set": {axis.key: point[axis.key] for axis in axes}}
        | {name: value if math.isfinite(value) else None for name, value in numbers.items()}
        for point, numbers in rows
    ]


def withheld_text(rows: Rows) -> str:
    """At how many points the speckle contrast is withheld, and why; "" where it is nowhere."""
    withheld = sum(math.isnan(numbers.get("contrast", 0.0)) for _, numbers in rows)
    where = "the picture doesn't show the target there"
    return f"speckle contrast withheld at {withheld} of {len(rows)} points: {where}" if withheld else ""


def sweep_figure(axes: Sequence[Axis], rows: Rows, names: Sequence[str]) -> Callable[[Figure], None]:
    """A function that draws each measure against the parameter with most values, a curve for each set of the others."""
    along = max(axes, key=lambda axis: (axis.is_numeric, len(axis.values)))
    others = [axis for axis in axes if axis is not along]
    curves: dict[str, list[tuple[Any, Mapping[str, float]]]] = {}
    for point, numbers in rows:
        curves.setdefault(point_text(others, point), []).append((along.shown(point[along.key]), numbers))

    def draw(figure: Figure) -> None:
        columns = min(len(names), 2)
        panels = figure.subplots(-(-len(names) // columns), columns, squeeze=False).ravel()
        for axes_of, name in zip(panels, names, strict=False):
            _draw_measure(axes_of, along, curves, name)
        for unused in panels[len(names) :]:
            unused.set_axis_off()
        if others:
            handles, labels = panels[0].get_legend_handles_labels()
            figure.legend(handles, labels, loc="outside upper center", ncols=3, fontsize=8, frameon=False)

    return draw


def tolerance_figure(table: ToleranceTable, rows: Rows) -> Callable[[Figure], None]:
    """A function that draws the loss against each parameter alone, with its limits."""
    own = {limits.axis.key: limits.own for limits in table.limits}

    def draw(figure: Figure) -> None:
        columns = min(len(table.limits), 2)
        panels = figure.subplots(-(-len(table.limits) // columns), columns, squeeze=False).ravel()
        for axes, limits in zip(panels, table.limits, strict=False):
            axis = limits.axis
            line = [(p, n) for p, n in rows if all(p[key] == value for key, value in own.items() if key != axis.key)]
            for tolerance in table.tolerances:
                curve = sorted((axis.shown(p[axis.key]), tolerance.loss(table.own, n)) for p, n in line)
                axes.plot(*zip(*curve, strict=True), marker="o", markersize=4, linewidth=1.2, label=tolerance.measure)
            axes.axhline(1, color="black", linestyle="--", linewidth=1)
            for end in (limits.low, limits.high):
                if end is not None:
                    axes.axvline(axis.shown(end), color="0.5", linewidth=1)
            axes.set_xlabel(label(units.with_symbols(axis.heading)))
            axes.set_ylabel("loss / tolerance")
            axes.grid(alpha=0.3)
        for unused in panels[len(table.limits) :]:
            unused.set_axis_off()
        panels[0].legend(fontsize=8)

    return draw


def _draw_measure(
    axes: Axes, along: Axis, curves: Mapping[str, Sequence[tuple[Any, Mapping[str, float]]]], name: str
) -> None:
    for words, points in list(curves.items())[:_MOST_CURVES]:
        ordered = sorted(points, key=lambda point: point[0]) if along.is_numeric else points
        found = [(x, numbers) for x, numbers in ordered if name in numbers]
        x = [value for value, _ in found] if along.is_numeric else [str(value) for value, _ in found]
        errors = [numbers.get(f"{name}_error", 0.0) for _, numbers in found]
        y = [numbers[name] for _, numbers in found]
        bars = errors if any(errors) else None
        axes.errorbar(x, y, bars, marker="o", markersize=4, linewidth=1.2, label=label(words))
    all_found = [numbers[name] for points in curves.values() for _, numbers in points if name in numbers]
    if name == "contrast" and all(map(math.isnan, all_found)):
        text = "withheld: the picture\ndoesn't show the target"
        axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes)
        axes.set_xticks([])
        axes.set_yticks([])
    axes.set_xlabel(label(units.with_symbols(along.heading)))
    axes.set_ylabel(MEASURES[name].title)
    axes.grid(alpha=0.3)


def tolerance_lines(table: ToleranceTable) -> list[str]:
    """The table of tolerances as lines of text."""
    stated = ", ".join(f"{t.measure} worse by {t.amount:g}{_unit(t.measure)}" for t in table.tolerances)
    own = ", ".join(f"{t.measure} {table.own[t.measure]:.4g}{_unit(t.measure)}" for t in table.tolerances)
    width = max(len(limits.axis.key) for limits in table.limits)
    lines = [
        f"tolerances: {stated}; at the bench's own values {own}",
        f"{'parameter':<{max(width, 9)}}  {'own value':>12}  {'from':>16}  {'to':>16}",
    ]
    for limits in table.limits:
        low, high = (_limit(limits, side) for side in (0, 1))
        lines.append(f"{limits.axis.key:<{max(width, 9)}}  {limits.axis.text(limits.own):>12}  {low:>16}  {high:>16}")
    if table.corners:
        lines.append("worst pairs, both at their limits:")
    for corner in table.corners[:_WORST]:
        found = ", ".join(f"{t.measure} {corner.measures[t.measure]:.4g}{_unit(t.measure)}" for t in table.tolerances)
        lines.append(f"  {point_text(corner.axes, corner.point)}: {found}, {corner.loss:.2f} times the tolerance")
    return lines


def tolerance_json(table: ToleranceTable) -> dict[str, Any]:
    """The table of tolerances for programs, values in SI units; None for a limit that the range doesn't reach."""
    return {
        "tolerances": {tolerance.measure: tolerance.amount for tolerance in table.tolerances},
        "own": dict(table.own),
        "limits": [
            {"parameter": found.axis.key, "own": found.own, "low": found.low, "high": found.high}
            for found in table.limits
        ],
        "pairs": [
            {"set": {axis.key: corner.point[axis.key] for axis in corner.axes}}
            | {"loss": corner.loss, **corner.measures}
            for corner in table.corners
        ],
    }


def _unit(measure: str) -> str:
    unit = MEASURES[measure].unit
    return f" {unit}" if unit else ""


def _limit(limits: Limits, side: int) -> str:
    """A limit in words: beyond the range's end where the range doesn't reach one."""
    found = (limits.low, limits.high)[side]
    if found is not None:
        return limits.axis.text(found)
    return f"{'below' if side == 0 else 'above'} {limits.axis.text(limits.ends[side])}"
