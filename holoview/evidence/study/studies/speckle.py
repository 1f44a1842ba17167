"""Speckle contrast of random patterns: by the number of wavelengths and frames, on the retina, and how alike it stays.

Alike: the memory effect, the correlation of speckle after a change of the wavelength or of the direction of the light.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.evidence.study.charts import line_plot
from holoview.evidence.study.hologram_study import (
    CONTRADICTS,
    DIRECTION_ONLY,
    REPRODUCES,
    SHOWN,
    has_settings,
    job_system,
    mean_curve,
    mean_number,
    table_row,
)
from holoview.evidence.study.study import (
    Claim,
    Findings,
    JobResult,
    Results,
    StatusCallback,
    Study,
    StudyFigure,
    StudyJob,
    StudyPicture,
    StudyScale,
    format_size,
    speckle_shape,
)
from holoview.holograms.metrics.speckle import CONE_ARCMIN, independent_patterns, seen_by_cones, speckle_contrast
from holoview.holograms.view import random_drive, simulate
from holoview.light.colour import to_srgb8
from holoview.light.model.system import System

_COUNTS = (1, 2, 4, 8, 16, 32)
_SEEDS = 4
_PICTURE_MEAN = 0.3  # linear light
_AVERAGED_OVER = {
    "frames": "frames of independent patterns, one laser",
    "wavelengths": "wavelengths 440 to 660 nm, two modulators",
    "wavelengths, 1 modulator": "wavelengths 440 to 660 nm, one modulator",
}


class _Contrast(Study):
    name = "contrast"
    title = "Speckle contrast against the number of wavelengths and frames"
    summary = (
        "N independent patterns of fully developed speckle have contrast 1/√N. Frames are independent; wavelengths "
        "through the same pattern only where they are far apart (memory-effect)."
    )
    revision = 2
    quick_note = "Contrast is taken of intensity (all lasers alike) over the whole field."

    def describe_size(self, scale: StudyScale) -> str:
        """Random patterns; nothing is optimised."""
        return ", ".join(format_size(speckle_shape(scale), _SEEDS))

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        return [
            self.make_job(
                f"{count} {way}, seed {number}",
                {"shape": list(speckle_shape(scale)), "way": way, "count": count, "seed": number},
            )
            for way in _AVERAGED_OVER
            for count in _COUNTS
            for number in range(seed, seed + _SEEDS)
        ]

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        system = job_system({**settings, "planes": 1, "scheme": "simultaneous", "set": _changes(settings)})
        if settings["way"].endswith("1 modulator"):
            system = system.edit({"modulators": system.modulators[:1], "gap": None})
        view = simulate(system, random_drive(system, settings["seed"]), backend="torch")
        image = view.intensity[0].mean(axis=0)
        contrast = speckle_contrast(image).contrast
        picture = to_srgb8(np.repeat((_PICTURE_MEAN * image / image.mean())[..., None], 3, axis=-1))
        return JobResult({"contrast": contrast, "patterns": independent_patterns(contrast)}, {"speckle": picture})

    def analyse(self, results: Results) -> Findings:
        curves = {
            way: [mean_number(results, "contrast", way=way, count=count) for count in _COUNTS] for way in _AVERAGED_OVER
        }
        law = 1 / np.sqrt(_COUNTS)
        draw = line_plot(
            {**{_AVERAGED_OVER[way]: (_COUNTS, curve) for way, curve in curves.items()}, "1/√N": (_COUNTS, law)},
            "N",
            "speckle contrast",
            dashed=("1/√N",),
            logarithmic=True,
        )
        return Findings(
            rows=[table_row(job, result, ("way", "count", "seed")) for job, result in results],
            claims=_contrast_claims(curves, law),
            plots=[StudyFigure("contrast", f"Mean over {_SEEDS} random patterns", draw)],
            pictures=_pictures(results),
        )


def _contrast_claims(curves: Mapping[str, list[float]], law: NDArray[np.float64]) -> list[Claim]:
    departure = float(np.max(np.abs(np.array(curves["frames"]) / law - 1)))
    verdict = REPRODUCES if departure < 0.05 else DIRECTION_ONLY
    claims = [Claim("N frames have contrast 1/√N", "1/√N", f"within {departure:.1%}", verdict)]
    for way, curve in curves.items():
        contrast = curve[_COUNTS.index(8)]
        measured = f"{contrast:.3f}: as {independent_patterns(contrast):.1f} independent patterns"
        claims.append(Claim(f"8 {_AVERAGED_OVER[way]}", "", measured, SHOWN))
    return claims


def _pictures(results: Results) -> list[StudyPicture]:
    """Speckle of 1, 8 and 32 wavelengths for the first seed."""
    first_seed = results[0][0].settings["seed"]
    return [
        StudyPicture(
            f"speckle-{count}",
            f"{count} wavelength{'s' * (count > 1)}: contrast {result.numbers['contrast']:.2f}",
            result.pictures["speckle"],
        )
        for job, result in results
        if has_settings(job, way="wavelengths", seed=first_seed) and (count := job.settings["count"]) in (1, 8, 32)
    ]


def _changes(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Changes of the bench to `count` frames of one laser, or to `count` lasers in one frame."""
    count = settings["count"]
    if settings["way"] == "frames":
        return {"wavelengths": [550e-9], "amplitudes": [[1.0]] * count, "observer": "mono"}
    wavelengths = np.linspace(440e-9, 660e-9, count) if count > 1 else np.array([550e-9])
    return {"wavelengths": wavelengths.tolist(), "amplitudes": [[1.0] * count], "observer": "mono"}


