"""What an eye sees whose pupil isn't where the hologram expects it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from holoview.metrics.image_quality import measure_image_quality
from holoview.model.system import System
from holoview.numerics.fft_grid import positions
from holoview.study.claims import SHOWN
from holoview.study.hologram_jobs import has_settings, job_system, job_target, mean_curve, optimise_job
from holoview.study.hologram_study import aimed_jobs
from holoview.study.perceptual_columns import (
    notes_on_scores,
    score_axis,
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

_KINDS = {
    "planes": "focal planes",
    "even": "focal planes, even eyebox",
    "one place": "a pupil on the axis",
    "places": "3 x 3 places of the pupil",
}
_PUPIL_MM = 2.0
_SPACING_M = 0.6e-3
_PLACES_MM = (0.0, 0.3, 0.6, 0.9, 1.2)  # of the pupil, along x; at 1.15 mm its middle is at the edge of blue's eyebox
_EYEBOX = 0.03
_KEYS = ("psnr_db", "luminance", "speckle_contrast")


class _Pupil(Study):
    name = "pupil"
    title = "A pupil beside the axis"
    summary = (
        "A hologram of 8 wavelengths seen through a pupil of 2 mm that moves through the eyebox, by an eye with "
        "chromatic aberration that moves as a whole: PSNR against the scene as it is seen from there, brightness and "
        "speckle, for holograms that were optimised for focal planes, with an even eyebox, for one place of the pupil, "
        "and for nine. Places between those that were optimised show whether it holds there too."
    )
    quick_note = "Quick: 128 x 96 samples, 3 planes and 40 iterations."
    options = ("scores",)
    revision = 2

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        return aimed_jobs(self, ("holochrome-8",), scale, seed, _KINDS, **score_settings(scale))

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        system, kind = job_system(settings), settings["optimised_for"]
        aimed = _seen_from(system, 0.0) if kind in ("one place", "places") else system
        options = {**settings, **({"eyebox": _EYEBOX} if kind == "even" else {})}
        stacks = [job_target(aimed, settings, aimed.planes_m)]
        if kind == "places":
            steps = positions(3, _SPACING_M).tolist()
            places = [(y, x) for y in steps for x in steps]
            stacks = [job_target(_seen_from(system, x, y), settings, system.planes_m) for y, x in places]
            options["options"] = {"pupil_places_m": places}
        state = optimise_job(aimed, np.concatenate(stacks), options, status)
        numbers: dict[str, Any] = {"place_mm": list(_PLACES_MM), **{key: [] for key in (*_KEYS, *settings["scores"])}}
        pictures = {}
        for x_mm in _PLACES_MM:
            status(f"scoring, pupil at {x_mm:g} mm")
            seen_by = _seen_from(state.best.system, x_mm * 1e-3)
            view = simulate(seen_by, state.best.drive, backend="torch")
            target = job_target(seen_by, settings, seen_by.planes_m)
            quality = measure_image_quality(view, target)
            figures = (quality.psnr.mean_db, float(view.xyz[..., 1].mean()), quality.mean_speckle_contrast)
            found = dict(zip(_KEYS, figures, strict=True)) | score_numbers(view, target, settings)
            for key, figure in found.items():
                numbers[key].append(figure)
            pictures[f"{x_mm:g} mm"] = view.srgb8[len(view.srgb8) // 2]
        return JobResult(numbers, pictures)

    def analyse(self, results: Results) -> Findings:
        figures, scores = [], score_names(results)
        axes = dict(zip(_KEYS, ("PSNR (dB)", "mean luminance", "speckle contrast σ/μ"), strict=True))
        for key, axis in (axes | {name: score_axis(name) for name in scores}).items():
            curves = {what: (_PLACES_MM, mean_curve(results, key, optimised_for=kind)) for kind, what in _KINDS.items()}
            caption = f"Seen through a pupil of {_PUPIL_MM:g} mm, optimised for …"
            figures.append(StudyFigure(key, caption, line_plot(curves, "place of the pupil (mm)", axis)))
        rows = [
            {key: job.settings[key] for key in ("optimised_for", "target", "seed")}
            | {"place_mm": place, **{key: result.numbers[key][i] for key in (*_KEYS, *scores)}}
            for job, result in results
            for i, place in enumerate(_PLACES_MM)
        ]
        notes = notes_on_scores(results)
        return Findings(rows=rows, claims=_claims(results), plots=figures, pictures=_pictures(results), notes=notes)


def _seen_from(system: System, x_m: float, y_m: float = 0.0) -> System:
    eye = {"pupil": _PUPIL_MM * 1e-3, "pupil_y": y_m, "pupil_x": x_m, "chromatic_axis": "pupil"}
    return system.with_(eye=eye)


def _claims(results: Results) -> list[Claim]:
    claims = []
    for kind, what in _KINDS.items():
        psnr, luminance = (mean_curve(results, key, optimised_for=kind) for key in _KEYS[:2])
        edge = f"brightness at {_PLACES_MM[-1]:g} mm {luminance[-1] / luminance[0]:.0%}"
        text = (
            f"{psnr[0]:.1f} dB on the axis, {psnr[1]:.1f} at {_PLACES_MM[1]:g} mm, "
            f"{psnr[2]:.1f} at {_PLACES_MM[2]:g} mm; {edge}"
        )
        claims.append(Claim(f"optimised for {what}", "", text, SHOWN))
    return claims


def _pictures(results: Results) -> list[StudyPicture]:
    """What each pupil position sees at the middle plane, for the first target and seed."""
    first = {key: results[0][0].settings[key] for key in ("target", "seed")}
    return [
        StudyPicture(
            f"{job.settings['optimised_for'].replace(' ', '-')}-{i}",
            f"{_KINDS[job.settings['optimised_for']]}, pupil at {place}",
            pixels,
        )
        for job, result in results
        if has_settings(job, **first)
        for i, (place, pixels) in enumerate(result.pictures.items())
    ]


STUDY = _Pupil()
