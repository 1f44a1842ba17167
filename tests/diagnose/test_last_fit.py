"""Candidates near the floor are fitted to the end, so that their values are right and not only their names."""

from __future__ import annotations

import pytest

from holoview.diagnose.effect_fit import CandidateFit, local_fit
from holoview.diagnose.held_out_ranking import rank_on_held_out
from holoview.diagnose.last_fit import fit_to_the_end
from holoview.diagnose.verdict import chance_excess
from tests.diagnose.conftest import MakeContext

TRUE = {"sigma": 0.58, "coupling": 0.3}


def _fit(**values: float) -> CandidateFit:
    return CandidateFit(("crosstalk",), {"crosstalk": values}, 0.0)


def test_a_narrow_valley_is_followed_to_its_end(make_context: MakeContext) -> None:
    """More blur across the pixels' edges and less coupling are nearly the same."""
    context = make_context({"crosstalk": TRUE})
    comparison, crosstalk = context.data_weighted_comparison(context.split.fine, 0.0), context.effects["crosstalk"]
    held = frozenset({("crosstalk", "sigma")})
    start = _fit(sigma=0.65, coupling=0.22).values
    early = rank_on_held_out(context, [local_fit([crosstalk], start, comparison, context.config.fits, fixed=held)])
    last = fit_to_the_end(context, early)
    assert last.best.excess < chance_excess(last.pixel_count, context.config.verdict) < early.best.excess
    assert last.best.fit.values["crosstalk"] == pytest.approx(TRUE, rel=0.02)


def test_what_is_at_the_floor_or_far_from_it_is_left_alone(make_context: MakeContext) -> None:
    context = make_context({"crosstalk": TRUE})
    for values in (TRUE, {"sigma": 0.3, "coupling": 0.0}):
        result = rank_on_held_out(context, [_fit(**values)])
        assert fit_to_the_end(context, result) is result
