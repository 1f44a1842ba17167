"""Tables of options in the manual are those of the code: unit, range, default and sentence of each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import holoview
from holoview.bench.calibrate.train import CalibrationSettings
from holoview.holograms.optimise.settings import Settings
from holoview.light.model.fields import fields_by_key
from holoview.util import units

DOCS = Path(holoview.__file__).resolve().parents[1] / "docs"
TABLES = {"optimiser.md": Settings, "calibration.md": CalibrationSettings}


def table(description: type[Any]) -> str:
    """A row of Markdown for each field: its name in Python, its range, its default and its sentence."""
    rows = ["| option | values | default | |", "| --- | --- | --- | --- |"]
    for field in fields_by_key(description).values():
        kind, doc, default = field.metadata["kind"], field.metadata["doc"], field.default
        unit = getattr(getattr(kind, "item", kind), "unit", "")
        values = default if isinstance(default, tuple) else () if default is None else (default,)
        shown = ", ".join(units.format_rounded(value, unit) if unit else str(value) for value in values)
        rows.append(f"| `{field.name}` | {kind.format_range()} | {shown} | {doc} |")
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize("page", TABLES)
def test_a_table_of_options_is_that_of_the_code(page: str) -> None:
    expected = table(TABLES[page])
    assert expected in (DOCS / page).read_text(encoding="utf-8"), f"docs/{page} should hold:\n{expected}"
