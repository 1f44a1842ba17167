"""The points of a sweep as jobs of a study, which run here, in processes or by Dask, and whose results are kept.

As they are: the patterns of a hologram, or a bench's random ones, on the bench of each point. Optimised anew: each
optimisation begins with the patterns of its neighbour, so that the jobs of a row run one after another and those of
different rows beside each other. The first of a row begins with random patterns, takes three times as many iterations,
and is then found again from the second's patterns, since a comparison of points that began differently would be one of
their beginnings.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from holoview.evidence.study.runner import ExecutionTarget, ResultStore, run_jobs
from holoview.evidence.study.study import Findings, JobResult, Results, StatusCallback, Study, StudyJob, StudyScale
from holoview.evidence.sweep.axes import (
    Axis,
    Point,
    bench_changes,
    is_of_optimiser,
    optimiser_changes,
    point_text,
    settings_with,
)
from holoview.evidence.sweep.measures import measure_point
from holoview.holograms.hologram import Hologram
from holoview.holograms.optimise.hologram_job import RunOptions, optimise_hologram
from holoview.holograms.optimise.parallel import resolve_torch_device
from holoview.holograms.optimise.settings import Settings, next_settings
from holoview.holograms.targets.framing import FILL, Framing
from holoview.holograms.targets.target import Placement
from holoview.holograms.targets.target_source import TargetFile, TargetSource
from holoview.holograms.view import random_drive
from holoview.light.model import preset
from holoview.light.model.drives import drive_fits
from holoview.light.model.effects.registry import load_user_effects
from holoview.light.model.fields import to_mapping
from holoview.light.model.focus import parse_plane
from holoview.light.model.system import System
from holoview.light.numerics.sampling import Region
from holoview.util.errors import UserError
from holoview.util.progress import ProgressCallback, TextCallback, no_progress

_FIRST = 3  # times the iterations of a point that begins with its neighbour's patterns


@dataclass(frozen=True)
class SweptTarget:
    """The target's files, its brightness, a factor on linear light, and how a picture of another aspect is placed."""

    picture: str
    depth: str | None = None
    brightness: float = 1.0
    framing: Framing = FILL

    def source(self, system: System, tell: TextCallback = lambda text: None) -> TargetSource:
        """The target for a bench. Raises UserError for files that can't be read."""
        placement = Placement(depth=None if self.depth is None else Path(self.depth), framing=self.framing)
        return TargetSource(system, TargetFile(self.picture, placement, brightness=self.brightness), tell)

    def identity(self) -> list[Any]:
        """What says whether its files are still the same."""
        placed = [] if self.framing == FILL else [asdict(self.framing)]
        return [self.picture, self.depth, self.brightness, _digest_of(self.picture), _digest_of(self.depth), *placed]


@dataclass(frozen=True, eq=False)
class ParameterSweep:
    """What is swept.

    system: the bench, which each point changes. drive: patterns that are shown as they are, or with which optimisations
    begin; None: random ones of `seed`. measures: names of `MEASURES`. plane, region: as of `measure_point`. target:
    for measures that compare, and for optimisations. settings: of optimisations; None: shown as it is. is_cold: each
    optimisation begins with random patterns. light: share of a field's light in its window. effect_files: Python files
    that define effects.
    """

    system: System
    measures: tuple[str, ...]
    drive: Any = None
    seed: int = 0
    plane: str | None = None
    region: Region | None = None
    target: SweptTarget | None = None
    settings: Settings | None = None
    is_cold: bool = False
    light: float = 1.0
    effect_files: tuple[str, ...] = ()

    def system_at(self, axes: Sequence[Axis], point: Point) -> System:
        """The bench of a point. Raises UserError, which names the point, for values that it can't have."""
        try:
            return self.system.edit(bench_changes(point))
        except UserError as error:
            where = "--set " if len(axes) == 1 else f"at {point_text(axes, point)}: "
            raise error.inside(where) from error

    def check(self, axes: Sequence[Axis], points: Sequence[Point]) -> None:
        """Raises UserError for what can't be shown, optimised or measured at one of the points, before any is."""
        for point in points:
            system = self.system_at(axes, point)
            if self.plane is not None:
                parse_plane(system, self.plane, "--plane")
            if self.settings is not None:
                settings_with(self.settings, optimiser_changes(point))
            elif self.drive is not None and not drive_fits(system, self.drive):
                needed = ", ".join(map(str, system.drive_shapes.values()))
                found = f"{point_text(axes, point)} needs patterns of shape {needed}"
                expected = f"{', '.join(map(str, self.system.drive_shapes.values()))}, as the hologram has"
                raise UserError("--set", found, expected=expected, remedy="--optimise N finds patterns for it")
        if self.target is not None:
            self.target.source(self.system)


