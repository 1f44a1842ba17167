"""Contrast ratio against the number of wavelengths, with one and two modulators, at a matched eyebox.

Sequential contrast is the light of a white picture over that of a black one of the same lasers, checkerboard contrast
that of the white fields over that of the black ones of one picture. In scenes it is the light of the brightest
twentieth of the samples over that of the darkest. A monochrome camera sees all lasers alike, so that one laser makes
white as well as many.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.evidence.study.charts import line_plot
from holoview.evidence.study.hologram_study import (
    QUICK_SIZE,
    SHOWN,
    has_settings,
    job_system,
    job_target,
    optimise_job,
    table_row,
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
from holoview.holograms.hologram import Hologram
from holoview.holograms.metrics.image_quality import central_region, eyebox_uniformity_of
from holoview.holograms.metrics.sharpness import checkerboard, checkerboard_contrast, contrast_ratio
from holoview.holograms.metrics.speckle import speckle_contrast
from holoview.holograms.view import View, simulate
from holoview.light.colour import SRGB_TO_XYZ, to_srgb8
from holoview.light.model.system import System
from holoview.light.numerics.sampling import region_slices

_COUNTS = (1, 2, 4, 8, 16)
_MODULATORS = {"two modulators": "", "one modulator": "+1slm"}
_SEEDS = 2  # at least
_SCENES = ("night", "coffee", "resolution")  # the pictures with black parts
_TWENTIETH = 0.05  # of a scene's samples
_WHITE = 0.5  # linear light of a white picture: bright enough to need most lasers, with room for the checkerboard
_BLACK = 1e-6  # of white: the optimiser takes no target without light
_EYEBOX = 0.1  # weight of its penalty, at which the eyeboxes of one and two modulators are about as even
_QUANTITIES = {
    "sequential": "white picture over black picture",
    "checkerboard": "white fields over black fields",
    "scenes": "the brightest over the darkest twentieth of scenes",
}


class _ContrastRatio(Study):
    name = "contrast-ratio"
    title = "Contrast ratio against the number of wavelengths"
    summary = (
        "How black is black? Light of a white picture over that of a black one (sequential), of white fields over black "
        "fields of one picture (checkerboard), and of the brightest over the darkest twentieth of three scenes, with one "
        "and two modulators at a matched eyebox. The paper leaves open how the black level falls with more wavelengths."
    )
    quick_note = f"{QUICK_SIZE}; the black level still falls with more iterations."
    revision = 2

    def describe_size(self, scale: StudyScale) -> str:
        """Even pictures, a checkerboard and its own scenes in place of targets."""
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
        """A white picture with free laser powers; with the powers of it a black one, a checkerboard and scenes.

        "scenes" is the geometric mean of those of `_SCENES`.
        """
        system = job_system(settings)
        white = _optimised(system, _grey(system, 1.0), settings, status)
        kept = {**settings, "options": {"free": ["patterns"]}}
        black = _optimised(white.system, _grey(system, _BLACK), kept, status)
        board = _optimised(white.system, _grey(system, 1.0) * _board(system)[None, :, :, None], kept, status)
        views = [_middle(hologram) for hologram in (white, black, board)]
        centre = region_slices(central_region(views[0].xyz.shape[1:3]))
        lit, dark, fields = (view.xyz[0, ..., 1] for view in views)
        scenes = {f"scene_{name}": _scene_contrast(white.system, name, kept, status) for name in _SCENES}
        return JobResult(
            {
                "sequential": contrast_ratio(lit[centre], dark[centre]),
                "checkerboard": checkerboard_contrast(fields),
                "scenes": float(np.exp(np.mean(np.log(list(scenes.values()))))),
                **scenes,
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
            notes=[_eyebox_note(results), *(_scene_note(results, name) for name in _MODULATORS)],
        )


def _grey(system: System, share: float) -> NDArray[np.float64]:
    """A focal stack (plane, y, x, 3) of even light, a share of white."""
    rows, columns = (n * system.sampling.upsample for n in system.modulators[0].shape)
    return np.full((len(system.planes_m), rows, columns, 3), _WHITE * share)


def _board(system: System) -> NDArray[np.float64]:
    rows, columns = (n * system.sampling.upsample for n in system.modulators[0].shape)
    return checkerboard((rows, columns))


def _scene_contrast(system: System, scene: str, settings: Mapping[str, Any], status: StatusCallback) -> float:
    """Brightest over darkest twentieth of a scene in grey, no brighter than the white picture, in the middle plane."""
    planes_m = np.asarray(system.planes_m)
    luminance = job_target(system, {**settings, "target": scene}, planes_m) @ SRGB_TO_XYZ[1]
    grey = _WHITE / luminance.max() * luminance
    found = _middle(_optimised(system, np.repeat(grey[..., None], 3, axis=-1), settings, status)).xyz[0, ..., 1]
    wanted = grey[len(planes_m) // 2]
    low, high = np.quantile(wanted, (_TWENTIETH, 1 - _TWENTIETH))
    return contrast_ratio(found[wanted >= high], found[wanted <= low])


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


def _scene_note(results: Results, modulators: str) -> str:
    """The mean over wavelengths and seeds of each scene, and how far scenes are apart."""
    parts = []
    for count in _COUNTS:
        means = np.array([_values(results, f"scene_{scene}", modulators, count).mean() for scene in _SCENES])
        words = ", ".join(f"{scene} {mean:.3g}" for scene, mean in zip(_SCENES, means, strict=True))
        parts.append(f"{count}: {words} (deviation between scenes {means.std(ddof=1):.2g})")
    return f"Brightest over darkest twentieth of scenes by the number of wavelengths, {modulators}: {'; '.join(parts)}."


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
