"""Stuck pixels show their level whatever is sent, in any part of either modulator, and are told in words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.light.effects.slm_stuck import describe_levels
from holoview.light.engine.frame import compute_focal_stack
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.model import preset
from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.light.model.effects.registry import get_effect
from holoview.light.model.plan import make_plan
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.util.errors import UserError

Make = Callable[..., Captures]
STUCK = {
    "columns": (2, 27),
    "column_levels": (5 / 15, 9 / 15),
    "rows": (19,),
    "row_levels": (0.2,),
    "pixel_rows": (4, 5),
    "pixel_columns": (11, 11),
    "pixel_levels": (1.0,),
}


def test_captures_are_those_of_patterns_that_hold_the_levels(make_session: Make) -> None:
    """Of 16 levels, so that 5 is a third of the stroke. Where lines cross, the column is seen."""
    captures = make_session(1)
    levels = captures.levels.copy()
    levels[:, 0, 19], levels[:, 0, 4:6, 11] = 3, 15
    levels[:, 0, :, 2], levels[:, 0, :, 27] = 5, 9
    found = Predictor(captures, double_precision=True)([0], {"slm1_stuck": STUCK}).signal
    expected = Predictor(replace(captures, levels=levels), double_precision=True)([0]).signal
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-12)


def test_parts_of_lines_hold_their_level_and_the_rest_is_as_sent(make_session: Make) -> None:
    """A column from row 12 on, and a rectangle across the corner; a last row beyond the edge is the edge."""
    captures = make_session(1)
    levels = captures.levels.copy()
    levels[:, 0, 12:, 5], levels[:, 0, :2, 25:] = 6, 9
    parts = {
        "part_first_rows": (12, 0),
        "part_last_rows": (65535, 1),
        "part_first_columns": (5, 25),
        "part_last_columns": (5, 27),
        "part_levels": (0.4, 0.6),
    }
    found = Predictor(captures, double_precision=True)([0], {"slm1_stuck": parts}).signal
    expected = Predictor(replace(captures, levels=levels), double_precision=True)([0]).signal
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-12)


def test_lines_show_the_first_pattern_or_the_one_before(make_session: Make) -> None:
    """Also of captures that were taken out of their session."""
    captures = make_session(3)
    sent, levels = captures.levels, captures.levels.copy()
    levels[:, 0, 7], levels[:, 0, :, 3] = sent[0, 0, 7], sent[0, 0, :, 3]
    levels[1:, 0, 12], levels[1:, 0, :, 20] = sent[:2, 0, 12], sent[:2, 0, :, 20]
    levels[1:, 0, 7, 20] = sent[0, 0, 7, 20]  # where lines cross, the one that keeps the first pattern is seen
    levels[:, 0, 12, 3] = sent[0, 0, 12, 3]
    stuck = {"slm1_stuck": {"kept_rows": (7,), "kept_columns": (3,), "late_rows": (12,), "late_columns": (20,)}}
    found = Predictor(captures, double_precision=True)([0, 1, 2], stuck).signal
    expected = Predictor(replace(captures, levels=levels), double_precision=True)([0, 1, 2]).signal
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-12)
    part = captures.subset([2, 1]).subset([1, 0])
    assert torch.equal(Predictor(part, double_precision=True)([0, 1], stuck).signal, found[1:])


def test_frames_keep_the_first_one_and_show_the_one_before() -> None:
    """Of three frames that repeat, so that the one before the first is the last."""
    lines = {"effects.slm1_stuck.kept_rows": [2], "effects.slm1_stuck.late_rows": [5]}
    system = hv.load("holochrome-8").edit({"shape": [8, 12], "amplitudes": [[1.0] * 8] * 3})
    drive = np.random.default_rng(0).random(system.drive_shape)
    shown = drive.copy()
    shown[:, 0, 2], shown[:, 0, 5] = drive[0, 0, 2], np.roll(drive[:, 0, 5], 1, axis=0)
    plans = make_plan(system.edit(lines)), make_plan(system)
    one, two = (
        compute_focal_stack(TorchExecutor(plan, FrameInputs(plan, sent)))[1]
        for plan, sent in zip(plans, (drive, shown), strict=True)
    )
    assert one == pytest.approx(two, rel=1e-4, abs=1e-5 * float(np.max(two)))  # complex64


def test_a_rectangle_needs_all_its_sides(make_session: Make) -> None:
    with pytest.raises(UserError, match="1 part_first_rows, 0 part_last_rows"):
        Predictor(make_session(1))([0], {"slm1_stuck": {"part_first_rows": (3,)}})


def test_an_observer_sees_nothing_of_what_is_sent_to_a_dead_line() -> None:
    changes = {"shape": [8, 12], "effects.slm1_stuck.columns": [3], "effects.slm1_stuck.column_levels": [0.4]}
    system = hv.load("holochrome-8").edit(changes)
    drive = np.random.default_rng(0).random(system.drive_shape)
    other = drive.copy()
    other[:, 0, :, 3] = 0.9
    plan = make_plan(system)
    one, two = (compute_focal_stack(TorchExecutor(plan, FrameInputs(plan, sent)))[1] for sent in (drive, other))
    assert np.array_equal(one, two)


def test_a_part_of_the_modulator_counts_from_the_edge_of_the_whole() -> None:
    effect, whole = get_effect("slm1_stuck"), (20, 28)
    v = effect.parameter_values(STUCK)
    sent = torch.rand(whole, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    shown = effect.stroke_response(sent, ModulatorContext(0, 520e-9, 780e-9, 8e-6, whole, 1), v)
    middle = ModulatorContext(0, 520e-9, 780e-9, 8e-6, (14, 24), 1, frame=whole)
    assert torch.equal(effect.stroke_response(sent[3:17, 2:26], middle, v), shown[3:17, 2:26])


def test_the_last_level_holds_for_all_that_have_none() -> None:
    effect, at = get_effect("slm1_stuck"), ModulatorContext(0, 520e-9, 780e-9, 8e-6, (4, 6), 1)
    v = effect.parameter_values({"rows": (0, 2, 3), "row_levels": (0.1, 0.7)})
    shown = effect.stroke_response(torch.full((4, 6), 0.5), at, v)
    assert shown[:, 0].tolist() == pytest.approx([0.1, 0.5, 0.7, 0.7])


def test_presets_hold_lists_and_the_command_line_takes_text() -> None:
    system = hv.load("holochrome-8").edit(
        {"effects.slm1_stuck.columns": "3, 40", "effects.slm1_stuck.column_levels": [0.25]}
    )
    assert system.effect_values["slm1_stuck"] == {"columns": (3, 40), "column_levels": (0.25,)}
    assert preset.loads(preset.dumps(system)).effect_values == system.effect_values


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"columns": [-1]}, r"columns\[0\]"),
        ({"columns": [1.5]}, r"columns\[0\]"),
        ({"columns": "left"}, "numbers, with commas"),
        ({"row_levels": [0.5, 3.0]}, r"row_levels\[1\].*3 is out of range"),
        ({"row_levels": [float("nan")]}, r"row_levels\[0\]"),
    ],
)
def test_what_no_modulator_has_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(UserError, match=words):
        hv.load("holochrome-8").edit({f"effects.slm1_stuck.{key}": value for key, value in changes.items()})


SIDES = {"part_first_rows": (0,), "part_last_rows": (0,), "part_first_columns": (0,), "part_last_columns": (0,)}


@pytest.mark.parametrize(
    ("values", "key"),
    [
        *(
            ({f"{name}{lines}": (0, places)}, f"{name}{lines}")
            for name in ("", "kept_", "late_")
            for lines, places in (("rows", 8), ("columns", 12))
        ),
        ({"pixel_rows": (8,), "pixel_columns": (0,)}, "pixel_rows"),
        ({"pixel_rows": (0,), "pixel_columns": (12,)}, "pixel_columns"),
        (SIDES | {"part_first_rows": (8,), "part_last_rows": (9,)}, "part_first_rows"),
        (SIDES | {"part_first_columns": (12,), "part_last_columns": (65535,)}, "part_first_columns"),
    ],
)
@pytest.mark.parametrize("number", [0, 1])
def test_places_beyond_the_modulator_are_refused(number: int, values: dict[str, Any], key: str) -> None:
    """Also where only its middle is computed; the last row and column are inside."""
    effect, sent = get_effect(f"slm{number + 1}_stuck"), torch.full((6, 10), 0.5)
    at = ModulatorContext(number, 520e-9, 780e-9, 8e-6, (6, 10), 1, frame=(8, 12))
    with pytest.raises(UserError, match=rf"^{key}: .* modulator {number + 1} has 8 rows and 12 col"):
        effect.stroke_response(sent, at, effect.parameter_values(values))
    inside = {name: tuple(min(n, 11 if "columns" in name else 7) for n in places) for name, places in values.items()}
    effect.stroke_response(sent, at, effect.parameter_values(inside))


def test_a_pixel_needs_a_row_and_a_column(make_session: Make) -> None:
    with pytest.raises(UserError, match="2 pixel_rows, 1 pixel_columns"):
        Predictor(make_session(1))([0], {"slm1_stuck": {"pixel_rows": (1, 2), "pixel_columns": (3,)}})


def test_modulator_2_holds_its_levels(make_session: Callable[..., Captures]) -> None:
    captures = make_session(1)
    levels = captures.levels.copy()
    levels[:, 1, :, 6] = 12
    stuck = {"slm2_stuck": {"columns": (6,), "column_levels": (0.8,)}}
    found = Predictor(captures, double_precision=True)([0], stuck).signal
    expected = Predictor(replace(captures, levels=levels), double_precision=True)([0]).signal
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"columns": (70,), "column_levels": (0.3,)}, "Column 70 of modulator 2 is stuck at 0.3 of full drive"),
        ({"columns": (9, 4, 5, 6)}, "Columns 4 to 6 and 9 of modulator 2 are stuck at 0 of full drive"),
        (
            {"rows": (8,), "row_levels": (0.2,), "columns": (1, 2), "column_levels": (0.4, 0.6)},
            "Columns 1 and 2 and row 8 of modulator 2 are stuck at 0.2 to 0.6 of full drive",
        ),
        (
            {"pixel_rows": (5, 5, 6, 9), "pixel_columns": (7, 8, 9, 1), "pixel_levels": (0.5,)},
            "4 pixels (rows 5 and 6, columns 7 to 9; row 9, column 1) of modulator 2 are stuck at 0.5",
        ),
        ({"column_levels": (0.5,)}, "No pixels of modulator 2"),
        (
            {
                "part_first_rows": (48,),
                "part_last_rows": (95,),
                "part_first_columns": (70,),
                "part_last_columns": (70,),
                "part_levels": (0.3,),
            },
            "Rows 48 to 95 of column 70 of modulator 2 are stuck at 0.3 of full drive, whatever is sent (",
        ),
        ({"kept_rows": (41,)}, "Row 41 of modulator 2 shows the first pattern of all instead of what is sent ("),
        (
            {"rows": (8,), "row_levels": (0.2,), "late_columns": (3, 9)},
            "0.2 of full drive, whatever is sent; columns 3 and 9 of modulator 2 show the pattern before instead of",
        ),
    ],
)
def test_it_is_told_in_words(values: dict[str, Any], words: str) -> None:
    assert words in get_effect("slm2_stuck").format_finding(hv.load("holochrome-8"), values)


def test_a_level_of_almost_nothing_is_nothing() -> None:
    assert describe_levels([-1.7e-5, 1.0]) == "0 to 1"
