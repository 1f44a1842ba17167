"""Contrast ratio against the number of wavelengths, with one and two modulators, at a matched eyebox.

Sequential contrast is the light of a white picture over that of a black one of the same lasers, checkerboard contrast
that of the white fields over that of the black ones of one picture. A monochrome camera sees all lasers alike, so that
one laser makes white as well as many.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.evidence.study.charts import line_plot
from holoview.evidence.study.hologram_study import QUICK_SIZE, SHOWN, has_settings, job_system, optimise_job, table_row
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
from holoview.holograms.hologram import Hologram
from holoview.holograms.metrics.image_quality import central_region, eyebox_uniformity_of
from holoview.holograms.metrics.sharpness import checkerboard, checkerboard_contrast, contrast_ratio
from holoview.holograms.metrics.speckle import speckle_contrast
from holoview.holograms.view import View, simulate
from holoview.light.colour import to_srgb8
from holoview.light.model.system import System
from holoview.light.numerics.sampling import region_slices

_COUNTS = (1, 2, 4, 8, 16)
_MODULATORS = {"two modulators": "", "one modulator": "+1slm"}
_SEEDS = 2  # at least
_WHITE = 0.5  # linear light of a white picture: bright enough to need most lasers, with room for the checkerboard
_BLACK = 1e-6  # of white: the optimiser takes no target without light
_EYEBOX = 0.1  # weight of its penalty, at which the eyeboxes of one and two modulators are about as even
_QUANTITIES = {
    "sequential": "white picture over black picture",
    "checkerboard": "white fields over black fields",
}


class _ContrastRatio(Study):
    name = "contrast-ratio"
    title = "Contrast ratio against the number of wavelengths"
    summary = (
        "How black is black? Light of a white picture over that of a black one (sequential), and of white fields over "
        "black fields of one picture (checkerboard), with one and two modulators at a matched eyebox. The paper leaves "
        "open how the black level falls with more wavelengths."
    )
    quick_note = f"{QUICK_SIZE}; the black level still falls with more iterations."

    def describe_size(self, scale: StudyScale) -> str:
        """Even pictures and a checkerboard in place of targets."""
        return replace(scale, targets=("",), seeds=max(scale.seeds, _SEEDS)).description

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        shared = {**scale.job_settings, "eyebox": scale.eyebox or _EYEBOX, "set": {"observer": "mono"}}
        return [
            self.make_job(
                f"{count} wavelengths, {name}, seed {number}",
                {**shared, "count": count, "modulators": name, "scheme": f"holochrome-{count}{part}", "seed": number},
            )
            for count in _COUNTS
            for name, part in _MODULATORS.items()
            for number in range(seed, seed + max(scale.seeds, _SEEDS))
        ]

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        """A white picture with free laser powers; a black one and a checkerboard with the powers of the white one."""
        system = job_system(settings)
        white = _optimised(system, _grey(system, 1.0), settings, status)
        kept = {**settings, "options": {"free": ["patterns"]}}
        black = _optimised(white.system, _grey(system, _BLACK), kept, status)
        board = _optimised(white.system, _grey(system, 1.0) * _board(system)[None, :, :, None], kept, status)
        views = [_middle(hologram) for hologram in (white, black, board)]
        centre = region_slices(central_region(views[0].xyz.shape[1:3]))
        lit, dark, fields = (view.xyz[0, ..., 1] for view in views)
        return JobResult(
            {
                "sequential": contrast_ratio(lit[centre], dark[centre]),
                "checkerboard": checkerboard_contrast(fields),
                "speckle_contrast": speckle_contrast(lit[centre]).contrast,
                "white": float(lit[centre].mean()),
                "eyebox_white": eyebox_uniformity_of(white).coefficient_of_variation,
                "eyebox_checkerboard": eyebox_uniformity_of(board).coefficient_of_variation,
            },
            {"checkerboard": to_srgb8(views[2].rgb[0])},
        )

    def analyse(self, results: Results) -> Findings:
        curves = {
            f"{quantity}, {name}": (_COUNTS, [float(_values(results, quantity, name, n).mean()) for n in _COUNTS])
            for quantity in _QUANTITIES
            for name in _MODULATORS
        }
        draw = line_plot(curves, "number of wavelengths", "contrast ratio")
        return Findings(
            rows=[table_row(job, result, ("count", "modulators", "seed")) for job, result in results],
            claims=[
                Claim(f"{name}, {words}", "", _in_words(results, quantity, name), SHOWN)
                for quantity, words in _QUANTITIES.items()
                for name in _MODULATORS
            ],
            plots=[StudyFigure("contrast-ratio", "Mean over seeds", draw)],
            pictures=_pictures(results),
            notes=[_eyebox_note(results)],
        )


def _grey(system: System, share: float) -> NDArray[np.float64]:
    """A focal stack (plane, y, x, 3) of even light, a share of white."""
    rows, columns = (n * system.sampling.upsample for n in system.modulators[0].shape)
    return np.full((len(system.planes_m), rows, columns, 3), _WHITE * share)


def _board(system: System) -> NDArray[np.float64]:
    rows, columns = (n * system.sampling.upsample for n in system.modulators[0].shape)
    return checkerboard((rows, columns))


def _optimised(
    system: System, stack: NDArray[np.float64], settings: Mapping[str, Any], status: StatusCallback
) -> Hologram:
    return optimise_job(system, stack, settings, status).best


def _middle(hologram: Hologram) -> View:
    """The view of the middle plane."""
    planes_m = hologram.system.planes_m
    return simulate(hologram.system, hologram.drive, planes_m[len(planes_m) // 2 :][:1], backend="torch")


def _values(results: Results, key: str, modulators: str, count: int) -> NDArray[np.float64]:
    found = [r.numbers[key] for job, r in results if has_settings(job, modulators=modulators, count=count)]
    return np.array(found)


def _in_words(results: Results, quantity: str, modulators: str) -> str:
    parts = []
    for count in _COUNTS:
        values = _values(results, quantity, modulators, count)
        parts.append(f"{count}: {values.mean():.3g} ± {values.std(ddof=1) if len(values) > 1 else 0:.2g}")
    return ", ".join(parts)


def _eyebox_note(results: Results) -> str:
    parts = []
    for name in _MODULATORS:
        values = [_values(results, "eyebox_white", name, count).mean() for count in _COUNTS]
        parts.append(f"{name} {min(values):.2f} to {max(values):.2f}")
    return f"Variation of the eyebox of the white pictures: {'; '.join(parts)}. ± is the deviation between seeds."


def _pictures(results: Results) -> list[StudyPicture]:
    """The checkerboards of the first seed, for few and many wavelengths."""
    first = results[0][0].settings["seed"]
    return [
        StudyPicture(
            f"checkerboard-{count}-{name.split()[0]}",
            f"{count} wavelength{'s' * (count > 1)}, {name}: {result.numbers['checkerboard']:.3g} : 1",
            result.pictures["checkerboard"],
        )
        for count in (_COUNTS[0], 8)
        for name in _MODULATORS
        for job, result in results
        if has_settings(job, seed=first, count=count, modulators=name)
    ]


STUDIES = (_ContrastRatio(),)
