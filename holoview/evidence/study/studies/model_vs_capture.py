"""Prediction of a bench's captures before and after its errors are diagnosed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.report.diagnosis import Diagnosis
from holoview.evidence.study.charts import bar_chart
from holoview.evidence.study.hologram_study import SHOWN, mean_number, table_row
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
)
from holoview.light.model import preset
from holoview.util.figures import greyscale_pixels

_WAVELENGTHS_M = (460e-9, 550e-9, 640e-9)
_PLANES_M = (9e-3, 11e-3)
_CAPTURES_PER_SETTING = 4
BENCHES: dict[str, dict[str, dict[str, float]]] = {
    "as designed": {},
    "gap 0.1 mm long": {"gap": {"gap_error": 1e-4}},
    "modulator 2 shifted": {"slm_alignment": {"shift_x": 3e-6, "shift_y": -2e-6}},
    "stroke 4 % high": {"stroke": {"stroke_error": 0.04}},
    "gap long, camera soft": {"gap": {"gap_error": 1e-4}, "camera_blur": {"sigma": 0.6}},
}
_WHITE_QUANTILE = 0.999
_RANGE_SIGMAS = 10.0
_CAPTIONS = {
    "light": "a capture that was held out",
    "left-before": f"what its prediction lacks, as designed (± {_RANGE_SIGMAS:g} σ)",
    "left-after": "the same, as diagnosed",
}
_NOTE = (
    "These captures were made by the simulation that then predicts them, with a camera's noise: nothing is left "
    "over. Of a bench of glass more is; `holoview diagnose CAPTURES.h5` does the same with what was measured there."
)


class _ModelVsCapture(Study):
    name = "model-vs-capture"
    title = "Prediction against captures, before and after diagnosis"
    summary = (
        "Virtual benches with one or two known errors and a noisy camera: how well the bench as designed and the "
        "bench as diagnosed predict captures that no fit has used, as PSNR and χ²/n (1: nothing but noise)."
    )
    quick_note = "Quick: 64 x 48 pixels; real benches have more errors at a time than these."

    def describe_size(self, scale: StudyScale) -> str:
        """24 captures of each bench."""
        captures = _CAPTURES_PER_SETTING * len(_WAVELENGTHS_M) * len(_PLANES_M)
        return ", ".join((*format_size(scale.shape, scale.seeds), f"{captures} captures of each bench"))

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        return [
            self.make_job(
                f"{bench}, seed {number}",
                {"shape": list(scale.shape), "bench": bench, "effects": effects, "seed": number},
            )
            for bench, effects in BENCHES.items()
            for number in range(seed, seed + scale.seeds)
        ]

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        lasers = {"wavelengths": list(_WAVELENGTHS_M), "amplitudes": [[1.0] * len(_WAVELENGTHS_M)], "observer": "mono"}
        system = preset.load("holochrome-8").with_(shape=settings["shape"]).edit(lasers)
        acquisition = AcquisitionSettings(
            captures_per_condition=_CAPTURES_PER_SETTING, seed=settings["seed"], planes_m=_PLANES_M
        )
        captures = make_captures(system, settings["effects"], acquisition)
        diagnosis = diagnose(captures, workers=1, progress=lambda done, total, what: status(what), free_maps=False)
        numbers = {
            "chi2_before": diagnosis.before.chi2_per_pixel,
            "chi2_after": diagnosis.after.chi2_per_pixel,
            "psnr_db_before": diagnosis.before.psnr_db,
            "psnr_db_after": diagnosis.after.psnr_db,
            "verdict": str(diagnosis.verdict),
            "named": " ".join(cause.sentence for cause in diagnosis.causes),
        }
        return JobResult(numbers, _pictures(diagnosis))

    def analyse(self, results: Results) -> Findings:
        keys = {"as designed": "psnr_db_before", "as diagnosed": "psnr_db_after"}
        heights = {name: [mean_number(results, key, bench=bench) for bench in BENCHES] for name, key in keys.items()}
        first = [next(pair for pair in results if pair[0].settings["bench"] == bench) for bench in BENCHES]
        caption = "PSNR of predicted captures that were held out; noise alone allows what the faultless bench reaches"
        return Findings(
            rows=[table_row(job, result, ("bench", "seed")) for job, result in results],
            claims=[
                Claim(f"bench: {job.settings['bench']}", "", _format_outcome(outcome), SHOWN) for job, outcome in first
            ],
            plots=[StudyFigure("psnr", caption, bar_chart(list(BENCHES), heights, "PSNR (dB)"))],
            pictures=[
                StudyPicture(f"{name}-{number}", f"{job.settings['bench']}: {words}", outcome.pictures[name])
                for number, (job, outcome) in enumerate(first)
                for name, words in _CAPTIONS.items()
                if name in outcome.pictures and job.settings["effects"]
            ],
            notes=[_NOTE],
        )


def _pictures(diagnosis: Diagnosis) -> dict[str, NDArray[np.uint8]]:
    """The first held-out capture, and its residuals before and after the diagnosis in units of the noise."""
    if not diagnosis.samples:
        return {}
    sample = diagnosis.samples[0]
    bright = float(np.quantile(sample.light, _WHITE_QUANTILE))
    before, after = (residual / (2 * _RANGE_SIGMAS) + 0.5 for residual in sample.residual)
    light = np.sqrt(np.clip(sample.light / max(bright, 1e-9), 0, 1))
    pictures = {"light": light, "left-before": before, "left-after": after}
    return {name: greyscale_pixels(values) for name, values in pictures.items()}


def _format_outcome(outcome: JobResult) -> str:
    n = outcome.numbers
    named = n["named"] or "nothing named"
    return (
        f"χ²/n {n['chi2_before']:.3g} → {n['chi2_after']:.3g}, "
        f"{n['psnr_db_before']:.1f} → {n['psnr_db_after']:.1f} dB; {n['verdict']}: {named}"
    )


STUDIES = (_ModelVsCapture(),)
