"""A Fourier bench: one modulator, a lens, the camera in its focal plane, a saturated zero order."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.report import error_places
from holoview.light.model.effects.registry import listed_effects
from tests.diagnose.conftest import small_system
from tests.explored import explored

SATURATED = 9  # pixels each way about the zero order


def _measured(effects: dict[str, dict[str, float]], seed: int) -> Captures:
    """Captures with a zero order that fills its pixels."""
    system = small_system(1)
    session = AcquisitionSettings(
        captures_per_condition=6, seed=seed, focal_length_m=0.1, camera_pitch_m=20e-6, camera_shape=(101, 121)
    )
    captures = make_captures(system, effects, session)
    images = captures.images.copy()
    middle = tuple(slice(n // 2 - SATURATED // 2, n // 2 + SATURATED // 2 + 1) for n in captures.shape)
    images[(slice(None), *middle)] = captures.camera.saturation
    return dataclasses.replace(captures, images=images)


@pytest.mark.parametrize(
    ("effects", "seed"),
    [
        ({"stroke": {"stroke_error": 0.12}}, 1),
        pytest.param({"camera_alignment": {"magnification": 0.02, "rotation": 0.01}}, 2, marks=pytest.mark.slow),
    ],
    ids=["stroke", "a camera that is turned and too large"],
)
def test_it_is_diagnosed_beside_its_saturated_zero_order(effects: dict[str, dict[str, float]], seed: int) -> None:
    few = ("stroke", "camera_alignment", "camera_blur", "distance", "crosstalk", "tilt")
    absent = ("gap", "slm_alignment", "iris1", "aberration2")  # this bench has none of these
    candidates = [listed_effects()[n] for n in (*few, *absent)]
    found = diagnose(_measured(effects, seed), candidates, workers=1, free_maps=False)
    assert found.verdict is Verdict.EXPLAINED and [c.effect for c in found.causes] == list(effects)
    (cause,) = found.causes
    for name, true in effects[cause.effect].items():
        interval = cause.intervals[name]
        assert abs(interval.value - true) <= 3 * interval.half_width  # as for hidden faults
    assert found.after.chi2_per_pixel == pytest.approx(1.0, abs=0.05) and found.before.chi2_per_pixel > 2


@pytest.mark.long
def test_one_modulator_in_the_near_field_has_no_rivals_between_two() -> None:
    captures = make_captures(small_system(1), {"stroke": {"stroke_error": 0.1}}, AcquisitionSettings(6, seed=1))
    candidates = [listed_effects()[n] for n in ("stroke", "camera_black", "gap", "slm_alignment", "iris1", "stage")]
    found = diagnose(captures, candidates, workers=1, free_maps=False)
    assert found.verdict is Verdict.EXPLAINED and [c.effect for c in found.causes] == ["stroke"]
    assert not any({"gap", "slm_alignment", "iris1"} & {*names} for names in found.rivals)


@pytest.mark.long
def test_a_zero_order_that_is_saturated_isnt_a_fault() -> None:
    few = [listed_effects()[n] for n in ("stroke", "undiffracted", "camera_black", "dc_block", "camera_gamma")]
    found = diagnose(_measured({}, 3), few, workers=1, free_maps=False)
    assert found.verdict is Verdict.CONSISTENT and not found.causes


def _averaged(effects: dict[str, dict[str, float]], seed: int) -> Captures:
    """Captures whose pixels, a third of a speckle wide, are the mean of 4 × 4 points; nobody states so."""
    session = AcquisitionSettings(
        captures_per_condition=3,
        seed=seed,
        focal_length_m=0.1,
        camera_pitch_m=20e-6,
        camera_shape=(160, 200),
        full_well=1e3,
    )
    fine = make_captures(small_system(1), effects, session)
    parts = fine.images.reshape(len(fine), 40, 4, 50, 4)
    full = fine.camera.saturation
    means = np.where(parts.max(axis=(2, 4)) == full, full, parts.mean(axis=(2, 4)))
    camera = dataclasses.replace(
        fine.camera,
        pitch_m=80e-6,
        electrons_per_count=16 * fine.camera.electrons_per_count,
        read_noise=4 * fine.camera.read_noise,
        integrates=None,
    )
    return dataclasses.replace(fine, images=np.rint(means).astype(np.uint16), camera=camera)


FEW = ("stroke", "camera_blur", "camera_black", "tilt")


@pytest.mark.long
@pytest.mark.parametrize(
    "effects", explored([{}, {"camera_blur": {"sigma": 3.0}}, {"stroke": {"stroke_error": 0.1}}], 2)
)
def test_camera_pixels_that_integrate_arent_a_blur(effects: dict[str, dict[str, float]]) -> None:
    """A blur that is more than the pixels' area is named, and no other one."""
    found = diagnose(_averaged(effects, 5), [listed_effects()[n] for n in FEW], workers=1, free_maps=False)
    assert [cause.effect for cause in found.causes] == [*effects]
    assert found.verdict is (Verdict.EXPLAINED if effects else Verdict.CONSISTENT)
    assert any("camera pixels measure the mean light over their area" in note for note in found.notes)


@pytest.mark.parametrize("states", [True, False])
def test_captures_that_sample_points_are_consistent_whether_they_state_it_or_not(states: bool) -> None:
    session = AcquisitionSettings(
        captures_per_condition=3, seed=4, focal_length_m=0.1, camera_pitch_m=80e-6, camera_shape=(40, 50)
    )
    captures = make_captures(small_system(1), {}, session)
    assert captures.camera.integrates is False
    if not states:
        captures = dataclasses.replace(captures, camera=dataclasses.replace(captures.camera, integrates=None))
    found = diagnose(captures, [listed_effects()[n] for n in FEW], workers=1, free_maps=False)
    assert found.verdict is Verdict.CONSISTENT and not found.causes
    assumed = [note for note in found.notes if "camera pixels measure the light at their middle" in note]
    assert bool(assumed) is not states


@pytest.mark.long
def test_free_maps_are_fitted_where_no_candidate_explains_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """One step at each place that such a bench has: there is no pupil behind its modulator."""
    session = AcquisitionSettings(
        captures_per_condition=3, seed=1, focal_length_m=0.1, camera_pitch_m=40e-6, camera_shape=(41, 51)
    )
    captures = make_captures(small_system(1), {"stroke": {"stroke_error": 0.2}}, session)
    monkeypatch.setattr(error_places, "ITERATIONS", 1)
    found = diagnose(captures, [listed_effects()["camera_black"]])
    assert found.verdict in (Verdict.UNEXPLAINED, Verdict.PARTLY)
    assert set(found.lives_in) <= {"source", "modulator 1", "camera"}


def test_what_such_a_bench_cant_show_is_said() -> None:
    captures = _measured({}, 4)
    shown = [one for one in listed_effects().values() if not one.needs.unmet_by(captures.data_properties())]
    assert {"gap", "slm_alignment", "iris1", "aberration1", "aberration2"}.isdisjoint(e.id for e in shown)
    assert np.all(captures.images[:, 50, 60] == captures.camera.saturation)
