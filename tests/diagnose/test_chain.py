"""Hidden faults of chains, drawn by a program that shares no code with the predictor, are found and named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from holoview.bench.captures.predictor import PLAIN, SamplingConfig
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.sampling_choice import choose_sampling, other_samplings
from holoview.light.numerics.sampling import AREA
from tests.diagnose.independent_chain import (
    OF_AMPLITUDE,
    OF_MASK,
    PIXELS,
    STUCK,
    USUAL,
    Simulation,
    captures_with,
    draw_fault,
    nominal,
    on_camera,
)
from tests.explored import explored

KINDS = [*((kind, False) for kind in OF_AMPLITUDE), *((kind, True) for kind in OF_MASK)]
AS_PREDICTED = Simulation(2, 2, integrates=False)
"""With the samples and the width that predictions have unless told otherwise: no others are sought, and a diagnosis
takes a tenth of the time."""


@pytest.mark.parametrize(
    ("kind", "is_mask", "by"),
    [
        ("leakage", False, AS_PREDICTED),
        *(pytest.param(*kind, USUAL, marks=pytest.mark.explores) for kind in KINDS),
    ],
)
def test_a_hidden_fault_of_a_chain_is_named_with_its_size(kind: str, is_mask: bool, by: Simulation) -> None:
    rng = np.random.default_rng([7, is_mask, KINDS.index((kind, is_mask))])
    fault = draw_fault(rng, kind)
    found = diagnose(captures_with(fault, is_mask, rng, by))
    (cause,) = found.causes
    assert found.verdict == "explained" and cause.effect == fault.effect
    for name, value in fault.values.items():
        # 1 %, for what the band limit and the stops of the two programs differ in at the noise's size
        assert cause.intervals[name].value == pytest.approx(value, rel=0.01)
    assert "second" in cause.sentence


@pytest.mark.parametrize(
    ("kind", "by"),
    [
        pytest.param("pixel", AS_PREDICTED, marks=pytest.mark.long),
        pytest.param("column", USUAL, marks=pytest.mark.explores),
    ],
)
def test_a_stuck_part_of_a_modulator_of_a_chain_is_named_with_its_place_and_level(kind: str, by: Simulation) -> None:
    rng = np.random.default_rng([12, STUCK.index(kind)])
    fault = draw_fault(rng, kind)
    found = diagnose(captures_with(fault, False, rng, by))
    (cause,) = found.causes
    assert found.verdict == "explained" and cause.effect == fault.effect
    places = {name: own for name, own in fault.values.items() if not name.endswith("levels")}
    assert cause.lists == places
    (name,) = fault.values.keys() - places.keys()
    # 1 % of full drive: as for the other faults
    assert cause.intervals[f"{name}[0]"].value == pytest.approx(fault.values[name][0], abs=0.01)
    assert f" of {fault.effect.split('@')[1]} is stuck at " in cause.sentence


@pytest.mark.long
def test_fringes_over_a_modulator_of_a_chain_are_named() -> None:
    values = {"path_y": 2.2e-6, "path_x": -3.1e-6, "cos1": 0.05, "sin1": -0.03, "cos2": 0.04, "sin2": 0.02}
    settings = AcquisitionSettings(captures_per_condition=4, seed=int(np.random.default_rng(13).integers(1 << 16)))
    found = diagnose(make_captures(nominal(False), {"slm_fringes@first": values}, settings))
    (cause,) = found.causes
    assert found.verdict == "explained" and cause.effect == "slm_fringes@first"
    for name in ("path_y", "path_x"):
        assert cause.intervals[name].value == pytest.approx(values[name], rel=0.05)  # a twentieth of a fringe
    assert cause.sentence.startswith("Fringes of depth ") and " lie over first; " in cause.sentence


@pytest.mark.explores
@pytest.mark.parametrize("is_mask", [False, True])
def test_of_a_chain_without_a_fault_nothing_is_named(is_mask: bool) -> None:
    found = diagnose(captures_with(None, is_mask, np.random.default_rng([8, is_mask])))
    assert found.verdict == "consistent" and not found.causes


@pytest.mark.parametrize("fine", [2, 4, 8])
@pytest.mark.parametrize("integrates", [True, False])
def test_pixels_of_the_simulation_have_the_exact_mean_of_their_light(fine: int, integrates: bool) -> None:
    """Of fringes 2 + 2·cos(2πkx) a pixel of width w sees 2 + 2·sin(πkw)/(πkw)·cos(2πkx) at its middle x."""
    by, wider = Simulation(fine, 2, integrates), 2 * PIXELS
    k = np.array([19, -11]) / wider  # periods a modulator pixel, (y, x), that the whole width holds
    y, x = ((np.arange(wider * fine) + 0.5) / fine * turns for turns in k)
    found = on_camera(1 + np.exp(2j * np.pi * (y[:, None] + x[None, :])), by)
    middle_y, middle_x = ((np.arange(2 * wider) + 0.5) / 2 * turns for turns in k)
    contrast = np.prod(np.sinc(k / 2)) if integrates else 1.0
    expected = 2 + 2 * contrast * np.cos(2 * np.pi * (middle_y[:, None] + middle_x[None, :]))
    np.testing.assert_allclose(found, expected[PIXELS:-PIXELS, PIXELS:-PIXELS], atol=1e-12)


@pytest.mark.parametrize("integrates", explored([True, False], 1))
def test_the_samples_of_a_chain_without_a_fault_are_found(integrates: bool) -> None:
    by = Simulation(integrates=integrates)
    captures = captures_with(None, True, np.random.default_rng([9, integrates]), by)
    chosen = choose_sampling(captures, [], {})
    assert chosen is not None and chosen.sampling == SamplingConfig(2, 4, AREA if integrates else 1)
    # χ²/n of the sixteen thousand pixels of four captures scatters by 0.011; the two programs differ by a little more
    assert 0.9 < chosen.chi2 < 1.15 and chosen.other > 10
    assert "with finer samples and a grid 4 times the modulators' size" in chosen.note


def test_a_chain_sampled_as_usual_keeps_its_samples() -> None:
    captures = captures_with(None, True, np.random.default_rng(10), AS_PREDICTED)
    assert choose_sampling(captures, [], {}) is None


def test_samples_that_cost_much_are_not_tried_unasked() -> None:
    captures = captures_with(None, True, np.random.default_rng(11), Simulation(2, 2))
    assert SamplingConfig(4, 4, AREA) in other_samplings(captures, PLAIN)
    assert captures.chain is not None
    sides = {f"elements.{k}.shape": [512, 512] for k, e in enumerate(captures.chain.elements) if e.kind != "space"}
    large = replace(captures, chain=captures.chain.edit(sides))
    assert {(one.finer, one.padding) for one in other_samplings(large, PLAIN)} <= {(1, 2)}
