"""Holograms seen by an eye whose pupil has another place or diameter than they were optimised for.

Also the uniformity of the light in the eyebox against the number of wavelengths and frames.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.evidence.study.charts import line_plot
from holoview.evidence.study.hologram_study import (
    QUICK_SIZE,
    SHOWN,
    HologramStudy,
    aimed_jobs,
    first_results,
    job_system,
    job_target,
    mean_curve,
    mean_number,
    notes_on_scores,
    optimise_job,
    result_table,
    scheme_jobs,
    score_axis,
    score_names,
    score_numbers,
    score_settings,
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
from holoview.holograms.view import View, simulate
from holoview.light.colour import SRGB_TO_XYZ
from holoview.light.model.system import System
from holoview.light.numerics.sampling import positions

_KINDS = {
    "planes": "focal planes",
    "even": "focal planes, even eyebox",
    "one place": "a pupil on the axis",
    "places": "3 x 3 places of the pupil",
}
_PUPIL_MM = 2.0  # of holograms that are optimised for a pupil, and of the pupil beside the axis
_SPACING_M = 0.6e-3
_PLACES_MM = (0.0, 0.3, 0.6, 0.9, 1.2)  # of the pupil, along x; at 1.15 mm its middle is at the edge of blue's eyebox
_PUPILS_MM = (1.0, 2.0, 3.0, 4.0, 6.0)  # on the axis
_EYEBOX = 0.03
_AXES = {
    "psnr_db": "PSNR (dB)",
    "matched_psnr_db": "PSNR at the target's brightness (dB)",
    "brightness": "luminance / that of the target",
    "speckle_contrast": "speckle contrast σ/μ",
}

_Look = tuple[float, float]
"""The place of a pupil along x and its diameter, in mm."""


class _Pupil(Study):
    name = "pupil"
    title = "A pupil beside the axis, small and large"
    summary = (
        "A hologram of 8 wavelengths seen by an eye that moves as a whole, through a pupil of 2 mm in the eyebox and "
        "through pupils of 1 to 6 mm on the axis, for holograms optimised for focal planes, with an even eyebox, for "
        "one place of the pupil, and for nine."
    )
    quick_note = f"{QUICK_SIZE}."
    options = ("pupils", "scores")
    revision = 4

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        pupils = {"pupils_mm": [round(1e3 * d, 6) for d in scale.pupils_m] or list(_PUPILS_MM)}
        return aimed_jobs(self, ("holochrome-8",), scale, seed, _KINDS, **score_settings(scale), **pupils)

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        state, looks = _optimised(settings, status), _looks(settings)
        numbers: dict[str, Any] = {"place_mm": [x for x, _ in looks], "pupil_mm": [d for _, d in looks]}
        numbers |= {key: [] for key in (*_AXES, *settings["scores"])}
        pictures = {}
        for look in looks:
            status(f"scoring, {_named(look)}")
            seen_by = _seen_from(state.best.system, look)
            view = simulate(seen_by, state.best.drive, backend="torch")
            target = job_target(seen_by, settings, seen_by.planes_m)
            for key, figure in (_measured(view, target) | score_numbers(view, target, settings)).items():
                numbers[key].append(figure)
            pictures[_named(look)] = view.srgb8[len(view.srgb8) // 2]
        return JobResult(numbers, pictures)

    def analyse(self, results: Results) -> Findings:
        return Findings(
            rows=_rows(results),
            claims=[*_place_claims(results), *_size_claims(results)],
            plots=_plots(results),
            pictures=_pictures(results),
            notes=notes_on_scores(results),
        )


def _looks(settings: Mapping[str, Any]) -> list[_Look]:
    """All pupils that look at a hologram, each once: one size beside the axis, and the other sizes on it."""
    sizes = [(0.0, pupil_mm) for pupil_mm in settings["pupils_mm"]]
    return list(dict.fromkeys([*((x_mm, _PUPIL_MM) for x_mm in _PLACES_MM), *sizes]))


def _named(look: _Look) -> str:
    return f"pupil of {look[1]:g} mm at {look[0]:g} mm"


def _seen_from(system: System, look: _Look, y_mm: float = 0.0) -> System:
    x_m, diameter_m, y_m = 1e-3 * look[0], 1e-3 * look[1], 1e-3 * y_mm
    return system.with_(eye={"pupil": diameter_m, "pupil_y": y_m, "pupil_x": x_m, "chromatic_axis": "pupil"})


def _optimised(settings: Mapping[str, Any], status: StatusCallback) -> IterationState:
    """A hologram for what a job's settings say that it is optimised for."""
    system, kind = job_system(settings), settings["optimised_for"]
    aimed = _seen_from(system, (0.0, _PUPIL_MM)) if kind in ("one place", "places") else system
    options = {**settings, **({"eyebox": _EYEBOX} if kind == "even" else {})}
    stacks = [job_target(aimed, settings, aimed.planes_m)]
    if kind == "places":
        steps = positions(3, _SPACING_M).tolist()
        places = [(y, x) for y in steps for x in steps]
        eyes = [_seen_from(system, (1e3 * x, _PUPIL_MM), 1e3 * y) for y, x in places]
        stacks = [job_target(eye, settings, system.planes_m) for eye in eyes]
        options["options"] = {"pupil_places_m": places}
    return optimise_job(aimed, np.concatenate(stacks), options, status)


