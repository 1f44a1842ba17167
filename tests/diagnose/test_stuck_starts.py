"""The residuals show which columns, rows and pixels of which modulator are stuck, and at which level."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

import numpy as np
import pytest

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.virtual_measurement import AcquisitionSettings
from holoview.bench.captures.virtual_measurement import make_captures as measure
from holoview.bench.diagnose import screening
from holoview.bench.diagnose.report.error_places import find_pixel_maps, flicker_notes, line_notes
from holoview.bench.diagnose.search_context import SearchContext
from holoview.bench.diagnose.starts.stuck import (
    LINE_SEGMENTS,
    DeadPlace,
    Shows,
    StuckStarts,
    as_values,
    is_stuck_effect,
    likely_span,
    spans_near,
)
from holoview.bench.diagnose.starts.transmission_slopes import line_gains, replacement_gains, significance
from holoview.light.model.effects.registry import listed_effects
from holoview.light.model.system import System
from tests.diagnose.conftest import MakeContext, make_context_of
from tests.explored import explored

EFFECTS = ("slm1_stuck", "slm2_stuck")


def _starts(context: SearchContext) -> StuckStarts:
    error = context.relative_model_error({})
    return StuckStarts(context, {}, context.tolerant_comparison(context.split.coarse, error))


def _most_unlike(context: SearchContext, row: int, column: int) -> float:
    """The level of a pixel of modulator 2 that changes its light most where it does least, in the smooth captures.

    A pixel that shows nearly what its patterns have there anyway stands out of nothing: one draw in five.
    """
    captures, some = context.data.captures, context.split.coarse
    levels, turns = np.linspace(0.0, 1.0, 16), captures.slms[1].opd_range_m / captures.wavelength_m[some]
    away = levels[:, None] - captures.levels[some, 1, row, column] / 15
    return float(levels[np.abs(np.exp(2j * np.pi * turns * away) - 1).min(axis=1).argmax()])


@pytest.mark.parametrize("seed", range(3))
def test_light_on_part_of_the_modulator_alone_makes_no_line_stand_out(seed: int) -> None:
    """Of 400 lines 120 get light, and gain at random: the largest of so many is below 5 deviations but for 1 seed in
    10 000, and robust deviations of 120 values scatter by 11 %. One that gains 30 deviations stands out by about that.
    """
    random = np.random.default_rng(seed)
    gains = 1e-18 * random.normal(size=(2, 400))
    gains[:, 100:220] = 1e3 * random.normal(size=(2, 120))
    assert significance(gains).max() < 5 * 1.6
    gains[0, 150] = 3e4
    assert significance(gains)[0].argmax() == 150
    assert 30 / 1.6 < significance(gains)[0, 150] < 30 * 1.6


def test_nothing_stands_out_among_a_few_that_get_light() -> None:
    """A small beam lights three of 48 rows: they have no neighbours to be compared with."""
    gains = np.zeros((2, 48))
    gains[:, 20:23] = [[3.0, 9.0, 2.0], [4.0, 5.0, 4.0]]
    assert not significance(gains).any()


@pytest.mark.parametrize(
    ("name", "true"),
    [
        pytest.param(
            "slm1_stuck", {"columns": (9, 10, 31), "column_levels": (0.8, 0.25, 0.6)}, marks=pytest.mark.explores
        ),
        ("slm2_stuck", {"rows": (12,), "row_levels": (0.4,), "pixel_rows": (22,), "pixel_columns": (17,)}),
    ],
)
def test_the_start_is_what_is_stuck_at_the_level_that_it_shows(
    make_context: MakeContext, context: SearchContext, name: str, true: dict[str, Any]
) -> None:
    """On the true modulator alone. Levels to a fiftieth of the stroke, from where a fit converges."""
    if "pixel_rows" in true:
        true = true | {"pixel_levels": (_most_unlike(context, 22, 17),)}
    context = make_context({name: true})
    starts = _starts(context)
    (found,) = starts(context.effects[name])
    complete = listed_effects()[name].parameter_values(true)
    for key in ("columns", "rows", "pixel_rows", "pixel_columns"):
        assert found[key] == complete[key]
    assert found["column_levels"] == pytest.approx(complete["column_levels"], abs=0.02)
    assert found["row_levels"] == pytest.approx(complete["row_levels"], abs=0.02)
    (other,) = {*EFFECTS} - {name}
    assert starts(context.effects[other]) == []


@pytest.mark.long
@pytest.mark.parametrize(
    "faults", explored([{"gap": {"gap_error": 2e-4}}, {}, {"stroke": {"stroke_error": 0.1}}], 1), ids=str
)
def test_where_nothing_is_stuck_there_is_no_start(make_context: MakeContext, faults: dict[str, Any]) -> None:
    context = make_context(faults)
    starts = _starts(context)
    assert [name for name, effect in context.effects.items() if starts(effect)] == []


def test_the_gain_is_the_slope_of_chi2_towards_a_level(make_context: MakeContext) -> None:
    """Of pixels whose path is moved a little: against differences of predictions, in single precision.

    The third derivative leaves a share of the slopes of step²: 0.0012 of their norm with four draws, where one slope
    alone may be near 0. The costs are sums of 5 000 rounded squares.
    """
    context, step = make_context({"gap": {"gap_error": 1e-4}}), 0.005
    comparison = context.data_weighted_comparison(context.split.coarse[:1], 0.0)
    drive = context.data.captures.drive(int(comparison.indices[0]))[0]
    slopes, differences = [], []
    for y, x in ((6, 8), (6, 31), (14, 20), (22, 8), (22, 20), (22, 31)):
        ends = float(drive[y, x]) + np.array([-step, step])
        pixels = ({"pixel_rows": (y,), "pixel_columns": (x,), "pixel_levels": (float(end),)} for end in ends)
        low, high = (float(comparison.fit_gains({"slm1_stuck": pixel}).squares.sum()) for pixel in pixels)
        gains = replacement_gains(context, {}, comparison, ends)[0][:, y, x]
        slopes.append(gains[0] - gains[1])
        differences.append(high - low)
    assert np.linalg.norm(np.subtract(slopes, differences)) < 0.02 * np.linalg.norm(differences)


def test_a_line_that_gains_in_one_place_alone_does_not_stand_out() -> None:
    gains = np.random.default_rng(0).standard_normal((3, 64, 50))
    gains[1, 20:26, 7] += 30.0
    gains[1, :, 33] += 2.0
    columns = significance(line_gains(gains, 1, LINE_SEGMENTS))
    assert int(columns[1].argmax()) == 33 and abs(columns[1, 7]) < 4


@pytest.mark.parametrize(("first", "last"), [(0, 17), (21, 39), (0, 39)])
def test_the_part_of_a_line_that_gains_ends_where_the_gain_does(first: int, last: int) -> None:
    gains = np.random.default_rng(1).standard_normal(40)
    gains[first : last + 1] += 5.0
    assert likely_span(gains) == (first, last)


def test_ends_of_parts_are_moved_within_the_line() -> None:
    assert list(spans_near((15, 31), 32, (-2, 1, 20))) == [(13, 31), (16, 31)]
    assert list(spans_near((0, 13), 32, (-1, 18))) == [(0, 12)]  # (0, 31) is the whole line


def test_stuck_pixels_are_looked_for_only_where_an_effect_has_them(
    make_context: MakeContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Looking takes seconds, and a fit of another effect over its range made a fit of a moment long."""
    context = make_context({"stroke": {"stroke_error": 0.3}})
    looked: list[str] = []
    monkeypatch.setattr(screening, "StuckStarts", lambda *_: looked.append("for stuck pixels") or (lambda effect: []))
    screening.fit_over_range(context, {}, context.effects["camera_gamma"], [])
    assert looked == []
    screening.fit_over_range(context, {}, context.effects["slm1_stuck"], [])
    assert looked == ["for stuck pixels"]


