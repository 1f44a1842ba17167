"""Wrong records of virtual measurements: each named, alone, in pairs and beside an effect; right records never."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.records import Case, run
from holoview.bench.captures import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.records import find_record_errors
from holoview.bench.captures.records.trials import cut_pictures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.light.model.bench_parts import Modulator, Relay
from holoview.light.model.system import System
from tests.captures.records.mistakes import Arrays, Name, all_mistakes, names, shuffle, spoiled, turn
from tests.explored import explored

WAVELENGTHS, PLANES = 3, 3
MISTAKES = all_mistakes(WAVELENGTHS, PLANES)
FIRST_OF_EACH_ID = {name[0]: name for name in reversed(MISTAKES)}
KINDS = ("camera_orientation", "slm1_inverted", "slm_exchange", "capture_order", "power_order")
"""A mirror, an inversion, an exchange, orders of patterns and of numbers: by default one mistake of each."""
PAIRS: list[tuple[Name, Name]] = [
    (("slm1_orientation", "flip_x"), ("slm2_inverted", "")),
    (("slm2_orientation", "flip_y"), ("capture_order", "offset:+1")),
    (("camera_orientation", "rotate_180"), ("slm_exchange", "")),
    (("slm1_inverted", ""), ("wavelength_order", "permutation:1,2,0")),
    (("capture_order", "offset:-1"), ("distance_order", "reversed")),
    (("slm1_orientation", "flip_y"), ("power_order", "reversed")),
]
EFFECTS: dict[str, dict[str, float]] = {
    "camera_alignment": {"shift_y": 12e-6, "shift_x": -8e-6},
    "tilt": {"tilt_y": 2e-3, "tilt_x": -1.5e-3},
    "distance": {"distance_error": 6e-4},
    "gap": {"gap_error": 3e-4},
    "stroke": {"stroke_error": -0.15},
    "aberration1": {"z5": 250e-9, "z7": 150e-9},
    "slm_alignment": {"shift_y": 6e-6, "shift_x": -5e-6},
    "vignetting": {"fall_y": 0.4, "fall_x": -0.3},
}


def bench(modulators: int = 2, shape: tuple[int, int] = (32, 40)) -> System:
    """A small bench with three wavelengths and planes."""
    panel = Modulator(pitch_m=8e-6, shape=shape, stroke_m=825e-9, levels=16)
    two = modulators == 2
    return System(
        wavelengths_m=np.array([450e-9, 520e-9, 638e-9]),
        amplitudes=np.ones((1, WAVELENGTHS)),
        modulators=(panel,) * modulators,
        gap_m=1e-3 if two else None,
        planes_m=np.array([3e-3, 4e-3, 5.5e-3]),
        relay1=Relay(iris_na=0.03 if two else None),
        relay2=Relay(iris_na=0.03),
        observer="mono",
    )


def measured(effects: Mapping[str, Mapping[str, float]] | None = None, **changes: object) -> Captures:
    """Two captures of each wavelength and plane."""
    settings = dataclasses.replace(AcquisitionSettings(captures_per_condition=2, seed=4), **changes)  # type: ignore[arg-type]
    return make_captures(bench(), effects or {}, settings)


@pytest.fixture(scope="module")
def right() -> Captures:
    return measured()


@pytest.mark.long
@pytest.mark.parametrize("name", explored(MISTAKES, [FIRST_OF_EACH_ID[kind] for kind in KINDS]), ids=" ".join)
def test_a_mistake_is_named_and_nothing_else(right: Captures, name: Name) -> None:
    found = find_record_errors(spoiled(right, MISTAKES[name]))
    assert names(found) == [name]


@pytest.mark.long
@pytest.mark.parametrize("pair", explored(PAIRS, 1), ids=str)
def test_two_mistakes_are_named(right: Captures, pair: tuple[Name, Name]) -> None:
    found = find_record_errors(spoiled(right, *(MISTAKES[name] for name in pair)))
    assert names(found) == sorted(pair)


@pytest.mark.long
@pytest.mark.parametrize("offset", explored(["offset:+1", "offset:+2"], 1))
def test_patterns_out_of_step_and_distances_mixed_up_are_two_mistakes(right: Captures, offset: str) -> None:
    """Patterns that are out of step with their settings put most captures right at once, but not all."""
    pair = [("capture_order", offset), ("distance_order", "permutation:1,2,0")]
    found = find_record_errors(spoiled(right, *(MISTAKES[name] for name in pair)))
    assert names(found) == pair and found.rivals == ()


@pytest.mark.explores
def test_patterns_far_out_of_step_are_found_beside_another_mistake(right: Captures) -> None:
    pair = [("camera_orientation", "rotate_180"), ("capture_order", "offset:+5")]
    found = find_record_errors(spoiled(right, *(MISTAKES[name] for name in pair)))
    assert names(found) == pair


@pytest.mark.long
@pytest.mark.parametrize("effect", explored(list(EFFECTS), 1))
def test_an_effect_is_no_mistake_and_hides_none(effect: str) -> None:
    captures = measured({effect: EFFECTS[effect]})
    assert find_record_errors(captures).corrections == ()
    name = ("slm2_orientation", "flip_x")
    assert names(find_record_errors(spoiled(captures, MISTAKES[name]))) == [name]


@pytest.mark.explores
def test_rougher_captures_decide_where_smooth_ones_look_alike() -> None:
    """Smooth speckle is much the same at another wavelength: with the wrong ones it still correlates by 0.98."""
    mistake = [("wavelength_order", "permutation:1,2,3,0")]
    case = run(Case("effects", 61701, mistake, "slm_alignment", 0.45))
    assert case is not None and case.correlation[0] > 0.97
    assert case.named == mistake


@pytest.mark.long
@pytest.mark.parametrize("seed", explored(range(20), 1))
def test_right_records_are_right(seed: int) -> None:
    found = find_record_errors(measured(seed=seed))
    assert found.corrections == () and found.rivals == () and found.correlation[0] > 0.95


@pytest.mark.long
def test_pictures_of_nothing_prove_nothing(right: Captures) -> None:
    """Of a thousand corrections, shifts and blurs the best must not be taken for a find."""
    noise = np.random.default_rng(0).integers(200, 3000, right.images.shape).astype(np.uint16)
    assert find_record_errors(dataclasses.replace(right, images=noise)).corrections == ()


@pytest.mark.long
def test_patterns_without_their_pictures_at_the_end_are_left_out(right: Captures) -> None:
    wrong = spoiled(right, MISTAKES["capture_order", "offset:+1"])
    lost = wrong.levels.copy()
    lost[0] = np.random.default_rng(0).integers(0, 16, lost[0].shape)  # what was shown before the session
    found = find_record_errors(dataclasses.replace(wrong, levels=lost))
    assert names(found) == [("capture_order", "offset:+1")]
    corrected = found.corrected(wrong)
    assert len(corrected) == len(right) - 1
    assert np.array_equal(corrected.levels, right.levels[:-1])


@pytest.mark.long
@pytest.mark.parametrize("how", explored(["transpose", "rotate_90", "rotate_270", "anti_transpose"], 1))
def test_square_modulators_can_be_turned(how: str) -> None:
    captures = make_captures(bench(shape=(36, 36)), {}, AcquisitionSettings(captures_per_condition=2, seed=4))
    for part, array in (("slm1", "slm1"), ("camera", "images")):
        assert names(find_record_errors(spoiled(captures, turn(array, how)))) == [(f"{part}_orientation", how)]


@pytest.mark.long
def test_with_one_modulator_mirrored_patterns_are_mirrored_pictures() -> None:
    captures = make_captures(bench(modulators=1), {}, AcquisitionSettings(captures_per_condition=3, seed=4))
    found = find_record_errors(spoiled(captures, turn("images", "flip_x")))
    assert names(found) == [("slm1_orientation", "flip_x")]
    assert [[c.label for c in rival] for rival in found.rivals] == [["camera_orientation flip_x"]]
    assert any("can't tell which" in note for note in found.notes)


def _symmetric(a: Arrays) -> None:
    half: NDArray[np.uint8] = a["slm1"][:, :, : a["slm1"].shape[2] // 2]
    a["slm1"] = np.concatenate([half, half[:, :, ::-1]], axis=2)


def _remeasured(captures: Captures) -> Captures:
    """The pictures that a right bench shows for these patterns."""
    signal = Predictor(captures)(range(len(captures))).signal.numpy()
    counts = 64 + 2500 * signal / signal.max(axis=(1, 2), keepdims=True)
    return dataclasses.replace(captures, images=np.rint(counts).astype(np.uint16))


@pytest.mark.long
def test_what_symmetric_patterns_cant_show_is_said(right: Captures) -> None:
    found = find_record_errors(_remeasured(spoiled(right, _symmetric)))
    assert found.corrections == ()
    undecided = {c.label: c.sentence for c in found.undecided}
    assert "slm1_orientation flip_x" in undecided and "slm1_orientation flip_y" not in undecided
    note = next(note for note in found.notes if "can't show whether" in note)
    assert undecided["slm1_orientation flip_x"] in note and "flip_x" not in note


def test_with_the_same_pattern_in_all_captures_their_order_cant_be_seen(right: Captures) -> None:
    def same(a: Arrays) -> None:
        a["slm2"] = np.repeat(a["slm2"][:1], len(a["slm2"]), axis=0)

    found = find_record_errors(_remeasured(spoiled(right, same)))
    assert found.corrections == ()
    undecided = [c.label for c in found.undecided]
    assert "capture_order offset:+1 of modulator 2" in undecided
    assert "capture_order offset:+1 of modulator 1" not in undecided
    (note,) = (note for note in found.notes if "can't show whether" in note)
    assert note.count("patterns of modulator 2 stand some captures earlier or later") == 1 and "offset" not in note


def test_one_capture_is_enough_to_name_an_orientation(right: Captures) -> None:
    one = right.subset([0])
    assert find_record_errors(one).corrections == ()
    assert names(find_record_errors(spoiled(one, turn("images", "flip_y")))) == [("camera_orientation", "flip_y")]


@pytest.mark.parametrize("seed", explored(list(range(2, 10)), 1))
def test_powers_in_any_order_are_found_and_put_right(right: Captures, seed: int) -> None:
    wrong = spoiled(right, shuffle("power", seed))
    found = find_record_errors(wrong)
    assert [c.effect for c in found.corrections] == ["power_order"]
    assert found.corrected(wrong).power == pytest.approx(right.power, abs=0.02)  # captures of nearly equal power


@pytest.mark.long
def test_a_dark_and_a_saturated_picture_hide_no_mistake(right: Captures) -> None:
    images = right.images.copy()
    images[0], images[5] = 64, right.camera.saturation
    for name in (("slm2_orientation", "flip_y"), ("power_order", "reversed")):
        wrong = spoiled(dataclasses.replace(right, images=images), MISTAKES[name])
        assert names(find_record_errors(wrong)) == [name]


@pytest.mark.long
def test_a_law_of_the_laser_is_no_wrong_order() -> None:
    assert find_record_errors(measured({"laser_power": {"exponent": 0.3}})).corrections == ()


@pytest.mark.long
def test_corrected_captures_are_the_right_ones(right: Captures) -> None:
    wrong = spoiled(right, turn("slm1", "flip_x"))
    corrected = find_record_errors(wrong).corrected(wrong)
    assert np.array_equal(corrected.levels, right.levels) and len(corrected.corrections) == 1


def test_a_picture_beside_its_axis_is_no_mistake_of_two_records() -> None:
    """A tilt moves the picture by a fifth of its height, beyond what may be aside. Patterns and pictures both upside
    down would show it there as well, because the axis isn't in the picture's middle: half of that way below it."""
    settings = AcquisitionSettings(captures_per_condition=1, seed=4, focal_length_m=0.2, camera_pitch_m=20e-6)
    planes = dataclasses.replace(bench(modulators=1), wavelengths_m=np.array([520e-9]), amplitudes=np.ones((1, 1)))
    moved = 20 * 20e-6
    session = dataclasses.replace(settings, camera_shape=(140, 160))
    whole = make_captures(planes, {"tilt": {"tilt_y": moved / 0.2}}, session)
    captures = cut_pictures(whole, (slice(30, 130), slice(0, 160)))
    assert captures.axis_m[0] == pytest.approx(-moved / 2)
    assert find_record_errors(captures).corrections == ()


@pytest.mark.long
def test_on_a_fourier_bench_what_cant_be_told_apart_is_said() -> None:
    """There an inverted pattern turns the picture by 180°, as a turned pattern and a turned camera do."""
    settings = AcquisitionSettings(captures_per_condition=3, seed=4, focal_length_m=0.2, camera_pitch_m=20e-6)
    captures = make_captures(bench(modulators=1), {}, dataclasses.replace(settings, camera_shape=(96, 120)))
    assert find_record_errors(captures).corrections == ()
    found = find_record_errors(spoiled(captures, turn("images", "rotate_180")))
    alike = {"slm1_orientation rotate_180", "camera_orientation rotate_180", "slm1_inverted"}
    assert {c.label for way in (found.corrections, *found.rivals) for c in way} == alike
