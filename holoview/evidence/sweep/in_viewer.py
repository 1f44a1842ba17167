"""Sweeps for the viewer, whose `Sweeper` this is: points of the document that it shows, one after another."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.evidence.study.runner import ResultStore
from holoview.evidence.sweep.axes import Axis, check_key, grid_points, is_of_optimiser, parse_axis
from holoview.evidence.sweep.measures import MEASURES, parse_measures
from holoview.evidence.sweep.points import ParameterSweep, PointRunner, SweptTarget
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.targets.target_source import TargetFile, TargetSource
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.progress import ProgressCallback, TextCallback, no_text
from holoview.viewer.document.document import Document
from holoview.viewer.document.sweeper import SweepRequest, SweptCurve, SweptPoint
from holoview.viewer.document.target_builder import TargetSpec


def sweep_document(
    document: Document, request: SweepRequest, report: ProgressCallback, show: Callable[[SweptCurve], None]
) -> None:
    """As `Sweeper`. Everything is measured as `holoview sweep` does, in the region where one is drawn."""
    axis = parse_axis(request.values)
    if axis is None or not axis.is_numeric:
        raise UserError("sweep", f'"{request.values}" has no values', expected="such as gap=1mm:3mm:9 or gap=1mm,2mm")
    check_key(axis.key)
    sweep, points = _sweep_of(document, request, axis), grid_points([axis])
    sweep.check([axis], points)
    with tempfile.TemporaryDirectory(prefix="holoview-sweep-") as folder:
        store = ResultStore(Path(folder), keeps_holograms=True)
        runner = PointRunner(sweep, [axis], store)
        shown = 0

        def progress(done: int, total: int, note: str) -> None:
            nonlocal shown
            if done > shown:
                shown = done
                show(_curve(runner, request.measure))
            report(done, total, note)

        runner.progress = progress
        runner.run_grid(points)
        show(_curve(runner, request.measure))


def _sweep_of(document: Document, request: SweepRequest, axis: Axis) -> ParameterSweep:
    """Raises UserError for measures and optimisations without a target."""
    spec, names = document.target_spec, parse_measures(request.measure, document.system)
    is_optimised = request.iterations > 0 or is_of_optimiser(axis.key)
    if spec is None and (is_optimised or MEASURES[request.measure].needs_target):
        what = "patterns are to be found" if is_optimised else f"{request.measure} compares with it"
        raise UserError("sweep", f"there is no target, and {what}", remedy="open a picture, or measure the contrast")
    if document.system.is_field and is_optimised:
        raise UserError("sweep", "with a field", expected="a bench with modulators, or 0 iterations")
    return ParameterSweep(
        system=document.lit_system,
        measures=names,
        drive=document.drive,
        region=document.view_settings.region,
        target=None if spec is None else _TargetOfViewer("", spec=spec),
        settings=Settings(iterations=request.iterations or Settings().iterations) if is_optimised else None,
    )


def _curve(runner: PointRunner, measure: str) -> SweptCurve:
    """The points that are done."""
    (axis,) = runner.axes
    found = []
    for point, job in runner.asked:
        result = runner.store.load(job)
        if result is None:
            continue
        value, numbers = point[axis.key], result.numbers
        drive = None if result.hologram is None else result.hologram.drive
        system = runner.sweep.system_at(runner.axes, point) if result.hologram is None else result.hologram.system
        text, error = f"{axis.key} = {axis.text(value)}", numbers.get(f"{measure}_error", 0.0)
        found.append(SweptPoint(text, float(axis.shown(value)), numbers[measure], error, system, drive))
    return SweptCurve(axis.heading, tuple(sorted(found, key=lambda one: one.value)))


# --- the viewer's target ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _TargetOfViewer(SweptTarget):
    """The target of a session, in place of files."""

    spec: TargetSpec | None = None

    def source(self, system: System, tell: TextCallback = no_text) -> TargetSource:
        """As there."""
        spec = self.spec
        assert spec is not None
        if spec.is_stack:
            return TargetSource(system, TargetFile(str(spec.source), **spec.light), tell)
        return TargetSource(system, TargetFile(spec.title), tell, scene=_TargetScene(spec))

    def identity(self) -> list[Any]:
        """It doesn't change while a sweep runs, and results are kept no longer."""
        return []


@dataclass(frozen=True)
class _TargetScene:
    """A target as a scene that computes its pictures for any bench."""

    spec: TargetSpec

    @property
    def source(self) -> str:
        """As of `Scene`."""
        return self.spec.title

    def images(self, system: System, planes_m: NDArray[np.float64]) -> NDArray[np.float32]:
        """As of `Scene`."""
        return self.spec.build(system, planes_m).stack
