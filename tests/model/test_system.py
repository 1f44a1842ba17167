"""The bench as data: what is impossible or contradictory is refused with key, value and remedy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from holoview.light.colour import D65_WHITE, observer_weights
from holoview.light.model.bench_parts import Modulator, Relay, Source
from holoview.light.model.preset import from_table
from holoview.light.model.system import System
from holoview.util.errors import UserError

MODULATOR = {"pitch": "8 um", "shape": [6, 8], "stroke": "825 nm"}
MISSING = object()
NAN = float("nan")


def _table(**changes: Any) -> dict[str, Any]:
    table = {
        "wavelengths": ["460 nm", "532 nm", "638 nm"],
        "amplitudes": [[1.0, 2.0, 3.0]],
        "gap": "2 mm",
        "planes": ["10 mm"],
        "modulators": [MODULATOR, MODULATOR],
    } | changes
    return {key: value for key, value in table.items() if value is not MISSING}


def _modulators(**changes: Any) -> dict[str, Any]:
    changed = {key: value for key, value in (MODULATOR | changes).items() if value is not MISSING}
    return {"modulators": [changed, changed]}


IMPOSSIBLE: list[tuple[dict[str, Any], tuple[str, ...]]] = [
    ({"wavelengths": MISSING}, ("wavelengths: is missing", "Vacuum wavelength")),
    ({"wavelengths": []}, ("wavelengths: ", "(0,)", "at least one length")),
    ({"wavelengths": [NAN]}, ("wavelengths[0]: nan", "between 100 nm and 10000 nm")),
    ({"wavelengths": ["460 nm", "5 nm", "638 nm"]}, ("wavelengths[1]: 5 nm", "between 100 nm and 10000 nm")),
    ({"wavelengths": ["460 nm", "532 nm", "900 nm"]}, ("wavelengths[2]: 900 nm", "390 to 830 nm", 'observer = "mono"')),
    ({"wavelengths": ["460 nm", "532 nm"]}, ("amplitudes: ", "(1, 3)", "(frames, 2)", "together with wavelengths")),
    ({"amplitudes": MISSING}, ("amplitudes: is missing",)),
    ({"amplitudes": []}, ("amplitudes: ", "(0,)", "(frames, 3)")),
    ({"amplitudes": 1.0}, ("amplitudes: 1.0 is not a list", "nested 2 deep")),
    ({"amplitudes": "grey"}, ("amplitudes: ", "grey")),
    ({"amplitudes": [[1, -2, 3]]}, ("amplitudes[0][1]: -2", "between 0 and 1e+12")),
    ({"amplitudes": [[1, NAN, 3]]}, ("amplitudes[0][1]: nan",)),
    ({"amplitudes": [[1, "2 W", 3]]}, ("amplitudes[0][1]: '2 W' is not a number",)),
    ({"amplitudes": [[1, 2, 3], [1, 2]]}, ("amplitudes: ", "[3, 2]", "rows of equal length")),
    ({"amplitudes": [[1, [2, 3], 4]]}, ("amplitudes", "[2, 3]")),
    ({"amplitudes": [[0, 0, 0]]}, ("amplitudes: all are zero", "at least one laser")),
    ({"modulators": MISSING}, ("modulators: is missing",)),
    ({"modulators": []}, ("modulators: 0 of them", "one or two")),
    ({"modulators": [MODULATOR] * 3}, ("modulators: 3 of them", "one or two")),
    ({"modulators": 5}, ("modulators: 5", "[[modulators]]")),
    ({"modulators": [5]}, ("modulators[0]: 5", "pitch, shape, stroke, levels")),
    ({"modulators": [MODULATOR]}, ("gap: 2 mm with one modulator", "no gap", "remove the gap")),
    ({"gap": MISSING}, ("gap: is missing", 'gap = "2 mm"')),
    ({"gap": "-1 mm"}, ("gap: -1 mm", "between 0 mm and")),
    ({"gap": NAN}, ("gap: nan",)),
    ({"gap": "2"}, ('gap: "2" has no unit', "2 mm")),
    ({"modulators": [MODULATOR], "gap": MISSING, "relay1": {"iris_na": 0.1}}, ("relay1: ", "use relay2")),
    ({"modulators": [MODULATOR, MODULATOR | {"pitch": "9 um"}]}, ("modulators: ", "9 um", "equal shape and pitch")),
    ({"modulators": [MODULATOR, MODULATOR | {"shape": [6, 6]}]}, ("modulators: ", "(6, 6)", "equal shape and pitch")),
    (_modulators(pitch=MISSING), ("modulators[0].pitch: is missing",)),
    (_modulators(pitch="0.005 um"), ("modulators[0].pitch: 0.005 um", "between 0.01 um and 1000 um")),
    (_modulators(shape=[1, 8]), ("modulators[0].shape[0]: 1", "from 2 to 16384")),
    (_modulators(shape=[6]), ("modulators[0].shape: [6]", "[rows, columns]")),
    (_modulators(shape=[6, 8.5]), ("modulators[0].shape[1]: 8.5", "whole number")),
    (_modulators(stroke="0 nm"), ("modulators[0].stroke: 0 nm", "between 1 nm and 20000 nm")),
    (_modulators(levels=1), ("modulators[0].levels: 1", "from 2 to 65536")),
    (_modulators(levels=[0, 0.7, 0.3, 1]), ("modulators[0].levels: ", "rise from 0 to 1")),
    (_modulators(levels=[0, 0.5]), ("modulators[0].levels: [0.0, 0.5]", "rise from 0 to 1")),
    (_modulators(levels=[0, NAN, 1]), ("modulators[0].levels[1]: nan",)),
    (_modulators(pich="8 um"), ("modulators[0].pich: unknown key", "did you mean pitch")),
    ({"planes": []}, ("planes: ", "at least one length")),
    ({"planes": ["10 mm", "-1 mm"]}, ("planes[1]: -1 mm", "between 0 mm and")),
    ({"planes": {"first": "1 mm"}}, ("planes: ", "['first']", "first, last and count")),
    ({"planes": {"first": "1 mm", "last": "2 mm", "count": 0}}, ("planes.count: 0", "whole number")),
    ({"relay2": 3}, ("relay2: 3", "iris_na, square, centre_na, dc_block_na")),
    ({"relay2": {"iris_na": 0}}, ("relay2.iris_na: 0", "between 1e-05 and 1")),
    ({"relay2": {"iris_na": 1.5}}, ("relay2.iris_na: 1.5", "between 1e-05 and 1")),
    ({"relay2": {"iris": 0.1}}, ("relay2.iris: unknown key", "did you mean iris_na?")),
    ({"relay2": {"iris_na": 0.02, "dc_block_na": 0.02}}, ("relay2.dc_block_na: 0.02", "less than iris_na = 0.02")),
    ({"relay2": {"square": 0.02, "dc_block_na": 0.0283}}, ("relay2.dc_block_na: 0.0283", "pass = 0.0282843")),
    ({"relay2": {"square": "first order at 600 nm", "dc_block_na": 0.0531}}, ("relay2.dc_block_na", "pass = 0.0530")),
    ({"relay2": {"iris_na": 0.01, "centre_na": [0, 0.01], "dc_block_na": 0.02}}, ("dc_block_na: 0.02", "pass = 0.02")),
    ({"relay1": {"aberration": {"Z4": "50 nm"}}}, ("relay1.aberration: without an iris", "give iris_na")),
    ({"relay2": {"iris_na": 0.02, "aberration": {"Z38": "5 nm"}}}, ('relay2.aberration: "Z38"', "Z1 to Z37")),
    ({"relay2": {"iris_na": 0.02, "aberration": {"Z²": "5 nm"}}}, ('relay2.aberration: "Z²"', "Z1 to Z37")),
    ({"relay2": {"iris_na": 0.02, "aberration": {"Z4": 1.0}}}, ("relay2.aberration.Z4: ", "between")),
    ({"relay2": {"iris_na": 0.02, "aberration": [4, 5]}}, ("relay2.aberration", "Z4")),
    ({"source": {"directions": [[0, 0, 0]]}}, ("source.directions: ", "(1, 3)", "[y, x]")),
    ({"source": {"directions": [[0, "2 rad"]]}}, ("source.directions[0][1]: 2000 mrad", "between -1000 mrad")),
    ({"source": {"directions": [[0, "2 mm"]]}}, ("source.directions[0][1]: ", '"mm"', "mrad")),
    ({"source": {"tilts": [[0, 0]]}}, ("source.tilts: 1 rows", "3 wavelengths")),
    ({"source": {"grid": [3, 3]}}, ("source.grid: [3, 3]", "grid and spacing together")),
    ({"source": {"grid": [3], "spacing": "5 mrad"}}, ("source.grid: [3]", "[rows, columns]")),
    ({"sampling": {"upsample": 0}}, ("sampling.upsample: 0", "from 1 to 16")),
    ({"sampling": {"upsample": 1.5}}, ("sampling.upsample: 1.5", "whole number")),
    ({"sampling": {"propagation": "linar"}}, ('sampling.propagation: "linar"', '"linear"')),
    ({"observer": "cat"}, ('observer: "cat"', '"eye"', '"mono"')),
    ({"name": 3}, ("name: 3 is not text",)),
    ({"wavelenghts": []}, ("wavelenghts: unknown key", "did you mean wavelengths")),
    ({"sequence": [[1, 0, 0]]}, ("sequence: without white balance", 'amplitudes = "white"')),
    ({"amplitudes": "white", "sequence": [[1, 0]]}, ("sequence: ", "(1, 2)", "(frames, 3)")),
    ({"amplitudes": "white", "sequence": np.eye(3).tolist(), "frames": 2}, ("sequence: ", "(3, 3)")),
    ({"amplitudes": "white", "frames": 0}, ("frames: 0", "whole number")),
    ({"amplitudes": "white", "wavelengths": []}, ("wavelengths", "at least one")),
    ({"single": "false"}, ("single", "'false'")),
]


@pytest.mark.parametrize(("change", "fragments"), IMPOSSIBLE, ids=lambda x: x[0] if isinstance(x, tuple) else "")
def test_an_impossible_bench_is_refused_with_key_value_and_remedy(
    change: dict[str, Any], fragments: tuple[str, ...]
) -> None:
    with pytest.raises(UserError) as caught:
        from_table(_table(**change))
    message = str(caught.value)
    assert "\n" not in message
    for fragment in fragments:
        assert fragment in message


def test_an_observer_without_an_eye_may_look_at_infrared() -> None:
    system = from_table(_table(wavelengths=["1550 nm"], amplitudes=[1], observer="mono"))
    assert system.wavelengths_m.tolist() == [1550e-9]


def test_one_laser_one_frame_and_one_plane_may_be_written_without_lists() -> None:
    system = from_table(_table(wavelengths="532 nm", amplitudes=[1], planes="10 mm"))
    assert system.wavelengths_m.shape == (1,)
    assert system.amplitudes.shape == (1, 1)
    assert system.planes_m.tolist() == [0.01]


def test_a_ramp_is_equally_spaced_and_includes_both_ends() -> None:
    system = from_table(_table(planes={"first": "9 mm", "last": "11 mm", "count": 5}))
    np.testing.assert_array_equal(system.planes_m, np.linspace(9e-3, 11e-3, 5))


def test_a_number_of_levels_means_equal_steps_over_the_stroke() -> None:
    system = from_table(_table(**_modulators(levels=4)))
    np.testing.assert_array_equal(system.modulators[0].levels, np.linspace(0, 1, 4))


def test_arrays_of_a_system_are_frozen_and_not_shared_with_the_caller() -> None:
    directions = np.zeros((2, 2))
    source = Source(directions_rad=directions)
    system = from_table(_table(**_modulators(levels=4)))
    for array in (system.wavelengths_m, system.amplitudes, system.planes_m, system.modulators[0].levels):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    directions[0] = 0.5
    assert not source.directions_rad.any()


def test_systems_are_equal_and_hash_alike_by_value() -> None:
    one, two = from_table(_table()), from_table(_table())
    assert one == two
    assert hash(one) == hash(two)
    assert len({one, two, one.edit({"gap": "3 mm"})}) == 2


@pytest.mark.parametrize(
    "change",
    [{"gap": "3 mm"}, {"planes": ["9 mm"]}, {"relay2.iris_na": 0.1}, {"levels": 4}, {"name": "other"}, {"frames": 2}],
)
def test_any_difference_makes_systems_unequal(change: dict[str, Any]) -> None:
    system = from_table(_table())
    assert system.edit(change) != system
    assert Modulator(8e-6, (6, 8), 825e-9) != Relay()


def test_the_drive_has_a_pattern_for_every_frame_and_modulator() -> None:
    system: System = from_table(_table(amplitudes=[[1, 0, 0], [0, 1, 1]]))
    assert system.frames == 2
    assert system.drive_shape == (2, 2, 6, 8)


# --- edits ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", ["3 mm", 3e-3, np.float64(3e-3), np.float32(3e-3)])
def test_an_edit_takes_peoples_text_or_si_numbers(value: Any) -> None:
    assert from_table(_table()).with_(gap=value).gap_m == pytest.approx(3e-3, rel=1e-7)


def test_an_edit_leaves_the_original_and_every_other_key_alone() -> None:
    system = from_table(_table())
    edited = system.edit({"relay2.iris_na": 0.1, "modulators.0.stroke": "700 nm"})
    assert system == from_table(_table())
    assert edited.relay2 == Relay(iris_na=0.1)
    assert [modulator.stroke_m for modulator in edited.modulators] == [700e-9, 825e-9]
    assert edited.edit({"relay2.iris_na": None, "modulators.0.stroke": "825 nm"}) == system


def test_keys_of_a_modulator_without_index_change_every_modulator() -> None:
    edited = from_table(_table()).with_(pitch="4 um", shape=[4, 10], stroke="700 nm", levels=16, upsample=3)
    assert edited.modulators[0] == edited.modulators[1]
    assert edited.modulators[0].shape == (4, 10)
    assert edited.modulators[0].levels is not None and len(edited.modulators[0].levels) == 16
    assert edited.sampling.upsample == 3


DEPENDENT: list[dict[str, Any]] = [
    {"wavelengths": ["460 nm", "640 nm"], "amplitudes": [[1, 2], [3, 4]]},
    {"wavelengths": ["900 nm"], "amplitudes": [[1]], "observer": "mono"},
    {"relay2.dc_block_na": 0.2, "relay2.iris_na": 0.3, "relay2.aberration": {"Z4": "50 nm"}},
    {"relay2.aberration.Z4": "50 nm", "relay2.iris_na": 0.3},
    {"relay2": {"iris_na": 0.3}, "relay2.dc_block_na": 0.2},
    {"modulators": [MODULATOR], "gap": None},
    {"modulators": [MODULATOR], "gap": None, "pitch": "9 um"},
    {"modulators.0.pitch": "9 um", "modulators.1.pitch": "9 um"},
]


@pytest.mark.parametrize("changes", DEPENDENT, ids=lambda changes: " ".join(changes))
def test_changes_that_depend_on_each_other_are_applied_together_in_any_order(changes: dict[str, Any]) -> None:
    system = from_table(_table())
    assert system.edit(changes) == system.edit(dict(reversed(changes.items())))


@pytest.mark.parametrize(
    ("changes", "fragments"),
    [
        ({"gapp": 1}, ("gapp: unknown key", "did you mean gap?")),
        ({"relay2.iriss_na": 1}, ("relay2.iriss_na: unknown key", "did you mean iris_na?")),
        ({"zzz": 1}, ("zzz: unknown key", "known: amplitudes", "wavelengths")),
        ({"gap": "-1 mm"}, ("gap: -1 mm",)),
        ({"gap.x": 1}, ("gap.x: unknown key", "gap has no parts")),
        ({"modulators.5.pitch": "9 um"}, ("modulators.5.pitch: unknown key", "modulators.0 to modulators.1")),
        ({"modulators.².pitch": "9 um"}, ("modulators.².pitch: unknown key", "modulators.0 to modulators.1")),
        ({"modulators.1.pitch": "9 um"}, ("modulators: ", "equal shape and pitch")),
        ({"modulators.1.levels": 1}, ("modulators.1.levels: 1", "whole number")),
        ({"wavelengths": ["460 nm"]}, ("amplitudes: ", '"white"')),
        ({"amplitudes": "grey"}, ('amplitudes: "grey"', '"white"')),
        ({"frames": 0}, ("frames: 0", "whole number")),
        ({"frames": 2, "amplitudes": [[1, 2, 3], [3, 2, 1]]}, ("frames: 2", "equal amplitudes")),
        ({"frames": 2, "amplitudes": [["a", "b", "c"]]}, ("amplitudes", "'a' is not a number")),
    ],
    ids=lambda x: x[0] if isinstance(x, tuple) else "",
)
def test_an_impossible_edit_is_refused_with_key_and_remedy(changes: dict[str, Any], fragments: tuple[str, ...]) -> None:
    with pytest.raises(UserError) as caught:
        from_table(_table()).edit(changes)
    for fragment in fragments:
        assert fragment in str(caught.value)


def test_white_balances_the_lasers_in_the_frames_in_which_they_are_on() -> None:
    sequential = from_table(_table(amplitudes=np.eye(3).tolist()))
    white = sequential.with_(amplitudes="white").amplitudes
    together = sequential.with_(amplitudes="white", frames=1).amplitudes
    np.testing.assert_allclose(white, 3 * np.diag(together[0]), rtol=1e-9)
    weights = observer_weights("eye", sequential.wavelengths_m)
    np.testing.assert_allclose(white.mean(axis=0) @ weights, D65_WHITE, atol=1e-9)


def test_frames_repeat_the_amplitudes_and_a_new_table_may_come_with_them() -> None:
    system = from_table(_table())
    np.testing.assert_array_equal(system.with_(frames=3).amplitudes, [[1, 2, 3]] * 3)
    np.testing.assert_array_equal(system.with_(frames=2, amplitudes=[3, 2, 1]).amplitudes, [[3, 2, 1]] * 2)
    assert from_table(_table(frames=2)) == system.with_(frames=2)


def test_a_grid_of_sources_is_centred_on_the_axis() -> None:
    grid = from_table(_table()).with_(source={"grid": [1, 3], "spacing": "8 mrad"}).source
    np.testing.assert_allclose(grid.directions_rad, [[0, -8e-3], [0, 0], [0, 8e-3]], atol=1e-18)