class SweepStudy(Study):
    """The jobs of a sweep, whose settings are plain; what is too large for them travels with the study."""

    name = kind = "sweep"
    title = "Sweep"
    summary = "Measures against parameters."
    quick_note = ""

    def __init__(self, sweep: ParameterSweep, starts: Mapping[str, Any] | None = None) -> None:
        self.sweep, self.starts = sweep, dict(starts or {})

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        """None of its own: `run_points` makes them."""
        return []

    def analyse(self, results: Results) -> Findings:
        """The numbers of each job."""
        return Findings([result.numbers for _, result in results])

    def job_at(self, axes: Sequence[Axis], point: Point, after: StudyJob | None) -> StudyJob:
        """The job of a point. after: the job with whose patterns its optimisation begins."""
        sweep, system = self.sweep, self.sweep.system_at(axes, point)
        settings: dict[str, Any] = {
            "system": preset.dumps(system),
            "measures": list(sweep.measures),
            "plane": sweep.plane,
            "region": None if sweep.region is None else list(sweep.region),
            "target": None if sweep.target is None else sweep.target.identity(),
            "patterns": sweep.seed if sweep.drive is None else _digest_of_drive(sweep.drive),
            "effects": [_digest_of(file) for file in sweep.effect_files],
        }
        if sweep.settings is not None:
            found = settings_with(sweep.settings, optimiser_changes(point))
            settings["optimise"] = to_mapping(found)
            settings["after"] = None if after is None else after.key
        return self.make_job(point_text(axes, point), settings)

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        """Shows or optimises the hologram of a point, and measures it."""
        sweep = self.sweep
        for file in sweep.effect_files:
            load_user_effects(file)
        system = preset.loads(settings["system"])
        source = None if sweep.target is None else sweep.target.source(system)
        if "optimise" in settings:
            hologram = self._optimised(settings, system, source, status)
        else:
            drive = random_drive(system, sweep.seed) if sweep.drive is None else sweep.drive
            hologram = Hologram(drive, system)
        plane_m = None if sweep.plane is None else parse_plane(system, sweep.plane, "--plane")
        numbers = measure_point(hologram, sweep.measures, source, plane_m, sweep.region)
        if "light" in numbers:
            numbers["light"] *= sweep.light
        return JobResult(numbers, hologram=hologram if "optimise" in settings else None)

    def _optimised(
        self, settings: Mapping[str, Any], system: System, source: TargetSource | None, status: StatusCallback
    ) -> Hologram:
        """The hologram of a point, from the patterns of its neighbour, of the file, or random ones."""
        assert source is not None
        options = settings_with(Settings(), settings["optimise"])
        start = self.starts.get(settings["after"] or "")
        if start is None and self.sweep.drive is not None and not self.sweep.is_cold:
            start = self.sweep.drive if drive_fits(system, self.sweep.drive) else None
        if start is not None:
            options = next_settings(options, options.iterations)
        elif not self.sweep.is_cold:
            options = replace(options, iterations=_FIRST * options.iterations)
        initial = None if start is None else Hologram(start, system)
        run = RunOptions(device=resolve_torch_device(), initial_hologram=initial)

        def tell(done: int, total: int, note: str) -> None:
            status(f"{done}/{total} {note}")

        return optimise_hologram(system, source.build().stack, options, run, progress=tell).hologram


def _digest_of_drive(drive: Any) -> str:
    """Of patterns; of a chain by the names of its elements."""
    if not isinstance(drive, Mapping):
        return hashlib.sha256(drive.tobytes()).hexdigest()
    parts = {name: hashlib.sha256(patterns.tobytes()).hexdigest() for name, patterns in drive.items()}
    return hashlib.sha256(repr(sorted(parts.items())).encode()).hexdigest()


def _digest_of(path: str | None) -> str:
    """Of a file's content; of a folder its files' names, sizes and times."""
    if path is None:
        return ""
    file = Path(path)
    if file.is_file():
        return hashlib.sha256(file.read_bytes()).hexdigest()
    listed = sorted((entry.name, entry.stat().st_size, entry.stat().st_mtime_ns) for entry in file.glob("*"))
    return hashlib.sha256(repr(listed).encode()).hexdigest()


# --- running ----------------------------------------------------------------------------------------------------------


