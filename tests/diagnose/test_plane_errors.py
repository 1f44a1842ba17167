"""Planes that an independent program's stage misses are named as such, and single bad captures still as bad."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from holoview.bench.captures import read_captures
from holoview.bench.captures.predictor import SamplingConfig
from holoview.bench.diagnose.correct.bad_captures import excess_stands_out, without_planes
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.report.diagnosis import Diagnosis
from holoview.light.model.effects.registry import listed_effects
from tests.diagnose.independent import Faults, Laboratory, Mishaps, write_session
from tests.diagnose.independent_camera import CameraFaults, Rail
from tests.explored import explored

SAME = SamplingConfig(padding=3)
"""The samples of the program where its pixels have two along a side and the camera one pixel for each."""
FAIL_AT = 3.0
"""Half-widths of the 95 % interval by which a value may miss the truth; as for hidden faults."""
ALIKE = ("aberration2", "camera_blur", "distance", "gap", "plane_errors", "stage", "wavelength_offset")
PLANES_M = (3e-3, 4e-3, 5.5e-3, 7e-3)


def _diagnosed(path: Path, lab: Laboratory, among: tuple[str, ...] | None = ALIKE) -> Diagnosis:
    effects = None if among is None else [listed_effects()[name] for name in among]
    return diagnose(read_captures(write_session(path / "c.h5", lab)), effects, free_maps=False, sampling=SAME)


def _laboratory(faults: Faults, mishaps: Mishaps | None = None, planes_m: tuple[float, ...] = PLANES_M) -> Laboratory:
    """Sixteen captures; patterns of every plane are smooth and rough."""
    smoothness = (4.0, 2.5, 1.5, 0.8, 3.0)
    own = {"planes_m": planes_m, "smoothness_px": smoothness, "each": 8, "fine": 2, "seed": 1}
    return Laboratory(faults=faults, mishaps=mishaps or Mishaps(), **own)


def _check(found: Diagnosis, missed_m: tuple[float, ...], planes_m: tuple[float, ...] = PLANES_M) -> None:
    assert found.verdict is Verdict.EXPLAINED and [cause.effect for cause in found.causes] == ["plane_errors"]
    assert not found.bad_captures
    (cause,) = found.causes
    true = {z: error for z, error in zip(planes_m, missed_m, strict=True) if error}
    assert cause.lists["distances"] == tuple(true)
    for number, error in enumerate(true.values()):
        interval = cause.intervals[f"errors[{number}]"]
        assert abs(interval.value - error) <= FAIL_AT * interval.half_width, (number, interval)


@pytest.mark.long
@pytest.mark.parametrize(
    "missed_m", explored([(1e-4, -2e-4, 1.5e-4, 5e-5), (0.0, 0.0, 3e-4, 0.0)], 1), ids=["every plane", "one plane"]
)
def test_planes_that_are_missed_are_named_with_their_errors(tmp_path: Path, missed_m: tuple[float, ...]) -> None:
    _check(_diagnosed(tmp_path, _laboratory(Faults(missed_m=missed_m))), missed_m)


@pytest.mark.parametrize(
    ("faults", "effect"),
    [
        pytest.param(Faults(distance_m=2e-4), "distance", marks=pytest.mark.explores),
        pytest.param(Faults(camera=CameraFaults(rail=Rail(1.02))), "stage", marks=pytest.mark.explores),
        pytest.param(Faults(missed_m=(2e-4,) * 4), "distance", marks=pytest.mark.explores),
    ],
    ids=["distance", "stage", "the same error of each plane"],
)
def test_what_one_number_says_is_named_by_it(tmp_path: Path, faults: Faults, effect: str) -> None:
    found = _diagnosed(tmp_path, _laboratory(faults))
    assert found.verdict is Verdict.EXPLAINED and [cause.effect for cause in found.causes] == [effect]
    assert not found.bad_captures


@pytest.mark.parametrize(
    "faults", explored([Faults(), Faults(missed_m=(0.0, 2e-4, 0.0, 0.0))], 0), ids=["clean", "a plane off"]
)
def test_a_single_capture_out_of_focus_is_bad(tmp_path: Path, faults: Faults) -> None:
    found = _diagnosed(tmp_path, _laboratory(faults, Mishaps(defocused={6: 3e-4})))
    assert [(bad.index, bad.why) for bad in found.bad_captures] == [(6, "out of focus")]
    assert [cause.effect for cause in found.causes] == ["plane_errors"] * any(faults.missed_m)
    assert found.verdict is (Verdict.EXPLAINED if any(faults.missed_m) else Verdict.CONSISTENT)


@pytest.mark.long
def test_a_plane_that_no_candidate_explains_has_bad_captures(tmp_path: Path) -> None:
    """As before the search they are excused only."""
    found = _diagnosed(tmp_path, _laboratory(Faults(missed_m=(0.0, 3e-4, 0.0, 0.0))), ("gap",))
    assert {bad.index for bad in found.bad_captures} == {1, 5, 9, 13} and found.verdict is Verdict.UNEXPLAINED


def test_what_all_captures_of_a_plane_have_blames_none_of_them() -> None:
    rng, plane = np.random.default_rng(0), np.repeat([3.0, 4.0, 5.0, 6.0], 4)
    excess = 0.01 * rng.uniform(0.8, 1.2, 16) * np.where(plane == 5.0, 1000.0, 1.0)
    excess[1] = 3.0
    same = np.ones(16)
    args = (excess, np.full(16, 0.005), rng.uniform(1.0, 2.0, 16), same, 3.0)
    assert np.flatnonzero(excess_stands_out(*args)).tolist() == [1, 8, 9, 10, 11]
    assert np.flatnonzero(excess_stands_out(*args, plane)).tolist() == [1]


def test_a_plane_is_off_where_most_of_its_captures_are_like_none() -> None:
    """Of twelve normally distributed correlations a plane's largest difference would count once in a thousand times,
    since their scatter is known to a tenth only: these are uniform, and none differs by more than 3.5 σ."""
    plane = np.repeat([3.0, 4.0, 5.0, 6.0], 3)
    correlations = np.random.default_rng(0).uniform(-0.01, 0.01, (12, 12)) + np.diag(np.where(plane == 5.0, 0, 0.9))
    flags = plane == 5.0
    flags[0] = True
    assert np.flatnonzero(without_planes(flags, plane, correlations)).tolist() == [0]
    correlations[6, 7] = correlations[7, 6] = 0.9  # exchanged with each other
    assert np.flatnonzero(without_planes(flags, plane, correlations)).tolist() == [0, 6, 7]
    one = np.full(12, 3.0)
    assert np.array_equal(without_planes(np.ones(12, dtype=bool), one, correlations), np.ones(12, dtype=bool))


SWEEP: dict[str, tuple[float, ...]] = {
    "one plane, barely": (0.0, 1e-5, 0.0, 0.0),
    "one plane": (0.0, 0.0, -3e-4, 0.0),
    "one plane, gross": (1e-3, 0.0, 0.0, 0.0),
    "two planes": (0.0, 3e-4, 0.0, -1e-4),
    "every plane, barely": (2e-5, -1e-5, 1.5e-5, -3e-5),
    "every plane, gross": (6e-4, -3e-4, 4e-4, -8e-4),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SWEEP)
def test_of_the_whole_library_they_are_named(tmp_path: Path, name: str) -> None:
    four = {"shape": (48, 64), "wavelengths_m": (450e-9, 520e-9, 590e-9, 650e-9), "each": 8, "seed": 3, "fine": 2}
    own = {"planes_m": PLANES_M, "smoothness_px": (4.0, 2.5, 1.5, 0.8, 3.0)}
    _check(_diagnosed(tmp_path, Laboratory(faults=Faults(missed_m=SWEEP[name]), **four, **own), None), SWEEP[name])
