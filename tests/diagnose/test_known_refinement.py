"""Errors of known effects are no causes, and hide none."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
import torch

from holoview.bench.captures import Captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.extended_model import PredictorWithKnownEffects
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.report.diagnosis import Diagnosis
from holoview.light.model.bench_parts import Modulator
from holoview.light.model.effects.effect import Effect, Parameter, Values
from holoview.light.model.effects.hook_contexts import CameraContext
from holoview.light.model.effects.registry import get_effect
from holoview.light.model.system import System

KNOWN = {"gap": {"gap_error": 80e-6}}
UNCERTAIN = {
    "gap": {"gap_error": 3e-6},
    "distance": {"distance_error": 4e-6},
    "camera_alignment": {"rotation": 2e-4, "magnification": 2e-4},
}
ERRORS = {
    "gap": {"gap_error": 4e-6},
    "distance": {"distance_error": -5e-6},
    "camera_alignment": {"rotation": 1e-4, "magnification": -3e-4},
}
NAMES = ("gap", "distance", "camera_alignment", "stroke", "vignetting", "camera_gamma", "wavelength_offset")


def _measured(fault: dict[str, dict[str, float]], errors: dict[str, dict[str, float]], each: int = 4) -> Captures:
    """A bench with the known gap, errors of what was measured, and a fault."""
    panel = Modulator(pitch_m=8e-6, shape=(32, 40), stroke_m=825e-9, levels=256)
    system = System(
        wavelengths_m=np.array([450e-9, 600e-9]),
        amplitudes=np.ones((1, 2)),
        modulators=(panel, panel),
        gap_m=1e-3,
        planes_m=np.array([3e-3, 6e-3]),
        observer="mono",
    )
    true = errors | {"gap": {"gap_error": KNOWN["gap"]["gap_error"] + errors.get("gap", {}).get("gap_error", 0.0)}}
    return make_captures(system, true | fault, AcquisitionSettings(captures_per_condition=each, seed=2))


def _diagnosed(captures: Captures, names: Sequence[str] = NAMES, time_s: float | None = None) -> Diagnosis:
    effects = [get_effect(name) for name in names]
    return diagnose(captures, effects, known=KNOWN, uncertain=UNCERTAIN, free_maps=False, time_s=time_s)


def _farthest(found: Diagnosis, errors: dict[str, dict[str, float]]) -> float:
    """How far the known values are from the true ones at most, in uncertainties."""
    return max(
        abs(found.known[name][key] - KNOWN.get(name, {}).get(key, 0.0) - errors.get(name, {}).get(key, 0.0)) / sigma
        for name, own in UNCERTAIN.items()
        for key, sigma in own.items()
    )


@pytest.mark.long
@pytest.mark.parametrize(
    "fault", [pytest.param({}, marks=pytest.mark.explores), {"stroke": {"stroke_error": -0.03}}], ids=["none", "stroke"]
)
def test_errors_of_a_measurement_are_corrected_and_only_the_fault_is_named(fault: dict[str, dict[str, float]]) -> None:
    found = _diagnosed(_measured(fault, ERRORS))
    assert found.verdict == (Verdict.EXPLAINED if fault else Verdict.CONSISTENT)
    assert [cause.effect for cause in found.causes] == list(fault)
    # With six draws noise moved the magnification by 0.09 uncertainties, the others by 0.05; errors are 0.5 to 1.5.
    assert _farthest(found, ERRORS) < 0.5
    assert any(note.startswith("Known effects were corrected") for note in found.notes)


@pytest.mark.explores
def test_an_error_beyond_the_uncertainty_is_a_cause() -> None:
    errors = {"gap": {"gap_error": 30e-6}}
    found = _diagnosed(_measured({}, errors))
    assert [cause.effect for cause in found.causes] == ["gap"]
    assert found.values["gap"]["gap_error"] == pytest.approx(30e-6, abs=1e-6)
    assert found.causes[0].sentence == "The gap is 1.11 mm, not 1.08 mm."


@pytest.mark.long
def test_a_correction_that_takes_too_long_is_told() -> None:
    captures = _measured({}, ERRORS, each=2)
    assert _diagnosed(captures, ("stroke",), time_s=0.0).known == KNOWN
    found = _diagnosed(captures, time_s=0.0)
    assert any("stayed as they were measured" in note for note in found.notes)


@pytest.mark.long
def test_where_nothing_asks_for_it_nothing_is_corrected() -> None:
    found = _diagnosed(_measured({}, {}))
    assert found.verdict is Verdict.CONSISTENT and found.known == KNOWN


class _Brighter(Effect):
    """One that no registry has."""

    id, cause, finding, acts_on = "brighter", "Brighter.", "Brighter by {factor}.", ("camera",)
    parameters = (Parameter("factor", "Of all light.", low=0.0, prior=1.0),)

    def image(self, image: torch.Tensor, at: CameraContext, v: Values) -> torch.Tensor:
        return image * (1 + v["factor"])


def test_effects_of_ones_own_may_stand_beside_known_ones() -> None:
    captures = _measured({}, {})
    plain, extended = (
        PredictorWithKnownEffects(captures, KNOWN),
        PredictorWithKnownEffects(captures, KNOWN, extra_effects=[_Brighter()]),
    )
    first = plain([0], {}).signal
    assert torch.equal(extended([0], {"brighter": {"factor": 1.0}}).signal, 2 * first)
