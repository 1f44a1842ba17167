"""A further cause is looked for in captures that show what the present causes leave."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import Mock

import pytest

from holoview.bench.captures.virtual_measurement import AcquisitionSettings
from holoview.bench.captures.virtual_measurement import make_captures as measure
from holoview.bench.diagnose import search
from holoview.bench.diagnose.fit import CandidateFit
from holoview.bench.diagnose.judge import FLOOR_CHI2, HeldOutScore, SearchResult
from holoview.bench.diagnose.search import (
    Beside,
    InitialCandidates,
    Policy,
    Refit,
    Until,
    refine_candidates,
    with_captures_that_show,
)
from holoview.bench.diagnose.search_context import BestSoFar, SearchContext, SearchEnded
from holoview.light.model.bench_parts import Modulator
from holoview.util.progress import no_progress
from tests.diagnose.conftest import MakeContext, make_context_of, small_system
from tests.explored import explored

STOP = {"radius_error": 0.12}


def test_a_second_line_that_smooth_captures_hide_is_looked_for_in_rough_ones() -> None:
    """Smooth patterns send little light to the edges of a stop, where the two lines differ.

    χ²/n of 24 576 pixels scatters by 0.009; the limit is 1.05.
    """
    panel = Modulator(pitch_m=8e-6, shape=(96, 128), stroke_m=825e-9, levels=16)
    hidden = {"iris2": STOP, "second_line": {"share": 0.2, "offset": -1.5e-9}}
    settings = AcquisitionSettings(captures_per_condition=6, seed=5)
    context = make_context_of(measure(replace(small_system(), modulators=(panel, panel)), hidden, settings))
    base = CandidateFit(("iris2",), {"iris2": STOP}, 0.0)
    shown = with_captures_that_show(context, base)
    assert _smooth_chi2(context, base) < FLOOR_CHI2 < _smooth_chi2(shown, base)
    assert set(shown.split.coarse).isdisjoint({*context.split.fine, *context.split.held_out})


def test_a_cause_that_leaves_much_in_smooth_captures_is_searched_there(make_context: MakeContext) -> None:
    context = make_context({"iris2": STOP, "gap": {"gap_error": 1e-4}})
    assert with_captures_that_show(context, CandidateFit(("iris2",), {"iris2": STOP}, 0.0)) is context


def _smooth_chi2(context: SearchContext, base: CandidateFit) -> float:
    return context.data_weighted_comparison(context.split.coarse, 0.0).chi2_per_pixel(base.values)


GAP = {"gap": {"gap_error": 1e-4}}
LIGHT = Policy(Beside.AFFORDABLE, Until.EXPLAINED, Refit.OF_ALL_NUMBERS, more=3, share=0.3)


@pytest.mark.long
@pytest.mark.parametrize("seed", explored([6, 8], 1))
def test_two_further_causes_of_which_neither_takes_enough_are_named(seed: int) -> None:
    """Beside a gap: a blur and stray light, of which the one alone leaves 0.3 to 0.8 of the excess of the gap alone."""
    beside = {"camera_blur": {"sigma": 0.8}, "ambient": {"level": 2000.0}}
    settings = AcquisitionSettings(captures_per_condition=6, seed=seed)
    context = make_context_of(measure(small_system(), {**GAP, **beside}, settings))
    with context.workers:
        found = refine_candidates(context, InitialCandidates((CandidateFit(("gap",), GAP, 0.0),), LIGHT), no_progress)
    assert {*found.best.causes} == {"gap", "camera_blur", "ambient"}
    assert found.best.chi2_per_pixel < 1.1


def _result(*left: float) -> SearchResult:
    """Candidates of which the first has as many causes as numbers were given, and leaves the last of them."""
    fit = CandidateFit(tuple("abcdef"[: len(left)]), {}, 0.0)
    best, unused = HeldOutScore(fit, 1 + left[-1], 1.0), Mock()
    return SearchResult(HeldOutScore(CandidateFit((), {}, 0.0), 200.0, 1.0), (best,), unused, unused)


@pytest.mark.parametrize(
    ("left", "named"),
    [
        ([20.0], 2),
        ([50.0, 8.0], 3),  # each half, together less than 0.3²
        ([50.0, 20.0], 1),
        ([50.0, 45.0, 1.0], 1),  # the second takes next to nothing
        ([50.0, 25.0, 2.0], 4),
        ([50.0, 25.0, 5.0], 1),
        ([90.0, 1.0], 1),
        ([20.0, 10.0], 2),  # the second leaves half of what is left, too much
        ([20.0, 10.0, 1.0], 4),
    ],
)
@pytest.mark.parametrize("ends", [False, True])
def test_further_causes_stay_that_were_accepted(
    left: list[float], named: int, ends: bool, context: SearchContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    """left: of an excess of 100, by each further cause; when the time ends, it was noted too."""
    context = replace(context, best_so_far=BestSoFar())
    results = [_result(*[100.0, *left][: count + 1]) for count in range(len(left) + 1)]

    def one_more(context: SearchContext, result: SearchResult, number: int, *_: object) -> SearchResult:
        if number > len(results):
            if ends:
                raise SearchEnded
            return result
        context.best_so_far.note(results[number - 1])
        return results[number - 1]

    def is_better(_: SearchContext, new: SearchResult, old: SearchResult, share: float) -> bool:
        return new.best.excess < share * old.best.excess

    for name, stand_in in {
        "_search_further_causes": one_more,
        "_drop_superfluous_causes": lambda _, result: result,
        "free_fine_parameters": lambda _, result: result,
        "samples_that_explain": lambda *_: None,
        "_is_better": is_better,
    }.items():
        monkeypatch.setattr(search, name, stand_in)
    try:
        found = search._with_further_causes(context, results[0], [], no_progress, 6, LIGHT.share)
    except SearchEnded:
        assert ends and context.best_so_far.result is not None
        found = context.best_so_far.result
    assert len(found.best.causes) == named


@pytest.mark.parametrize("excess", [(15.0, 105.0), (11.0, 39.0)])
def test_causes_that_leave_much_more_than_the_best_are_no_base(
    excess: tuple[float, float], context: SearchContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Though smooth captures prefer them."""
    fits = [CandidateFit(("camera_blur", name), {}, 0.0) for name in ("ambient", "camera_black")]
    scores = tuple(HeldOutScore(fit, 1 + left, 1.0) for fit, left in zip(fits, excess, strict=True))
    result = SearchResult(HeldOutScore(CandidateFit((), {}, 0.0), 400.0, 1.0), scores, Mock(), Mock(pixel_count=1.0))
    monkeypatch.setattr(search, "cost_or_inf", lambda *_: 0.0)
    assert [one.causes for one in search._bases(context, result, 2)] == [fits[0].causes]
