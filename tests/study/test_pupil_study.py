"""The study `pupil`: which pupils look, and what its table says of a picture whose errors are known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from holoview.evidence.study.studies import pupil, studies_by_name
from holoview.evidence.study.study import JobResult, Results, StudyScale
from holoview.holograms.view import View, random_drive, simulate

SMALL = StudyScale("small", (16, 16), 1, 1, ("still-life",), 2, scores=())
PLACES_MM = (0.0, 0.3, 0.6, 0.9, 1.2)


def _view(pupil_mm: float = 2.0) -> View:
    system = pupil._seen_from(
        pupil.job_system({"shape": [16, 16], "planes": 2, "scheme": "holochrome-8"}), (0, pupil_mm)
    )
    return simulate(system, random_drive(system, 0), backend="torch")


def _results(scale: StudyScale) -> Results:
    """Results whose numbers say which pupil they belong to."""
    found = []
    for job in studies_by_name()["pupil"].jobs(scale, 0):
        looks = pupil._looks(job.settings)
        numbers: dict[str, Any] = {key: [100 * x + d for x, d in looks] for key in pupil._AXES}
        numbers |= {"place_mm": [x for x, _ in looks], "pupil_mm": [d for _, d in looks]}
        found.append((job, JobResult(numbers, {pupil._named(look): np.zeros((4, 4, 3), np.uint8) for look in looks})))
    return found


def test_a_hologram_is_seen_from_each_place_and_through_each_size_once() -> None:
    (first, *_) = studies_by_name()["pupil"].jobs(SMALL, 0)
    looks = pupil._looks(first.settings)
    assert looks == [*((x, 2.0) for x in PLACES_MM), (0.0, 1.0), (0.0, 3.0), (0.0, 4.0), (0.0, 6.0)]


def test_the_sizes_are_chosen_and_the_pupil_beside_the_axis_stays() -> None:
    results = _results(SMALL.with_changes(pupils_m=(5e-3,)))
    assert pupil._looks(results[0][0].settings) == [*((x, 2.0) for x in PLACES_MM), (0.0, 5.0)]
    places, sizes = (pupil._curve(results, "psnr_db", "even", sizes=by_size) for by_size in (False, True))
    assert places[0] == list(PLACES_MM) and places[1].tolist() == pytest.approx([100 * x + 2 for x in PLACES_MM])
    assert sizes[0] == [2.0, 5.0] and sizes[1].tolist() == [2.0, 5.0]


def test_the_table_has_a_row_for_each_hologram_and_pupil() -> None:
    findings = studies_by_name()["pupil"].analyse(_results(SMALL))
    assert len(findings.rows) == len(findings.pictures) == 4 * 9
    assert all(row["psnr_db"] == 100 * row["place_mm"] + row["pupil_mm"] for row in findings.rows)
    assert {plot.name for plot in findings.plots} >= {"psnr_db", "psnr_db-by-size", "brightness-by-size"}
    (on_axis,) = [c.measured for c in findings.claims if c.claim == "optimised for focal planes, pupils on the axis"]
    assert on_axis.startswith("1.0 dB at 1 mm, 2.0 dB at 2 mm, 3.0 dB at 3 mm, 4.0 dB at 4 mm, 6.0 dB at 6 mm")


def test_a_picture_that_is_only_too_dark_is_right_at_its_targets_brightness() -> None:
    view = _view()
    target = np.clip(view.rgb, 0, 1)
    view = replace(view, xyz=target @ pupil.SRGB_TO_XYZ.T)
    found = pupil._measured(view.exposed(-2), target)
    assert found["brightness"] == pytest.approx(0.25, rel=1e-6)
    assert found["psnr_db"] == pytest.approx(-10 * np.log10(np.mean((0.75 * target) ** 2)), abs=0.1)
    assert found["matched_psnr_db"] > 100


def test_a_larger_pupil_lets_more_light_in_until_it_has_the_whole_eyebox() -> None:
    target = np.full((2, 32, 32, 3), 0.5)
    light = [pupil._measured(_view(pupil_mm), target)["brightness"] for pupil_mm in (1.0, 2.0, 3.0, 6.0, 8.0)]
    assert light[0] < light[1] < light[2] < light[3]
    assert light[4] == pytest.approx(light[3], rel=1e-6)  # the eyebox's corner is 2.3 mm from its middle at 650 nm
