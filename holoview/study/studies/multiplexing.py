"""Colour multiplexing in its smallest case: two frames of two lasers, one laser a frame or both in both."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from holoview.colour import SRGB_TO_XYZ, XYZ_TO_SRGB, observer_weights
from holoview.metrics.fidelity import psnr_xyz
from holoview.metrics.gamut import chromaticity
from holoview.study.hologram_study import (
    CONTRADICTS,
    QUICK_SIZE,
    REPRODUCES,
    hologram_metrics,
    job_system,
    job_target,
    mean_number,
    optimise_job,
    table_row,
    targets_and_seeds,
)
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
    StudyScale,
)
from holoview.view import simulate

_LASERS_M = (532e-9, 638e-9)
_MIXES = (0.0, 0.17, 0.33, 0.5, 0.67, 0.83, 1.0)
_DRIVES = {"sequential": [[1.0, 0.0], [0.0, 1.0]], "multiplexed": [[1.0, 1.0], [1.0, 1.0]]}


class _Multiplexing(Study):
    name = "multiplexing"
    title = "Two frames of two lasers, in turn or together"
    summary = (
        "The paper's argument for colour multiplexing, in its smallest case: a picture tinted along the line between "
        "two lasers in xyY, shown in two frames by one laser each or by both in both; PSNR of XYZ, unclipped."
    )
    quick_note = f"{QUICK_SIZE}."
    revision = 3

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        return [
            self.make_job(
                f"{drive}, {mix:.0%} of the longer wavelength, {case['target']}, seed {case['seed']}",
                {
                    **case,
                    "scheme": "simultaneous",
                    "drive": drive,
                    "mix": mix,
                    "set": {"wavelengths": list(_LASERS_M), "amplitudes": _DRIVES[drive]},
                    "options": {"loss": "xyz"},
                },
            )
            for mix in _MIXES
            for drive in _DRIVES
            for case in targets_and_seeds(scale, seed)
        ]

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        system = job_system(settings)
        target = tinted(job_target(system, settings, system.planes_m), settings["mix"])
        state = optimise_job(system, target, settings, status)
        view = simulate(state.best.system, state.best.drive, backend="torch")
        xyz_quality = {"psnr_xyz_db": psnr_xyz(view.xyz, target @ SRGB_TO_XYZ.T).mean_db}
        return JobResult(hologram_metrics(state.best, view, target) | xyz_quality)

    def analyse(self, results: Results) -> Findings:
        curves = {
            drive: [mean_number(results, "psnr_xyz_db", drive=drive, mix=mix) for mix in _MIXES] for drive in _DRIVES
        }
        gains = np.array(curves["multiplexed"]) - np.array(curves["sequential"])
        measured = f"{gains.min():+.1f} to {gains.max():+.1f} dB"
        return Findings(
            rows=[table_row(job, outcome, ("drive", "mix", "target", "seed")) for job, outcome in results],
            claims=[
                Claim(
                    "multiplexed against sequential, at every mix",
                    "better",
                    measured,
                    REPRODUCES if gains.min() > 0 else CONTRADICTS,
                )
            ],
            plots=[
                StudyFigure(
                    "mixes",
                    "PSNR of XYZ along the line between the lasers in xyY",
                    line_plot(
                        {d: (_MIXES, c) for d, c in curves.items()}, "way from 532 nm to 638 nm in xy", "PSNR (dB)"
                    ),
                )
            ],
        )


def tinted(stack: np.ndarray, mix: float) -> np.ndarray:
    """The luminance of a stack (…, 3) in linear sRGB with a single chromaticity, between those of the lasers in xy.

    mix: 0 for the chromaticity of the shorter wavelength, 1 for that of the longer one.
    """
    first, second = chromaticity(observer_weights("eye", np.array(_LASERS_M)))
    x, y = (1 - mix) * first + mix * second
    colour = np.array([x / y, 1.0, (1 - x - y) / y])
    luminance = stack @ SRGB_TO_XYZ[1]
    return np.asarray(luminance[..., None] * colour @ XYZ_TO_SRGB.T, dtype=np.float32)


STUDIES = (_Multiplexing(),)
