"""What the chromatic aberration of a human eye leaves of the gain of many wavelengths."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from holoview.colour import to_srgb8
from holoview.metrics.psnr import psnr_linear_srgb
from holoview.model.system import System
from holoview.study.claims import gain_claim
from holoview.study.hologram_jobs import has_settings, job_system, job_target, mean_number, optimise_job, table_row
from holoview.study.hologram_study import aimed_jobs
from holoview.study.perceptual_columns import (
    notes_on_scores,
    score_names,
    score_numbers,
    score_settings,
)
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

_SCHEMES = {"simultaneous": "3 wavelengths", "holochrome-8": "8 wavelengths", "holochrome-16": "16 wavelengths"}
_OPTIMISED_FOR = {"planes": "the focal planes", "eye": "the eye"}
_PUPILS_MM = (2.0, 3.0, 4.0, 6.0)
_PUPIL_MM = 3.0  # of the eye that holograms are optimised for
_EYES = {"plain": "no chromatic aberration", "chromatic": "chromatic aberration"}


class _Eye(Study):
    name = "eye"
    title = "Through a human eye"
    summary = (
        "Holograms of 3, 8 and 16 wavelengths behind a 40 mm eyepiece, seen by an eye whose focus differs by 1.1 "
        "dioptres between 460 and 650 nm, for pupils of 2 to 6 mm at three accommodations: how much of the gain of "
        "many wavelengths is left, and whether optimising for the eye brings it back. The target is the scene as the "
        "same eye sees it."
    )
    quick_note = "Quick: 128 x 96 samples, 3 planes and 40 iterations."
    options = ("pupils", "scores")
    revision = 2

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        pupils = {"pupils_mm": [round(1e3 * d, 6) for d in scale.pupils_m]} if scale.pupils_m else {}
        return aimed_jobs(self, tuple(_SCHEMES), scale, seed, _OPTIMISED_FOR, **score_settings(scale), **pupils)

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        system = job_system(settings)
        aimed = _with_eye(system, _PUPIL_MM, chromatic=True) if settings["optimised_for"] == "eye" else system
        state = optimise_job(aimed, job_target(aimed, settings, aimed.planes_m), settings, status)
        planes_m = system.planes_m[[0, len(system.planes_m) // 2, -1]]
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
    """The one of these pupils that is most like the one that holograms are optimised for."""
    return min(_pupils_mm(settings), key=lambda d: abs(d - _PUPIL_MM))


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
    """What the eye sees of each hologram at the middle accommodation, with and without its chromatic aberration."""
    first = {key: results[0][0].settings[key] for key in ("target", "seed")}
    pictures = []
    for job, result in results:
        if not has_settings(job, **first):
            continue
        scheme, aim = job.settings["scheme"], job.settings["optimised_for"]
        for eye in _EYES if aim == "planes" else ("chromatic",):
            caption = f"{_SCHEMES[scheme]}, {_EYES[eye]}, optimised for {_OPTIMISED_FOR[aim]}"
            pictures.append(StudyPicture(f"{scheme}-{aim}-{eye}", caption, result.pictures[eye]))
    return pictures


STUDY = _Eye()