def test_lists_hold_each_place_in_order_as_what_it_is() -> None:
    places = [
        DeadPlace(4, None, 0.2),
        DeadPlace(None, 9, 0.3, span=(5, 31)),
        DeadPlace(None, 7, shows=Shows.BEFORE),
        DeadPlace(None, 8, 0.6),
        DeadPlace(2, 3, 0.7),
        DeadPlace(6, None, shows=Shows.FIRST),
    ]
    values = {name: own for name, own in as_values(places).items() if own}
    parts = {"part_first_rows": (5,), "part_last_rows": (31,), "part_first_columns": (9,), "part_last_columns": (9,)}
    lines = {"columns": (8,), "column_levels": (0.6,), "rows": (4,), "row_levels": (0.2,)}
    pixels = {"pixel_rows": (2,), "pixel_columns": (3,), "pixel_levels": (0.7,)}
    assert values == {**parts, **lines, **pixels, "part_levels": (0.3,), "kept_rows": (6,), "late_columns": (7,)}
    assert is_stuck_effect(listed_effects()["slm2_stuck"]) and not is_stuck_effect(listed_effects()["stage"])


def test_pixel_maps_show_the_line(make_context: MakeContext) -> None:
    context = make_context({"slm1_stuck": {"columns": (24,), "column_levels": (0.7,)}})
    first, second = find_pixel_maps(context, {})
    assert int(first.columns.argmax()) == 24 and first.columns.max() > second.columns.max()
    assert first.pixels.shape == context.data.captures.levels.shape[2:]
    (note,) = line_notes((first, second))
    assert "column 24 of modulator 1 (" in note
    faint = dataclasses.replace(first, columns=first.columns * 1e-6, rows=first.rows * 1e-6)
    assert line_notes((faint,)) == line_notes(()) == []
    assert flicker_notes(context, {}, (faint,)) == flicker_notes(context, {}, ()) == []


