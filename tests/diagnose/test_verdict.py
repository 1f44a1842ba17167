"""What a search's figures allow one to say."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from holoview.bench.diagnose.config import VerdictConfig
from holoview.bench.diagnose.fit import CandidateFit
from holoview.bench.diagnose.judge import Decision, HeldOutScore, SearchResult, Verdict, decide

PIXELS = 100_000.0
EQUIVALENTS = {"distance": frozenset({"aberration2"}), "aberration2": frozenset({"distance"})}


def _score(causes: str, chi2: float) -> HeldOutScore:
    names = tuple(causes.split())
    return HeldOutScore(CandidateFit(names, {n: {"x": 1.0} for n in names}, chi2 * PIXELS), chi2, chi2)


def _decided(nominal: float, *tried: tuple[str, float], pixels: float = PIXELS) -> Decision:
    comparison: Any = SimpleNamespace(pixel_count=pixels)
    result = SearchResult(_score("", nominal), tuple(_score(*t) for t in tried), comparison, comparison)
    return decide(result, EQUIVALENTS, VerdictConfig())


@pytest.mark.parametrize(
    ("nominal", "tried", "verdict", "rivals"),
    [
        (1.0002, [("ghost", 1.0)], Verdict.CONSISTENT, []),
        (1.004, [("gap", 1.0), ("tilt", 1.004)], Verdict.EXPLAINED, []),  # small, yet Δχ² = 400
        (5.0, [("gap", 1.01), ("tilt", 3.0)], Verdict.EXPLAINED, []),
        (5.0, [("gap tilt", 1.01), ("gap", 2.0)], Verdict.EXPLAINED, []),
        (5.0, [("gap", 1.5), ("tilt", 3.0)], Verdict.PARTLY, []),
        (5.0, [("gap", 4.5)], Verdict.UNEXPLAINED, []),
        (5.0, [], Verdict.UNEXPLAINED, []),
        (5.0, [("gap", 1.010), ("tilt", 1.012)], Verdict.AMBIGUOUS, [("tilt",)]),
        (5.0, [("distance", 1.010), ("aberration2", 1.010)], Verdict.EXPLAINED, []),  # the same physics
        (5.0, [("gap", 1.010), ("gap tilt", 1.009)], Verdict.EXPLAINED, []),  # more causes are no rival
    ],
)
def test_the_verdict(
    nominal: float, tried: list[tuple[str, float]], verdict: Verdict, rivals: list[tuple[str, ...]]
) -> None:
    found = _decided(nominal, *tried)
    assert found.verdict is verdict
    assert [r.causes for r in found.rivals] == rivals
    assert (found.best is not None) == (verdict in (Verdict.EXPLAINED, Verdict.PARTLY, Verdict.AMBIGUOUS))


def test_of_a_large_error_nine_tenths_arent_enough_to_name_with_confidence() -> None:
    """χ²/n 1000 → 50 explains 95 %, as a blur would; it stays far from the floor."""
    assert _decided(1000.0, ("camera_blur", 50.0)).verdict is Verdict.PARTLY


def test_of_few_pixels_jitter_and_chance_add() -> None:
    """20 000 pixels exceed 0.048 once in a million times: as much and jitter of 0.02 leave 0.052; 10⁶ pixels 0.021."""
    assert _decided(1.051, pixels=2e4).verdict is Verdict.CONSISTENT
    assert _decided(1.054, pixels=2e4).verdict is Verdict.UNEXPLAINED
    assert _decided(1.022, pixels=1e6).verdict is Verdict.UNEXPLAINED
