"""Tables of options in the manual are those of the code: unit, range, default and sentence of each."""

from __future__ import annotations

import math
from dataclasses import MISSING
from pathlib import Path
from typing import Any

import pytest

import holoview
from holoview.bench.calibrate.exposure import ExposureLimits
from holoview.bench.calibrate.train import CalibrationSettings
from holoview.bench.captures.picture_import import KnownBench
from holoview.bench.captures.predictor import SamplingConfig
from holoview.bench.captures.speckle_meter import CameraLens
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, Nuisances
from holoview.bench.diagnose.pipeline import DiagnosisOptions
from holoview.bench.experiment.closed_loop import LoopSettings
from holoview.holograms.files.request import BinaryLayout, ReadRequest, WindowRequest
from holoview.holograms.metrics.photograph import CameraStatements
from holoview.holograms.optimise.hologram_job import RunOptions
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.targets.target_source import TargetLight
from holoview.light.model.fields import Nested, fields_by_key, flag_of
from holoview.util import units
from holoview.viewer.app.serve import ServeOptions

DOCS = Path(holoview.__file__).resolve().parents[1] / "docs"
TABLES = {
    "optimiser.md": (Settings, TargetLight, RunOptions),
    "calibration.md": (CalibrationSettings, ExposureLimits),
    "captures.md": (AcquisitionSettings, Nuisances, KnownBench),
    "diagnosis.md": (DiagnosisOptions, SamplingConfig),
    "rig-reference.md": (LoopSettings,),
    "fields.md": (ReadRequest, WindowRequest),
    "readers.md": (BinaryLayout,),
    "speckle-contrast.md": (CameraLens, CameraStatements),
    "security.md": (ServeOptions,),
}


def table(description: type[Any]) -> str:
    """A row of Markdown for each field: its name in Python (and its flag, where that is another), its range, its
    default and its sentence."""
    rows = ["| option | values | default | |", "| --- | --- | --- | --- |"]
    for field in fields_by_key(description).values():
        kind, doc, default = field.metadata["kind"], field.metadata["doc"], field.default
        unit = getattr(getattr(kind, "item", kind), "unit", "")
        default = None if default is MISSING else default
        values = default if isinstance(default, tuple) else () if default is None else (default,)
        shown = ", ".join(units.format_rounded(value, unit) if unit else str(value) for value in values)
        shown = "" if isinstance(kind, Nested) or default is False or default in (math.inf, math.nan) else shown
        name = f"`{field.name}`, `{flag_of(field)}`" if field.metadata["flag"] else f"`{field.name}`"
        rows.append(f"| {name} | {kind.format_range()} | {shown} | {doc} |")
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize(("page", "description"), [(page, one) for page, several in TABLES.items() for one in several])
def test_a_table_of_options_is_that_of_the_code(page: str, description: type[Any]) -> None:
    expected = table(description)
    assert expected in (DOCS / page).read_text(encoding="utf-8"), f"docs/{page} should hold:\n{expected}"
