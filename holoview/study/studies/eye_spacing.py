"""Which spacing of wavelengths is best for an eye, whose focus differs between them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from holoview.colour import to_srgb8
from holoview.metrics.image_quality import measure_image_quality
from holoview.model.eye import chromatic_refraction
from holoview.model.system import System
from holoview.study.claims import SHOWN
from holoview.study.hologram_jobs import has_settings, job_system, job_target, mean_number, optimise_job, table_row
from holoview.study.hologram_study import targets_and_seeds
from holoview.study.laser_sets import PRIMARIES_NM, ROW_MIDDLE_NM, groups_of_lasers, row_of_lasers
from holoview.study.plots import line_plot
from holoview.study.scale import StudyScale
from holoview.study.study import (
    Claim,
    Findings,
    JobResult,
    Results,
    StatusCallback,
    Study,
    StudyFigure,
    StudyJob,
    StudyPicture,
)
from holoview.view import simulate

_SPACINGS_NM = (4.0, 8.0, 16.0, 24.0, 32.0)
_PUPIL_M = 3e-3
_SETS = {
    "row": f"8 wavelengths about {ROW_MIDDLE_NM:g} nm, monochrome",
    "groups": f"3 x 3 wavelengths about {', '.join(f'{nm:g}' for nm in PRIMARIES_NM)} nm, in colour",
}
_SEEN = {
    ("planes", "plain"): "an eye without chromatic aberration",
    ("planes", "chromatic"): "a human eye",
    ("eye", "chromatic"): "a human eye, optimised for it",
}


class _EyeSpacing(Study):
    name = "eye-spacing"
    title = "The best spacing of wavelengths for an eye"
    summary = (
        "Wavelengths that are closer share more of their speckle; wavelengths that are farther apart are seen by an "
        "eye in planes that are farther apart. Eight of them in a row about 550 nm with a camera that sees all alike, "
        "as in the study bandwidth, and three about each of three primaries, seen through a pupil of 3 mm behind a 40 "
        "mm eyepiece."
    )
    quick_note = "Quick: 128 x 96 samples, 3 planes and 40 iterations."

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        return [
            self.make_job(
                f"{lasers} of wavelengths {spacing:g} nm apart, for {aim}, {case['target']}, seed {case['seed']}",
                {
                    **case,
                    "scheme": "simultaneous",
                    "lasers": lasers,
                    "spacing_nm": spacing,
                    "optimised_for": aim,
                    "set": row_of_lasers(8, spacing) if lasers == "row" else groups_of_lasers(spacing),
                },
            )
            for aim in ("planes", "eye")
            for lasers in _SETS
            for spacing in _SPACINGS_NM
            for case in targets_and_seeds(scale, seed)
        ]

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        system = job_system(settings)
        aimed = _with_eye(system, chromatic=True) if settings["optimised_for"] == "eye" else system
        state = optimise_job(aimed, job_target(aimed, settings, aimed.planes_m), settings, status)
        planes_m = system.planes_m[[0, len(system.planes_m) // 2, -1]]
        focus_range_d = float(np.ptp(chromatic_refraction(system.wavelengths_m)))
        numbers: dict[str, Any] = {"focus_range_d": focus_range_d, "eyebox_variation": state.eyebox}
        pictures: dict[str, Any] = {}
        for eye in ("plain", "chromatic"):
            status(f"scoring, {eye}")
            seen_by = _with_eye(state.best.system, chromatic=eye == "chromatic")
            view = simulate(seen_by, state.best.drive, planes_m, backend="torch")
            target = job_target(seen_by, settings, planes_m)
            quality = measure_image_quality(view, target)
            psnr = quality.psnr_luminance if settings["lasers"] == "row" else quality.psnr
            numbers |= {f"{eye}_db": psnr.mean_db, f"{eye}_contrast": quality.mean_speckle_contrast}
            pictures |= {eye: view.srgb8[1], f"{eye} wanted": to_srgb8(np.asarray(target[1]))}
        return JobResult(numbers, pictures)

    def analyse(self, results: Results) -> Findings:
        names = ("lasers", "spacing_nm", "optimised_for", "target", "seed")
        return Findings(
            rows=[table_row(job, result, names) for job, result in results],
            claims=[_claim(results, lasers, *seen) for lasers in _SETS for seen in _SEEN],
            plots=[_plot(results, lasers) for lasers in _SETS],
            pictures=_pictures(results),
        )


def _with_eye(system: System, *, chromatic: bool) -> System:
    return system.with_(eye={"pupil": _PUPIL_M, "chromatic": chromatic})


def _curve(results: Results, lasers: str, aim: str, eye: str) -> list[float]:
    """PSNR by spacing."""
    return [
        mean_number(results, f"{eye}_db", lasers=lasers, optimised_for=aim, spacing_nm=spacing)
        for spacing in _SPACINGS_NM
    ]


def _claim(results: Results, lasers: str, aim: str, eye: str) -> Claim:
    """The best spacing, and PSNR at each; the paper has no number for an eye."""
    curve = _curve(results, lasers, aim, eye)
    best = _SPACINGS_NM[int(np.argmax(curve))]
    values = ", ".join(f"{nm:g} nm {psnr_db:.1f}" for nm, psnr_db in zip(_SPACINGS_NM, curve, strict=True))
    what = f"best spacing for {_SEEN[aim, eye]}: {_SETS[lasers]}"
    return Claim(what, "", f"{best:g} nm ({values} dB)", SHOWN)


def _plot(results: Results, lasers: str) -> StudyFigure:
    curves = {label: (_SPACINGS_NM, _curve(results, lasers, *seen)) for seen, label in _SEEN.items()}
    return StudyFigure(lasers, f"Retinal image: {_SETS[lasers]}", line_plot(curves, "spacing (nm)", "PSNR (dB)"))


def _pictures(results: Results) -> list[StudyPicture]:
    """What the eye sees at the middle accommodation of the closest and the farthest wavelengths."""
    first = {key: results[0][0].settings[key] for key in ("target", "seed")}
    return [
        StudyPicture(
            f"{job.settings['lasers']}-{job.settings['spacing_nm']:g}-{aim}-{eye}",
            f"{_SETS[job.settings['lasers']]}, {job.settings['spacing_nm']:g} nm apart: {label}",
            result.pictures[eye],
        )
        for job, result in results
        if has_settings(job, **first) and job.settings["spacing_nm"] in (_SPACINGS_NM[0], _SPACINGS_NM[-1])
        for (aim, eye), label in _SEEN.items()
        if job.settings["optimised_for"] == aim
    ]


STUDY = _EyeSpacing()
