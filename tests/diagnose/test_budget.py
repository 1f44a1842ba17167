"""A search ends at its budget of fields, whoever computes them; many fields are begun only where they pay."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from holoview.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.diagnose import pipeline as whole
from holoview.diagnose.effect_fit import CandidateFit
from holoview.diagnose.field_count import incoherent_field_count, is_costly, max_field_count, without_costly_fits
from holoview.diagnose.search_context import SearchContext
from holoview.diagnose.verdict import Verdict
from holoview.model.effects.registry import listed_effects
from tests.diagnose.conftest import MakeBench, small_system

TWO = {"gap": {"gap_error": 2e-4}, "stroke": {"stroke_error": 0.2}}
FEW = ["gap", "stroke", "tilt"]


def _trial(**values: dict[str, float]) -> CandidateFit:
    return CandidateFit(tuple(values), values, 0.0)


def test_fields_are_counted_for_captures_wavelengths_directions_and_moments(make_bench: MakeBench) -> None:
    bench = make_bench()
    assert bench.predictor.fields_requested == 0
    bench.predictor(np.array([0, 1]), {})
    bench.predictor(np.array([0]), {})  # kept, and counted all the same
    assert bench.predictor.fields_requested == 3
    flicker = {"flicker": {"depth": 0.1}}
    assert incoherent_field_count(bench, flicker) == max_field_count(bench, listed_effects()["flicker"]) == 6
    before = bench.predictor.fields_requested
    bench.predictor(np.array([0]), flicker)
    assert bench.predictor.fields_requested == before + 6


def test_a_bench_is_spent_beyond_its_fields(make_bench: MakeBench) -> None:
    bench = dataclasses.replace(make_bench(), field_budget=2)
    bench.predictor(np.array([0, 1]), {})
    assert not bench.budget_exhausted
    bench.predictor(np.array([0]), {})
    assert bench.budget_exhausted


def test_many_fields_pay_only_where_nothing_simpler_does_as_well(make_bench: MakeBench) -> None:
    many, simple = _trial(bandwidth={"sigma": 3e-9}), _trial(gap={"gap_error": 1e-6})
    for fault, kept in (
        ({"bandwidth": {"sigma": 3e-9}}, [many, simple]),
        ({"stroke": {"stroke_error": 0.2}}, [simple]),
    ):
        bench: SearchContext = make_bench(fault)
        assert is_costly(bench, many) and not is_costly(bench, simple)
        assert without_costly_fits(bench, [many, simple], bench.data_weighted_comparison(bench.split.fine, 0.0)) == kept


def test_a_search_that_was_ended_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    captures = make_captures(small_system(), TWO, AcquisitionSettings(captures_per_condition=6, seed=1))
    effects = [listed_effects()[name] for name in FEW]
    monkeypatch.setattr(whole, "_MOST_FIELDS", 200)
    short = whole.diagnose(captures, effects, workers=1, free_maps=False)
    assert short.verdict in (Verdict.UNEXPLAINED, Verdict.PARTLY)
    assert any("--thorough" in note for note in short.notes)
    thorough = whole.diagnose(captures, effects, workers=1, free_maps=False, thorough=True)
    assert thorough.verdict is Verdict.EXPLAINED and {c.effect for c in thorough.causes} == set(TWO)
    assert not any("--thorough" in note for note in thorough.notes)


def test_the_end_does_not_depend_on_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    captures = make_captures(small_system(), TWO, AcquisitionSettings(captures_per_condition=6, seed=2))
    effects = [listed_effects()[name] for name in FEW]
    monkeypatch.setattr(whole, "_MOST_FIELDS", 1000)
    found = [whole.diagnose(captures, effects, workers=n, free_maps=False).as_json() for n in (1, 3)]
    first, second = ({k: v for k, v in one.items() if k != "seconds"} for one in found)
    assert json.dumps(first) == json.dumps(second)
