"""Candidates near the floor are fitted to the end, so that their values are right and not only their names."""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np
import pytest

from holoview.bench.captures.prepared_captures import PreparedCaptures
from holoview.bench.diagnose.capture_split import CaptureSplit
from holoview.bench.diagnose.extended_model import PredictorWithKnownEffects
from holoview.bench.diagnose.fit import CandidateFit, local_fit, search_within_steps
from holoview.bench.diagnose.judge import chance_excess, rank_on_held_out
from holoview.bench.diagnose.refine import fit_to_the_end
from holoview.bench.diagnose.search_context import NeighbourVariances, PerThreadPredictor, SearchContext
from tests.diagnose.conftest import MakeContext
from tests.explored import explored

TRUE = {"sigma": 0.58, "coupling": 0.3}


def _fit(**values: float) -> CandidateFit:
    return CandidateFit(("crosstalk",), {"crosstalk": values}, 0.0)


def _with_even_noise(context: SearchContext) -> SearchContext:
    """The context with each capture twice, every pixel off by one standard deviation: once up, once down, or reversed.

    χ²/n of the true values is 1 then, and no fit is drawn aside. One draw of random noise would leave an excess of
    ±√(2/n) or more, which is as much as the narrow valley leaves.
    """
    count = len(context.data.captures)
    expected = context.data_weighted_comparison(np.arange(count), 0.0).fit_gains({"crosstalk": TRUE}).expected
    deviation = np.sqrt(context.data.camera.noise_variance(expected))
    deviation *= np.random.default_rng(11).choice([-1.0, 1.0], expected.shape)
    twice = context.data.captures.subset(np.tile(np.arange(count), 2))
    light = np.concatenate([expected + deviation, expected - deviation]).astype(np.float32)
    data = PreparedCaptures(twice, light, np.tile(context.data.usable, (2, 1, 1)))
    split = CaptureSplit(
        *(np.concatenate([k, k + count]) for k in dataclasses.astuple(context.split)),
    )
    create = partial(PredictorWithKnownEffects, captures=twice, known_values={})
    return dataclasses.replace(
        context, data=data, split=split, predictor=PerThreadPredictor(create), variances=NeighbourVariances(data)
    )


@pytest.mark.long
def test_a_narrow_valley_is_followed_to_its_end(make_context: MakeContext) -> None:
    """More blur across the pixels' edges and less coupling are nearly the same."""
    context = _with_even_noise(make_context({"crosstalk": TRUE}))
    comparison, crosstalk = context.data_weighted_comparison(context.split.fine, 0.0), context.effects["crosstalk"]
    held = frozenset({("crosstalk", "sigma")})
    start = _fit(sigma=0.72, coupling=0.15).values
    early = rank_on_held_out(context, [local_fit([crosstalk], start, comparison, fixed=held)])
    last = fit_to_the_end(context, early)
    assert last.best.excess < chance_excess(last.pixel_count) < early.best.excess
    assert last.best.fit.values["crosstalk"] == pytest.approx(TRUE, rel=0.02)


def test_a_fit_at_the_floor_comes_to_the_least_of_the_rougher_captures(make_context: MakeContext) -> None:
    """The true values predict held-out captures to the noise. Noise moves the least; a standard deviation costs 1."""
    context = make_context({"crosstalk": TRUE})
    last = fit_to_the_end(context, rank_on_held_out(context, [_fit(**TRUE)])).best.fit
    assert last.is_final
    comparison = context.model_weighted_comparison(context.split.rough, last.values)
    again = local_fit([context.effects["crosstalk"]], last.values, comparison, iterations=20, tolerance=1e-9)
    true, found, least = (
        float(comparison.fit_gains(v).squares.sum()) for v in ({"crosstalk": TRUE}, last.values, again.values)
    )
    assert found <= true and found - least < 1.0


@pytest.mark.long
@pytest.mark.parametrize("away_m", explored([-0.3e-9, 0.3e-9], 1))
def test_jumps_of_stops_on_a_grid_dont_end_a_fit_early(make_context: MakeContext, away_m: float) -> None:
    """Without noise the true values have the least χ². Other wavelengths differ by samples at the edges of irises."""
    true = {"second_line": {"share": 0.3, "offset": 4e-9}}
    context = make_context(true)
    some = context.split.rough[-4:]
    expected = context.data_weighted_comparison(some, 0.0).fit_gains(true).expected
    light = context.data.light.copy()
    light[some] = expected
    data = PreparedCaptures(context.data.captures, light, context.data.usable)
    context = dataclasses.replace(context, data=data, variances=NeighbourVariances(data))
    comparison, second_line = context.data_weighted_comparison(some, 0.0), context.effects["second_line"]
    start = {"second_line": {"share": 0.3, "offset": 4e-9 + away_m}}
    early = local_fit([second_line], start, comparison, iterations=20, tolerance=1e-6)
    found = search_within_steps([second_line], early, comparison, iterations=20, tolerance=1e-6)
    assert found.cost < 1.0
    assert found.values["second_line"] == pytest.approx(true["second_line"], rel=0.02)


def test_what_is_far_from_the_floor_is_left_alone(make_context: MakeContext) -> None:
    context = make_context({"crosstalk": TRUE})
    result = rank_on_held_out(context, [_fit(sigma=0.3, coupling=0.0)])
    assert fit_to_the_end(context, result) is result
