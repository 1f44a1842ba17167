"""Whether lasers against speckle make people see different colours: one hologram, seen by 100 people.

Many narrow lines let people disagree in other ways than three do. The study optimises holograms for the standard eye
with 3, 8 and 16 lasers, and with lasers whose wavelengths are free for the picture alone, or for the agreement of 20
people as well, and has 80 other people look at each, for whom nothing was chosen.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.evidence.study.charts import bar_chart
from holoview.evidence.study.hologram_study import (
    QUICK_SIZE,
    SHOWN,
    SPREAD_NOTE,
    HologramStudy,
    Spread,
    case_jobs,
    case_table,
    result_pictures,
    result_table,
    run_hologram_job,
)
from holoview.evidence.study.study import (
    Claim,
    Findings,
    JobResult,
    Results,
    StatusCallback,
    StudyFigure,
    StudyJob,
    StudyScale,
)
from holoview.holograms.metrics.observer_agreement import PATCH, disagreement
from holoview.holograms.view import simulate
from holoview.light.observers import PEOPLE, drawn_people

_FREE = ["patterns", "amplitudes", "wavelengths"]
_FOR_PICTURE: dict[str, Any] = {"free": _FREE}
_CHOOSERS = 20  # the first people, for whom wavelengths are chosen; the others judge
_FOR_PEOPLE: dict[str, Any] = {"free": _FREE, "observers": _CHOOSERS}
_CASES: dict[str, dict[str, Any]] = {
    "3 lasers": {"scheme": "simultaneous", "options": {}},
    "8 lasers": {"scheme": "holochrome-8", "options": {}},
    "16 lasers": {"scheme": "holochrome-16", "options": {}},
    "3 free for the picture": {"scheme": "simultaneous", "options": _FOR_PICTURE},
    "3 chosen for agreement": {"scheme": "simultaneous", "options": _FOR_PEOPLE},
    "8 free for the picture": {"scheme": "holochrome-8", "options": _FOR_PICTURE},
    "8 chosen for agreement": {"scheme": "holochrome-8", "options": _FOR_PEOPLE},
}
_NUMBERS = {"daylight": "delta_e_daylight", "display": "delta_e_display", "white": "delta_e_white"}


class _Observers(HologramStudy):
    name = "observers"
    title = "One hologram, seen by many people"
    summary = (
        "Do eight lasers against speckle make people see different colours? CIEDE2000 between each of 80 people and "
        "their average, for 3, 8 and 16 lasers and for wavelengths chosen on which 20 others agree."
    )
    quick_note = f"{QUICK_SIZE}; half of the iterations of free wavelengths are left for the patterns alone."
    kind = "hologram seen by people"
    revision = 2

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        cases = {label: {**case, "people": PEOPLE} for label, case in _CASES.items()}
        return case_jobs(self, cases, scale, seed)

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        """A hologram job, and what people see of it in the middle plane."""
        result = run_hologram_job(settings, status)
        hologram = result.hologram
        assert hologram is not None
        plane_m = float(hologram.system.planes_m[len(hologram.system.planes_m) // 2])
        view = simulate(hologram, planes=[plane_m], backend="torch")
        people = drawn_people(settings["people"])
        for group, suffix in ((people[_CHOOSERS:], ""), (people[:_CHOOSERS], "_choosers")):
            found = disagreement(view.intensity[0], view.wavelengths_m, group)
            for what, name in _NUMBERS.items():
                values: NDArray[np.float64] = getattr(found, what)
                result.numbers[f"{name}{suffix}"] = float(values.mean())
                result.numbers[f"{name}{suffix}_95"] = float(np.percentile(values, 95))
        return result

    def analyse(self, results: Results) -> Findings:
        usual = _CASES["3 lasers"]
        claims = [
            Claim(
                f"{label}, eyes used to {eyes}: people's ΔE2000, beside 3 lasers",
                "",
                f"{Spread.of(case_table(results, key, case) - case_table(results, key, usual)):+.2f}",
                SHOWN,
            )
            for key, eyes in (("delta_e_daylight", "daylight"), ("delta_e_display", "the display"))
            for label, case in _CASES.items()
            if case != usual
        ]
        notes = [_case_note(results, label, case) for label, case in _CASES.items()]
        notes += [
            f"{job.label}: {', '.join(f'{nm:.1f}' for nm in outcome.numbers['wavelengths_nm'])} nm"
            for job, outcome in results
            if job.settings["options"]
        ]
        notes.append(f"Means over targets and seeds. {SPREAD_NOTE} Colours are means of {PATCH} x {PATCH} samples.")
        return Findings(
            rows=result_table(results, "options"),
            claims=claims,
            plots=[_figure(results)],
            pictures=result_pictures(results),
            notes=notes,
        )


def _figure(results: Results) -> StudyFigure:
    spreads = {
        words: [Spread.of(case_table(results, name, case)) for case in _CASES.values()]
        for words, name in (
            ("picture, eyes used to daylight", "delta_e_daylight"),
            ("picture, eyes used to the display", "delta_e_display"),
            ("white of the lasers", "delta_e_white"),
        )
    }
    bars = {words: [found.mean for found in column] for words, column in spreads.items()}
    errors = {words: [found.over_scenes for found in column] for words, column in spreads.items()}
    caption = "Mean CIEDE2000 between a person and the average of 80; error bars over scenes, where there are several"
    return StudyFigure("observers", caption, bar_chart(list(_CASES), bars, "CIEDE2000", errors))


def _case_note(results: Results, label: str, case: Mapping[str, Any]) -> str:
    def text(key: str) -> str:
        return f"{Spread.of(case_table(results, key, case)):.3g}"

    return (
        f"{label}: ΔE2000 {text('delta_e_daylight')} in daylight, {text('delta_e_display')} used to the display, of "
        f"95 % of the people at most {text('delta_e_daylight_95')}; white {text('delta_e_white')} (the {_CHOOSERS} for "
        f"whom wavelengths are chosen: {text('delta_e_white_choosers')}); speckle contrast "
        f"{text('speckle_contrast')}; PSNR {text('psnr_db')} dB."
    )


STUDIES = (_Observers(),)