@pytest.mark.long
@pytest.mark.parametrize("changes", [True, False])
def test_a_column_whose_levels_change_from_capture_to_capture_is_told_from_one_that_keeps_its_level(
    nominal: Captures, changes: bool
) -> None:
    """Pictures without noise. Phasors of levels at random have a mean of modulus 0.4 ± 0.02 over all pixels."""
    count, _, rows, _ = nominal.levels.shape
    levels, rng = nominal.levels.copy(), np.random.default_rng(3)
    levels[:, 1, :, 17] = rng.integers(0, 16, (count, rows)) if changes else 6
    light = Predictor(dataclasses.replace(nominal, levels=levels))(np.arange(count), {}).signal.numpy()
    black, top = nominal.camera.black_level, nominal.camera.saturation
    images = np.rint(black + 0.75 * (top - black) * light / light.max(axis=(1, 2), keepdims=True))
    context = make_context_of(dataclasses.replace(nominal, images=images.astype(np.uint16)))
    (note,) = flicker_notes(context, {}, find_pixel_maps(context, {}))
    assert note.startswith("Column 17 of modulator 2 shows levels ")
    assert ("change from capture to capture" in note) is changes


PANEL = {"kind": "phase", "pitch": "8 um", "shape": [24, 32], "stroke": "825 nm", "levels": 16}
STOPPED = {"kind": "space", "distance": "1 mm", "iris_na": 0.03}
FILTER = {"kind": "amplitude", "name": "filter", "pitch": "8 um", "shape": [24, 32], "levels": 16}
LENS = {"kind": "fourier", "name": "lens", "focal_length": "2.4 mm"}
LAST = {"kind": "space", "iris_na": 0.03}


def _chain(*elements: dict[str, Any]) -> System:
    return System(["450 nm", "600 nm"], [[1.0, 1.0]], elements=[*elements, LAST], planes_m=["3 mm"], observer="mono")


@pytest.mark.long
@pytest.mark.parametrize("place", [STOPPED, LENS], ids=["behind a space", "in the Fourier plane"])
@pytest.mark.parametrize("name", ["phase", "filter"])
@pytest.mark.parametrize("changes", [True, False])
def test_a_line_of_an_element_of_a_chain_is_told_by_its_name(place: dict[str, Any], name: str, changes: bool) -> None:
    line = 21
    captures = measure(_chain(PANEL, place, FILTER), {}, AcquisitionSettings(captures_per_condition=6, seed=5))
    number, levels, rng = ["phase", "filter"].index(name), captures.levels.copy(), np.random.default_rng(3)
    rows = captures.chain.drive_shapes[name][1]  # type: ignore[union-attr]
    levels[:, number, :rows, line] = rng.integers(0, 16, (len(captures), rows)) if changes else 6
    light = Predictor(dataclasses.replace(captures, levels=levels))(np.arange(len(captures)), {}).signal.numpy()
    black, top = captures.camera.black_level, captures.camera.saturation
    images = np.rint(black + 0.75 * (top - black) * light / light.max(axis=(1, 2), keepdims=True))
    context = make_context_of(dataclasses.replace(captures, images=images.astype(np.uint16)))
    maps = find_pixel_maps(context, {})
    assert [(one.name, one.pixels.shape) for one in maps] == [("phase", (24, 32)), ("filter", (24, 32))]
    assert int(maps[number].columns.argmax()) == line
    (note,) = line_notes(maps)
    assert f" of {name} (" in note
    (note,) = flicker_notes(context, {}, maps)  # lines beside it, and those through the middle, may be free, too
    assert re.match(rf"Columns? .*\b{line}\b.* of {name} shows? levels ", note), note
    assert ("change from capture to capture" in note) is changes
