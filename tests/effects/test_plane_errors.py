"""Each plane's error is that of a distance for its captures alone; lists of lengths are read and written."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.extended_model import PredictorWithKnownEffects
from holoview.light.model import preset
from holoview.light.model.effects.registry import ActiveEffects, get_effect
from holoview.light.model.plan import make_plan
from holoview.util.errors import UserError
from tests.diagnose.conftest import small_system

Make = Callable[..., Captures]
Predicted = Callable[..., torch.Tensor]
PLANES = np.array([3e-3, 5e-3, 6e-3])
ROUNDING = 1e-10  # of the brightest pixel, in complex128
OFF = {"distances": (5e-3, 3e-3), "errors": (0.2e-3, -0.1e-3)}


def _same(found: torch.Tensor, expected: torch.Tensor) -> bool:
    return float((found - expected).abs().max()) < ROUNDING * float(expected.max())


def test_each_plane_has_the_error_of_its_distance_and_others_none(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(3, distance_m=PLANES)
    found = predicted(captures, {"plane_errors": OFF})
    for k, error in enumerate((-0.1e-3, 0.2e-3)):
        assert _same(found[k], predicted(captures, {"distance": {"distance_error": error}})[k])
        assert not _same(found[k], predicted(captures)[k])
    assert torch.equal(found[2], predicted(captures)[2])


def test_on_a_fourier_bench_planes_are_told_by_their_defocus(make_fourier: Make, predicted: Predicted) -> None:
    captures = make_fourier(2, distance_m=np.array([0.0, -4e-3]))
    found = predicted(captures, {"plane_errors": {"distances": (-4e-3,), "errors": (0.4e-3,)}})
    assert torch.equal(found[0], predicted(captures)[0])
    assert _same(found[1], predicted(captures, {"distance": {"distance_error": 0.4e-3}})[1])


def test_the_rail_goes_on_from_where_the_stage_stops(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(1)
    both = {"plane_errors": {"distances": (3e-3,), "errors": (0.5e-3,)}, "stage": {"scale": 0.1}}
    expected = predicted(captures, {"distance": {"distance_error": 1.1 * 3.5e-3 - 3e-3}})
    assert _same(predicted(captures, both)[0], expected[0])


def test_what_is_found_adds_to_what_is_known(make_session: Make) -> None:
    captures = make_session(3, distance_m=PLANES)
    known = {"plane_errors": {"distances": (5e-3,), "errors": (0.15e-3,)}}
    more = {"plane_errors": {"distances": (3e-3, 5e-3), "errors": (-0.1e-3, 0.05e-3)}}
    found = PredictorWithKnownEffects(captures, known)([0, 1, 2], more).signal
    whole = Predictor(captures)([0, 1, 2], {"plane_errors": OFF}).signal
    torch.testing.assert_close(found, whole, rtol=1e-4, atol=1e-4 * float(whole.max()))  # f32; 0.15 + 0.05 mm


def test_a_virtual_stage_misses_what_it_is_told_to() -> None:
    system = small_system(planes=["4 mm", "6 mm"], **{"effects.plane_errors.distances": "6 mm"})
    system = system.edit({"effects.plane_errors.errors": "0.3 mm"})
    settings = AcquisitionSettings(captures_per_condition=1, seed=2)
    missed, nominal = (make_captures(s, {}, settings) for s in (system, small_system(planes=["4 mm", "6 mm"])))
    assert missed.distance_m[:2].tolist() == [4e-3, 6e-3]  # the noise of later captures is another
    assert [np.array_equal(missed.images[k], nominal.images[k]) for k in (0, 1)] == [True, False]


def test_presets_hold_lengths_with_units_and_the_command_line_takes_text() -> None:
    lists = {"effects.plane_errors.distances": "4, 5.5 mm", "effects.plane_errors.errors": ["300 um", "-0.1 mm"]}
    system = hv.load("holochrome-8").edit(lists)
    assert system.effect_values["plane_errors"] == {"distances": (4e-3, 5.5e-3), "errors": (0.3e-3, -0.1e-3)}
    assert preset.loads(preset.dumps(system)).effect_values == system.effect_values
    assert '"0.3 mm",\n    "-0.1 mm"' in preset.dumps(system)


@pytest.mark.parametrize(
    ("text", "words"),
    [("0.3", "no unit"), ("0.3 mm, 30 mm", r"errors\[1\].*out of range"), ("mm", "is not a length"), ("1 kg", "kg")],
)
def test_what_is_no_error_of_a_plane_is_refused(text: str, words: str) -> None:
    with pytest.raises(UserError, match=words):
        hv.load("holochrome-8").edit({"effects.plane_errors.errors": text})


def test_each_distance_needs_an_error(make_session: Make) -> None:
    uneven = {"distances": (3e-3, 4e-3), "errors": (1e-4,)}
    with pytest.raises(UserError, match="2 distances, 1 errors"):
        Predictor(make_session(1))([0], {"plane_errors": uneven})
    system = small_system().edit({"effects": {"plane_errors": uneven}})  # as a viewer edits one list after the other
    with pytest.raises(UserError, match=r"^effects\.plane_errors: has 2 distances, 1 errors"):
        make_plan(system)


def test_it_is_the_cameras_and_says_where_the_stage_stops() -> None:
    system, active = small_system(), ActiveEffects({"plane_errors": OFF})
    assert active.as_built(system).planes_m == pytest.approx(system.planes_m, rel=0)
    assert [effect.id for effect in active.camera_effects()] == ["plane_errors"]
    said = get_effect("plane_errors").format_finding(system, OFF)
    assert said == "The stage misses its position: it stops 0.1 mm short of 3 mm and 0.2 mm beyond 5 mm."
