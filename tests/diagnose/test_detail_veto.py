"""What takes away detail that the pictures show isn't named, however much it lowers χ²."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.detail_veto import (
    detail,
    fit_what_stays,
    veto_lost_detail,
    veto_no_size,
    veto_uncorrelated,
    veto_without_effect,
)
from holoview.bench.diagnose.fit import CandidateFit
from holoview.bench.diagnose.intervals import Interval
from holoview.bench.diagnose.judge import (
    Decision,
    SearchResult,
    Verdict,
    chance_excess,
    rank_on_held_out,
    score_on_held_out,
)
from holoview.bench.diagnose.search_context import SearchContext
from holoview.light.model.effects.effect import ListParameter
from holoview.light.model.effects.registry import listed_effects
from tests.diagnose.conftest import make_context_of, small_system

BLURRED = {"camera_blur": {"sigma": 3.0}}


def _measured(effects: dict[str, dict[str, float]], camera_shape: tuple[int, int] = (61, 81)) -> Captures:
    session = AcquisitionSettings(
        captures_per_condition=6, seed=5, focal_length_m=0.1, camera_pitch_m=40e-6, camera_shape=camera_shape
    )
    return make_captures(small_system(1), effects, session)


def _with_patterns_of_others(captures: Captures) -> Captures:
    """Captures whose patterns are none that were shown: their speckle stands nowhere."""
    rng = np.random.default_rng(6)
    levels = np.stack([rng.permuted(a, axis=-1) for a in captures.levels])
    return dataclasses.replace(captures, levels=levels)


def test_detail_is_that_of_the_grains_whatever_their_place_and_brightness() -> None:
    """A moved and brighter picture has the same detail; a Gaussian blur of the grains' own width leaves less."""
    rng = np.random.default_rng(1)
    grains = np.exp(gaussian_filter(rng.standard_normal((64, 80)), 1.5, mode="wrap") * 5)
    lit, mean = np.ones(grains.shape, bool), np.full(grains.shape, grains.mean())
    whole = detail(grains, mean, lit)
    moved = 7 * np.roll(grains, (20, 33), (0, 1))
    # The border between the last and first row and column counts in the moved picture alone: 1 pair of 64, 1 of 80.
    assert detail(moved, 7 * mean, lit) == pytest.approx(whole, rel=0.1)
    assert detail(gaussian_filter(grains, 1.5, mode="wrap"), mean, lit) < 0.6 * whole


@pytest.mark.parametrize("is_real", [True, False])
def test_a_blur_is_named_only_where_the_pictures_lack_the_detail(is_real: bool) -> None:
    """Beside patterns that were never shown a blur lowers χ² as well, of pictures with all of their detail."""
    captures = _measured(BLURRED) if is_real else _with_patterns_of_others(_measured({}))
    context = make_context_of(captures)
    fit = CandidateFit(("camera_blur",), BLURRED, 0.0)
    result = rank_on_held_out(context, [fit])
    assert result.best.causes == ("camera_blur",)  # χ² prefers it
    decision, notes = veto_lost_detail(context, result, Decision(Verdict.PARTLY, result.best))
    if is_real:
        assert decision.best is not None and decision.best.causes == ("camera_blur",) and not notes
    else:
        assert decision.verdict is Verdict.UNEXPLAINED and decision.best is None
        assert notes[0].startswith("camera_blur is not named")


def _partly(context: SearchContext, values: dict[str, dict[str, float]]) -> tuple[SearchResult, Decision]:
    result = rank_on_held_out(context, [CandidateFit(tuple(values), values, 0.0)])
    return result, Decision(Verdict.PARTLY, result.best)


def test_a_cause_of_no_size_is_not_named_beside_a_true_one() -> None:
    """A shift of the picture by a billionth of a metre, 25 millionths of a pixel, changes no prediction."""
    true = {"tilt": {"tilt_y": 0.001, "tilt_x": -0.002}}
    context = make_context_of(_measured(true))
    result, decision = _partly(context, true | {"camera_alignment": {"shift_y": 1e-9}})
    decided, notes = veto_without_effect(context, result, decision)
    assert decided.best is not None and decided.best.causes == ("tilt",) and decided.verdict is Verdict.PARTLY
    assert notes == ["camera_alignment is not named: without it the held-out pixels are predicted as well."]
    assert veto_without_effect(context, result, decided) == (decided, [])  # what acts stays


