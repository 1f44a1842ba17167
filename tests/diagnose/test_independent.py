"""Captures that other programs computed: faults are named, and another sampling or padding is never taken for one."""

from __future__ import annotations

from pathlib import Path

import pytest

from holoview.captures import read_captures
from holoview.diagnose.diagnosis import Diagnosis
from holoview.diagnose.pipeline import diagnose
from holoview.diagnose.sampling_config import SamplingConfig
from holoview.diagnose.verdict import Verdict
from holoview.model.effects.registry import listed_effects
from tests.diagnose.independent import Faults, Laboratory, write_session
from tests.diagnose.sealed import taken

SAMPLES = Path(__file__).resolve().parents[1] / "data"
FEW = ("camera_blur", "distance", "gap", "stroke", "tilt")
VALUE_TOLERANCE = 0.05
"""Of a value, where model and bench differ by their sampling: 2 samples a pixel and points on the camera, against 4 and
whole camera pixels. Seen: 1.6 % of a gap."""
FAULTS: list[tuple[Faults, str, dict[str, float]]] = [
    (Faults(gap_m=1.5e-4), "gap", {"gap_error": 1.5e-4}),
    (Faults(distance_m=-3e-4), "distance", {"distance_error": -3e-4}),
    (Faults(stroke=0.1), "stroke", {"stroke_error": 0.1}),
    (Faults(tilt_rad=(2e-3, -1e-3)), "tilt", {"tilt_y": 2e-3, "tilt_x": -1e-3}),
]


def _diagnosed(path: Path, faults: Faults, seed: int) -> Diagnosis:
    file = write_session(path / "c.h5", Laboratory(faults=faults, seed=seed, each=4))
    return diagnose(read_captures(file), [listed_effects()[n] for n in FEW], workers=1, free_maps=False)


@pytest.mark.parametrize("case", taken(range(len(FAULTS)), 1))
def test_a_fault_is_named_first_beside_the_difference_of_sampling(tmp_path: Path, case: int) -> None:
    faults, name, values = FAULTS[case]
    found = _diagnosed(tmp_path, faults, seed=case)
    cause = found.causes[0]
    assert cause.effect == name
    for key, true in values.items():
        assert cause.intervals[key].value == pytest.approx(true, rel=VALUE_TOLERANCE)
    assert cause.gain_db > 3 and cause.excess_explained > 0.5


@pytest.mark.parametrize("seed", taken([0, 1], 1))
def test_sampling_and_padding_alone_are_never_a_cause(tmp_path: Path, seed: int) -> None:
    """The camera's pixels integrate, the model's don't: a blur helps, other samples help more, and are told."""
    found = _diagnosed(tmp_path, Faults(), seed)
    assert found.verdict in (Verdict.CONSISTENT, Verdict.UNEXPLAINED) and not found.causes
    assert found.before.chi2_per_pixel > 5
    assert any("--finer 2 --padding 3 --points 2" in note for note in found.notes)


def test_with_its_samples_the_nominal_bench_predicts_them(tmp_path: Path) -> None:
    file = write_session(tmp_path / "c.h5", Laboratory(seed=0, each=4))
    same = SamplingConfig(finer=2, padding=3, points=2)
    found = diagnose(read_captures(file), [listed_effects()[n] for n in FEW], workers=1, free_maps=False, sampling=same)
    assert found.before.chi2_per_pixel < 1.2
    assert found.verdict in (Verdict.CONSISTENT, Verdict.UNEXPLAINED) and not found.causes


@pytest.mark.slow
def test_what_no_effect_describes_is_not_explained(tmp_path: Path) -> None:
    """A spiral phase plate on the source."""
    found = _diagnosed(tmp_path, Faults(vortex=1.0), 3)
    assert found.verdict in (Verdict.UNEXPLAINED, Verdict.PARTLY) and found.after.chi2_per_pixel > 1.1


def _sample(name: str) -> Diagnosis:
    return diagnose(read_captures(SAMPLES / f"{name}.h5"), workers=1, free_maps=False)


def test_a_sample_without_faults_is_consistent() -> None:
    found = _sample("sample_consistent")
    assert found.verdict is Verdict.CONSISTENT and not found.causes
    assert found.before.chi2_per_pixel == pytest.approx(1.0, abs=0.02)  # 4 held-out captures: √(2/n) = 0.0035


def test_a_sample_with_a_longer_gap_says_so() -> None:
    found = _sample("sample_gap")
    assert found.verdict is Verdict.EXPLAINED and [c.effect for c in found.causes] == ["gap"]
    interval = found.causes[0].intervals["gap_error"]
    assert abs(interval.value - 0.108e-3) <= 3 * interval.half_width and interval.half_width < 1e-6


@pytest.mark.slow
def test_a_sample_with_two_faults_names_both() -> None:
    found = _sample("sample_two")
    assert found.verdict is Verdict.EXPLAINED and {c.effect for c in found.causes} == {"crosstalk", "slm_alignment"}
    values = {name: i for c in found.causes for name, i in c.intervals.items()}
    for name, true in (("sigma", 0.45), ("shift_y", 0.6 * 8e-6), ("shift_x", -0.45 * 8e-6)):
        assert abs(values[name].value - true) <= 3 * values[name].half_width
