"""Corrections undo what happened to the records, to the last bit, alone and composed, and the file notes them."""

from __future__ import annotations

import dataclasses
import inspect
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from holoview.bench.captures import Captures, read_captures, write_captures
from holoview.bench.captures.dataset import ORIENTATIONS, turned
from holoview.bench.captures.records import corrections, record_errors, trials
from holoview.bench.captures.records.corrections import (
    ORDER,
    CameraOrientation,
    ColumnReversal,
    Correction,
    PatternOffset,
    SlmExchange,
    SlmInversion,
    SlmOrientation,
    ValueOrder,
    WrongUnit,
    apply_corrections,
    hypothesis,
    level_candidates,
    moves_only,
    offset_candidates,
    orientation_candidates,
    plausible_units,
)
from holoview.bench.captures.records.record_errors import PowerOrder, RecordFindings
from holoview.util.errors import UserError
from tests.captures.conftest import pictures
from tests.captures.records.mistakes import Name, all_mistakes, late, shuffle, spoiled, turn

COUNT = 12


@pytest.fixture(scope="module")
def square() -> Captures:
    """Random numbers on square modulators and a square camera; three wavelengths, three planes."""
    rng, plain = np.random.default_rng(3), pictures(COUNT)
    return dataclasses.replace(
        plain,
        levels=rng.integers(0, 16, (COUNT, 2, 24, 24)).astype(np.uint8),
        images=rng.integers(70, 4000, (COUNT, 48, 48)).astype(np.uint16),
        slms=tuple(dataclasses.replace(slm, num_levels=16) for slm in plain.slms),
        wavelength_m=np.repeat([450e-9, 520e-9, 638e-9], 4),
        distance_m=np.tile([3e-3, 4e-3, 5e-3], 4),
        power=np.round(rng.uniform(0.5, 1.0, COUNT), 4),
    )


def _correction(captures: Captures, name: Name) -> Correction:
    """The correction of a mistake, made from its name alone."""
    effect, choice = name
    values = {n: tuple(np.unique(getattr(captures, f"{n}_m")).tolist()) for n in ("wavelength", "distance")}
    column = "wavelength" if effect.startswith("wavelength") else "distance"
    if choice.startswith("offset:") and effect == "capture_order":
        steps, *rest = choice.removeprefix("offset:").split(" ", 1)
        slms = (int(rest[0][-1]) - 1,) if rest and "modulator" in rest[0] else (0, 1)
        return PatternOffset(int(steps), slms, 2, with_settings="settings" in choice)
    if effect == "power_order":
        index = np.arange(len(captures))
        return PowerOrder(tuple((index[::-1] if choice == "reversed" else np.roll(index, -1)).tolist()), choice)
    if choice.startswith("unit:"):
        factors = {"mm taken as m": 1e3, "m taken as mm": 1e-3, "nm taken as µm": 1e3, "nm taken as m": 1e9}
        meant, taken = choice.removeprefix("unit:").split(" taken as ")
        return WrongUnit(column, factors[choice.removeprefix("unit:")], meant, taken)
    if effect.endswith("_order"):
        count = len(values[column])
        text = choice.removeprefix("permutation:")
        order = tuple(range(count)[::-1]) if choice == "reversed" else tuple(int(n) for n in text.split(","))
        return ValueOrder(column, order, values[column])
    if effect == "slm_exchange":
        return SlmExchange()
    slm = int(effect[3]) - 1 if effect.startswith("slm") else 0
    if effect.endswith("_inverted"):
        return SlmInversion(slm)
    return CameraOrientation(choice) if effect == "camera_orientation" else SlmOrientation(slm, choice)


def _same(a: Captures, b: Captures) -> bool:
    arrays = ("levels", "images", "wavelength_m", "distance_m", "power", "exposure_s")
    return all(np.allclose(getattr(a, n), getattr(b, n), rtol=1e-12, atol=0) for n in arrays)


@pytest.mark.parametrize("name", all_mistakes(3, 3, square=True), ids=" ".join)
def test_each_correction_undoes_its_mistake_and_tells_its_name(square: Captures, name: Name) -> None:
    wrong = spoiled(square, all_mistakes(3, 3, square=True)[name])
    correction = _correction(square, name)
    assert (correction.effect, correction.choice) == name
    assert not _same(wrong, square) and _same(correction.apply(wrong), square)
    assert correction.effect in ORDER and correction.sentence.endswith(".")


def test_corrections_compose_with_the_exchange_undone_first(square: Captures) -> None:
    """Modulator 1 is the one on the bench, wherever its patterns are recorded."""
    every = all_mistakes(3, 3, square=True)
    wrong = spoiled(square, turn("slm1", "rotate_90"), every["slm_exchange", ""], late(2, ("slm1", "slm2")))
    chosen = hypothesis([PatternOffset(2, (0, 1), 2), SlmOrientation(0, "rotate_90"), SlmExchange()])
    assert [c.effect for c in chosen] == ["slm_exchange", "slm1_orientation", "capture_order"]
    assert _same(apply_corrections(wrong, chosen), square)


def test_without_the_ends_only_pictures_with_a_pattern_stay(square: Captures) -> None:
    found = PatternOffset(2, (0, 1), 2).without_ends().apply(spoiled(square, late(2, ("slm1", "slm2"))))
    assert len(found) == COUNT - 2 and _same(found, square.subset(range(COUNT - 2)))


def test_a_column_backwards_is_put_right(square: Captures) -> None:
    wrong = dataclasses.replace(square, distance_m=square.distance_m[::-1])
    assert _same(ColumnReversal("distance").apply(wrong), square)


