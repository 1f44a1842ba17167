"""PSNR and speckle contrast through focus, in comparison with incoherent defocus."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from holoview.metrics.image_quality import measure_image_quality
from holoview.study.hologram_study import SHOWN, job_system, job_target, mean_curve, optimise_job, scheme_jobs
from holoview.study.plots import line_plot
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
    StudyScale,
)
from holoview.view import simulate

_SCHEMES = ("simultaneous", "holochrome-8", "holochrome-8x3")
_SWEEP = 9
_KEYS = ("planes_mm", "psnr_db", "speckle_contrast")


class _Defocus(Study):
    name = "defocus"
    title = "Through focus"
    summary = (
        "A hologram of a scene with depth at planes that it was optimised for and between them, against the natural "
        "defocus of incoherent light: whether it blurs as the eye expects, and where speckle comes back."
    )
    quick_note = "Quick: 128 x 96 samples, 3 planes to optimise and 40 iterations."
    revision = 3

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        return scheme_jobs(self, _SCHEMES, scale, seed, sweep=_SWEEP)

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
        curves = {scheme: {key: mean_curve(results, key, scheme=scheme) for key in _KEYS} for scheme in _SCHEMES}
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
            for number, (job, outcome) in enumerate(results[:: max(len(results) // len(_SCHEMES), 1)])
            for where in ("near", "far")
        ]
        return Findings(rows=rows, claims=claims, plots=plots, pictures=pictures)


STUDIES = (_Defocus(),)
