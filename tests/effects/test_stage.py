"""The rail's errors are those of distance and camera position, in proportion to the distance of each plane."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.light.model.effects.registry import ActiveEffects, unmet_requirement
from tests.diagnose.conftest import small_system

Make = Callable[..., Captures]
Predicted = Callable[..., torch.Tensor]
PLANES = np.array([3e-3, 5e-3])
ROUNDING = 1e-10  # of the brightest pixel, in complex128


def _same(found: torch.Tensor, expected: torch.Tensor) -> bool:
    return float((found - expected).abs().max()) < ROUNDING * float(expected.max())


def test_a_wrong_scale_is_an_error_that_grows_with_the_distance(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(2, distance_m=PLANES)
    found = predicted(captures, {"stage": {"scale": 0.02}})
    for k, z in enumerate(PLANES):
        assert _same(found[k], predicted(captures, {"distance": {"distance_error": 0.02 * z}})[k])
        assert not _same(found[k], predicted(captures)[k])


def test_an_inclined_rail_and_a_growing_picture_are_those_of_a_displaced_camera(
    make_session: Make, predicted: Predicted
) -> None:
    captures = make_session(2, distance_m=PLANES)
    found = predicted(captures, {"stage": {"walk_y": 1e-3, "walk_x": -2e-3, "growth": 3.0}})
    for k, z in enumerate(PLANES):
        moved = {"shift_y": 1e-3 * z, "shift_x": -2e-3 * z, "magnification": 3.0 * z}
        assert _same(found[k], predicted(captures, {"camera_alignment": moved})[k])


def test_the_walk_is_in_proportion_to_the_true_distance(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(1)
    found = predicted(captures, {"stage": {"scale": 0.1, "walk_x": 1e-3}})
    parts = {"distance": {"distance_error": 0.3e-3}, "camera_alignment": {"shift_x": 3.3e-6}}
    assert _same(found[0], predicted(captures, parts)[0])


def test_on_a_fourier_bench_all_of_it_is_in_proportion_to_the_defocus(make_fourier: Make, predicted: Predicted) -> None:
    captures = make_fourier(2, distance_m=np.array([0.0, 4e-3]))
    found = predicted(captures, {"stage": {"scale": 0.1, "walk_y": 2e-3}})
    assert torch.equal(found[0], predicted(captures)[0])
    parts = {"distance": {"distance_error": 0.4e-3}, "camera_alignment": {"shift_y": 8.8e-6}}
    assert _same(found[1], predicted(captures, parts)[1])


def test_a_predictor_that_is_asked_for_other_rails_forgets_none(make_session: Make) -> None:
    captures = make_session(2, distance_m=PLANES)
    shared = Predictor(captures)
    for stage in ({"walk_x": 1e-3}, {"walk_x": 2e-3}, {"scale": 0.01, "walk_x": 1e-3}, {"growth": 1.0}):
        effects = {"stage": stage}
        assert torch.equal(shared([0, 1], effects).signal, Predictor(captures)([0, 1], effects).signal)


def test_it_is_the_cameras_so_that_an_eye_sees_nothing_of_it() -> None:
    system, active = small_system(), ActiveEffects({"stage": {"scale": 0.1, "growth": 2.0}})
    assert active.as_built(system).planes_m == pytest.approx(system.planes_m, rel=0)
    assert [effect.id for effect in active.camera_effects()] == ["stage"]
    assert not unmet_requirement(active.pairs[0][0], system)


def test_the_search_begins_within_the_reach_of_its_fits() -> None:
    from holoview.light.model.effects.registry import get_effect

    starts = list(get_effect("stage").starting_points(small_system(planes=[3e-3, 6e-3])))
    assert max(s.get("scale", 0.0) for s in starts) == pytest.approx(0.1) and len(starts) == 18