# --- on the retina, against the pupil ---


_PUPILS_MM = (1.0, 2.0, 3.0, 4.0, 6.0)
_RETINAL_SEEDS = 3
_CASES = {
    "1 wavelength": (1, 1),
    "3 wavelengths": (3, 1),
    "8 wavelengths": (8, 1),
    "16 wavelengths": (16, 1),
    "8 wavelengths, 3 frames": (8, 3),
}
_LAW_TOLERANCE = 0.1


class _RetinalSpeckle(Study):
    name = "retinal-speckle"
    title = "Speckle on the retina against the pupil"
    summary = (
        "Random patterns seen by an eye behind a 40 mm eyepiece: speckle contrast at every sample and over foveal "
        "cones, which average only grains smaller than they are. Grains are about λ/pupil wide."
    )
    options = ("pupils",)
    quick_note = "Nothing is optimised; all lasers have the same power."

    def describe_size(self, scale: StudyScale) -> str:
        """Random patterns; nothing is optimised."""
        return ", ".join(format_size(speckle_shape(scale), _RETINAL_SEEDS))

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        return [
            self.make_job(
                f"{case}, pupil {pupil_mm:g} mm, seed {number}",
                {"shape": list(speckle_shape(scale)), "case": case, "pupil_mm": pupil_mm, "seed": number},
            )
            for case in _CASES
            for pupil_mm in [round(1e3 * d, 6) for d in scale.pupils_m] or _PUPILS_MM
            for number in range(seed, seed + _RETINAL_SEEDS)
        ]

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        count, frames = _CASES[settings["case"]]
        wavelengths = np.linspace(440e-9, 660e-9, count) if count > 1 else np.array([550e-9])
        changes = {
            "wavelengths": wavelengths.tolist(),
            "amplitudes": [[1.0] * count] * frames,
            "eye": {"pupil": settings["pupil_mm"] * 1e-3},
        }
        system = job_system({**settings, "planes": 1, "scheme": "simultaneous", "set": changes})
        view = simulate(system, random_drive(system, settings["seed"]), backend="torch")
        image = view.intensity[0].mean(axis=0)
        assert view.degrees_per_sample is not None
        contrast = speckle_contrast(image).contrast
        return JobResult(
            {
                "contrast": contrast,
                "patterns": independent_patterns(contrast),
                "contrast_of_cones": speckle_contrast(seen_by_cones(image, view.degrees_per_sample)).contrast,
            }
        )

    def analyse(self, results: Results) -> Findings:
        plots, pupils_mm = [], _pupils_mm(results)
        for key, caption in (
            ("contrast", "Contrast of the retinal intensity; 1/√(wavelengths · frames) is dashed"),
            ("contrast_of_cones", f"Contrast of means over discs of {CONE_ARCMIN:g} arcmin, the size of foveal cones"),
        ):
            curves = {case: (pupils_mm, _curve(results, key, case)) for case in _CASES}
            cases = {f"1/√{n * m}": case for case, (n, m) in _CASES.items()}
            ends = (pupils_mm[0], pupils_mm[-1])
            laws = {
                name: (ends, [1 / np.sqrt(np.prod(_CASES[case]))] * 2)
                for name, case in cases.items()
                if key == "contrast"
            }
            draw = line_plot({**curves, **laws}, "pupil (mm)", "σ/μ", dashed=cases)
            plots.append(StudyFigure(key.replace("_", "-"), caption, draw))
        return Findings(
            rows=[table_row(job, result, ("case", "pupil_mm", "seed")) for job, result in results],
            claims=_retinal_claims(results),
            plots=plots,
        )


def _pupils_mm(results: Results) -> list[float]:
    """The diameters of all results, rising."""
    return sorted({job.settings["pupil_mm"] for job, _ in results})


def _curve(results: Results, key: str, case: str) -> list[float]:
    return [mean_number(results, key, case=case, pupil_mm=pupil_mm) for pupil_mm in _pupils_mm(results)]


def _retinal_claims(results: Results) -> list[Claim]:
    """Against 1/√N of N independent patterns, and what the cones see."""
    claims, pupils_mm = [], _pupils_mm(results)
    for case, (count, frames) in _CASES.items():
        curve, law = _curve(results, "contrast", case), 1 / np.sqrt(count * frames)
        departure = float(np.max(np.abs(np.array(curve) / law - 1)))
        claims.append(
            Claim(
                f"{case}: contrast at every pupil",
                f"1/√{count * frames} = {law:.3f}",
                f"{min(curve):.3f} to {max(curve):.3f}",
                REPRODUCES if departure < _LAW_TOLERANCE else DIRECTION_ONLY,
            )
        )
        cones = _curve(results, "contrast_of_cones", case)
        text = f"{cones[0]:.3f} at {pupils_mm[0]:g} mm, {cones[-1]:.3f} at {pupils_mm[-1]:g} mm"
        claims.append(Claim(f"{case}: contrast that cones see", "", text, SHOWN))
    return claims


# --- memory effect ---


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
        "Correlation of speckle with that at another wavelength (same plane, or refocused at equal z·λ) or direction "
        "(shifted back): a second modulator behind a gap shortens the range over which patterns stay alike, so that "
        "more wavelengths and directions count."
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
        return Findings(
            rows, _memory_claims(curves, steps), [_figure(way, curves, steps[way]) for way in _STEPS_BY_CHANGE]
        )


def _memory_claims(curves: Curves, steps: Mapping[str, Sequence[float]]) -> list[Claim]:
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


STUDIES = (_Contrast(), _RetinalSpeckle(), _MemoryEffect())
