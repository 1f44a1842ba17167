"""A gross cause is refined from far away, and where another one is missing the fit isn't led astray."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import pytest

from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.fit import CandidateFit
from holoview.bench.diagnose.judge import rank_on_held_out
from holoview.bench.diagnose.refine import free_fine_parameters, refine_fit
from holoview.light.model.effects.registry import effect_on_bench
from tests.diagnose.conftest import MakeContext, make_context_of, small_system

GROSS = {"z4": 4e-7, "z5": 3e-7, "z9": -4e-7}


def _fit(cause: str, values: Mapping[str, float]) -> CandidateFit:
    return CandidateFit((cause,), {cause: dict(values)}, 0.0)


@pytest.mark.long
def test_a_gross_cause_is_found_from_far_away(make_context: MakeContext, monkeypatch: pytest.MonkeyPatch) -> None:
    """One tolerant fit from half of three aberrations leaves too much for the next stage; further ones come near.

    In 26 draws of the patterns one fit left 0.195 ± 0.014, and further ones found the values within 0.3 %.
    """
    context = make_context({"aberration1": GROSS})
    far = _fit("aberration1", {name: 0.5 * x for name, x in GROSS.items()})
    with monkeypatch.context() as only:
        only.setattr("holoview.bench.diagnose.refine._TOLERANT_ROUNDS", 1)
        once = refine_fit(context, far)
    assert context.relative_model_error(once.values) > 0.1
    found = refine_fit(context, far).values["aberration1"]
    assert {name: found[name] for name in GROSS} == pytest.approx(GROSS, rel=0.02)


def test_a_cause_is_not_led_astray_by_another_that_is_missing(make_context: MakeContext) -> None:
    """Rough captures of a laser that flickers look most like those with less dispersion than there is."""
    truth = {"dispersion": {"slope": 0.29}, "flicker": {"depth": 0.27}}
    context = make_context(truth)
    right = _fit("dispersion", truth["dispersion"])
    refined = refine_fit(context, right)
    assert context.relative_model_error(refined.values) <= context.relative_model_error(right.values)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("strength", [1.0, 2.0])
def test_secondary_numbers_are_freed_far_from_the_floor_too_where_they_explain_much(seed: int, strength: float) -> None:
    """A wavefront on a Fourier bench, of which the first three numbers leave as much as a map of strokes does."""
    wave = {"z4_1": 12e-9, "z6_1": -8e-9, "z8_1": -8e-9, "z10_1": -7e-9, "z11_1": -5e-9}
    true = {"slm_flatness": {name: strength * value for name, value in wave.items()}}
    settings = AcquisitionSettings(
        captures_per_condition=6, seed=seed, focal_length_m=0.1, camera_pitch_m=40e-6, camera_shape=(61, 81)
    )
    captures = make_captures(small_system(1), true, settings)
    properties, context = captures.data_properties(), make_context_of(captures)
    seen = {name: effect_on_bench(effect, properties) for name, effect in context.effects.items()}
    context = dataclasses.replace(context, effects=seen)
    primary = {"z4_1": strength * 12e-9, "z6_1": -strength * 8e-9}
    starts = {"stroke_map": {"z1_1": 0.01, "z4_1": 0.02, "z6_1": 0.01}, "slm_flatness": primary}
    fits = [refine_fit(context, CandidateFit((name,), {name: values}, 0.0)) for name, values in starts.items()]
    result = rank_on_held_out(context, fits)
    assert result.best.excess > 10  # far, and neither is clearly better
    freed = free_fine_parameters(context, result).best
    assert freed.causes == ("slm_flatness",) and freed.excess < 0.1
    assert freed.fit.values["slm_flatness"]["z8_1"] == pytest.approx(-strength * 8e-9, rel=0.05)
