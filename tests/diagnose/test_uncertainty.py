"""Intervals hold the truth as often as they say; correlations are cosines."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.bench.diagnose.config import SearchConfig
from holoview.bench.diagnose.fit import CandidateFit, FreeParameters, free_parameters_of
from holoview.bench.diagnose.intervals import (
    LocalInformation,
    LocalJacobian,
    canonical_correlation,
    confidence_intervals,
    local_information,
    local_jacobian,
)
from holoview.bench.diagnose.search_context import SearchEnd
from holoview.light.model.effects.effect import Effect, Parameter

CAPTURES, PIXELS = 12, 300


class Two(Effect):
    id = "two"
    cause = finding = "Two numbers."
    parameters = (Parameter("a", "One.", prior=2.0), Parameter("b", "Another.", prior=0.5))
    acts_on = ("camera",)


def _free() -> FreeParameters:
    return free_parameters_of([Two()])


def _drawn(rng: np.random.Generator, slopes: np.ndarray, error: float) -> tuple[float, float, np.ndarray, TwoCaptures]:
    """A fit of both numbers, true at 0, to unit noise and an error that all pixels of a capture share: a, b, rest."""
    noise = rng.standard_normal((CAPTURES, PIXELS)) + error * rng.standard_normal((CAPTURES, 1))
    flat = noise.ravel()
    x = np.linalg.solve(slopes @ slopes.T, -(slopes @ flat))
    linear = TwoCaptures(slopes.reshape(2, CAPTURES, PIXELS), noise)
    return x[0] * 2.0, x[1] * 0.5, (flat + slopes.T @ x).astype(np.float32), linear


@pytest.mark.parametrize("error", [0.0, 0.3])
def test_intervals_hold_the_truth_as_often_as_they_say(error: float) -> None:
    """400 draws at 95 %: 380 ± 4.4 inside. More is allowed: the larger of two estimates is told. Four σ fewer isn't,
    nor where neighbouring pixels err together, which photon noise alone would underestimate."""
    rng = np.random.default_rng(0)
    slopes = (rng.standard_normal((2, CAPTURES * PIXELS)) + 0.5).astype(np.float32)
    inside = 0
    for _ in range(200):
        a, b, rest, linear = _drawn(rng, slopes, error)
        fit = CandidateFit(("two",), {"two": {"a": a, "b": b}}, 0.0)
        at = LocalInformation.of(LocalJacobian(_free(), slopes, rest, CAPTURES))
        found = confidence_intervals(fit, at, linear, SearchConfig())  # type: ignore[arg-type]
        inside += abs(a) <= found["two", "a"].half_width
        inside += abs(b) <= found["two", "b"].half_width
    assert inside >= 380 - 4 * 4.4


def test_a_number_that_nothing_depends_on_is_unknown() -> None:
    slopes = np.zeros((2, CAPTURES * PIXELS), np.float32)
    slopes[0] = 1.0
    rest = np.random.default_rng(1).standard_normal(CAPTURES * PIXELS).astype(np.float32)
    fit = CandidateFit(("two",), {"two": {"a": 1.0, "b": 1.0}}, 0.0)
    at = LocalInformation.of(LocalJacobian(_free(), slopes, rest, CAPTURES))
    linear = TwoCaptures(slopes.reshape(2, CAPTURES, PIXELS), (rest - slopes[0] / 2).reshape(CAPTURES, PIXELS))
    found = confidence_intervals(fit, at, linear, SearchConfig())  # type: ignore[arg-type]
    assert np.isfinite(found["two", "a"].sigma) and found["two", "b"].sigma == float("inf")


class TwoCaptures:
    """Residuals of some captures that depend linearly on both numbers; parts of two captures each."""

    def __init__(self, slopes: np.ndarray, rest: np.ndarray, captures: range = range(CAPTURES)) -> None:
        self.slopes, self.rest, self.indices = slopes, rest, np.array(captures)

    def residual(self, values: dict[str, dict[str, float]]) -> np.ndarray:
        x = np.array([values["two"]["a"] / 2.0, values["two"]["b"] / 0.5], np.float32)
        found = np.einsum("p,pkn->kn", x, self.slopes[:, self.indices]) + self.rest[self.indices]
        return np.asarray(found, np.float32).ravel()

    def parts(self) -> list[tuple[slice, TwoCaptures]]:
        starts = range(0, CAPTURES, 2)
        return [
            (slice(k * PIXELS, (k + 2) * PIXELS), TwoCaptures(self.slopes, self.rest, range(k, k + 2))) for k in starts
        ]


def test_of_a_few_captures_at_a_time_information_is_that_of_all() -> None:
    rng = np.random.default_rng(5)
    slopes = rng.standard_normal((2, CAPTURES, PIXELS)).astype(np.float32)
    rest = rng.standard_normal((CAPTURES, PIXELS)).astype(np.float32)
    whole = TwoCaptures(slopes, rest)
    fit = CandidateFit(("two",), {"two": {"a": 0.4, "b": -0.3}}, 0.0)
    expected = LocalInformation.of(local_jacobian(fit, [Two()], whole))  # type: ignore[arg-type]
    found = local_information(fit, [Two()], whole)  # type: ignore[arg-type]
    np.testing.assert_array_equal(found.residual, expected.residual)
    np.testing.assert_array_equal(found.scores, expected.scores)
    np.testing.assert_allclose(found.normal, expected.normal, rtol=0, atol=1e-5 * expected.normal.max())


class FlatBottom(TwoCaptures):
    """Residuals that are flat near the least, as where an edge passes no sample: a counts from 0.6 on."""

    def residual(self, values: dict[str, dict[str, float]]) -> np.ndarray:
        a = values["two"]["a"]
        beyond = np.sign(a) * max(abs(a) - 0.6, 0.0)
        return super().residual({"two": {**values["two"], "a": beyond}})


def test_an_interval_reaches_as_far_as_chi_squared_is_flat() -> None:
    """The slopes are those of a parabola; χ² rises by as much only 0.6 further out."""
    rng = np.random.default_rng(4)
    slopes = np.linalg.qr(rng.standard_normal((CAPTURES * PIXELS, 3)))[0].T.astype(np.float32) * 10
    rest = rng.standard_normal(CAPTURES * PIXELS)
    rest = (rest - slopes.T @ (slopes @ rest) / 100).reshape(CAPTURES, PIXELS).astype(np.float32)
    fit = CandidateFit(("two",), {"two": {"a": 0.0, "b": 0.0}}, 0.0)
    at = LocalInformation.of(LocalJacobian(_free(), slopes[:2], rest.ravel(), CAPTURES))
    linear, flat = (kind(slopes[:2].reshape(2, CAPTURES, PIXELS), rest) for kind in (TwoCaptures, FlatBottom))
    parabola, wide = (confidence_intervals(fit, at, one, SearchConfig()) for one in (linear, flat))  # type: ignore[arg-type]
    assert wide["two", "b"] == parabola["two", "b"]
    hurried = confidence_intervals(fit, at, flat, SearchConfig(), SearchEnd(-1.0))  # type: ignore[arg-type]
    assert hurried == parabola
    further = wide["two", "a"].half_width - parabola["two", "a"].half_width
    assert further == pytest.approx(0.6, abs=0.08 * wide["two", "a"].half_width)


class Aperture(Effect):
    id = "aperture"
    cause = finding = "Its size and its centre."
    parameters = (
        Parameter("size", "Half.", prior=1.0, non_smooth=True),
        Parameter("centre", "At.", prior=1.0, non_smooth=True),
    )
    acts_on = ("relay 1",)


class SampledEdges:
    """A comparison that sees only between which samples, a quarter apart, the two edges of an aperture lie."""

    infeasible_residual = np.full(CAPTURES * PIXELS, 1e3, np.float32)
    pixel_count = CAPTURES * PIXELS

    def __init__(self, size: float, centre: float) -> None:
        self.true = self.samples(size, centre)
        self.noise = np.random.default_rng(3).standard_normal(self.pixel_count).astype(np.float32)
        self.noise[:2] = 0.0

    @staticmethod
    def samples(size: float, centre: float) -> np.ndarray:
        return np.floor(4 * np.array([size + centre, size - centre]))

    def parts(self) -> list[tuple[slice, SampledEdges]]:
        return [(slice(None), self)]

    def residual(self, values: dict[str, dict[str, float]]) -> np.ndarray:
        found = self.noise.copy()
        found[:2] = 10 * (self.samples(**values["aperture"]) - self.true)
        return found


def test_intervals_of_edges_hold_all_that_no_sample_tells_apart() -> None:
    """Size and centre anywhere in the cell of the true ones, which is found by drawing until the samples agree.

    The half widths are at least 2/√5 of the cell's: of points drawn evenly, at least 95 % are inside.
    """
    rng, free, inside = np.random.default_rng(0), free_parameters_of([Aperture()]), 0
    slopes = (100 * rng.standard_normal((2, CAPTURES * PIXELS))).astype(np.float32)
    for _ in range(100):
        size, centre = rng.uniform(1, 2), rng.uniform(-0.5, 0.5)
        comparison = SampledEdges(size, centre)
        found = next(
            point
            for point in ((size + dy, centre + dx) for dy, dx in rng.uniform(-0.25, 0.25, (10_000, 2)))
            if (comparison.samples(*point) == comparison.true).all()
        )
        fit = CandidateFit(("aperture",), {"aperture": {"size": found[0], "centre": found[1]}}, 0.0)
        at = LocalInformation.of(LocalJacobian(free, slopes, comparison.noise, CAPTURES))
        told = confidence_intervals(fit, at, comparison, SearchConfig())  # type: ignore[arg-type]
        inside += abs(found[0] - size) <= told["aperture", "size"].half_width
        inside += abs(found[1] - centre) <= told["aperture", "centre"].half_width
    assert inside >= 190


def test_a_canonical_correlation_is_the_cosine_between_planes() -> None:
    """(e1, e2) and (cos φ·e1 + sin φ·e3, e4): the smallest angle between them is φ."""
    e = np.eye(6, dtype=np.float32)
    angle = 0.7
    first, second = e[[0, 1]], np.stack([np.cos(angle) * e[0] + np.sin(angle) * e[2], e[3]]).astype(np.float32)
    assert canonical_correlation(first, second) == pytest.approx(np.cos(angle), abs=1e-6)
    assert canonical_correlation(first, 7 * first[::-1].copy()) == pytest.approx(1.0, abs=1e-6)
    assert canonical_correlation(first, e[[4, 5]]) == pytest.approx(0.0, abs=1e-6)


def test_what_is_known_is_taken_out_first() -> None:
    """Two slopes that share only a known third are unlike."""
    e = np.eye(4, dtype=np.float32)
    first, second = (e[0] + e[1])[None], (e[0] + e[2])[None]
    assert canonical_correlation(first, second) == pytest.approx(0.5, abs=1e-6)
    assert canonical_correlation(first, second, e[[0]]) == pytest.approx(0.0, abs=1e-6)