Patterns = dict[str, tuple[StudyJob, Any]]
"""The job that found patterns, and these, by the other parameters of its point."""


@dataclass(eq=False)
class PointRunner:
    """Measures points of a sweep. asked: the points and their jobs, in order."""

    sweep: ParameterSweep
    axes: Sequence[Axis]
    store: ResultStore
    target: ExecutionTarget = field(default_factory=ExecutionTarget)
    progress: ProgressCallback = no_progress
    asked: list[tuple[Point, StudyJob]] = field(default_factory=list)

    def row_axis(self) -> Axis | None:
        """The axis along which each optimisation begins with its neighbour's patterns; None without one."""
        if self.sweep.settings is None or self.sweep.is_cold:
            return None
        return next((axis for axis in self.axes if axis.is_numeric and not is_of_optimiser(axis.key)), None)

    def run_grid(self, points: Sequence[Point]) -> list[dict[str, float]]:
        """The numbers of points; with a row axis one value of it after another, each from its neighbour's patterns.

        The first value is found twice, to begin with and again from the second's patterns, so that all are found alike.
        """
        axis = self.row_axis()
        if axis is None:
            return [result.numbers for _, result in self._run(points, {}, None, 0, len(points))]
        by_place = [[point for point in points if point[axis.key] == value] for value in axis.values]
        steps = [(0, None), (1, 0), (0, 1), *((place, place - 1) for place in range(2, len(by_place)))]
        total, done = len(points) + len(by_place[0]), 0
        found: dict[int, Patterns] = {}
        numbers: dict[str, dict[str, float]] = {}
        for place, origin in steps:
            wave, starts = by_place[place], {} if origin is None else found[origin]
            results = self._run(wave, starts, axis, done, total, is_reported=origin is not None)
            done += len(wave)
            found[place] = _patterns(wave, results, axis)
            numbers |= {repr(point): result.numbers for point, (_, result) in zip(wave, results, strict=True)}
        return [numbers[repr(point)] for point in points]

    def run_about(self, centre: Point, points: Sequence[Point]) -> list[dict[str, float]]:
        """The numbers of points whose optimisations all begin with patterns that were found at the point `centre`."""
        starts: Patterns = {}
        if self.sweep.settings is not None and not self.sweep.is_cold:
            (found,) = self._run([centre], {}, None, 0, 1, is_reported=False)
            ((job, drive),) = _patterns([centre], [found], None).values()
            starts = {_others(point, None): (job, drive) for point in points}
        return [result.numbers for _, result in self._run(points, starts, None, 0, len(points))]

    def rows(self) -> list[tuple[Point, dict[str, float]]]:
        """The points that are done so far, each once, with their numbers, the last axis fastest."""
        jobs = {job.key: (point, job) for point, job in self.asked}
        found = [(point, self.store.load(job)) for point, job in jobs.values()]

        def place(row: tuple[Point, Any]) -> list[Any]:
            return [row[0][a.key] if a.is_numeric else a.values.index(row[0][a.key]) for a in self.axes]

        return sorted(((point, result.numbers) for point, result in found if result is not None), key=place)

    def _run(
        self,
        points: Sequence[Point],
        starts: Patterns,
        axis: Axis | None,
        done: int,
        total: int,
        *,
        is_reported: bool = True,
    ) -> list[tuple[StudyJob, JobResult]]:
        """Runs the jobs of points that don't depend on one another.

        starts: patterns with which they begin, where their shape fits. axis: along which these were found.
        """
        study = SweepStudy(self.sweep, {job.key: drive for job, drive in starts.values()})
        jobs = []
        for point in points:
            job, drive = starts.get(_others(point, axis), (None, None))
            fits = drive is not None and drive_fits(self.sweep.system_at(self.axes, point), drive)
            jobs.append(study.job_at(self.axes, point, job if fits else None))

        def report(count: int, _: int, note: str) -> None:
            self.progress(done + count, total, note)

        if is_reported:
            self.asked += zip(points, jobs, strict=True)
        return run_jobs(study, jobs, self.store, self.target, report)


def _patterns(points: Sequence[Point], results: Sequence[tuple[StudyJob, JobResult]], axis: Axis | None) -> Patterns:
    return {
        _others(point, axis): (job, result.hologram.drive)
        for point, (job, result) in zip(points, results, strict=True)
        if result.hologram is not None
    }


def _others(point: Point, axis: Axis | None) -> str:
    """A point without its value along an axis."""
    return repr([(key, value) for key, value in point.items() if axis is None or key != axis.key])
