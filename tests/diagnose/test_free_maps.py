"""Free maps change nothing while they are zero, and name the place of what no effect describes."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import torch

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor, SamplingConfig
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.report.error_places import (
    FreeCamera,
    FreeMapFit,
    FreeMaps,
    FreeModulator,
    FreeRelay,
    FreeSource,
    ShownMap,
    _free_maps_of_chain,
    fit_free_maps,
    likely_fits,
    placed_map,
    suggest_for,
)
from holoview.light.model.effects.hook_contexts import RelayContext
from holoview.light.model.effects.registry import get_effect
from holoview.light.model.system import System
from tests.diagnose.conftest import make_context_of, small_system

MAPS = [
    FreeSource(),
    FreeModulator(0),
    FreeModulator(1),
    FreeRelay(0),
    FreeRelay(1),
    FreeCamera(),
]


@pytest.mark.parametrize("maps", MAPS, ids=lambda m: m.id)
def test_maps_of_zero_are_no_maps(nominal: Captures, maps: FreeMaps) -> None:
    maps.set_from_vector(np.zeros(maps.parameter_count))
    plain = Predictor(nominal, double_precision=True)([0]).signal
    mapped = Predictor(nominal, extra_effects=[maps], double_precision=True)([0], {maps.id: {"on": 1.0}}).signal
    torch.testing.assert_close(mapped, plain, rtol=1e-9, atol=1e-12)


def test_maps_of_a_relay_are_centred_where_its_stops_are() -> None:
    maps = FreeRelay(1)
    maps.set_from_vector(np.random.default_rng(0).standard_normal(maps.parameter_count))
    sine, (y, x), flat = torch.linspace(-0.03, 0.03, 25).double(), (0.004, -0.01), torch.ones(25, 25).cdouble()
    middle = RelayContext(1, 500e-9, sine[:, None], sine[None], 0.03)
    moved = RelayContext(1, 500e-9, sine[:, None] + y, sine[None] + x, 0.03, (y, x))
    on = maps.parameter_values({"on": 1.0})
    torch.testing.assert_close(maps.pupil(flat, moved, on), maps.pupil(flat, middle, on))


@pytest.mark.parametrize("maps", MAPS, ids=lambda m: m.id)
def test_every_number_of_a_map_has_its_slope(nominal: Captures, maps: FreeMaps) -> None:
    """Autograd's directional derivative of the light is a central difference's."""
    rng = np.random.default_rng(0)
    at, way = 0.3 * rng.standard_normal(maps.parameter_count), rng.standard_normal(maps.parameter_count)
    predictor, on = Predictor(nominal, extra_effects=[maps], double_precision=True), {maps.id: {"on": 1.0}}

    def light(x: np.ndarray) -> float:
        maps.set_from_vector(x)
        return float(predictor([1], on, grad=True).signal.square().sum())

    leaves = maps.set_from_vector(at, grad=True)
    total = predictor([1], on, grad=True).signal.square().sum()
    gradients = torch.autograd.grad(total, leaves, allow_unused=True)
    flat = np.concatenate(
        [
            (torch.zeros_like(leaf) if g is None else g).ravel().numpy()
            for leaf, g in zip(leaves, gradients, strict=True)
        ]
    )
    h = 1e-5
    slope = (light(at + h * way) - light(at - h * way)) / (2 * h)
    assert float(flat @ way) == pytest.approx(slope, rel=1e-4)
    maps.set_from_vector(np.zeros(maps.parameter_count))


def _chain() -> System:
    pixels = {"kind": "phase", "pitch": "8 um", "shape": [16, 20], "stroke": "825 nm"}
    space = {"kind": "space", "distance": "1 mm", "iris_na": 0.03}
    coarse = {"kind": "amplitude", "name": "coarse", "pitch": "16 um", "shape": [8, 10]}
    mask = pixels | {"kind": "mask", "name": "glass", "pattern": "random", "stroke": "400 nm"}
    elements = [pixels, space, mask, space | {"distance": "0.5 mm"}, coarse]
    return System(["520 nm", "638 nm"], [[1.0, 1.0]], elements=elements, planes_m=["3 mm"], observer="mono")


@pytest.fixture(scope="module")
def of_chain() -> Captures:
    return make_captures(_chain(), {}, AcquisitionSettings(captures_per_condition=4))


CHAIN_MAPS = [FreeSource(), *_free_maps_of_chain(_chain()), FreeCamera()]


def test_every_place_of_a_chain_has_maps() -> None:
    assert [maps.acts_on[0] for maps in CHAIN_MAPS] == [
        "source",
        "phase",
        "glass",
        "coarse",
        "space1",
        "space2",
        "the way to the planes",
        "camera",
    ]
    assert len({maps.id for maps in CHAIN_MAPS}) == len(CHAIN_MAPS)


@pytest.mark.parametrize("maps", CHAIN_MAPS, ids=lambda m: m.id)
def test_maps_of_a_chain_change_its_light_and_nothing_while_they_are_zero(of_chain: Captures, maps: FreeMaps) -> None:
    plain = Predictor(of_chain, double_precision=True)([0]).signal
    predictor = Predictor(of_chain, extra_effects=[maps], double_precision=True)
    maps.set_from_vector(np.zeros(maps.parameter_count))
    torch.testing.assert_close(predictor([0], {maps.id: {"on": 1.0}}).signal, plain, rtol=1e-9, atol=1e-12)
    test_every_number_of_a_map_has_its_slope(of_chain, maps)
    maps.set_from_vector(np.random.default_rng(1).standard_normal(maps.parameter_count))
    again = Predictor(of_chain, extra_effects=[maps], double_precision=True)
    assert float((again([0], {maps.id: {"on": 1.0}}).signal - plain).norm() / plain.norm()) > 1e-3
    maps.set_from_vector(np.zeros(maps.parameter_count))


def test_maps_of_a_chain_lie_over_the_pixels_of_their_element(of_chain: Captures) -> None:
    surface = ShownMap("stroke", np.zeros((6, 8)), "1")
    assert placed_map(surface, "coarse", of_chain).extent == (-0.5, 9.5, 7.5, -0.5)
    assert placed_map(surface, "glass", of_chain).axis == "pixels of glass"
    assert placed_map(surface, "source", of_chain).extent == (-0.5, 39.5, 31.5, -0.5)
    assert {placed_map(surface, name, of_chain).axis for name in ("space1", "the way to the planes")} == {"pupil radii"}
    assert placed_map(surface, "camera", of_chain).axis == "camera pixels"


@pytest.mark.long
def test_maps_end_with_their_time_each_after_a_step() -> None:
    """Without any time each place still has a step, which lowers what is left; it says that it was ended."""
    hidden = {"slm_flatness": {"z5_1": 60e-9}}
    captures = make_captures(small_system(1), hidden, AcquisitionSettings(captures_per_condition=6, seed=2))
    context = make_context_of(captures)
    held_out = context.model_weighted_comparison(context.split.held_out, {})
    fits = fit_free_maps(context, {}, held_out, most_s=0.0)
    assert len(fits) == 4 and all(fit.was_ended for fit in fits) and fits[0].share > 0.0
    assert not any(fit.was_ended for fit in fit_free_maps(context, {}, held_out))


@pytest.mark.long
def test_the_place_in_a_chain_of_what_no_effect_describes_is_told() -> None:
    """A fault of an element, while none of its effects may be named."""
    hidden = {"amplitude_gamma@coarse": {"gamma": 1.6}}
    captures = make_captures(_chain(), hidden, AcquisitionSettings(captures_per_condition=8, seed=2))
    found = diagnose(captures, workers=1, effects=[get_effect("laser_power")], sampling=SamplingConfig(points=1))
    assert found.verdict is Verdict.UNEXPLAINED
    assert next(iter(found.lives_in)) == "coarse", found.lives_in
    assert found.lives_in["coarse"] > 0.5 and "acts on coarse" in found.suggestions["coarse"]


def test_only_places_that_explain_much_are_named() -> None:
    fits = [FreeMapFit("camera", 0.9), FreeMapFit("source", 0.7), FreeMapFit("relay 1", 0.2)]
    assert [fit.location for fit in likely_fits(fits)] == ["camera", "source"]
    assert likely_fits([FreeMapFit("camera", 0.05)]) == likely_fits([]) == ()


@pytest.mark.parametrize("maps", MAPS, ids=lambda m: m.id)
def test_maps_are_shown_in_units_and_their_place_has_a_suggestion(maps: FreeMaps) -> None:
    maps.set_from_vector(np.arange(1.0, maps.parameter_count + 1))
    for name, shown in ((shown.name, shown) for shown in maps.shown_maps()):
        raw = maps.maps[name].numpy()
        if shown.unit == "m":
            np.testing.assert_allclose(shown.values, 50e-9 * (raw - raw.mean()))
        else:
            np.testing.assert_allclose(shown.values, 0.1 * raw)
    hook = re.search(r"overrides `(\w+)`", suggest_for(maps.acts_on[0]))
    assert hook and maps.overrides(hook[1]), "the hook that the maps themselves use"
    maps.set_from_vector(np.zeros(maps.parameter_count))


def test_maps_are_placed_in_pixels_of_what_they_lie_over(nominal: Captures) -> None:
    surface, numbers = ShownMap("stroke", np.zeros((6, 8)), "1"), ShownMap("neighbours", np.zeros(4), "1")
    (rows, columns), (camera_rows, camera_columns) = nominal.levels.shape[2:], nominal.shape
    on_modulator = placed_map(surface, "modulator 2", nominal)
    assert (on_modulator.extent, on_modulator.axis) == ((-0.5, columns - 0.5, rows - 0.5, -0.5), "modulator pixels")
    middle = replace(nominal, slm_frame=(rows + 20, columns + 6), frame=(camera_rows + 4, camera_columns))
    assert placed_map(surface, "source", middle).extent == (2.5, columns + 2.5, rows + 9.5, 9.5)
    assert placed_map(surface, "camera", middle).extent == (-0.5, camera_columns - 0.5, camera_rows + 1.5, 1.5)
    assert placed_map(surface, "relay 1", nominal).axis == "pupil radii"
    assert placed_map(numbers, "camera", nominal).labels == ("above", "below", "left", "right")
    assert placed_map(ShownMap("curve", np.zeros(9), "1"), "modulator 1", nominal).axis == "share of the stroke"