def _measured(view: View, target: NDArray[np.floating]) -> dict[str, float]:
    """The columns of the table for a view: fidelity as it is and as bright as the target, light, speckle; no scores."""
    quality = measure_image_quality(view, target)
    brightness = float(view.xyz[..., 1].mean() / (np.asarray(target) @ SRGB_TO_XYZ.T)[..., 1].mean())
    matched = psnr_linear_srgb(view.rgb / brightness, target)
    figures = (quality.psnr.mean_db, matched.mean_db, brightness, quality.mean_speckle_contrast)
    return dict(zip(_AXES, figures, strict=True))


def _curve(results: Results, key: str, kind: str, *, sizes: bool = False) -> tuple[list[float], NDArray[np.float64]]:
    """Places of the pupil of 2 mm, or diameters on the axis (mm), rising, and the mean of a number there."""
    looks, values = _looks(results[0][0].settings), mean_curve(results, key, optimised_for=kind)
    chosen = sorted(
        (look[sizes], i) for i, look in enumerate(looks) if (look[0] == 0.0 if sizes else look[1] == _PUPIL_MM)
    )
    return [at for at, _ in chosen], values[[i for _, i in chosen]]


def _rows(results: Results) -> list[dict[str, Any]]:
    """A row for each hologram and pupil."""
    keys = ("place_mm", "pupil_mm", *_AXES, *score_names(results))
    return [
        {key: job.settings[key] for key in ("optimised_for", "target", "seed")}
        | {key: result.numbers[key][i] for key in keys}
        for job, result in results
        for i in range(len(result.numbers["place_mm"]))
    ]


def _plots(results: Results) -> list[StudyFigure]:
    """Each number against the place of the pupil, then each against its diameter."""
    axes = _AXES | {name: score_axis(name) for name in score_names(results)}
    plots = []
    for sizes, name, caption, along in (
        (False, "{}", f"Seen through a pupil of {_PUPIL_MM:g} mm, optimised for …", "place of the pupil (mm)"),
        (True, "{}-by-size", "Seen through pupils on the axis, optimised for …", "diameter of the pupil (mm)"),
    ):
        for key, axis in axes.items():
            curves = {what: _curve(results, key, kind, sizes=sizes) for kind, what in _KINDS.items()}
            plots.append(StudyFigure(name.format(key), caption, line_plot(curves, along, axis)))
    return plots


def _place_claims(results: Results) -> list[Claim]:
    claims = []
    for kind, what in _KINDS.items():
        (places_mm, psnr), (_, brightness) = (_curve(results, key, kind) for key in ("psnr_db", "brightness"))
        text = (
            f"{psnr[0]:.1f} dB on the axis, {psnr[1]:.1f} at {places_mm[1]:g} mm, {psnr[2]:.1f} at "
            f"{places_mm[2]:g} mm; {brightness[-1] / brightness[0]:.0%} of the light at {places_mm[-1]:g} mm"
        )
        claims.append(Claim(f"optimised for {what}, seen from beside the axis", "", text, SHOWN))
    return claims


def _size_claims(results: Results) -> list[Claim]:
    claims = []
    for kind, what in _KINDS.items():
        pupils_mm, psnr = _curve(results, "psnr_db", kind, sizes=True)
        contrast = _curve(results, "speckle_contrast", kind, sizes=True)[1]
        text = ", ".join(f"{db:.1f} dB at {d:g} mm" for d, db in zip(pupils_mm, psnr, strict=True))
        text += f"; speckle contrast {contrast[0]:.2f} to {contrast[-1]:.2f}"
        claims.append(Claim(f"optimised for {what}, pupils on the axis", "", text, SHOWN))
    return claims


def _pictures(results: Results) -> list[StudyPicture]:
    """The pictures that each pupil sees at the middle plane, for the first target and seed."""
    return [
        StudyPicture(
            f"{job.settings['optimised_for'].replace(' ', '-')}-{i}",
            f"{_KINDS[job.settings['optimised_for']]}, {name}",
            pixels,
        )
        for job, result in first_results(results)
        for i, (name, pixels) in enumerate(result.pictures.items())
    ]


# --- the eyebox -------------------------------------------------------------------------------------------------------


_COUNTS, _FRAMES = (2, 4, 8, 16), (1, 3)


class _Eyebox(HologramStudy):
    name = "eyebox"
    title = "The eyebox against the number of wavelengths and frames"
    summary = (
        "Uniformity of the light over the modulator's first order, by the number of wavelengths and of frames: how "
        "far the pupil may move."
    )

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        schemes = [_scheme(count, frames) for frames in _FRAMES for count in _COUNTS]
        return scheme_jobs(self, schemes, scale, seed)

    def analyse(self, results: Results) -> Findings:
        table = {
            frames: [mean_number(results, "eyebox_variation", scheme=_scheme(count, frames)) for count in _COUNTS]
            for frames in _FRAMES
        }
        curves = {f"{frames} frame{'s' if frames > 1 else ''}": (_COUNTS, table[frames]) for frames in _FRAMES}
        few, many = (table[frames][-1] for frames in _FRAMES)
        measured = ", ".join(f"{count} λ {value:.2f}" for count, value in zip(_COUNTS, table[1], strict=True))
        return Findings(
            rows=result_table(results),
            claims=[
                Claim("eyebox variation in one frame", "", measured, SHOWN),
                Claim("16 λ in 3 frames rather than one", "", f"{few:.2f} → {many:.2f}", SHOWN),
            ],
            plots=[
                StudyFigure(
                    "eyebox",
                    "Coefficient of variation of the eyebox's filling (block means); 0 is even",
                    line_plot(curves, "wavelengths", "variation of the eyebox's filling"),
                )
            ],
        )


def _scheme(count: int, frames: int) -> str:
    return f"holochrome-{count}x{frames}"


STUDIES = (_Pupil(), _Eyebox())
