"""The captures show which planes are off, and by how much, unless a simpler effect says the same."""

from __future__ import annotations

from typing import Any

import pytest

from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.search_context import SearchContext
from holoview.bench.diagnose.starts.picture import PlaneStarts
from tests.diagnose.conftest import make_context_of, small_system
from tests.explored import explored

PLANES = ("3 mm", "4 mm", "6 mm")


def _context(faults: dict[str, Any], planes: tuple[str, ...] = PLANES) -> SearchContext:
    settings = AcquisitionSettings(captures_per_condition=3, seed=5)
    return make_context_of(make_captures(small_system(planes=list(planes)), faults, settings))


def _start(context: SearchContext, base: dict[str, Any] | None = None) -> list[dict[str, Any]]:
    return PlaneStarts(context, base or {})(context.effects["plane_errors"])


@pytest.mark.parametrize(
    "true",
    [
        {"distances": (4e-3,), "errors": (0.3e-3,)},
        {"distances": (6e-3,), "errors": (-1.2e-3,)},
        {"distances": (3e-3,), "errors": (8e-6,)},
        {"distances": (3e-3, 4e-3, 6e-3), "errors": (0.1e-3, -0.25e-3, 0.15e-3)},
    ],
    ids=str,
)
def test_the_start_is_the_planes_that_are_off(true: dict[str, tuple[float, ...]]) -> None:
    """To 2 µm and a tenth, from where a fit converges; no other effect gets a start."""
    context = _context({"plane_errors": true})
    (found,) = _start(context)
    assert found["distances"] == true["distances"]
    assert found["errors"] == pytest.approx(true["errors"], rel=0.1, abs=2e-6)
    assert [name for name, effect in context.effects.items() if PlaneStarts(context, {})(effect)] == ["plane_errors"]


@pytest.mark.parametrize(
    "faults",
    explored([{"stage": {"scale": 0.04}}, {"distance": {"distance_error": 2e-4}}, {}], 1),
    ids=str,
)
def test_what_one_number_says_is_no_error_of_single_planes(faults: dict[str, Any]) -> None:
    assert _start(_context(faults)) == []


def test_beside_a_common_error_there_is_none() -> None:
    """It would say the same twice."""
    context = _context({"plane_errors": {"distances": (4e-3,), "errors": (0.3e-3,)}})
    assert _start(context, {"distance": {"distance_error": 1e-4}}) == []


def test_one_plane_has_no_error_of_its_own() -> None:
    assert _start(_context({"distance": {"distance_error": 2e-4}}, ("4 mm",))) == []


def test_a_plane_can_be_where_the_camera_goes_no_further() -> None:
    """On one side of it there is nothing to compare."""
    context = _context({"plane_errors": {"distances": (4e-3,), "errors": (0.3e-3,)}}, ("0 mm", "4 mm", "6 mm"))
    (found,) = _start(context)
    assert found["distances"] == (4e-3,) and found["errors"] == pytest.approx((0.3e-3,), rel=0.1)


def test_beside_a_cause_it_is_what_that_leaves() -> None:
    faults = {"plane_errors": {"distances": (4e-3,), "errors": (0.2e-3,)}, "gap": {"gap_error": 1e-4}}
    (found,) = _start(_context(faults), {"gap": {"gap_error": 1e-4}})
    assert found["distances"] == (4e-3,) and found["errors"] == pytest.approx((0.2e-3,), rel=0.1)
