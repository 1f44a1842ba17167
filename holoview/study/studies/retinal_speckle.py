"""Speckle contrast of the retinal image against the pupil, for several numbers of wavelengths and frames."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from holoview.metrics.speckle import CONE_ARCMIN, independent_patterns, seen_by_cones, speckle_contrast
from holoview.study.claims import DIRECTION_ONLY, REPRODUCES, SHOWN
from holoview.study.hologram_jobs import job_system, mean_number, table_row
from holoview.study.plots import line_plot
from holoview.study.scale import StudyScale, format_size, speckle_shape
from holoview.study.study import Claim, Findings, JobResult, Results, StatusCallback, Study, StudyFigure, StudyJob
from holoview.view import random_drive, simulate

_PUPILS_MM = (1.0, 2.0, 3.0, 4.0, 6.0)
_SEEDS = 3
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
        "Random patterns through two modulators, seen by an eye behind a 40 mm eyepiece: speckle contrast of the "
        "retinal intensity at every sample, and of its means over foveal cones, which see only grains that are larger "
        "than they are. Grains are about λ/pupil wide, so that a small pupil makes coarse speckle and a large one fine."
    )
    options = ("pupils",)
    quick_note = "Nothing is optimised; all lasers have the same power."

    def describe_size(self, scale: StudyScale) -> str:
        """Random patterns; nothing is optimised."""
        return ", ".join(format_size(speckle_shape(scale), _SEEDS))

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        return [
            self.make_job(
                f"{case}, pupil {pupil_mm:g} mm, seed {number}",
                {"shape": list(speckle_shape(scale)), "case": case, "pupil_mm": pupil_mm, "seed": number},
            )
            for case in _CASES
            for pupil_mm in [round(1e3 * d, 6) for d in scale.pupils_m] or _PUPILS_MM
            for number in range(seed, seed + _SEEDS)
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
            claims=_claims(results),
            plots=plots,
        )


def _pupils_mm(results: Results) -> list[float]:
    """The diameters of all results, rising."""
    return sorted({job.settings["pupil_mm"] for job, _ in results})


def _curve(results: Results, key: str, case: str) -> list[float]:
    return [mean_number(results, key, case=case, pupil_mm=pupil_mm) for pupil_mm in _pupils_mm(results)]


def _claims(results: Results) -> list[Claim]:
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


STUDY = _RetinalSpeckle()
