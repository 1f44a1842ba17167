"""Does the display drive the eye's focus? Retinal contrast against accommodation, beside an incoherent scene."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.colour import SRGB_TO_XYZ
from holoview.metrics.band_contrast import band_contrast
from holoview.study.claims import SHOWN
from holoview.study.hologram_jobs import job_system, job_target, mean_curve, optimise_job
from holoview.study.hologram_study import scheme_jobs
from holoview.study.plots import line_plot
from holoview.study.scale import StudyScale
from holoview.study.study import Claim, Findings, JobResult, Results, StatusCallback, Study, StudyFigure, StudyJob
from holoview.view import simulate

_SCHEMES = {"simultaneous": "3 wavelengths", "holochrome-8": "8 wavelengths", "holochrome-16": "16 wavelengths"}
_BEGIN = ("smooth", "random")
_PUPIL_MM = 3.0
_DEFOCUS_D = np.linspace(-1.0, 1.0, 9)
_BAND_CPD = (3.0, 12.0)
"""Spatial frequencies that drive accommodation most, cycles a degree (MacKenzie, Hoffman & Watt, J. Vis. 10(8), 22)."""


class _Accommodation(Study):
    name = "accommodation"
    title = "Does the display drive focus?"
    summary = (
        "A flat picture in one plane, holograms with smooth and with random phase of 3, 8 and 16 wavelengths, seen by "
        "an eye with a pupil of 3 mm and chromatic aberration: luminance contrast between 3 and 12 cycles a degree, "
        "which falls with defocus as fast as that of an incoherent scene if the display is to drive accommodation."
    )
    quick_note = "Quick: 128 x 96 samples and 40 iterations; the picture is 0.7° wide."

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        return [
            job
            for begin in _BEGIN
            for job in scheme_jobs(
                self, tuple(_SCHEMES), scale, seed, f"{begin} phase", begin=begin, planes=1, depth=False
            )
        ]

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        eye = {"pupil": _PUPIL_MM * 1e-3, "infinity": "7 mm"}
        system = job_system(settings).with_(eye=eye)
        options = {**settings, "options": {"begin": settings["begin"]}}
        state = optimise_job(system, job_target(system, settings, system.planes_m), options, status)
        assert system.eye is not None
        planes_m = system.eye.plane_m(
            system.eye.dioptres(system.planes_m[0], system.planes_m) + _DEFOCUS_D, system.planes_m
        )
        status("through focus")
        view = simulate(state.best.system, state.best.drive, planes_m, backend="torch")
        scene = job_target(state.best.system, settings, planes_m)
        assert view.degrees_per_sample is not None
        shown, real = (
            [band_contrast(image, view.degrees_per_sample, _BAND_CPD) for image in images]
            for images in (view.xyz[..., 1], scene @ SRGB_TO_XYZ[1])
        )
        return JobResult({"psnr_db": state.best_psnr_db, "contrast": shown, "scene_contrast": real})

    def analyse(self, results: Results) -> Findings:
        figures = []
        for begin in _BEGIN:
            curves = {
                label: (_DEFOCUS_D, mean_curve(results, "contrast", scheme=scheme, begin=begin))
                for scheme, label in _SCHEMES.items()
            }
            scene = {"incoherent scene": (_DEFOCUS_D, mean_curve(results, "scene_contrast", begin=begin))}
            draw = line_plot({**curves, **scene}, "defocus (D)", "luminance contrast", dashed=("incoherent scene",))
            caption = f"Retinal contrast, 3 to 12 cycles a degree, {begin} phase"
            figures.append(StudyFigure(f"{begin}-phase", caption, draw))
        rows = [
            {key: job.settings[key] for key in ("scheme", "begin", "target", "seed")}
            | {"defocus_d": float(d), "contrast": result.numbers["contrast"][i]}
            | {"scene_contrast": result.numbers["scene_contrast"][i], "psnr_db": result.numbers["psnr_db"]}
            for job, result in results
            for i, d in enumerate(_DEFOCUS_D)
        ]
        return Findings(rows=rows, claims=_claims(results), plots=figures)


def _claims(results: Results) -> list[Claim]:
    """The loss of contrast a dioptre beside that of the scene, and the accommodation of the highest contrast."""
    claims = []
    for begin in _BEGIN:
        for scheme, label in _SCHEMES.items():
            shown, real = (
                mean_curve(results, key, scheme=scheme, begin=begin) for key in ("contrast", "scene_contrast")
            )
            text = (
                f"falls by {_fall(shown):.0%} at 1 D (scene {_fall(real):.0%}), "
                f"highest at {_DEFOCUS_D[np.argmax(shown)]:+.2f} D (scene {_DEFOCUS_D[np.argmax(real)]:+.2f} D)"
            )
            claims.append(Claim(f"{label}, {begin} phase", "", text, SHOWN))
    return claims


def _fall(curve: NDArray[np.float64]) -> float:
    """The share of the contrast in focus that is lost a dioptre out of focus, mean of both sides."""
    return float(1 - (curve[0] + curve[-1]) / 2 / curve[len(curve) // 2])


STUDY = _Accommodation()
