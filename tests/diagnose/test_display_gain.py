"""What knowing a fault buys on the display, and the bench with causes switched on."""

from __future__ import annotations

import io

import pytest
from PIL import Image

from holoview.bench.diagnose.extended_model import add_effect_values, extended_system, with_preset_geometry
from holoview.bench.diagnose.report.display_gain import display_gain
from holoview.util.errors import UserError
from tests.diagnose.conftest import pictures, small_system

GAP = {"gap": {"gap_error": 0.5e-3}}


def test_a_hologram_made_for_the_bench_as_it_is_looks_better_there() -> None:
    found = display_gain(small_system(), {}, GAP, iterations=8)
    assert found is not None and found.iterations == 8
    assert found.gain_db > 0.5 and found.gain_db == found.extended_db - found.nominal_db
    with Image.open(io.BytesIO(found.sheet)) as sheet:
        assert sheet.width > 3 * 360


def test_what_only_the_camera_does_buys_nothing() -> None:
    assert display_gain(small_system(), {}, {"camera_gamma": {"exponent": 0.2}}, iterations=1) is None
    assert display_gain(small_system(), GAP, {}, iterations=1) is None


def test_errors_add_to_what_is_known_and_stay_in_bounds() -> None:
    known = {"gap": {"gap_error": 1e-4}, "lut": {"gamma1": 1.2}}
    found = {"gap": {"gap_error": 2e-4}, "lut": {"gamma1": 1.1}, "stroke": {"stroke_error": 0.1}}
    both = add_effect_values(known, found)
    assert both["gap"]["gap_error"] == pytest.approx(3e-4)
    assert both["lut"]["gamma1"] == pytest.approx(1.3)  # from the identity, 1
    assert both["stroke"] == {"stroke_error": 0.1} and known["gap"]["gap_error"] == 1e-4
    assert add_effect_values({"gap": {"gap_error": 4e-3}}, {"gap": {"gap_error": 4e-3}})["gap"]["gap_error"] == 5e-3


def test_an_extended_bench_has_the_causes_on_and_its_nominal_geometry() -> None:
    system = extended_system(small_system(), GAP)
    assert system.effect_values["gap"]["gap_error"] == 0.5e-3 and system.gap_m == 1e-3
    assert extended_system(small_system(), {}) == small_system()


def test_a_preset_gives_the_geometry_and_what_is_known() -> None:
    system = small_system(**{"gap": "1.2 mm", "effects.gap.gap_error": "0.1 mm"})
    captures, known, _ = with_preset_geometry(pictures(), system, "mine")
    assert captures.gap_m == pytest.approx(1.2e-3) and known["gap"]["gap_error"] == pytest.approx(1e-4)


def test_a_preset_s_relays_count_as_a_whole() -> None:
    changes = {"relay1.square": "first order", "relay2": {"square": 0.03, "centre_na": [0, 1e-3], "dc_block_na": 1e-3}}
    system = small_system(**changes)
    captures, _, _ = with_preset_geometry(pictures(), system, "mine")
    assert (captures.relay1, captures.relay2) == (system.relay1, system.relay2)
    assert captures.nominal_system().relay2 == system.relay2


@pytest.mark.parametrize(
    ("changes", "words"),
    [({"shape": [30, 40]}, "30 x 40 pixels"), ({"pitch": "9 um"}, "a pitch of 9e-06 m")],
)
def test_a_preset_of_another_bench_is_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(UserError, match=words):
        with_preset_geometry(pictures(), small_system(**changes), "mine")
