"""Does the display drive the eye's focus? Retinal contrast against accommodation, beside an incoherent scene.

Also PSNR and speckle contrast through focus, in comparison with incoherent defocus.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.evidence.study.charts import line_plot
from holoview.evidence.study.hologram_study import SHOWN, job_system, job_target, mean_curve, optimise_job, scheme_jobs
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
from holoview.holograms.metrics.image_quality import measure_image_quality
from holoview.holograms.metrics.perceptual import band_contrast, contrast_like
from holoview.holograms.view import simulate
from holoview.light.colour import SRGB_TO_XYZ

_SCHEMES = {"simultaneous": "3 wavelengths", "holochrome-8": "8 wavelengths", "holochrome-16": "16 wavelengths"}
_BEGIN = ("smooth", "random")
_PUPIL_MM = 3.0
_CONTRASTS = {"contrast": "of all", "picture_contrast": "of the picture"}
_DEFOCUS_D = np.linspace(-1.0, 1.0, 9)
_BAND_CPD = (3.0, 12.0)
"""Spatial frequencies that drive accommodation most, cycles a degree (MacKenzie, Hoffman & Watt, J. Vis. 10(8), 22)."""


class _Accommodation(Study):
    name = "accommodation"
    title = "Does the display drive focus?"
    summary = (
        "A flat picture in one plane, of smooth and of random phase, seen by an eye with a pupil of 3 mm: to drive "
        "accommodation, its luminance contrast between 3 and 12 cycles a degree has to fall with defocus as fast as "
        "that of an incoherent scene."
    )
    quick_note = "Quick: 128 x 96 samples and 40 iterations; the picture is 0.7° wide."

    def describe_size(self, scale: StudyScale) -> str:
        """A flat picture in one plane, at any scale."""
        return replace(scale, planes=1).description

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
        run = {**settings, "options": {"begin": settings["begin"]}}
        state = optimise_job(system, job_target(system, settings, system.planes_m), run, status)
        assert system.eye is not None
        planes_m = system.eye.plane_m(
            system.eye.dioptres(system.planes_m[0], system.planes_m) + _DEFOCUS_D, system.planes_m
        )
        status("through focus")
        view = simulate(state.best.system, state.best.drive, planes_m, backend="torch")
        scene = job_target(state.best.system, settings, planes_m)
        assert view.degrees_per_sample is not None
        images = {"": view.xyz[..., 1], "scene_": scene @ SRGB_TO_XYZ[1]}
        numbers: dict[str, Any] = {"psnr_db": state.best_psnr_db}
        wanted = images["scene_"][len(_DEFOCUS_D) // 2]
        for name, stack in images.items():
            options = (view.degrees_per_sample, _BAND_CPD)
            numbers[f"{name}contrast"] = [band_contrast(image, *options) for image in stack]
            numbers[f"{name}picture_contrast"] = [contrast_like(image, wanted, *options) for image in stack]
        return JobResult(numbers)

    def analyse(self, results: Results) -> Findings:
        figures = []
        for begin in _BEGIN:
            for key, what in _CONTRASTS.items():
                curves = {
                    label: (_DEFOCUS_D, mean_curve(results, key, scheme=scheme, begin=begin))
                    for scheme, label in _SCHEMES.items()
                }
                scene = {"incoherent scene": (_DEFOCUS_D, mean_curve(results, f"scene_{key}", begin=begin))}
                draw = line_plot({**curves, **scene}, "defocus (D)", "contrast", dashed=("incoherent scene",))
                caption = f"Contrast {what}, 3 to 12 cycles a degree, {begin} phase"
                figures.append(StudyFigure(f"{begin}-phase-{key.replace('_', '-')}", caption, draw))
        keys = [f"{of}{key}" for key in _CONTRASTS for of in ("", "scene_")]
        rows = [
            {key: job.settings[key] for key in ("scheme", "begin", "target", "seed")}
            | {"defocus_d": float(d), "psnr_db": result.numbers["psnr_db"]}
            | {key: result.numbers[key][i] for key in keys}
            for job, result in results
            for i, d in enumerate(_DEFOCUS_D)
        ]
        return Findings(rows=rows, claims=_claims(results), plots=figures)


def _claims(results: Results) -> list[Claim]:
    """The contrast a dioptre out of focus over that in focus, of all that is seen and of the picture's part."""
    claims = []
    for begin in _BEGIN:
        for scheme, label in _SCHEMES.items():
            parts = []
            for key, what in _CONTRASTS.items():
                shown, real = (mean_curve(results, f"{of}{key}", scheme=scheme, begin=begin) for of in ("", "scene_"))
                parts.append(f"{what} {_left(shown):.0%} (scene {_left(real):.0%})")
            claims.append(Claim(f"{label}, {begin} phase: contrast left at 1 D", "", ", ".join(parts), SHOWN))
    return claims


