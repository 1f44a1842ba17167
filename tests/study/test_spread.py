"""Means over scenes and seeds with their standard errors, and how both studies of people and of black state them."""

from __future__ import annotations

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose

from holoview.evidence.study.hologram_study import Spread, case_table, standard_error
from holoview.evidence.study.studies import contrast_ratio, observers, studies_by_name
from holoview.evidence.study.study import QUICK, JobResult, Results


def test_errors_of_effects_that_add_are_those_of_each() -> None:
    rng = np.random.default_rng(1)
    scenes, seeds = rng.normal(size=3), rng.normal(size=4)
    found = Spread.of(scenes[:, None] + seeds)
    assert_allclose(found.mean, scenes.mean() + seeds.mean(), rtol=1e-12, atol=1e-12)
    assert_allclose(found.over_seeds, np.sqrt(((seeds - seeds.mean()) ** 2).sum() / 3) / 2, rtol=1e-9)
    assert_allclose(found.over_scenes, np.sqrt(((scenes - scenes.mean()) ** 2).sum() / 2 / 3), rtol=1e-9)


def test_a_standard_error_is_the_scatter_of_means() -> None:
    """10⁴ means of 8 draws: their scatter is known within 1/√(2·10⁴) = 0.7 %; the tolerance is seven times that."""
    draws = np.random.default_rng(0).normal(size=(10_000, 8))
    stated = np.sqrt(np.mean([standard_error(row) ** 2 for row in draws]))
    assert_allclose(stated, draws.mean(axis=1).std(ddof=1), rtol=0.05)


def test_ratios_are_averaged_as_logarithms() -> None:
    found = Spread.of_ratios(np.array([[2.0, 8.0], [2.0, 8.0]]))
    assert_allclose([found.mean, found.over_seeds, found.over_scenes], [4.0, 4.0 * np.log(2.0), 0.0], atol=1e-12)
    swapped = Spread.of_ratios(1 / np.array([[2.0, 8.0], [2.0, 8.0]]))
    assert_allclose(found.mean * swapped.mean, 1.0, rtol=1e-12)


def test_an_unknown_error_is_a_dash() -> None:
    assert f"{Spread.of(np.array([[1.0, 1.2]])):.3g}" == "1.1 (0.1; –)"
    assert f"{Spread.of(np.array([[1.5]])):.3g}" == "1.5 (–; –)"
    assert f"{Spread.of(np.array([[1.0], [1.0]])):+.2f}" == "+1.00 (–; 0)"


def _invented(name: str, numbers_of: object, scenes: tuple[str, ...]) -> Results:
    study = studies_by_name()[name]
    jobs = study.jobs(QUICK.with_changes(seeds=2, targets=scenes), 7)
    return [(job, JobResult(numbers_of(job.settings))) for job in jobs]  # type: ignore[operator]


def test_people_are_compared_in_pairs_of_scene_and_seed() -> None:
    """Scenes differ by 1 and seeds by 0.1 with any lasers, and 8 lasers add 0.5: the difference has no error."""

    def numbers(settings: dict[str, object]) -> dict[str, object]:
        free = bool(settings["options"])
        value = 1.0 + (settings["target"] == "night") + 0.1 * (settings["seed"] == 8)
        value += 0.5 * (settings["scheme"] == "holochrome-8" and not free)
        keys = [f"{key}{end}" for key in observers._NUMBERS.values() for end in ("", "_95", "_choosers")]
        return dict.fromkeys([*keys, "speckle_contrast", "psnr_db"], value) | {"wavelengths_nm": [532.0]}

    results = _invented("observers", numbers, ("still-life", "night"))
    table = case_table(results, "psnr_db", observers._CASES["3 lasers"])
    assert_allclose(table, [[2.0, 2.1], [1.0, 1.1]])
    findings = studies_by_name()["observers"].analyse(results)
    measured = {claim.claim.partition(",")[0]: claim.measured for claim in findings.claims}
    assert re.fullmatch(r"\+0\.50 \(\S+; \S+\)", measured["8 lasers"])
    errors = [float(number) for number in re.findall(r"\((\S+); (\S+)\)", measured["8 lasers"])[0]]
    assert_allclose(errors, 0.0, atol=1e-12)
    assert measured["16 lasers"].startswith(("+0.00", "-0.00"))
    assert findings.notes[0].startswith("3 lasers: ΔE2000 1.55 (0.05; 0.5) in daylight")


@pytest.mark.parametrize("gain", [1.0, 2.0])
def test_two_modulators_are_compared_with_one_in_pairs(gain: float) -> None:
    def numbers(settings: dict[str, object]) -> dict[str, object]:
        value = (gain if settings["modulators"] == "two modulators" else 1.0) * (1 + (settings["seed"] == 8))
        scenes = {f"scene_{scene}": value * 3.0**i for i, scene in enumerate(contrast_ratio._SCENES)}
        return dict.fromkeys(("sequential", "checkerboard", "scenes", "eyebox_white"), value) | scenes

    study = studies_by_name()["contrast-ratio"]
    jobs = study.jobs(QUICK.with_changes(seeds=2), 7)
    claims = contrast_ratio._comparisons([(job, JobResult(numbers(dict(job.settings)))) for job in jobs])
    shown = {claim.claim: claim.measured for claim in claims}
    scenes = shown["two modulators over one modulator, the brightest over the darkest twentieth of scenes"]
    assert [float(value) for value in re.findall(r"\d+: (\S+) \(", scenes)] == [gain] * 5
    assert shown["16 over 2 wavelengths, one modulator, white picture over black picture"].startswith("1 (")
