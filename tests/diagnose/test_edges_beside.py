"""A narrow stop off its centre takes the zero order of tilted light away: it's found beside the tilt alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pytest

from holoview.bench.diagnose import refine, search
from holoview.bench.diagnose.fit import CandidateFit
from holoview.bench.diagnose.judge import rank_on_held_out
from holoview.bench.diagnose.likelihood import Comparison
from holoview.bench.diagnose.screening import fit_over_range
from holoview.bench.diagnose.search import _joint_fits, _with_edges_anew
from holoview.light.model.effects.effect import Effect
from tests.diagnose.conftest import MakeContext

TILT = {"tilt_y": 7.28e-3, "tilt_x": 5.95e-3}
IRIS = {"radius_error": -0.42, "decentre_y": 0.37, "decentre_x": -0.39}
TRUTH = {"tilt": TILT, "iris1": IRIS}
WRONG = {"radius_error": 0.12, "decentre_y": 0.63, "decentre_x": -0.87}
"""Whose edge passes the zero order as closely, from the other side."""


def _assert_found(values: Mapping[str, float]) -> None:
    """Where the far edge is cut by no light, a larger stop that lies further off does the same: with 20 draws radius
    and shift had opposite errors of 0.02 r.m.s., at most 0.06, and the edge where they meet one of 0.0004."""
    assert values == pytest.approx(IRIS, abs=0.25)
    edge = IRIS["radius_error"] + IRIS["decentre_x"]
    assert values["radius_error"] + values["decentre_x"] == pytest.approx(edge, abs=0.01)


@pytest.mark.long
def test_both_radius_and_shift_are_scanned(make_context: MakeContext) -> None:
    context = make_context(TRUTH)
    found = fit_over_range(context, {"tilt": TILT}, context.effects["iris1"], [])
    _assert_found(found.values["iris1"])


@pytest.mark.long
def test_a_stop_that_was_taken_for_another_is_searched_anew(make_context: MakeContext) -> None:
    context = make_context(TRUTH)
    base = CandidateFit(("iris1",), {"iris1": WRONG}, 0.0)
    both = CandidateFit(("iris1", "tilt"), {"iris1": WRONG, "tilt": TILT}, 0.0)
    joint, anew = (_joint_fits(context, fits)[0] for fits in ([both], _with_edges_anew(context, both, base)))
    assert anew.cost < joint.cost / 2
    _assert_found(anew.values["iris1"])
    assert _with_edges_anew(context, both, CandidateFit(("tilt",), {"tilt": TILT}, 0.0)) == []


def test_edges_are_searched_where_least_squares_end_far_off(
    make_context: MakeContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Least squares that end where they begin; a search of edges that finds the truth."""
    context, searched = make_context(TRUTH), list[Any]()

    def end_at_once(effects: Sequence[Effect], start: Any, *_: Any, **__: Any) -> CandidateFit:
        return CandidateFit(tuple(effect.id for effect in effects), start, 0.0)

    def search_edges(effects: Sequence[Effect], fit: CandidateFit, comparison: Comparison) -> CandidateFit:
        searched.append(fit.values)
        return CandidateFit(fit.causes, TRUTH, 0.0)

    monkeypatch.setattr(refine, "local_fit", end_at_once)
    monkeypatch.setattr(refine, "refine_hard_edges", search_edges)
    near = {"tilt": TILT, "iris1": {"radius_error": -0.3, "decentre_y": 0.45, "decentre_x": -0.5}}
    assert refine.FAR_ERROR < context.relative_model_error(near) < context.relative_model_error({}) / 2
    found = refine.refine_fit(context, CandidateFit(tuple(near), near, 0.0))
    assert searched[0] == near and context.relative_model_error(found.values) < 0.02
    searched.clear()
    far = {"tilt": TILT, "iris1": {"radius_error": 0.0, "decentre_y": 0.0, "decentre_x": 0.0}}
    assert refine.refine_fit(context, CandidateFit(tuple(far), far, 0.0)).values == far and not searched


@pytest.mark.parametrize(("left", "first"), [(0.97, "tilt"), (0.8, "aberration1")])
def test_many_numbers_have_to_leave_clearly_less(
    make_context: MakeContext, monkeypatch: pytest.MonkeyPatch, left: float, first: str
) -> None:
    """Bases of further causes: eight numbers that leave a share `left` of what one number leaves."""
    many = {"aberration1": {f"z{j}": 1e-8 for j in range(4, 12)}}
    few = {"tilt": {"tilt_y": 1e-4}}
    context = make_context(TRUTH)
    result = rank_on_held_out(context, [CandidateFit(tuple(values), values, 0.0) for values in (few, many)])
    monkeypatch.setattr(search, "cost_or_inf", lambda _, values: left if "aberration1" in values else 1.0)
    assert search._bases(context, result, 1)[0].causes == (first,)
