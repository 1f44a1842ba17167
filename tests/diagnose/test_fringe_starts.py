"""The residuals show where fringes are, how deep, and with which phase at each wavelength."""

from __future__ import annotations

from dataclasses import replace

import pytest

from holoview.bench.diagnose.screening import fit_over_range
from holoview.bench.diagnose.starts.fringes import FringeStarts, ModulatorFringeStarts
from holoview.light.model.effects.registry import listed_effects
from tests.diagnose.conftest import MakeContext, make_context_of

TRUE = {"path_y": 3.65e-6, "path_x": -6.1e-6, "cos1": 0.02, "sin1": -0.01, "cos2": 0.0, "sin2": 0.03}


def test_the_strongest_start_is_the_fringes_that_lie_over_the_picture(make_context: MakeContext) -> None:
    """Paths to half a step, a quarter of the shortest wavelength; amplitudes with what so far off a peak costs.

    The true ones lie within a quarter of a step, so that noise doesn't choose between two steps.
    """
    context = make_context({"camera_fringes": TRUE})
    comparison = context.data_weighted_comparison(context.split.coarse, 0.0)
    starts = FringeStarts(comparison.fit_gains({}), comparison)
    found = starts(listed_effects()["camera_fringes"])[0]
    for axis in ("path_y", "path_x"):
        assert found[axis] == pytest.approx(TRUE[axis], abs=0.25 * 450e-9 * 1.01)
    for name in ("cos1", "sin1", "cos2", "sin2"):
        assert found[name] == pytest.approx(TRUE[name], abs=0.01)


def test_fringes_of_one_period_at_all_wavelengths_are_a_start(make_context: MakeContext) -> None:
    """It lowers χ² by most of what the true values do; the best wedge doesn't."""
    true = {**TRUE, "cos1": 0.03, "sin1": 0.0, "achromatic": 1.0}
    context = make_context({"camera_fringes": true})
    comparison = context.data_weighted_comparison(context.split.coarse, 0.0)
    starts = FringeStarts(comparison.fit_gains({}), comparison)(listed_effects()["camera_fringes"])
    excess = {
        share: min(comparison.chi2_per_pixel({"camera_fringes": s}) - 1 for s in starts if s["achromatic"] == share)
        for share in (0.0, 1.0)
    }
    assert excess[1.0] < 0.3 * (comparison.chi2_per_pixel({}) - 1) < excess[0.0]


def test_the_path_is_over_the_whole_picture_where_only_its_middle_is_searched(make_context: MakeContext) -> None:
    context, effect = make_context({"camera_fringes": TRUE}), listed_effects()["camera_fringes"]
    captures = context.data.captures
    middle = replace(captures, frame=(3 * captures.shape[0], 2 * captures.shape[1]))
    found = []
    for data in (context.data, replace(context.data, captures=middle)):
        comparison = replace(context, data=data).data_weighted_comparison(context.split.coarse, 0.0)
        found.append(FringeStarts(comparison.fit_gains({}), comparison)(effect)[0])
    whole, cut = found
    assert cut == pytest.approx({**whole, "path_y": 3 * whole["path_y"], "path_x": 2 * whole["path_x"]})


@pytest.mark.parametrize("name", ["slm1_fringes", "slm2_fringes"])
def test_the_strongest_start_is_the_fringes_that_lie_over_a_modulator(make_context: MakeContext, name: str) -> None:
    """Paths as above; most of what the true values lower χ² by is lowered by the start, and nothing by the other's."""
    context = make_context({name: TRUE})
    comparison = context.data_weighted_comparison(context.split.coarse, 0.0)
    starts = ModulatorFringeStarts(context, {}, comparison)
    found = starts(listed_effects()[name])[0]
    for axis in ("path_y", "path_x"):
        assert found[axis] == pytest.approx(TRUE[axis], abs=0.25 * 450e-9 * 1.01)
    without, true, start = (comparison.chi2_per_pixel(v) for v in ({}, {name: TRUE}, {name: found}))
    assert without - start > 0.7 * (without - true)


def test_a_modulator_that_is_cut_to_its_middle_has_the_path_of_the_whole(make_context: MakeContext) -> None:
    """Of a modulator three times as high and twice as wide, the path over the middle is a third, and half, of its."""
    captures = make_context({"slm1_fringes": TRUE}).data.captures
    rows, columns = captures.levels.shape[2:]
    context = make_context_of(replace(captures, slm_frame=(3 * rows, 2 * columns)))
    comparison = context.data_weighted_comparison(context.split.coarse, 0.0)
    found = ModulatorFringeStarts(context, {}, comparison)(listed_effects()["slm1_fringes"])[0]
    assert found["path_y"] == pytest.approx(3 * TRUE["path_y"], abs=3 * 0.25 * 450e-9 * 1.01)
    assert found["path_x"] == pytest.approx(2 * TRUE["path_x"], abs=2 * 0.25 * 450e-9 * 1.01)


def test_other_effects_get_no_starts_of_fringes(make_context: MakeContext) -> None:
    context = make_context()
    comparison = context.data_weighted_comparison(context.split.coarse, 0.0)
    over_picture = FringeStarts(comparison.fit_gains({}), comparison)
    over_modulator = ModulatorFringeStarts(context, {}, comparison)
    effects = listed_effects().items()
    assert [name for name, effect in effects if over_picture(effect)] == ["camera_fringes"]
    assert [name for name, effect in effects if over_modulator(effect)] == ["slm1_fringes", "slm2_fringes"]


def test_narrow_fringes_on_a_modulator_are_found_though_their_contrast_is_reversed(make_context: MakeContext) -> None:
    """Over 7 fringes of 35 µm, 5 mm away, what is bright on the modulator is dark in the picture."""
    fringes = {"cos1": 0.0094, "sin1": 0.0141, "cos2": 0.0098, "sin2": -0.0114}
    context = make_context({"slm1_fringes": {"path_y": 1.83e-6, "path_x": -2.33e-6, **fringes}})
    found = fit_over_range(context, {}, context.effects["slm1_fringes"], []).values["slm1_fringes"]
    assert (found["path_y"], found["path_x"]) == pytest.approx((1.83e-6, -2.33e-6), rel=0.02)
    assert {name: found[name] for name in fringes} == pytest.approx(fringes, abs=0.003)
