"""Contrast ratio against the number of wavelengths, with one and two modulators, at a matched eyebox.

Sequential contrast is the light of a white picture over that of a black one of the same lasers, checkerboard contrast
that of the white fields over that of the black ones of one picture. In scenes it is the light of the brightest
twentieth of the samples over that of the darkest. A monochrome camera sees all lasers alike, so that one laser makes
white as well as many.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.evidence.study.charts import line_plot
from holoview.evidence.study.display_contrast import WHITE, DisplayContrast, display_contrast, middle_view
from holoview.evidence.study.hologram_study import (
    QUICK_SIZE,
    SHOWN,
    SPREAD_NOTE,
    Spread,
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
from holoview.holograms.metrics.image_quality import eyebox_uniformity_of
from holoview.holograms.metrics.sharpness import contrast_ratio
from holoview.holograms.metrics.speckle import speckle_contrast
from holoview.light.colour import SRGB_TO_XYZ, to_srgb8
from holoview.light.numerics.sampling import central_region, region_slices

_COUNTS = (1, 2, 4, 8, 16)
_MODULATORS = {"two modulators": "", "one modulator": "+1slm"}
_SEEDS = 2  # at least
_SCENES = ("night", "coffee", "resolution")  # the pictures with black parts
_TWENTIETH = 0.05  # of a scene's samples
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
        "How black is black? Light of a white picture over that of a black one (sequential), of white fields over "
        "black fields of one picture (checkerboard), and of the brightest over the darkest twentieth of three scenes, "
        "with one and two modulators at a matched eyebox. The paper leaves open how the black level falls with more "
        "wavelengths."
    )
    quick_note = f"{QUICK_SIZE}; the black level still falls with more iterations."
    revision = 2

    def describe_size(self, scale: StudyScale) -> str:
        """Even pictures, a checkerboard and its own scenes in place of targets."""
        return replace(scale, targets=scale.targets[:1], seeds=max(scale.seeds, _SEEDS)).description

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
        found = display_contrast(system, settings, status)
        scenes = {f"scene_{name}": _scene_contrast(found, name, status) for name in _SCENES}
        lit = found.white_view.xyz[0, ..., 1]
        centre = region_slices(central_region(lit.shape))
        return JobResult(
            {
                "sequential": found.sequential.value,
                "checkerboard": found.checkerboard.value,
                "scenes": float(np.exp(np.mean(np.log(list(scenes.values()))))),
                **scenes,
                "speckle_contrast": speckle_contrast(lit[centre]).contrast,
                "white": float(lit[centre].mean()),
                "eyebox_white": eyebox_uniformity_of(found.white).coefficient_of_variation,
                "eyebox_checkerboard": eyebox_uniformity_of(found.board).coefficient_of_variation,
            },
            {"checkerboard": to_srgb8(found.board_view.rgb[0])},
        )

    def analyse(self, results: Results) -> Findings:
        cases = [(quantity, words, name) for quantity, words in _QUANTITIES.items() for name in _MODULATORS]
        spreads = {
            f"{quantity}, {name}": [Spread.of_ratios(_values(results, quantity, name, n)) for n in _COUNTS]
            for quantity, _, name in cases
        }
        draw = line_plot(
            {name: (_COUNTS, [found.mean for found in curve]) for name, curve in spreads.items()},
            "number of wavelengths",
            "contrast ratio",
            errors={name: [found.over_seeds for found in curve] for name, curve in spreads.items()},
        )
        claims = [
            Claim(f"{name}, {words}", "", _by_count(spreads[f"{quantity}, {name}"]), SHOWN)
            for quantity, words, name in cases
        ]
        return Findings(
            rows=[table_row(job, result, ("count", "modulators", "seed")) for job, result in results],
            claims=[*claims, *_comparisons(results)],
            plots=[
                StudyFigure("contrast-ratio", "Mean over seeds and scenes, with the standard error over seeds", draw)
            ],
            pictures=_pictures(results),
            notes=[SPREAD_NOTE, _eyebox_note(results), *(_scene_note(results, name) for name in _MODULATORS)],
        )


def _scene_contrast(display: DisplayContrast, scene: str, status: StatusCallback) -> float:
    """Brightest over darkest twentieth of a scene in grey, no brighter than the white picture, in the middle plane."""
    system = display.white.system
    planes_m = np.asarray(system.planes_m)
    luminance = job_target(system, {**display.settings, "target": scene}, planes_m) @ SRGB_TO_XYZ[1]
    grey = WHITE / luminance.max() * luminance
    shown = optimise_job(system, np.repeat(grey[..., None], 3, axis=-1), display.settings, status).best
    wanted, found = grey[len(planes_m) // 2], middle_view(shown).xyz[0, ..., 1]
    low, high = np.quantile(wanted, (_TWENTIETH, 1 - _TWENTIETH))
    return contrast_ratio(found[wanted >= high], found[wanted <= low])


def _values(results: Results, quantity: str, modulators: str, count: int) -> NDArray[np.float64]:
    """A quantity (scene, seed); those that aren't of scenes as if there were one."""
    keys = [f"scene_{scene}" for scene in _SCENES] if quantity == "scenes" else [quantity]
    found = [r.numbers for job, r in results if has_settings(job, modulators=modulators, count=count)]
    return np.array([[numbers[key] for numbers in found] for key in keys])


def _by_count(spreads: Sequence[Spread]) -> str:
    return ", ".join(f"{count}: {found:.3g}" for count, found in zip(_COUNTS, spreads, strict=True))


def _comparisons(results: Results) -> list[Claim]:
    """Ratios of ratios, of pairs of equal scene and seed: of both displays, and of many wavelengths and two."""
    both, few = list(_MODULATORS), 2
    found = []
    for quantity, words in _QUANTITIES.items():
        values = {(name, n): _values(results, quantity, name, n) for name in both for n in _COUNTS}
        gains = [Spread.of_ratios(values[both[0], n] / values[both[1], n]) for n in _COUNTS]
        found.append(Claim(f"{both[0]} over {both[1]}, {words}", "", _by_count(gains), SHOWN))
        for name in both:
            change = Spread.of_ratios(values[name, _COUNTS[-1]] / values[name, few])
            found.append(Claim(f"{_COUNTS[-1]} over {few} wavelengths, {name}, {words}", "", f"{change:.3g}", SHOWN))
    return found


def _eyebox_note(results: Results) -> str:
    parts = []
    for name in _MODULATORS:
        values = [_values(results, "eyebox_white", name, count).mean() for count in _COUNTS]
        parts.append(f"{name} {min(values):.2f} to {max(values):.2f}")
    return f"Variation of the eyebox of the white pictures: {'; '.join(parts)}."


def _scene_note(results: Results, modulators: str) -> str:
    """The mean over seeds of each scene."""
    parts = []
    for count in _COUNTS:
        scenes = zip(_SCENES, _values(results, "scenes", modulators, count), strict=True)
        parts.append(f"{count}: " + ", ".join(f"{scene} {Spread.of_ratios(row[None]):.3g}" for scene, row in scenes))
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
