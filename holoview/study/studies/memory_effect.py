"""Correlation of speckle after a change of the wavelength or of the direction of the light."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.model.system import System
from holoview.study.claims import CONTRADICTS, REPRODUCES, SHOWN
from holoview.study.hologram_jobs import has_settings, job_system, mean_curve
from holoview.study.plots import line_plot
from holoview.study.scale import StudyScale, format_size, speckle_shape
from holoview.study.study import Claim, Findings, JobResult, Results, StatusCallback, Study, StudyFigure, StudyJob
from holoview.view import random_drive, simulate

_MIDDLE_M, _PLANE_M = 550e-9, 10e-3
_STEPS_NM = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0)
_ANGLES_MRAD = (0.0, 0.5, 1.0, 2.0, 3.0, 4.3, 6.0, 8.6)
_GAPS_MM = (None, 1.0, 2.0, 4.0)
_STEPS_BY_CHANGE = {"wavelength": _STEPS_NM, "refocused": _STEPS_NM, "angle": _ANGLES_MRAD}
_SUBSAMPLE_SHIFTS = (-0.5, -0.25, 0.0, 0.25, 0.5)
_UNITS = {"wavelength": "nm", "refocused": "nm", "angle": "mrad"}
_FIGURE_CAPTIONS = {
    "wavelength": "Another wavelength, same plane",
    "refocused": "Another wavelength, refocused at equal z·λ",
    "angle": "Another direction, shifted back",
}

Curves = Mapping[tuple[str, float | None], NDArray[np.float64]]
"""Correlation at each step, by what changes and the gap (mm; None for one modulator)."""


class _MemoryEffect(Study):
    name = "memory-effect"
    title = "The memory effect of one and two modulators"
    summary = (
        "Correlation of the speckle of a random pattern with that at another wavelength (same plane, or refocused at "
        "equal z·λ) or direction (shifted back): a second modulator behind a gap shortens the range over which "
        "patterns stay alike, and so makes more wavelengths and directions count."
    )
    quick_note = "Quick: 256 x 192 samples; correlations scatter by about 0.02."
    revision = 2

    def describe_size(self, scale: StudyScale) -> str:
        """Random patterns; nothing is optimised."""
        return ", ".join(format_size(speckle_shape(scale), _seeds(scale)))

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        shared = {"grid": "periodic", "shape": list(speckle_shape(scale)), "planes": 1, "scheme": "simultaneous"}
        return [
            self.make_job(f"{way}, {_format_gap(gap)}, seed {n}", {**shared, "way": way, "gap_mm": gap, "seed": n})
            for way in _STEPS_BY_CHANGE
            for gap in _GAPS_MM
            for n in range(seed, seed + _seeds(scale))
        ]

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        bench = job_system(settings).edit({"observer": "mono"})
        gap = settings["gap_mm"]
        bench = bench.edit({"modulators": bench.modulators[:1], "gap": None} if gap is None else {"gap": gap * 1e-3})
        drive = random_drive(_laser(bench, _MIDDLE_M), settings["seed"])
        first = _speckle(_laser(bench, _MIDDLE_M), drive, _PLANE_M)
        steps = [_grid_step(bench, settings["way"], step) for step in _STEPS_BY_CHANGE[settings["way"]]]
        correlation = [_correlation(first, *_changed_speckle(bench, drive, settings["way"], step)) for step in steps]
        return JobResult({"steps": steps, "correlation": correlation})

    def analyse(self, results: Results) -> Findings:
        cases = [(way, gap) for way in _STEPS_BY_CHANGE for gap in _GAPS_MM]
        curves = {(way, gap): mean_curve(results, "correlation", way=way, gap_mm=gap) for way, gap in cases}
        steps = {
            way: next(result.numbers["steps"] for job, result in results if has_settings(job, way=way))
            for way in _STEPS_BY_CHANGE
        }
        rows = [
            {**{name: job.settings[name] for name in ("way", "gap_mm", "seed")}, "step": step, "correlation": value}
            for job, result in results
            for step, value in zip(result.numbers["steps"], result.numbers["correlation"], strict=True)
        ]
        return Findings(rows, _claims(curves, steps), [_figure(way, curves, steps[way]) for way in _STEPS_BY_CHANGE])


def _claims(curves: Curves, steps: Mapping[str, Sequence[float]]) -> list[Claim]:
    widths = [_half_width(_STEPS_NM, curves["wavelength", gap]) for gap in _GAPS_MM]
    measured = ", ".join(f"{_format_gap(gap)}: {width:.1f} nm" for gap, width in zip(_GAPS_MM, widths, strict=True))
    falls = all(later < earlier for earlier, later in pairwise(widths))
    angle = _ANGLES_MRAD.index(4.3)
    at_angle = ", ".join(f"{_format_gap(gap)}: {curves['angle', gap][angle]:.2f}" for gap in _GAPS_MM)
    refocused = ", ".join(f"{_format_gap(gap)}: {curves['refocused', gap][-1]:.2f}" for gap in _GAPS_MM)
    verdict = REPRODUCES if falls else CONTRADICTS
    return [
        Claim("a larger gap decorrelates faster (half width)", "yes", measured, verdict),
        Claim(f"correlation {steps['angle'][angle]:.1f} mrad away, shifted back", "", at_angle, SHOWN),
        Claim("correlation 32 nm away, refocused at equal z·λ", "", refocused, SHOWN),
    ]


def _figure(way: str, curves: Curves, steps: Sequence[float]) -> StudyFigure:
    lines = {_format_gap(gap): (steps, curves[way, gap]) for gap in _GAPS_MM}
    x_axis = f"{'angle' if way == 'angle' else 'wavelength'} difference ({_UNITS[way]})"
    return StudyFigure(f"memory-{way}", _FIGURE_CAPTIONS[way], line_plot(lines, x_axis, "correlation"))


def _changed_speckle(
    bench: System, drive: NDArray[np.float32], way: str, step: float
) -> tuple[NDArray[np.float64], int]:
    """Speckle after a change by `step`, and the greatest shift (samples) that the change may cause."""
    if way == "angle":
        angle = step * 1e-3
        tilted = _laser(bench, _MIDDLE_M).edit({"source.directions": [[0.0, angle]]})
        pitch_m = bench.modulators[0].pitch_m / bench.sampling.upsample
        reach = (_PLANE_M + (bench.gap_m or 0.0)) * np.tan(angle) / pitch_m
        return _speckle(tilted, drive, _PLANE_M), int(np.ceil(reach)) + 1
    λ = _MIDDLE_M + step * 1e-9
    plane_m = _PLANE_M * _MIDDLE_M / λ if way == "refocused" else _PLANE_M
    return _speckle(_laser(bench, λ), drive, plane_m), 0


def _grid_step(bench: System, way: str, step: float) -> float:
    """The step; of angles the nearest whose plane wave is periodic on the grid, a multiple of λ/width."""
    if way != "angle":
        return step
    shape, pitch_m = bench.modulators[0].shape, bench.modulators[0].pitch_m
    finest = _MIDDLE_M / (shape[1] * pitch_m) * 1e3
    return round(step / finest) * finest


def _laser(bench: System, wavelength_m: float) -> System:
    return bench.edit({"wavelengths": [wavelength_m], "amplitudes": [[1.0]]})


def _speckle(system: System, drive: NDArray[np.float32], plane_m: float) -> NDArray[np.float64]:
    return np.asarray(simulate(system, drive, [plane_m], backend="torch").intensity[0, 0], dtype=np.float64)


def _correlation(first: NDArray[np.float64], second: NDArray[np.float64], reach: int) -> float:
    """Correlation of the central halves, the maximum over shifts of `second` along x by up to `reach` samples.

    The best whole shift is refined to a quarter of a sample. The intensity has twice the bandwidth of the field, more
    than the grid resolves: of the speckle of one modulator, which shifts unchanged, up to a tenth of the correlation is
    lost between samples.
    """
    rows, columns = first.shape
    y, x = slice(rows // 4, rows - rows // 4), slice(columns // 4, columns - columns // 4)
    reach = min(reach, columns // 4)
    spectrum, frequencies = np.fft.rfft(second, axis=1), np.fft.rfftfreq(columns)

    def shifted_correlation(shift: float) -> float:
        moved = np.fft.irfft(spectrum * np.exp(-2j * np.pi * frequencies * shift), columns, axis=1)
        return float(np.corrcoef(first[y, x].ravel(), moved[y, x].ravel())[0, 1])

    best = max(range(-reach, reach + 1), key=shifted_correlation)
    return max(shifted_correlation(best + part) for part in (_SUBSAMPLE_SHIFTS if reach else (0.0,)))


def _seeds(scale: StudyScale) -> int:
    return max(scale.seeds, 2)


def _half_width(steps: tuple[float, ...], curve: NDArray[np.float64]) -> float:
    """The step at which the curve falls to a half, interpolated; infinite if it doesn't."""
    below = int(np.argmax(curve < 0.5))
    if not curve[below] < 0.5:
        return float("inf")
    return float(np.interp(0.5, [curve[below], curve[below - 1]], [steps[below], steps[below - 1]]))


def _format_gap(gap_mm: float | None) -> str:
    return "one modulator" if gap_mm is None else f"gap {gap_mm:g} mm"


STUDY = _MemoryEffect()
