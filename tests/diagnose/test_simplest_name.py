"""Of effects that are the same physics the one with fewer numbers is named, alone and beside another cause."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.fit import CandidateFit
from holoview.bench.diagnose.judge import Decision, HeldOutScore, SearchResult, Verdict, rank_on_held_out
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.refine import refine_fit
from holoview.bench.diagnose.rivals import prefer_fewer_numbers, wider_names
from holoview.bench.diagnose.screening import fit_over_range
from holoview.bench.diagnose.search_context import SearchContext
from holoview.light.model.effects.registry import listed_effects
from tests.diagnose.conftest import NOISE_CHI2, MakeContext, small_system

Truth = Mapping[str, Mapping[str, float]]
ERRORS = {"gap": {"gap_error": 1.5e-4}, "distance": {"distance_error": -3e-4}}
STROKE = {"stroke": {"stroke_error": 0.05}}


def _found_first(context: SearchContext, wide: str, base: Truth) -> SearchResult:
    """A search that came to the name of more numbers first, on top of what else is wrong."""
    known = {name: dict(values) for name, values in base.items()}
    return rank_on_held_out(context, [refine_fit(context, fit_over_range(context, known, context.effects[wide], []))])


def _decision(*causes: str) -> Decision:
    fit = CandidateFit(causes, {name: {} for name in causes}, 0.0)
    return Decision(Verdict.EXPLAINED, HeldOutScore(fit, 1.0, 1.0))


@pytest.mark.parametrize(
    ("simple", "wide", "other"),
    [
        ("gap", "aberration1", {}),
        pytest.param("gap", "aberration1", STROKE, marks=pytest.mark.explores),
        pytest.param("distance", "aberration2", {}, marks=pytest.mark.explores),
        pytest.param("distance", "aberration2", STROKE, marks=pytest.mark.explores),
    ],
)
def test_what_one_number_explains_is_named_by_it(
    make_context: MakeContext, simple: str, wide: str, other: Truth
) -> None:
    context = make_context({simple: ERRORS[simple], **other})
    found = prefer_fewer_numbers(context, _found_first(context, wide, other))
    assert set(found.best.causes) == {simple, *other}
    assert found.best.chi2_per_pixel < NOISE_CHI2 and {wide, *other} in [set(c.causes) for c in found.candidates]
    name, true = next(iter(ERRORS[simple].items()))
    assert found.best.fit.values[simple][name] == pytest.approx(true, rel=0.02)


@pytest.mark.long
def test_what_one_number_does_not_explain_keeps_its_name(make_context: MakeContext) -> None:
    """Defocus and astigmatism."""
    context = make_context({"aberration1": {"z4": 150e-9, "z5": 150e-9}})
    found = prefer_fewer_numbers(context, _found_first(context, "aberration1", {}))
    assert found.best.causes == ("aberration1",)


@pytest.mark.long
def test_a_second_line_does_not_stand_for_an_offset_of_the_wavelength(make_context: MakeContext) -> None:
    """An offset of 5 nm is far from the nominal wavelength: derivatives there don't lead to it, a second line does."""
    context = make_context({"wavelength_offset": {"offset": 5e-9}})
    found = prefer_fewer_numbers(context, _found_first(context, "second_line", {}))
    assert found.best.causes == ("wavelength_offset",)
    assert found.best.fit.values["wavelength_offset"]["offset"] == pytest.approx(5e-9, rel=0.02)
    assert ("second_line",) not in wider_names(context, _decision("wavelength_offset"))


def test_the_name_of_more_numbers_is_a_rival(context: SearchContext) -> None:
    assert wider_names(context, _decision("gap")) == [("aberration1",)]
    assert wider_names(context, _decision("crosstalk", "distance")) == [("crosstalk", "aberration2")]
    assert wider_names(context, _decision("stroke")) == [("stroke_map",)]
    assert wider_names(context, _decision("aberration1")) == []
    assert wider_names(context, Decision(Verdict.CONSISTENT, None)) == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_bandwidth_and_gap_are_named_so(seed: int) -> None:
    truth = {"bandwidth": {"sigma": 2e-9}, "gap": {"gap_error": 1.2e-4}}
    captures = make_captures(small_system(), truth, AcquisitionSettings(captures_per_condition=6, seed=seed))
    effects = [listed_effects()[name] for name in ("aberration1", "bandwidth", "camera_blur", "gap", "stroke")]
    found = diagnose(captures, effects, free_maps=False)
    assert {cause.effect for cause in found.causes} == set(truth) and found.verdict is Verdict.EXPLAINED
    assert any(set(rival) == {"bandwidth", "aberration1"} for rival in found.rivals)
