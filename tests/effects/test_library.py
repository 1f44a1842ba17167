"""What holds for every effect: complete, off at its identity to the last bit, and named by the ids that files use."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

import holoview as hv
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.light.model.effects.effect import DataProperties
from holoview.light.model.effects.registry import element_effects, listed_effects
from holoview.util.errors import UserError

IDS = [
    "gap",
    "distance",
    "stroke",
    "lut",
    "lut_dispersion",
    "stroke_map",
    "slm1_stuck",
    "slm2_stuck",
    "dispersion",
    "tilt",
    "source_profile",
    "beam",
    "source_extent",
    "bandwidth",
    "second_line",
    "wavelength_offset",
    "laser_power",
    "slm_alignment",
    "slm_flatness",
    "slm1_fringes",
    "slm2_fringes",
    "crosstalk",
    "fringing",
    "twisted_nematic",
    "undiffracted",
    "polarisation",
    "flicker",
    "iris1",
    "iris2",
    "dc_block",
    "aberration1",
    "aberration2",
    "camera_black",
    "camera_gamma",
    "camera_blur",
    "camera_alignment",
    "vignetting",
    "ghost",
    "camera_fringes",
    "motion_blur",
    "ambient",
    "stage",
    "plane_errors",
    "settling",
]
ELEMENT_IDS = [
    "leakage",
    "amplitude_gamma",
    "misplaced",
    "mask_depth",
    "iris",
    "aberration",
    "slm_stuck",
    "slm_fringes",
]
PLACES = {"source", "modulator 1", "relay 1", "modulator 2", "relay 2", "camera"}
RICH = DataProperties(wavelengths=4, planes=2, powers=5, modulators=2, irises=(True, True), is_fourier=False)

Make = Callable[..., Captures]


def _off(name: str) -> dict[str, float]:
    return {p.name: p.identity for p in listed_effects()[name].parameters}


def test_the_library_has_every_id_that_files_may_hold() -> None:
    assert set(IDS) <= set(listed_effects())
    assert set(ELEMENT_IDS) <= set(element_effects())  # their physics: tests/effects/test_on_element


@pytest.mark.parametrize("name", IDS)
def test_an_effect_states_what_others_need_to_know(name: str) -> None:
    effect = listed_effects()[name]
    assert effect.id == name
    assert effect.cause.endswith(".") and set(effect.acts_on) <= PLACES
    assert all(other in listed_effects() for other in (*effect.degeneracies(RICH), *effect.degenerate_with))
    assert all(len(listed_effects()[other].parameters) < len(effect.parameters) for other in effect.degenerate_limit)
    for p in effect.parameters:
        assert p.has_sound_bounds and p.doc.endswith(".")
        assert p.parse(p.to_toml(p.identity), name) == p.identity
        for own in p.free_entries(p.nudged(1.0)):
            inside = own.read({p.name: p.nudged(1.0)})
            assert own.from_fit(own.to_fit(inside)) == pytest.approx(inside, rel=1e-12)


@pytest.mark.parametrize("name", IDS)
def test_an_effect_at_its_identity_changes_no_bit_near_by(name: str, make_session: Make) -> None:
    predict = Predictor(make_session(1))
    assert torch.equal(predict([0], {name: _off(name)}).signal, predict([0]).signal)
    assert predict([0], {name: _off(name)}).black_level == predict([0]).black_level


@pytest.mark.parametrize("name", [n for n in IDS if listed_effects()[n].needs.fourier])
def test_an_effect_at_its_identity_changes_no_bit_far_away(name: str, make_fourier: Make) -> None:
    predict = Predictor(make_fourier(1))
    assert torch.equal(predict([0], {name: _off(name)}).signal, predict([0]).signal)


@pytest.mark.parametrize("name", IDS)
def test_every_start_of_a_search_is_a_bench_that_can_be_and_differs(name: str, make_session: Make) -> None:
    captures = make_session(2, power=torch.tensor([0.5, 0.5]).double().numpy())
    predict, effect = Predictor(captures), listed_effects()[name]
    starts = list(effect.starting_points(captures.nominal_system()))
    plain = predict([1])
    for values in (starts or [{p.name: p.nudged(1.0) for p in effect.parameters}])[:: max(1, len(starts) // 4)]:
        given = [p for p in effect.parameters if p.name in values]
        assert all(p.parse(p.to_toml(values[p.name]), name) == values[p.name] for p in given)
        changed = predict([1], {name: values})
        same = torch.equal(changed.signal, plain.signal) and changed.black_level == plain.black_level
        same = same and changed.ambient is None
        assert not same or name == "dispersion", values  # which is nothing at its reference alone
        assert "{" not in effect.format_finding(captures.nominal_system(), values)


@pytest.mark.parametrize("name", IDS)
def test_a_value_out_of_bounds_is_refused_with_the_key(name: str) -> None:
    system = hv.load("holochrome-8")
    for p in listed_effects()[name].parameters:
        if p.high < float("inf"):
            with pytest.raises(UserError, match=f"effects.{name}.{p.name}"):
                system.edit({f"effects.{name}.{p.name}": p.high + 1.0 + abs(p.high)})


@pytest.mark.parametrize(
    ("name", "facts", "words"),
    [
        ("dispersion", {"wavelengths": 1}, "2 wavelengths"),
        ("laser_power", {"powers": 1}, "2 powers"),
        ("gap", {"modulators": 1}, "2 modulators"),
        ("iris1", {"irises": (False, True)}, "relay 1 has neither an iris nor a square stop"),
        ("gap", {"is_fourier": True}, "Fourier"),
    ],
)
def test_an_effect_says_what_data_it_lacks(name: str, facts: dict[str, int], words: str) -> None:
    from dataclasses import replace

    assert listed_effects()[name].needs.unmet_by(RICH) == ""
    assert words in listed_effects()[name].needs.unmet_by(replace(RICH, **facts))
