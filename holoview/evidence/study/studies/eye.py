"""How much of the gain of many wavelengths a human eye's chromatic aberration leaves, and the spacing that suits it."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.evidence.study.charts import line_plot
from holoview.evidence.study.hologram_study import (
    PRIMARIES_NM,
    QUICK_SIZE,
    ROW_MIDDLE_NM,
    SHOWN,
    aimed_jobs,
    case_jobs,
    first_results,
    gain_claim,
    groups_of_lasers,
    job_system,
    job_target,
    mean_number,
    notes_on_scores,
    optimise_job,
    row_of_lasers,
    score_names,
    score_numbers,
    score_settings,
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
)
from holoview.holograms.metrics.fidelity import psnr_linear_srgb
from holoview.holograms.metrics.image_quality import measure_image_quality
from holoview.holograms.optimise.checkpoint import IterationState
from holoview.holograms.view import simulate
from holoview.light.colour import to_srgb8
from holoview.light.model.eye import chromatic_refraction
from holoview.light.model.system import System

Floats = NDArray[np.float64]

_SCHEMES = {"simultaneous": "3 wavelengths", "holochrome-8": "8 wavelengths", "holochrome-16": "16 wavelengths"}
_OPTIMISED_FOR = {"planes": "the focal planes", "eye": "the eye"}
_PUPILS_MM = (2.0, 3.0, 4.0, 6.0)
_PUPIL_MM = 3.0  # of the eye that holograms are optimised for
_EYES = {"plain": "no chromatic aberration", "chromatic": "chromatic aberration"}


class _Eye(Study):
    name = "eye"
    title = "Through a human eye"
    summary = (
        "Holograms behind a 40 mm eyepiece, seen by an eye whose focus differs by 1.1 dioptres between 460 and 650 "
        "nm: how much of the gain of many wavelengths is left, and how much optimising for the eye brings back."
    )
    quick_note = f"{QUICK_SIZE}."
    options = ("pupils", "scores")
    revision = 2

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        pupils = {"pupils_mm": [round(1e3 * d, 6) for d in scale.pupils_m]} if scale.pupils_m else {}
        return aimed_jobs(self, tuple(_SCHEMES), scale, seed, _OPTIMISED_FOR, **score_settings(scale), **pupils)

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        state, planes_m = _optimised(settings, status)
        numbers: dict[str, Any] = {"psnr_db": state.best_psnr_db}
        pictures: dict[str, Any] = {}
        for name in _EYES:
            for pupil_mm in _pupils_mm(settings):
                status(f"scoring, pupil {pupil_mm:g} mm")
                seen_by = _with_eye(state.best.system, pupil_mm, chromatic=name == "chromatic")
                view = simulate(seen_by, state.best.drive, planes_m, backend="torch")
                target = job_target(seen_by, settings, planes_m)
                psnr, case = psnr_linear_srgb(view.rgb, target), f"{name}_{pupil_mm:g}"
                numbers |= {f"{case}_db": psnr.mean_db, f"{case}_planes_db": list(psnr.planes_db)}
                numbers |= {f"{case}_{key}": value for key, value in score_numbers(view, target, settings).items()}
                if pupil_mm == _judged_mm(settings):
                    pictures |= {name: view.srgb8[1], f"{name} wanted": to_srgb8(np.asarray(target[1]))}
        numbers["eyebox_variation"] = state.eyebox
        return JobResult(numbers, pictures)

    def analyse(self, results: Results) -> Findings:
        return Findings(
            rows=[table_row(job, result, ("scheme", "optimised_for", "target", "seed")) for job, result in results],
            claims=_claims(results),
            plots=[
                _plot(results, "planes", "Holograms optimised for focal planes, seen by an eye"),
                _plot(results, "eye", f"Holograms optimised for an eye with a pupil of {_PUPIL_MM:g} mm"),
            ],
            pictures=_pictures(results),
            notes=notes_on_scores(results),
        )


def _pupils_mm(settings: Mapping[str, Any]) -> tuple[float, ...]:
    """Diameters of the pupils that look at the hologram of a job."""
    return tuple(settings.get("pupils_mm", _PUPILS_MM))


def _judged_mm(settings: Mapping[str, Any]) -> float:
    """The diameter among these that is nearest to that of the pupil that holograms are optimised for."""
    return min(_pupils_mm(settings), key=lambda d: abs(d - _PUPIL_MM))


def _optimised(settings: Mapping[str, Any], status: StatusCallback) -> tuple[IterationState, Floats]:
    """The hologram of a job, and the nearest, the middle and the farthest plane (m)."""
    system = job_system(settings)
    aimed = _with_eye(system, _PUPIL_MM, chromatic=True) if settings["optimised_for"] == "eye" else system
    state = optimise_job(aimed, job_target(aimed, settings, aimed.planes_m), settings, status)
    return state, system.planes_m[[0, len(system.planes_m) // 2, -1]]


def _with_eye(system: System, pupil_mm: float, *, chromatic: bool) -> System:
    return system.with_(eye={"pupil": pupil_mm * 1e-3, "chromatic": chromatic})


def _claims(results: Results) -> list[Claim]:
    """The gain over 3 wavelengths without chromatic aberration, with it, and if it is optimised for: in dB and JOD."""
    claims, pupil_mm = [], _judged_mm(results[0][0].settings)
    for scheme, label in list(_SCHEMES.items())[1:]:
        for aim, eye, what in (
            ("planes", "plain", f"seen by an eye without chromatic aberration, pupil {pupil_mm:g} mm"),
            ("planes", "chromatic", "with chromatic aberration"),
            ("eye", "chromatic", "with chromatic aberration, optimised for it"),
        ):
            better, worse = ({"scheme": s, "optimised_for": aim} for s in (scheme, "simultaneous"))
            text = f"{label} gain over 3, {what}"
            case = f"{eye}_{pupil_mm:g}"
            claims.append(gain_claim(results, text, None, better, worse, key=f"{case}_db"))
            if "jod" in score_names(results):
                claims.append(gain_claim(results, text, None, better, worse, key=f"{case}_jod", unit="JOD"))
    return claims


def _plot(results: Results, aim: str, caption: str) -> StudyFigure:
    pupils_mm = _pupils_mm(results[0][0].settings)
    curves = {
        f"{label}, {what}": (
            pupils_mm,
            [mean_number(results, f"{eye}_{d:g}_db", scheme=scheme, optimised_for=aim) for d in pupils_mm],
        )
        for scheme, label in _SCHEMES.items()
        for eye, what in _EYES.items()
    }
    return StudyFigure(f"pupil-{aim}", caption, line_plot(curves, "pupil (mm)", "PSNR (dB)"))


def _pictures(results: Results) -> list[StudyPicture]:
    """Pictures of each hologram at the middle accommodation, seen with and without chromatic aberration."""
    pictures = []
    for job, result in first_results(results):
        scheme, aim = job.settings["scheme"], job.settings["optimised_for"]
        for eye in _EYES if aim == "planes" else ("chromatic",):
            caption = f"{_SCHEMES[scheme]}, {_EYES[eye]}, optimised for {_OPTIMISED_FOR[aim]}"
            pictures.append(StudyPicture(f"{scheme}-{aim}-{eye}", caption, result.pictures[eye]))
    return pictures


# --- the spacing of wavelengths ---


_SPACINGS_NM = (4.0, 8.0, 16.0, 24.0, 32.0)
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
        "Closer wavelengths share more of their speckle, and an eye sees wavelengths that are farther apart in "
        "planes that are farther apart: eight wavelengths in a row about 550 nm (monochrome), and three about each "
        "of three primaries, through a pupil of 3 mm."
    )
    quick_note = f"{QUICK_SIZE}."
    revision = 2

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        cases = {
            f"{lasers} of wavelengths {spacing:g} nm apart, for {aim}": {
                "scheme": "simultaneous",
                "lasers": lasers,
                "spacing_nm": spacing,
                "optimised_for": aim,
                "set": row_of_lasers(8, spacing) if lasers == "row" else groups_of_lasers(spacing),
            }
            for aim, lasers, spacing in product(("planes", "eye"), _SETS, _SPACINGS_NM)
        }
        return case_jobs(self, cases, scale, seed)

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        state, planes_m = _optimised(settings, status)
        focus_range_d = float(np.ptp(chromatic_refraction(state.best.system.wavelengths_m)))
        numbers: dict[str, Any] = {"focus_range_d": focus_range_d, "eyebox_variation": state.eyebox}
        pictures: dict[str, Any] = {}
        for eye in ("plain", "chromatic"):
            status(f"scoring, {eye}")
            seen_by = _with_eye(state.best.system, _PUPIL_MM, chromatic=eye == "chromatic")
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
            plots=[_spacing_plot(results, lasers) for lasers in _SETS],
            pictures=_spacing_pictures(results),
        )


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


def _spacing_plot(results: Results, lasers: str) -> StudyFigure:
    curves = {label: (_SPACINGS_NM, _curve(results, lasers, *seen)) for seen, label in _SEEN.items()}
    return StudyFigure(lasers, f"Retinal image: {_SETS[lasers]}", line_plot(curves, "spacing (nm)", "PSNR (dB)"))


def _spacing_pictures(results: Results) -> list[StudyPicture]:
    """Pictures at the middle accommodation, for the closest and the farthest wavelengths."""
    return [
        StudyPicture(
            f"{job.settings['lasers']}-{job.settings['spacing_nm']:g}-{aim}-{eye}",
            f"{_SETS[job.settings['lasers']]}, {job.settings['spacing_nm']:g} nm apart: {label}",
            result.pictures[eye],
        )
        for job, result in first_results(results)
        if job.settings["spacing_nm"] in (_SPACINGS_NM[0], _SPACINGS_NM[-1])
        for (aim, eye), label in _SEEN.items()
        if job.settings["optimised_for"] == aim
    ]


STUDIES = (_Eye(), _EyeSpacing())
