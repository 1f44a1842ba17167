"""Speckle contrast of random patterns against the number of wavelengths and of frames."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.colour import to_srgb8
from holoview.metrics.speckle import independent_patterns, speckle_contrast
from holoview.study.claims import DIRECTION_ONLY, REPRODUCES, SHOWN
from holoview.study.hologram_jobs import has_settings, job_system, mean_number, table_row
from holoview.study.plots import line_plot
from holoview.study.scale import StudyScale, format_size, speckle_shape
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
from holoview.view import random_drive, simulate

_COUNTS = (1, 2, 4, 8, 16, 32)
_SEEDS = 4
_PICTURE_MEAN = 0.3  # linear light
_AVERAGED_OVER = {
    "frames": "frames of independent patterns, one laser",
    "wavelengths": "wavelengths 440 to 660 nm, two modulators",
    "wavelengths, 1 modulator": "wavelengths 440 to 660 nm, one modulator",
}


class _Contrast(Study):
    name = "contrast"
    title = "Speckle contrast against the number of wavelengths and frames"
    summary = (
        "Random patterns make fully developed speckle of contrast 1, and N independent ones average to 1/√N. Frames "
        "are independent; wavelengths through the same pattern only where they are far apart (see memory-effect)."
    )
    revision = 2
    quick_note = "Contrast is taken of intensity (all lasers alike) over the whole field."

    def describe_size(self, scale: StudyScale) -> str:
        """Random patterns; nothing is optimised."""
        return ", ".join(format_size(speckle_shape(scale), _SEEDS))

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        return [
            self.make_job(
                f"{count} {way}, seed {number}",
                {"shape": list(speckle_shape(scale)), "way": way, "count": count, "seed": number},
            )
            for way in _AVERAGED_OVER
            for count in _COUNTS
            for number in range(seed, seed + _SEEDS)
        ]

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        system = job_system({**settings, "planes": 1, "scheme": "simultaneous", "set": _changes(settings)})
        if settings["way"].endswith("1 modulator"):
            system = system.edit({"modulators": system.modulators[:1], "gap": None})
        view = simulate(system, random_drive(system, settings["seed"]), backend="torch")
        image = view.intensity[0].mean(axis=0)
        contrast = speckle_contrast(image).contrast
        picture = to_srgb8(np.repeat((_PICTURE_MEAN * image / image.mean())[..., None], 3, axis=-1))
        return JobResult({"contrast": contrast, "patterns": independent_patterns(contrast)}, {"speckle": picture})

    def analyse(self, results: Results) -> Findings:
        curves = {
            way: [mean_number(results, "contrast", way=way, count=count) for count in _COUNTS] for way in _AVERAGED_OVER
        }
        law = 1 / np.sqrt(_COUNTS)
        draw = line_plot(
            {**{_AVERAGED_OVER[way]: (_COUNTS, curve) for way, curve in curves.items()}, "1/√N": (_COUNTS, law)},
            "N",
            "speckle contrast",
            dashed=("1/√N",),
            logarithmic=True,
        )
        return Findings(
            rows=[table_row(job, result, ("way", "count", "seed")) for job, result in results],
            claims=_claims(curves, law),
            plots=[StudyFigure("contrast", f"Mean over {_SEEDS} random patterns", draw)],
            pictures=_pictures(results),
        )


def _claims(curves: Mapping[str, list[float]], law: NDArray[np.float64]) -> list[Claim]:
    departure = float(np.max(np.abs(np.array(curves["frames"]) / law - 1)))
    verdict = REPRODUCES if departure < 0.05 else DIRECTION_ONLY
    claims = [Claim("N frames have contrast 1/√N", "1/√N", f"within {departure:.1%}", verdict)]
    for way, curve in curves.items():
        contrast = curve[_COUNTS.index(8)]
        measured = f"{contrast:.3f}: as {independent_patterns(contrast):.1f} independent patterns"
        claims.append(Claim(f"8 {_AVERAGED_OVER[way]}", "", measured, SHOWN))
    return claims


def _pictures(results: Results) -> list[StudyPicture]:
    """Speckle of 1, 8 and 32 wavelengths for the first seed."""
    first_seed = results[0][0].settings["seed"]
    return [
        StudyPicture(
            f"speckle-{count}",
            f"{count} wavelength{'s' * (count > 1)}: contrast {result.numbers['contrast']:.2f}",
            result.pictures["speckle"],
        )
        for job, result in results
        if has_settings(job, way="wavelengths", seed=first_seed) and (count := job.settings["count"]) in (1, 8, 32)
    ]


def _changes(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Changes of the bench to `count` frames of one laser, or to `count` lasers in one frame."""
    count = settings["count"]
    if settings["way"] == "frames":
        return {"wavelengths": [550e-9], "amplitudes": [[1.0]] * count, "observer": "mono"}
    wavelengths = np.linspace(440e-9, 660e-9, count) if count > 1 else np.array([550e-9])
    return {"wavelengths": wavelengths.tolist(), "amplitudes": [[1.0] * count], "observer": "mono"}


STUDY = _Contrast()