def test_powers_in_any_order_are_put_right(square: Captures) -> None:
    wrong = spoiled(square, shuffle("power", 1))
    source = tuple(int(np.flatnonzero(wrong.power == p)[0]) for p in square.power)
    assert _same(PowerOrder(source, "permutation").apply(wrong), square)


def test_turns_by_90_degrees_need_square_shapes(square: Captures) -> None:
    def count(captures: Captures, kind: type[Correction]) -> int:
        return sum(isinstance(c, kind) for c in orientation_candidates(captures))

    wide = dataclasses.replace(square, levels=square.levels[..., :20, :], images=square.images[:, :40])
    assert count(square, SlmOrientation) == 14 and count(square, CameraOrientation) == 7
    assert count(wide, SlmOrientation) == 6 and count(wide, CameraOrientation) == 3


def test_patterns_with_more_levels_than_the_other_modulator_has_are_not_exchanged(square: Captures) -> None:
    coarse = dataclasses.replace(square.slms[1], num_levels=8)
    other = dataclasses.replace(square, slms=(square.slms[0], coarse), levels=square.levels.clip(0, 7))
    other.levels[0, 0, 0, 0] = 15
    assert SlmExchange() in level_candidates(square) and SlmExchange() not in level_candidates(other)


def test_offsets_go_to_half_of_a_short_session(square: Captures) -> None:
    found = [c for c in offset_candidates(square.subset(range(5)), 8) if isinstance(c, PatternOffset)]
    assert {c.offset for c in found} == {1, -1, 2, -2}


def test_units_are_corrected_only_where_lengths_are_impossible(square: Captures) -> None:
    assert plausible_units(square) == ()
    wrong = dataclasses.replace(square, wavelength_m=square.wavelength_m * 1e9, distance_m=square.distance_m * 1e3)
    assert {c.label for c in plausible_units(wrong)} == {
        "wavelength_order unit:nm taken as m",
        "distance_order unit:mm taken as m",
    }
    with pytest.raises(UserError, match="pitch"):
        plausible_units(dataclasses.replace(square, camera=dataclasses.replace(square.camera, pitch_m=4.0)))


def test_the_file_notes_what_was_corrected(square: Captures, tmp_path: Path) -> None:
    once = RecordFindings((SlmExchange(),)).corrected(square)
    write_captures(tmp_path / "c.h5", once)
    again = RecordFindings((CameraOrientation("flip_y"),)).corrected(read_captures(tmp_path / "c.h5"))
    write_captures(tmp_path / "c.h5", again)
    first, second = read_captures(tmp_path / "c.h5").corrections
    assert first.startswith("slm_exchange: ") and second.startswith("camera_orientation flip_y: ")
    assert read_captures(tmp_path / "c.h5").levels.tolist() == square.levels[:, ::-1].tolist()


def _thresholds(module: ModuleType) -> list[str]:
    """The public constants of a module that are numbers."""
    return [n for n, v in vars(module).items() if n.isupper() and n[0] != "_" and isinstance(v, int | float)]


def test_every_threshold_states_its_unit_and_evidence() -> None:
    stated: list[str] = []
    for module in (corrections, record_errors, trials):
        source = inspect.getsource(module)
        stated += re.findall(r'^(\w+) = [^\n]+\n"""\[[^\]]+\] [A-Z…].*?Evidence:\s+\S', source, flags=re.DOTALL | re.M)
    every = {name for module in (corrections, record_errors, trials) for name in _thresholds(module)}
    assert every <= set(stated) and len(every) > 20


@pytest.mark.parametrize("camera", ORIENTATIONS)
@pytest.mark.parametrize("is_inverted", [False, True])
def test_what_only_moves_a_far_field_is_told_by_its_pictures(square: Captures, camera: str, is_inverted: bool) -> None:
    """The picture of a pattern of phases is |FFT|², of an odd number of pixels so that its middle is one of them."""
    one = dataclasses.replace(square, levels=square.levels[:, :1], slms=square.slms[:1], focal_length_m=0.1)
    phases = np.random.default_rng(5).uniform(0, 6, (9, 9))

    def picture(pattern: np.ndarray) -> np.ndarray:
        return np.fft.fftshift(np.abs(np.fft.fft2(np.exp(1j * pattern))) ** 2)

    for slm in ORIENTATIONS:
        wrong = turned(phases, slm) * (-1 if is_inverted else 1)
        of_slm = [*([SlmOrientation(0, slm)] if slm != ORIENTATIONS[0] else []), *([SlmInversion(0)] * is_inverted)]
        found = hypothesis([*of_slm, *([CameraOrientation(camera)] if camera != ORIENTATIONS[0] else [])])
        is_alike = np.allclose(picture(wrong), turned(picture(phases), camera), atol=1e-6)
        assert moves_only(found, one) == (is_alike and bool(of_slm)), found


def test_in_a_near_field_both_modulators_and_the_camera_turn_together(square: Captures) -> None:
    """An inverted pattern shows another near field, and one modulator that isn't turned with the other as well."""
    camera, first, second = CameraOrientation("flip_y"), SlmOrientation(0, "flip_y"), SlmOrientation(1, "flip_y")
    assert moves_only((first, second, camera), square)
    half_turn = (SlmInversion(0), SlmInversion(1), CameraOrientation("rotate_180"))
    for found in ((camera,), (first, camera), (first, second), (first, SlmOrientation(1, "flip_x"), camera), half_turn):
        assert not moves_only(found, square)