@pytest.mark.parametrize(("half_width", "is_named"), [(1e-6, False), (1e-8, True)])
def test_a_cause_that_may_be_nominal_is_not_named_beside_a_true_one(half_width: float, is_named: bool) -> None:
    """A shift by a hundredth of a micrometre, known to a micrometre or to a hundredth of that; the tilt is large."""
    true = {"tilt": {"tilt_y": 0.001, "tilt_x": -0.002}}
    context = make_context_of(_measured(true))
    shift = {"camera_alignment": {"shift_y": 1.1e-8}}
    result, decision = _partly(context, true | shift)
    within = Interval(1.1e-8, half_width / 2, half_width)
    intervals = {("camera_alignment", "shift_y"): within, ("tilt", "tilt_y"): Interval(0.001, 1e-5, 2e-5)}
    decided, notes = veto_no_size(context, result, decision, intervals)[1:]
    assert decided.best is not None and decided.best.causes == ("tilt", *shift)[: 1 + is_named]
    assert is_named == (not notes)


@pytest.mark.parametrize("name", sorted(listed_effects()))
def test_every_effect_may_have_no_size_but_entries_of_a_list(name: str) -> None:
    """Numbers at their nominal values, but for those that then change nothing, as the edge of a beam of no size: not
    named, beside a true cause. The entries of a list have no nominal value."""
    true = {"wavelength_offset" if name == "tilt" else "tilt": {}}
    context = make_context_of(_measured({}))
    effect = listed_effects()[name]
    own = {p.name: p.identity for p in effect.parameters if not isinstance(p, ListParameter)}
    result, decision = _partly(context, {**true, name: own})
    numbers = {p.name: p.read(own) for p in effect.parameters if not isinstance(p, ListParameter)}
    entries = {f"{p.name}[0]": 0.0 for p in effect.parameters if isinstance(p, ListParameter)}
    intervals = {(name, part): Interval(value, 0.1, 0.2) for part, value in (numbers | entries).items()}
    away = {p.name: p.read(own) + 1.0 for p in effect.parameters if not isinstance(p, ListParameter) and p.modifies}
    intervals |= {(name, part): Interval(value, 0.1, 0.2) for part, value in away.items()}
    decided, notes = veto_no_size(context, result, decision, intervals)[1:]
    assert decided.best is not None and (name in decided.best.causes) == bool(entries) == (not notes)


def test_a_cause_that_pictures_need_is_named_however_uncertain_its_numbers_are() -> None:
    """Numbers that stand for each other have wide intervals, though one of them has to act."""
    true = {"tilt": {"tilt_y": 0.001, "tilt_x": -0.002}, "camera_alignment": {"shift_y": 4e-5}}
    context = make_context_of(_measured(true))
    result, decision = _partly(context, true)
    intervals = {(name, key): Interval(v, 9.0, 9.0) for name, own in true.items() for key, v in own.items()}
    assert veto_no_size(context, result, decision, intervals) == (result, decision, [])


def test_the_others_are_fitted_again_without_a_cause_that_may_be_nominal() -> None:
    """On a Fourier bench a tilt θ moves the picture by f·θ: a tenth of it taken for a shift is the tilt's."""
    true = {"tilt": {"tilt_y": 1e-3, "tilt_x": -2e-3}}
    context = make_context_of(_measured(true))
    parted = {"tilt": {"tilt_y": 0.9e-3, "tilt_x": -2e-3}, "camera_alignment": {"shift_y": 0.1 * 0.1e-3}}
    result, decision = _partly(context, parted)
    intervals = {("tilt", "tilt_y"): Interval(0.9e-3, 1e-5, 2e-5)}
    intervals |= {("camera_alignment", "shift_y"): Interval(1e-5, 1e-5, 2e-5)}
    assert veto_no_size(context, result, decision, intervals) == (result, decision, [])  # just left out, it is missed
    decided, notes = veto_no_size(context, result, decision, intervals, context)[1:]
    assert decided.best is not None and decided.best.causes == ("tilt",) and len(notes) == 1
    assert decided.values["tilt"]["tilt_y"] == pytest.approx(1e-3, rel=0.01)


