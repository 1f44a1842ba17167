"""What predicts the same in these captures can't be excluded, however the search came to one of the names."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from holoview.bench.diagnose.fit import CandidateFit
from holoview.bench.diagnose.judge import SearchResult, Verdict, decide, rank_on_held_out, score_on_held_out
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.power_law import changes_only_power
from holoview.bench.diagnose.refine import refine_fit
from holoview.bench.diagnose.rivals import find_lookalikes, with_rivals
from holoview.bench.diagnose.screening import fit_over_range
from holoview.bench.diagnose.search_context import SearchContext
from holoview.light.model.effects.registry import EffectValues, listed_effects
from holoview.light.model.system import System
from holoview.util.errors import UserError
from tests.diagnose.conftest import make_context_of, measure_at_one_exposure, small_system
from tests.diagnose.effect_sampling import sample_effect
from tests.explored import explored

MODULATOR = {"slm_alignment": {"shift_y": 3e-6, "rotation": 3e-3}}
BLACK = {"camera_black": {"black": 45.0}}
EXCLUDED = 25.0
"""Δχ² that excludes an explanation."""


def _one_laser() -> System:
    return dataclasses.replace(small_system(), wavelengths_m=np.array([520e-9]), amplitudes=np.ones((1, 1)))


def _seen_only(context: SearchContext) -> SearchContext:
    """Without the effects that these captures can't show, which become possible rivals."""
    properties = context.data.captures.data_properties()
    unseen = {e.id: e for e in context.effects.values() if e.needs.unmet_by(properties) and not changes_only_power(e)}
    seen = {e.id: e for e in context.effects.values() if not e.needs.unmet_by(properties)}
    return dataclasses.replace(context, effects=seen, unseen=unseen)


def _found(context: SearchContext, truth: EffectValues) -> SearchResult:
    """A search that came to the truth, and to nothing else."""
    values = {name: dict(own) for name, own in truth.items()}
    return rank_on_held_out(context, [refine_fit(context, CandidateFit((*values,), values, 0.0))])


ALIKE = ("ambient", "camera_alignment", "camera_black", "camera_gamma", "gap", "slm_alignment", "stroke")


@pytest.mark.long
@pytest.mark.parametrize("names", explored([ALIKE, tuple(listed_effects())], [ALIKE]), ids=["few", "all"])
def test_a_black_level_at_one_exposure_may_be_light_of_the_room(names: tuple[str, ...]) -> None:
    """Light of the room has more noise: by χ² alone it explained the captures better than the truth, χ²/n 0.6."""
    captures = measure_at_one_exposure(small_system(), {**BLACK, **MODULATOR}, seed=2)
    found = diagnose(captures, [listed_effects()[name] for name in names], free_maps=False)
    assert found.verdict is Verdict.AMBIGUOUS
    assert {cause.effect for cause in found.causes} == {"camera_black", "slm_alignment"}
    assert {frozenset(rival) for rival in found.rivals} == {frozenset({"ambient", "slm_alignment"})}
    black = next(cause for cause in found.causes if cause.effect == "camera_black")
    assert black.separate_by == "a capture with a tenth of the exposure" and black.confounded_with["ambient"] == 1.0
    pixels = 4 * 44 * 60
    assert found.after.chi2_per_pixel == pytest.approx(1.0, abs=0.02 + 5 * (2 / pixels) ** 0.5)


def test_the_noise_of_the_likeliest_candidate_judges_all() -> None:
    """Whichever comes first: with the noise of light of the room every χ²/n would be 0.6."""
    context = make_context_of(measure_at_one_exposure(small_system(), BLACK, seed=3))
    black = CandidateFit(("camera_black",), {"camera_black": {"black": 45.0}}, 0.0)
    room = CandidateFit(("ambient",), {"ambient": {"level": 900.0, "slope_y": 0.0, "slope_x": 0.0}}, 0.0)
    for fits in ([black, room], [room, black]):
        result = rank_on_held_out(context, fits)
        assert result.best.causes == ("camera_black",)  # fewer numbers
        for score in result.candidates:
            assert score.chi2_per_pixel == pytest.approx(1.0, abs=0.01 + 5 * (2 / result.pixel_count) ** 0.5)


@pytest.mark.parametrize(
    ("truth", "rival"),
    [
        ({"camera_alignment": {"shift_y": 2e-6, "shift_x": -1e-6}}, "stage"),
        ({"stroke": {"stroke_error": 0.03}}, "dispersion"),
    ],
)
def test_what_these_captures_cannot_show_cannot_be_excluded(truth: EffectValues, rival: str) -> None:
    """One plane doesn't tell a rail that leans from a camera that is displaced, nor one laser the two strokes."""
    context = _seen_only(make_context_of(measure_at_one_exposure(_one_laser(), truth, seed=4)))
    found = with_rivals(context, _found(context, truth))
    assert (rival,) in [fit.causes for fit in found.unseen_rivals]
    assert found.best.causes == (*truth,) and (rival,) not in [c.causes for c in found.candidates]


SIZES = (0.05, 0.3)


@pytest.mark.explores
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", [name for name, e in listed_effects().items() if not changes_only_power(e)])
def test_of_all_pairs_what_predicts_the_same_is_told(name: str, size: float) -> None:
    """Each effect simulated in a file of one laser, plane, power and exposure; every look-alike fitted to it."""
    effect, seed = listed_effects()[name], [*listed_effects()].index(name)
    truth = {name: sample_effect(effect, _one_laser(), size, np.random.default_rng(seed))}
    try:
        captures = measure_at_one_exposure(_one_laser(), truth, seed)
    except (UserError, ValueError) as error:
        pytest.skip(f"can't be measured: {error}")
    everything = make_context_of(captures)
    context = _seen_only(everything)
    if name not in context.effects:
        pytest.skip("can't be seen in this file")
    result = _found(context, truth)
    if decide(result, context.equivalents, context.config.verdict).verdict is not Verdict.EXPLAINED:
        pytest.skip("too small to be seen")
    found = with_rivals(context, result)
    told = {c.causes[0] for c in found.candidates if c.excess < found.best.excess + EXCLUDED / found.pixel_count}
    told |= {fit.causes[0] for fit in found.unseen_rivals} | context.equivalents[name]
    for other, share in find_lookalikes(context, result.best.fit).shares[name].items():
        if share < 0.7 or other in told:
            continue
        fit = refine_fit(everything, fit_over_range(everything, {}, everything.effects[other], []))
        score = score_on_held_out(fit, result.comparison, result.tolerant_comparison)
        assert (score.chi2_per_pixel - result.best.chi2_per_pixel) * result.pixel_count > EXCLUDED, other
