"""The two sheets of a report on holograms as blocks of `sheet_fit`: what hologram_report.html and its style lay out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from holoview.evidence.study.sheet_fit import Block, beside, fitting_zoom, picture, stack, table, text

_HEADING = text("", 10.5, 5.0)
_TABLE_PT, _SMALL_PT = 8.6, 8.0
_CODE_PT = 8.4  # letters of equal width are wider


def print_style(context: Mapping[str, Any]) -> str:
    """The style that makes each of the two sheets fit. context: of the template."""
    zooms = [fitting_zoom(stack(sheet)) for sheet in (_first(context), _second(context))]
    rules = " ".join(f".sheet:nth-of-type({n}) {{ zoom: {zoom:.2f}; }}" for n, zoom in enumerate(zooms, 1))
    return f"@media print {{ {rules} }}\n"


def _first(context: Mapping[str, Any]) -> list[Block]:
    shown = [(one["aspect"], one["caption"]) for one in context["holograms"]]
    shown[1:1] = [(one["aspect"], "the target") for one in context["holograms"][:1] if one["wanted"]]
    pictures = [picture(aspect, caption, _SMALL_PT, 58.0) for aspect, caption in shown]
    claims = [
        [claim["text"], claim["quantity"], *(f"{one['verdict']} ({one['value']})" for one in claim["verdicts"])]
        for claim in context["claims"]
    ]
    names, is_alone = context["names"], len(context["names"]) == 1
    numbers = [[quantity, *values, method] for quantity, values, method in context["rows"]]
    ends = (0.28, 0.4) if is_alone else (0.2, 0.22)
    return [
        text(context["title"], 16.5, 1.0),
        *(text(one["heading"], _SMALL_PT, 1.6) for one in context["holograms"]),
        beside(pictures, max(2, len(pictures)), 4.0),
        *(
            [_HEADING, table([["claim", "of the", *names], *claims], _shares(0.2, names, 0.28), _TABLE_PT)]
            if claims
            else []
        ),
        _HEADING,
        table([["quantity", *names, "method"], *numbers], _shares(ends[0], names, ends[1]), _TABLE_PT),
        text(context["texts"]["methods"], _SMALL_PT, 1.6),
        _HEADING,
        _plain(context, "visibility"),
        text(context["texts"]["thresholds"], _SMALL_PT, 1.6),
    ]


def _second(context: Mapping[str, Any]) -> list[Block]:
    is_alone = len(context["names"]) == 1
    light = stack([_HEADING, _plain(context, "light")])
    lasers = [stack([_HEADING, _plain(context, "lasers")])] if context["lasers"] else []
    above, below = ([light], lasers) if context["fills_charts"] else ([], [light, *lasers])
    notes = [text(note, _SMALL_PT) for note in context["notes"]]
    seen = stack([_HEADING, text(context["texts"]["instrument"], _SMALL_PT, 1.6), *notes, text("", 1.0, 1.0)])
    charts = [picture(chart["aspect"], chart["caption"], _SMALL_PT, 60.0) for chart in context["charts"]]
    half = (len(context["bench"]) + 1) // 2
    rows = [[row["name"], row["text"]] for row in context["bench"]]
    benches = [table(part, (0.26, 0.74), _SMALL_PT) for part in (rows[:half], rows[half:])]
    return [
        beside([*charts, *above], 2, 5.0) if is_alone else beside(charts, 4, 3.0),
        beside([*below, seen], 2, 7.0) if is_alone else stack([*below, seen]),
        _HEADING,
        beside(benches, 2, 7.0),
        _HEADING,
        text(context["command"], _CODE_PT, 1.6),
        text(context["texts"]["foot"], _SMALL_PT, 1.6),
    ]


def _plain(context: Mapping[str, Any], of: str) -> Block:
    names = context["names"]
    rows = [[quantity, *values] for quantity, values, _ in context[of]]
    return table([["", *names], *rows], _shares(0.5 if len(names) == 1 else 0.34, names), _TABLE_PT)


def _shares(first: float, names: Sequence[str], last: float = 0.0) -> list[float]:
    """Shares of the width of the columns of a table: of the words, equal ones of the holograms, and of the method."""
    middle = (1.0 - first - last) / len(names)
    return [first, *(middle for _ in names), *([last] if last else [])]