def test_causes_that_stay_are_fitted_again_once_a_veto_has_dropped_another() -> None:
    """On a Fourier bench a tilt θ moves the picture by f·θ: a tenth of it was taken for a shift, which is dropped."""
    true = {"tilt": {"tilt_y": 1e-3, "tilt_x": -2e-3}}
    context = make_context_of(_measured(true))
    parted = {"tilt": {"tilt_y": 0.9e-3, "tilt_x": -2e-3}, "camera_alignment": {"shift_y": 0.1 * 0.1e-3}}
    result, decision = _partly(context, parted)
    assert decision.best is not None
    fewer = score_on_held_out(decision.best.fit.without("camera_alignment"), result.comparison, result.comparison)
    fitted, decided = fit_what_stays(context, result, dataclasses.replace(decision, best=fewer))
    assert decided.verdict is Verdict.EXPLAINED and decided.best is fitted.best
    assert {*fitted.best.causes} == {"tilt"} and all("camera_alignment" not in one.causes for one in fitted.candidates)
    assert decided.values["tilt"]["tilt_y"] == pytest.approx(1e-3, rel=0.01)
    again = fit_what_stays(context, fitted, decided)[1]
    assert fitted.comparison.chi2_per_pixel(again.values) <= fitted.best.chi2_per_pixel  # a worse fit is never taken


@pytest.mark.parametrize("is_at_noise", [True, False])
def test_what_explains_within_tolerance_alone_does_so_without_a_cause_that_may_be_nominal(is_at_noise: bool) -> None:
    """A blur beside a large tilt, of an interval that holds none: it stays where both leave noise alone. Where a blur
    that is a bit too narrow leaves more, it isn't named, and the tilt explains a part."""
    true = {"tilt": {"tilt_y": 0.001, "tilt_x": -0.002}, "camera_blur": {"sigma": 0.5}}
    context = make_context_of(_measured(true))
    sigma = 0.5 if is_at_noise else 0.48
    result, decision = _partly(context, true | {"camera_blur": {"sigma": sigma}})
    assert (result.best.excess <= chance_excess(result.pixel_count)) == is_at_noise
    intervals = {("tilt", "tilt_y"): Interval(0.001, 1e-5, 2e-5), ("camera_blur", "sigma"): Interval(sigma, 1.0, 2.0)}
    explained = dataclasses.replace(decision, verdict=Verdict.EXPLAINED)
    decided, notes = veto_no_size(context, result, explained, intervals)[1:]
    assert decided.best is not None and ("camera_blur" in decided.best.causes) == is_at_noise == (not notes)
    assert decided.verdict is (Verdict.EXPLAINED if is_at_noise else Verdict.PARTLY)


@pytest.mark.parametrize("camera_shape", [(61, 81), (21, 22)], ids=["many grains", "few lit pixels"])
@pytest.mark.parametrize("is_shown", [True, False])
def test_nothing_is_named_far_from_pictures_whose_speckle_stands_nowhere(
    is_shown: bool, camera_shape: tuple[int, int]
) -> None:
    """Light of the room lowers χ² beside patterns that were never shown; beside those that were, their speckle stands,
    though the room's light stays a part of what is wrong. In a few grains chance correlates, but seldom by 4 σ."""
    room = {"ambient": {"level": 0.1}}
    measured = _measured(room | {"tilt": {"tilt_y": 1e-4}}, camera_shape)
    context = make_context_of(measured if is_shown else _with_patterns_of_others(measured))
    result, decision = _partly(context, room)
    if is_shown:
        assert veto_uncorrelated(context, result, decision) == (decision, [])
        return
    assert result.best.chi2_per_pixel > 4
    decided, notes = veto_uncorrelated(context, result, decision)
    assert decided.verdict is Verdict.UNEXPLAINED and decided.best is None
    assert "the predicted speckle doesn't stand in the pictures" in notes[0]
