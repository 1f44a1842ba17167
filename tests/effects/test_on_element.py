"""Effects on elements of a chain: all of them over one bench, the twins of a short form, and the new ones' physics."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

import holoview as hv
from holoview.evidence.benchmark.report_run import ExecutorPair, stage_errors
from holoview.light.gpu.device import Device
from holoview.light.model.effects.on_element import split_id
from holoview.light.model.effects.registry import (
    effect_or_twin,
    effects_for,
    element_effects,
    get_effect,
    listed_effects,
)
from holoview.light.model.preset import dumps, loads
from holoview.light.model.system import System

UM, MM, NM = 1e-6, 1e-3, 1e-9


def _pixels(name: str, kind: str, **keys: Any) -> dict[str, Any]:
    return {"name": name, "kind": kind, "pitch": 8 * UM, "shape": (18, 24)} | keys


def _space(name: str, **keys: Any) -> dict[str, Any]:
    return {"name": name, "kind": "space", "distance": 1 * MM, "iris_na": 0.03} | keys


ELEMENTS = [
    _pixels("slm", "phase", stroke=800 * NM),
    _space("first"),
    _pixels("mask", "mask", pattern="random", stroke=700 * NM),
    _space("second"),
    _pixels("cells", "complex", stroke=600 * NM),
    _space("third"),
    _pixels("coarse", "amplitude", pitch=24 * UM, shape=(6, 8)),
    {"name": "last", "kind": "space", "square": "first order of slm"},
]


def _chain(elements: list[dict[str, Any]] | None = None, **keys: Any) -> System:
    keys = {"planes_m": [3 * MM, 4 * MM], "observer": "mono"} | keys
    return System([532 * NM, 580 * NM], [[1.0, 0.5], [0.5, 1.0]], elements=elements or ELEMENTS, **keys)


def _shown(system: System, drive: Any) -> np.ndarray[Any, Any]:
    """The intensity (plane, y, x) of all lasers."""
    return hv.simulate(system, drive, backend="torch64").intensity.sum(axis=1)


def effect_cases(elements: Sequence[dict[str, Any]]) -> list[tuple[str, str]]:
    """Each effect on each element that it may act on; "" for the whole chain."""
    kinds = {e["name"]: e["kind"] for e in elements}
    cases = []
    for name, effect in element_effects().items():
        cases += [(name, element) for element, kind in kinds.items() if kind in effect.element_kinds]
    return sorted([*cases, *((name, "") for name, effect in listed_effects().items() if not effect.element_kinds)])


CASES = effect_cases(ELEMENTS)
UNKNOWN = {"polarisation", "slm_alignment"}
NO_DISTANCE = ("gap", "last")  # the way to the planes


def with_effect(system: System, name: str, element: str, priors: float = 0.7) -> System:
    effect = get_effect(f"{name}@{element}" if element else name)
    values = {p.name: p.nudged(priors) for p in effect.parameters}
    return system.edit({"effects": {name: values | ({"element": element} if element else {})}})


@pytest.mark.parametrize(("name", "element"), CASES)
def test_each_effect_changes_a_chain_or_says_why_it_cannot(name: str, element: str) -> None:
    system = _chain()
    drive = hv.random_drive(system, seed=1)
    if name in UNKNOWN or (name, element) == NO_DISTANCE:
        with pytest.raises(hv.UserError, match=f"effects.{name}") as caught:
            hv.make_plan(with_effect(system, name, element))
        assert "\n" not in str(caught.value)
        return
    changed = with_effect(system, name, element)
    assert loads(dumps(changed)).effect_values == changed.effect_values
    difference = np.linalg.norm(_shown(changed, drive) - _shown(system, drive))
    is_of_camera = listed_effects().get(name) is not None and set(listed_effects()[name].acts_on) == {"camera"}
    assert (difference == 0) == is_of_camera
    finding = get_effect(f"{name}@{element}" if element else name).format_finding(
        changed, next(iter(changed.effect_values.values()))
    )
    assert "{" not in finding and (not element or element in finding)


def test_what_is_said_of_an_effect_on_an_element_names_no_other_modulator() -> None:
    for effect in effects_for(_chain()):
        if "@" in effect.id:
            texts = [effect.cause, *(p.doc for p in effect.parameters)]
            texts += [effect.format_finding(_chain(), {p.name: p.nudged(0.5) for p in effect.parameters})]
            assert not any(re.search(r"(modulator|relay) [12]", text) for text in texts), texts


@pytest.mark.parametrize(("name", "element"), [case for case in CASES if case[1]])
def test_an_effect_at_its_identity_changes_no_bit(name: str, element: str) -> None:
    system = _chain()
    effect = get_effect(f"{name}@{element}")
    off = system.edit({"effects": {f"{name}@{element}": {p.name: p.identity for p in effect.parameters}}})
    drive = hv.random_drive(system, seed=1)
    assert np.array_equal(_shown(off, drive), _shown(system, drive))


@pytest.mark.parametrize("name", sorted({name for name, element in CASES if element}))
def test_an_effect_that_acts_on_an_element_asks_for_it(name: str) -> None:
    effect = effect_or_twin(name)
    with pytest.raises(hv.UserError, match=f"effects.{effect.id}.*which it has to state"):
        _chain().edit({f"effects.{effect.id}": {p.name: p.nudged(1.0) for p in effect.parameters[:1]}})


@pytest.mark.parametrize(("name", "other"), [("one", "two"), ("two", "one")])
def test_an_arm_is_moved_across_the_light_only(name: str, other: str) -> None:
    """Moved along it, the ways of the arms would differ."""
    arms = [_pixels("one", "phase", stroke=800 * NM), _pixels("two", "phase", stroke=700 * NM, beside="one")]
    system = _chain([*arms, _space("way"), _pixels("coarse", "amplitude")])
    system.edit({"effects": {"misplaced": {"element": name, "shift_y": 3 * UM, "rotation": 0.01}}})
    with pytest.raises(hv.UserError, match=f"shift_z: moves {name}, which stands beside {other}, along the light"):
        hv.make_plan(system.edit({"effects": {"misplaced": {"element": name, "shift_z": 0.1 * MM}}}))


@pytest.mark.gpu
@pytest.mark.parametrize(
    ("name", "element"),
    [
        case
        for case in CASES
        if case != NO_DISTANCE and case[0] not in UNKNOWN and case[1] in ("slm", "coarse", "last", "")
    ],
)
def test_shaders_show_each_effect_as_torch_does_stage_by_stage(device: Device, name: str, element: str) -> None:
    changed = with_effect(_chain(planes_m=[3 * MM]), name, element)
    errors = stage_errors(ExecutorPair.open(changed, device))
    # single precision is 6e-8, a transform of 72 samples adds 2e-7 (tests/parity/test_chain)
    assert not {step: error for step, error in errors.items() if error > 1e-6}


TWINS = {
    "lut@modulator 2": ({"gamma": 1.3, "level_05": 0.1}, "lut", {"gamma2": 1.3, "level2_05": 0.1}),
    "slm_flatness@phase1": ({"z5": 50 * NM}, "slm_flatness", {"z5_1": 50 * NM}),
    "slm_stuck@phase2": ({"rows": [3]}, "slm2_stuck", {"rows": [3]}),
    "slm_fringes@phase1": ({"path_y": 2 * UM, "cos1": 0.1}, "slm1_fringes", {"path_y": 2 * UM, "cos1": 0.1}),
    "settling@phase2": ({"share": 0.2}, "settling", {"share2": 0.2}),
    "iris@space1": ({"radius_error": 0.2}, "iris1", {"radius_error": 0.2}),
    "iris@relay 2": ({"decentre_y": 0.2}, "iris2", {"decentre_y": 0.2}),
    "aberration@space2": ({"z7": 50 * NM}, "aberration2", {"z7": 50 * NM}),
    "dc_block@space2": ({"radius": 2e-3}, "dc_block", {"radius": 2e-3}),
    "gap@space1": ({"gap_error": 0.1 * MM}, "gap", {"gap_error": 0.1 * MM}),
}


@pytest.mark.parametrize("name", TWINS)
def test_on_a_short_form_an_effect_on_an_element_is_the_twin(name: str) -> None:
    values, twin, own = TWINS[name]
    stops = {"relay1.iris_na": 0.03, "relay2.iris_na": 0.03}
    system = hv.load("holochrome-8").edit({"shape": [12, 16], "planes": [5 * MM], "frames": 2} | stops)
    drive = hv.random_drive(system, seed=2)
    plain, element = split_id(name)
    changed = system.edit({f"effects.{plain}": {"element": element, **values}})
    # a modulator that a twin leaves as it is may be computed by its pixels or by its samples
    assert _shown(changed, drive) == pytest.approx(_shown(system.edit({f"effects.{twin}": own}), drive), rel=1e-11)
    assert loads(dumps(changed)).effect_values == changed.effect_values


# --- the new effects --------------------------------------------------------------------------------------------------


def _displayed(element: dict[str, Any], drive: Any, **effects: Any) -> np.ndarray[Any, Any]:
    """The field (y, x) behind one element."""
    first = _pixels("slm", "phase", stroke=800 * NM)
    system = _chain([first, element], planes_m=[1 * MM], effects=effects)
    patterns = {name: np.zeros(shape) for name, shape in system.drive_shapes.items()}
    patterns |= {element["name"]: drive} if drive is not None else {}
    return np.asarray(hv.field_at(system, patterns, stage=element["name"]).values)


def test_black_pixels_leak_and_the_finding_tells_the_contrast() -> None:
    drive = np.linspace(0, 1, 18 * 24).reshape(18, 24)
    leaking = {"element": "cells", "amplitude": 0.2, "quadrature": -0.1}
    found = _displayed(_pixels("cells", "amplitude"), drive, leakage=leaking)
    assert found == pytest.approx(drive.repeat(2, 0).repeat(2, 1) * (0.8 + 0.1j) + 0.2 - 0.1j, abs=1e-12)
    values = {"amplitude": 0.2, "quadrature": -0.1}
    assert "a contrast of 20:1" in get_effect("leakage@cells").format_finding(_chain(), values)


def test_the_gamma_of_an_amplitude_modulator_is_a_power_of_its_drive() -> None:
    drive = np.linspace(0, 1, 18 * 24).reshape(18, 24)
    found = _displayed(_pixels("cells", "amplitude"), drive, amplitude_gamma={"element": "cells", "gamma": 2.2})
    assert found == pytest.approx(drive.repeat(2, 0).repeat(2, 1) ** 2.2, abs=1e-12)


def test_a_mask_of_another_depth_has_another_stroke() -> None:
    mask = _pixels("mask", "mask", pattern="random", stroke=500 * NM)
    found = _displayed(mask, None, mask_depth={"element": "mask", "error": 0.3})
    assert found == pytest.approx(_displayed(mask | {"stroke": 650 * NM}, None), abs=1e-9)


def test_a_mask_that_is_shifted_by_pixels_is_one_at_another_place() -> None:
    mask = _pixels("mask", "mask", pattern="random", stroke=500 * NM, shape=(8, 8))
    shifted = _displayed(mask, None, misplaced={"element": "mask", "shift_y": 16 * UM, "shift_x": -8 * UM})
    there = _displayed(mask | {"offset": (16 * UM, -8 * UM)}, None)
    assert shifted == pytest.approx(there, abs=1e-9)


def test_a_mask_that_is_turned_turns_about_its_own_centre_from_x_to_y() -> None:
    mask = _pixels("mask", "mask", pattern="half plane", shape=(8, 8), offset=(16 * UM, 8 * UM))
    found = _displayed(mask, None, misplaced={"element": "mask", "rotation": 0.5}).real
    y, x = (index - (n - 1) / 2 for index, n in zip(np.indices(found.shape), found.shape, strict=True))
    y, x = y - 4, x - 2  # from its centre, in samples of 4 µm
    own_y, own_x = np.cos(0.5) * y - np.sin(0.5) * x, np.sin(0.5) * y + np.cos(0.5) * x
    inside = np.minimum(np.minimum(8 - np.abs(own_x), -own_y), 8 + own_y)  # how far from the nearest edge, > 0 within
    assert found[inside > 1.5] == pytest.approx(1.0) and (inside > 1.5).sum() > 40
    assert found[inside < -1.5] == pytest.approx(0.0)


def test_an_element_that_is_too_far_on_changes_the_ways_beside_it_and_leaves_the_planes() -> None:
    system = _chain()
    drive = hv.random_drive(system, seed=3)
    for name, spaces in (("cells", ("second", "third")), ("mask", ("first", "second"))):
        moved = system.edit({"effects.misplaced": {"element": name, "shift_z": 0.2 * MM}})
        same = system.edit({f"elements.{spaces[0]}.distance": 1.2 * MM, f"elements.{spaces[1]}.distance": 0.8 * MM})
        assert np.array_equal(_shown(moved, drive), _shown(same, drive))
    moved = system.edit({"effects.misplaced": {"element": "coarse", "shift_z": 0.2 * MM}})
    same = system.edit({"elements.third.distance": 1.2 * MM, "planes": [2.8 * MM, 3.8 * MM]})
    assert _shown(moved, drive) == pytest.approx(_shown(same, drive), rel=1e-9)
    with pytest.raises(hv.UserError, match=r"effects.misplaced@mask: shift_z: brings mask .* past the element behind"):
        hv.make_plan(system.edit({"effects.misplaced": {"element": "mask", "shift_z": 2 * MM}}))


REFUSED = {
    "an unknown element": ({"lut": {"element": "slmm", "gamma": 1.2}}, 'acts on "slmm", and this chain has slm'),
    "another kind": (
        {"leakage": {"element": "slm", "amplitude": 0.1}},
        "kind amplitude, and .slm. is one of kind phase",
    ),
    "no element where it has none": ({"tilt": {"element": "slm", "tilt_y": 1e-3}}, "expected no element"),
    "an element twice": ({"lut": [{"element": "slm", "gamma": 1.2}] * 2}, "twice for slm"),
    "an element that is a number": ({"lut": {"element": 3, "gamma": 1.2}}, "the name of an element"),
    "a twin's number": ({"lut": {"element": "slm", "gamma1": 1.2}}, "gamma1"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_an_element_that_cannot_be_is_refused_in_a_sentence(name: str) -> None:
    effects, words = REFUSED[name]
    with pytest.raises(hv.UserError, match=words) as caught:
        _chain(effects=effects)
    assert "\n" not in str(caught.value)


def test_an_effect_on_several_elements_is_a_list_and_edits_find_the_element() -> None:
    effects = {"settling": [{"element": "slm", "share": 0.1}, {"element": "coarse", "share": 0.2}]}
    system = _chain(effects=effects)
    assert system.effect_values == {"settling@coarse": {"share": 0.2}, "settling@slm": {"share": 0.1}}
    assert loads(dumps(system)).effect_values == system.effect_values
    assert system.edit({"effects.settling@slm.share": 0.3}).effect_values["settling@slm"] == {"share": 0.3}
    alone = _chain().edit({"effects.lut.element": "slm", "effects.lut.gamma": 1.2}).edit({"effects.lut.gamma": 1.3})
    assert alone.effect_values == {"lut@slm": {"gamma": 1.3}}
