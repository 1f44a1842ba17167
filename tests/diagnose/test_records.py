"""Wrong records in files of another program: named and put right, and effects are found with the right records."""

from __future__ import annotations

from pathlib import Path

import pytest

from holoview.bench.captures import Captures, read_captures
from holoview.bench.captures.predictor import SamplingConfig
from holoview.bench.captures.records import RecordFindings, find_record_errors, plausible_units
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.pipeline import diagnose
from holoview.light.model.effects.registry import listed_effects
from tests.captures.records.mistakes import Name, all_mistakes, names, spoil_file, spoiled
from tests.diagnose.independent import Faults, Laboratory, write_session
from tests.explored import explored

LABORATORY = Laboratory(planes_m=(3e-3, 4e-3, 5.5e-3), wavelengths_m=(450e-9, 520e-9, 638e-9), each=6, seed=2)
MISTAKES = all_mistakes(wavelengths=3, planes=3)
FAULTS: list[Faults] = [
    Faults(gap_m=2e-4),
    Faults(distance_m=-4e-4),
    Faults(stroke=0.15),
    Faults(tilt_rad=(2e-3, -1e-3)),
    Faults(shift_px=(1.0, -0.75)),
    Faults(crosstalk_px=0.8),
]
PAIRS: list[tuple[Name, Name]] = [
    (("slm2_orientation", "flip_x"), ("slm1_inverted", "")),
    (("slm1_orientation", "rotate_180"), ("wavelength_order", "reversed")),
    (("slm_exchange", ""), ("capture_order", "offset:-1")),
    (("camera_orientation", "flip_y"), ("slm2_inverted", "")),
    (("distance_order", "reversed"), ("slm1_orientation", "flip_x")),
    (("wavelength_order", "unit:nm taken as m"), ("capture_order", "offset:+2")),
]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return write_session(tmp_path_factory.mktemp("lab") / "c.h5", LABORATORY).read_bytes()


def _found(path: Path, written: bytes, *mistakes: Name) -> RecordFindings:
    path.write_bytes(written)
    return find_record_errors(read_captures(spoil_file(path, *(MISTAKES[n] for n in mistakes)), plausible_units))


@pytest.mark.long
@pytest.mark.parametrize("name", explored(list(MISTAKES), 1), ids=" ".join)
def test_a_mistake_in_a_file_is_named_and_nothing_else(tmp_path: Path, written: bytes, name: Name) -> None:
    assert names(_found(tmp_path / "c.h5", written, name)) == [name]


@pytest.mark.parametrize("pair", explored(PAIRS, 0), ids=str)
def test_two_mistakes_in_a_file_are_named(tmp_path: Path, written: bytes, pair: tuple[Name, Name]) -> None:
    assert names(_found(tmp_path / "c.h5", written, *pair)) == sorted(pair)


@pytest.mark.long
@pytest.mark.parametrize("case", explored(range(len(FAULTS)), 1))
def test_a_fault_of_the_bench_is_no_mistake_and_hides_none(tmp_path: Path, case: int) -> None:
    file = write_session(tmp_path / "c.h5", Laboratory(faults=FAULTS[case], each=4, seed=3))
    captures = read_captures(file)
    assert find_record_errors(captures).corrections == ()
    name = ("slm1_orientation", "flip_y")
    assert names(find_record_errors(spoiled(captures, MISTAKES[name]))) == [name]


def _captures(path: Path, faults: Faults, *mistakes: Name) -> Captures:
    file = write_session(path / "c.h5", Laboratory(faults=faults, each=4, fine=2, seed=0))
    return read_captures(spoil_file(file, *(MISTAKES[n] for n in mistakes)))


@pytest.mark.long
def test_a_wrong_record_and_a_fault_are_both_named(tmp_path: Path) -> None:
    captures = _captures(tmp_path, Faults(gap_m=1.5e-4), ("slm1_orientation", "flip_x"))
    effects = [listed_effects()[n] for n in ("gap", "stroke", "tilt")]
    found = diagnose(captures, effects, workers=1, free_maps=False, sampling=SamplingConfig(padding=3))
    assert found.verdict is Verdict.EXPLAINED
    first, *others = found.causes
    assert (first.effect, first.choice) == ("slm1_orientation", "flip_x")
    assert first.gain_db > 3 and first.excess_explained > 0.5
    assert first.before.chi2_per_pixel > 5 * first.after.chi2_per_pixel
    assert [cause.effect for cause in others] == ["gap"]
    entry = found.as_json()["causes"][0]
    assert entry["effect"] == "slm1_orientation" and entry["choice"] == "flip_x" and entry["parameters"] == {}
    assert found.as_json()["records"]["wrong"][0]["sentence"] == first.sentence


@pytest.mark.long
def test_a_wrong_order_of_powers_alone_explains_the_captures(nominal: Captures) -> None:
    found = diagnose(
        spoiled(nominal, MISTAKES["power_order", "reversed"]), [listed_effects()["gap"]], workers=1, free_maps=False
    )
    assert found.verdict is Verdict.EXPLAINED
    (cause,) = found.causes
    assert (cause.effect, cause.choice) == ("power_order", "reversed") and cause.gain_db > 10


@pytest.mark.long
def test_a_wrong_unit_that_no_bench_can_have_is_named(nominal: Captures) -> None:
    wrong = spoiled(nominal, MISTAKES["wavelength_order", "unit:nm taken as m"])
    found = diagnose(wrong, [listed_effects()["gap"]], workers=1, free_maps=False)
    assert found.verdict is Verdict.EXPLAINED
    assert [(c.effect, c.choice) for c in found.causes] == [("wavelength_order", "unit:nm taken as m")]
