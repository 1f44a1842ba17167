"""Equal causes count as one; look-alikes are told, with the capture that tells them apart."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.fit import CandidateFit, effect_jacobian, identity_values
from holoview.bench.diagnose.intervals import canonical_correlation
from holoview.bench.diagnose.report.causes import best_separating_capture, proposed_captures
from holoview.bench.diagnose.search_context import SearchContext, equivalent_effects
from holoview.light.model.effects.registry import listed_effects
from holoview.light.model.system import System
from tests.diagnose.conftest import pictures


def test_defocus_of_a_relay_is_a_distance_either_way() -> None:
    equals = equivalent_effects(dict(listed_effects()), pictures().data_properties())
    for one, other in (("distance", "aberration2"), ("gap", "aberration1")):
        assert other in equals[one] and one in equals[other]
    assert "distance" not in equals["gap"]


def _alike(context: SearchContext, first: str, second: str, index: int | None = None) -> float:
    """Correlation of what two effects change, near their identity; index: of one parameter of the second."""
    comparison = context.model_weighted_comparison(context.split.coarse, {})
    residual = comparison.residual({})
    slopes = []
    for name in (first, second):
        one = context.effects[name]
        slopes.append(effect_jacobian(one, {name: identity_values(one)}, comparison, residual))
    chosen = slopes[1] if index is None else slopes[1][[index]]
    return canonical_correlation(slopes[0], chosen)


@pytest.mark.parametrize(("length", "relay"), [("gap", "aberration1"), ("distance", "aberration2")])
def test_the_pictures_say_so_too(context: SearchContext, length: str, relay: str) -> None:
    """√(1 − s²) is a parabola up to s⁴/8: at NA 0.03 the rest is (0.03)²/4 = 2e-4 of it."""
    assert _alike(context, length, relay, 0) > 0.99  # z4, defocus; steps of float32 pictures
    assert _alike(context, length, relay, 1) < 0.6  # z5, astigmatism


def test_a_vignette_is_unlike_a_gap(context: SearchContext) -> None:
    assert _alike(context, "gap", "vignetting") < 0.3


def test_captures_that_might_help_differ_in_one_respect_each() -> None:
    captures = pictures(6, distance_m=np.full(6, 4e-3))
    found = {e.description: e.captures for e in proposed_captures(captures, 0, 1)}
    assert len(found) == 9 and all(len(c) == 1 for c in found.values())
    flat = found["a capture with all modulators flat"]
    assert np.ptp(flat.levels) == 0
    one = found["a capture with modulator 1 flat and a rough pattern on the other"]
    assert np.ptp(one.levels[:, 0]) == 0 and np.array_equal(one.levels[:, 1], captures.levels[[1], 1])
    assert found["a capture in another plane, at 6 mm"].distance_m == pytest.approx([6e-3])
    assert found["a capture at 660 nm"].wavelength_m == pytest.approx([660e-9])


def test_captures_of_a_chain_that_might_help_are_named_by_its_elements_and_within_their_levels() -> None:
    pixels = {"kind": "phase", "pitch": "8 um", "shape": [16, 20], "stroke": "825 nm"}
    coarse = {"kind": "amplitude", "name": "coarse", "pitch": "16 um", "shape": [8, 10], "levels": 4}
    other = pixels | {"name": "last", "levels": 16}
    chain = System(["520 nm"], [[1.0]], elements=[pixels, coarse, other], planes_m=["3 mm"], observer="mono")
    captures = make_captures(chain, {}, AcquisitionSettings(captures_per_condition=2))
    found = {e.description: e.captures for e in proposed_captures(captures, 0, 1)}
    assert {f"a capture with {name} flat and a rough pattern on the others" for name in chain.drive_shapes} < set(found)
    flat = found["a capture with all modulators flat"].levels[0]
    assert [int(own[0, 0]) for own in flat] == [128, 2, 8] and all(np.ptp(own) == 0 for own in flat)
    for proposed in found.values():
        assert np.isfinite(Predictor(proposed)([0]).signal.numpy()).all()
        assert all(own.max() < slm.num_levels for own, slm in zip(proposed.levels[0], proposed.slms, strict=True))


def test_a_second_plane_tells_a_wavelength_from_a_distance(context: SearchContext) -> None:
    """z·λ is what one plane sees: 450 nm at 4 mm, 1 % off. What is proposed must be one of the experiments."""

    def fit(effect: str, name: str, value: float) -> CandidateFit:
        return CandidateFit((effect,), {effect: {name: value}}, 0.0)

    words = best_separating_capture(
        context, fit("wavelength_offset", "offset", 5e-9), fit("distance", "distance_error", 4e-5)
    )
    assert words is not None and words.startswith("a capture")


def test_nothing_separates_what_is_the_same(context: SearchContext) -> None:
    same = CandidateFit(("gap",), {"gap": {"gap_error": 1e-4}}, 0.0)
    assert best_separating_capture(context, same, same) is None