def _left(curve: NDArray[np.float64]) -> float:
    """The contrast a dioptre out of focus, mean of both sides, over that in focus."""
    return float((curve[0] + curve[-1]) / 2 / curve[len(curve) // 2])


# --- through focus ----------------------------------------------------------------------------------------------------


_DEFOCUS = ("simultaneous", "holochrome-8", "holochrome-8x3")
_SWEEP = 9
_KEYS = ("planes_mm", "psnr_db", "speckle_contrast")


class _Defocus(Study):
    name = "defocus"
    title = "Through focus"
    summary = (
        "A hologram of a scene with depth, at the planes that were optimised and between them, against the natural "
        "defocus of incoherent light."
    )
    quick_note = "Quick: 128 x 96 samples, 3 planes to optimise and 40 iterations."
    revision = 4

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        return scheme_jobs(self, _DEFOCUS, scale, seed, sweep=_SWEEP)

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        system = job_system(settings)
        first, last = system.planes_m[0], system.planes_m[-1]
        sweep_m = np.linspace(first, last, settings["sweep"])
        count = len(system.planes_m)
        target = job_target(system, settings, np.concatenate([system.planes_m, sweep_m]))
        state = optimise_job(system, target[:count], settings, status)
        view = simulate(state.best.system, state.best.drive, sweep_m, backend="torch")
        quality = [measure_image_quality(view.at([i]), target[count + i : count + i + 1]) for i in range(len(sweep_m))]
        numbers = {
            "planes_mm": (sweep_m * 1e3).tolist(),
            "psnr_db": [plane.psnr.mean_db for plane in quality],
            "speckle_contrast": [plane.mean_speckle_contrast for plane in quality],
        }
        return JobResult(numbers, {"far": view.srgb8[0], "near": view.srgb8[-1]})

    def analyse(self, results: Results) -> Findings:
        curves = {scheme: {key: mean_curve(results, key, scheme=scheme) for key in _KEYS} for scheme in _DEFOCUS}
        plots = [
            StudyFigure(
                key,
                caption,
                line_plot({s: (c["planes_mm"], c[key]) for s, c in curves.items()}, "focal plane (mm)", axis),
            )
            for key, caption, axis in (
                (
                    "psnr_db",
                    "PSNR of linear sRGB against natural defocus; it peaks at the planes that were optimised",
                    "PSNR (dB)",
                ),
                ("speckle_contrast", "Speckle contrast through focus", "σ/μ"),
            )
        ]
        claims = [
            Claim(
                f"PSNR through focus, {scheme}",
                "",
                f"{curve['psnr_db'].min():.1f} to {curve['psnr_db'].max():.1f} dB",
                SHOWN,
            )
            for scheme, curve in curves.items()
        ]
        rows = [
            {"scheme": job.settings["scheme"], "target": job.settings["target"], "seed": job.settings["seed"]}
            | {key: outcome.numbers[key][i] for key in _KEYS}
            for job, outcome in results
            for i in range(len(outcome.numbers["planes_mm"]))
        ]
        pictures = [
            StudyPicture(f"{where}-{number}", f"{job.settings['scheme']}, {where} plane", outcome.pictures[where])
            for number, (job, outcome) in enumerate(results[:: max(len(results) // len(_DEFOCUS), 1)])
            for where in ("near", "far")
        ]
        return Findings(rows=rows, claims=claims, plots=plots, pictures=pictures)


STUDIES = (_Accommodation(), _Defocus())
