"""How well captures tell hypotheses apart, which is taken, and how long they take."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from holoview.bench.captures.dataset import Captures, join_captures
from holoview.bench.captures.patterns import random_levels
from holoview.bench.diagnose.config import SearchConfig
from holoview.bench.diagnose.fit import CandidateFit, FreeParameters
from holoview.bench.diagnose.search_context import NEVER
from holoview.bench.experiment.capture_choice import (
    START_COUNT,
    BenchTime,
    CaptureChooser,
    NextCapture,
    Proposal,
    ProposalPrediction,
    Response,
    draw_proposals,
    expected_delta_chi2,
    expected_information,
    pairwise_delta_chi2,
    planes_of,
    starting_proposals,
    value_information,
)
from holoview.bench.experiment.hypotheses import Belief, Hypothesis, fitted_hypothesis, loop_context, open_hypotheses
from holoview.bench.rig.measurement import Measurement
from holoview.light.effects.modulator_response import Dispersion
from holoview.light.model.effects.registry import get_effect, listed_effects
from tests.experiment.next_capture.benches import BenchInProcess, make_bench

NOTHING = np.zeros((0, 1))


def test_a_straight_line_is_told_from_a_parabola_in_the_middle() -> None:
    """The T-optimal design of these two on −1 … 1 is a half at 0 and a quarter at each end (Atkinson & Fedorov 1975).

    With n captures at the ends, half at each, y = x² is fitted best by y = 1, with var(x) = (1 + x²)/n. So the next one
    separates by (x² − 1)²/(1 + var), most at 0.
    """
    taken = 10
    x = np.linspace(-1, 1, 41)
    deltas = []
    for at in x:
        rival = Response(np.array([1.0]), np.array([[1.0], [at]]) / np.sqrt(taken))
        deltas.append(expected_delta_chi2(Response(np.array([at**2]), NOTHING), rival))
    assert deltas == pytest.approx((x**2 - 1) ** 2 / (1 + (1 + x**2) / taken), rel=1e-12)
    assert x[int(np.argmax(deltas))] == 0.0


def test_it_is_what_a_refit_of_the_rival_leaves() -> None:
    rng = np.random.default_rng(1)
    truth = Response(rng.standard_normal(30), np.zeros((0, 30)))
    rival = Response(rng.standard_normal(30), rng.standard_normal((4, 30)))
    # minimise |d − Bᵀz|² + |z|², with z in standard deviations of what the captures so far say
    rows = np.vstack([rival.spreads.T, np.eye(4)])
    right = np.concatenate([truth.picture - rival.picture, np.zeros(4)])
    left = right - rows @ np.linalg.lstsq(rows, right, rcond=None)[0]
    assert expected_delta_chi2(truth, rival) == pytest.approx(left @ left, rel=1e-10)


def test_what_is_unknown_of_the_truth_adds_its_mean_square() -> None:
    rng = np.random.default_rng(2)
    truth = Response(rng.standard_normal(20), rng.standard_normal((2, 20)))
    rival = Response(np.zeros(20), rng.standard_normal((3, 20)))
    m = np.linalg.inv(np.eye(20) + rival.spreads.T @ rival.spreads)
    expected = truth.picture @ m @ truth.picture + np.trace(truth.spreads @ m @ truth.spreads.T)
    assert expected_delta_chi2(truth, rival) == pytest.approx(expected, rel=1e-10)


def test_a_gain_separates_nothing() -> None:
    picture = np.linspace(1, 2, 12)
    responses = [Response(f * picture, f * picture[None]).without(picture) for f in (1.0, 1.7)]
    assert pairwise_delta_chi2(responses) == pytest.approx(np.zeros((2, 2)), abs=1e-24)


def test_both_rivals_may_be_fitted_again() -> None:
    """What one hypothesis can imitate isn't separated, whichever of the two is true."""
    first = Response(np.array([1.0, 0.0]), np.array([[1e6, 0.0]]))
    second = Response(np.zeros(2), np.zeros((0, 2)))
    deltas = pairwise_delta_chi2([first, second])
    assert np.array_equal(deltas, deltas.T) and deltas[0, 1] < 1e-6


def test_information_is_never_negative_nor_more_than_there_is_to_know() -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        count = int(rng.integers(1, 7))
        p = rng.dirichlet(np.full(count, 0.3))
        deltas = rng.exponential(10.0 ** rng.uniform(-6, 4), (count, count))
        deltas = np.minimum(deltas, deltas.T) * (1 - np.eye(count))
        # each of the sums rounds by a few 2⁻⁵²
        entropy = -float(p[p > 0] @ np.log(p[p > 0]))
        assert 0.0 <= expected_information(p, deltas) <= max(entropy, 0.0) + 1e-14


def test_information_of_two_hypotheses() -> None:
    p, delta = np.array([0.5, 0.5]), 7.0
    deltas = np.array([[0.0, delta], [delta, 0.0]])
    assert expected_information(p, deltas) == pytest.approx(np.log(2) - np.log1p(np.exp(-delta / 8)), rel=1e-12)
    assert expected_information(p, 0 * deltas) == 0.0
    assert expected_information(p, 1e6 * deltas) == pytest.approx(np.log(2), rel=1e-12)


def test_information_on_values_is_that_of_a_linear_model() -> None:
    """Prior N(0, I), pictures Bᵀz + noise: the entropy falls by half the logarithm of the determinants' ratio."""
    spreads = np.random.default_rng(4).standard_normal((3, 20))
    after = np.linalg.inv(np.eye(3) + spreads @ spreads.T)
    found = value_information(Response(np.zeros(20), spreads))
    assert found == pytest.approx(-0.5 * np.log(np.linalg.det(after)), rel=1e-10)
    assert value_information(Response(np.zeros(20), np.zeros((0, 20)))) == 0.0


def test_it_learns_the_stage_and_the_readout() -> None:
    time = BenchTime(settle_s=0.1)
    for exposure_s in (0.01, 0.02, 0.05):
        time.note(0.0, exposure_s, 0.1 + exposure_s + 0.03)
    time.note(4e-3, 0.01, 2.0 + 0.1 + 0.01 + 0.03)
    assert time.readout_s == pytest.approx(0.03, rel=1e-9)
    assert time.speed == pytest.approx(2e-3, rel=1e-9)
    assert time.expect(-1e-3, 0.2) == pytest.approx(0.5 + 0.1 + 0.2 + 0.03, rel=1e-9)


def test_one_exposure_that_had_to_be_searched_misleads_nobody() -> None:
    time = BenchTime(settle_s=0.1)
    for seconds in (0.15, 0.15, 0.9):
        time.note(0.0, 0.02, seconds)
    assert time.expect(0.0, 0.02) == pytest.approx(0.15, rel=1e-9)


# Two hypotheses without free values that predict the same pictures at one setting of the bench.


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> BenchInProcess:
    return make_bench(tmp_path_factory.mktemp("bench"), {})


def _proposal(bench: BenchInProcess, wavelength: int, plane: int, brightness: float = 1.0) -> Proposal:
    rng = np.random.default_rng((1, wavelength, plane))
    levels = np.stack([random_levels(rng, bench.rig.slm_shape, 256, 1.5) for _ in range(2)])
    place = bench.rig.wavelengths_m[wavelength], planes_of(bench.rig)[plane]
    return Proposal(*place, bench.rig.limits.power, levels, "noise", brightness)


def _taken(bench: BenchInProcess) -> Captures:
    """One capture of each wavelength, in the first plane."""
    measurement, proposals = Measurement(bench.rig, bench.devices()), [_proposal(bench, k, 0) for k in (0, 1)]
    return join_captures([measurement.take(p.request, p.levels) for p in proposals])


def _belief(taken: Captures, *values: dict[str, dict[str, float]]) -> Belief:
    """Hypotheses of these values, all as probable."""
    context = loop_context(taken, list(listed_effects().values()), SearchConfig(), NEVER, {})
    comparison = context.model_weighted_comparison(context.kept, values[0])
    known = [Hypothesis(tuple(v), {**v}, FreeParameters(()), np.zeros((0, 0)), 0.0) for v in values]
    p = np.full(len(known), 1 / len(known))
    return Belief(tuple(known), p, 1.0, True, 1.0, context, comparison)


def _choose(bench: BenchInProcess, belief: Belief, taken: Captures, proposals: list[Proposal]) -> NextCapture:
    chooser = CaptureChooser(belief, taken, bench.rig.limits, BenchTime(0.1, moved_m=1.0, moving_s=1e-3), 0.0)
    return chooser.choose(proposals)


def test_light_of_the_room_is_told_from_a_black_level_by_another_exposure(bench: BenchInProcess) -> None:
    """The hypotheses differ by level·(t − t₀) counts in every pixel, of which a gain imitates a part."""
    taken = _taken(bench)
    at_exposure_s, level = float(taken.exposure_s[0]), 20 / float(taken.exposure_s[0])
    belief = _belief(taken, {"camera_black": {"black": 20.0}}, {"ambient": {"level": level}})
    proposals = [_proposal(bench, 0, 0, brightness) for brightness in (1.0, 0.1)]
    prediction = ProposalPrediction(belief, taken, proposals, bench.rig.limits)
    for k, responses in enumerate(prediction.responses(list(belief.hypotheses))):
        t = float(prediction.captures.exposure_s[k])
        signal, _ = prediction.light(belief.context.predictor.create(captures=prediction.captures), {})
        difference = prediction.weight[k] * level * (t - at_exposure_s)
        gain = signal[k] * prediction.weight[k]
        apart = difference - gain * (gain * difference).sum() / np.square(gain).sum()
        # counts in single precision: 10⁻⁴ of some thousand, squared, in a thousand pixels, over their variance
        assert expected_delta_chi2(*responses) == pytest.approx(np.square(apart).sum(), rel=1e-3, abs=1e-4)
    choice = _choose(bench, belief, taken, proposals)
    assert choice.proposal.brightness == 0.1 and choice.promises_something
    assert choice.reason.startswith("separates camera_black from ambient")


@pytest.mark.parametrize(("wavelength", "plane"), [(0, 1), (1, 1)])
def test_a_distance_is_told_from_the_scale_of_the_stage_in_another_plane(
    bench: BenchInProcess, wavelength: int, plane: int
) -> None:
    taken, near = _taken(bench), planes_of(bench.rig)[0]
    belief = _belief(taken, {"distance": {"distance_error": 0.1 * near}}, {"stage": {"scale": 0.1}})
    here, there = _proposal(bench, wavelength, 0), _proposal(bench, wavelength, plane)
    assert not _choose(bench, belief, taken, [here]).promises_something
    choice = _choose(bench, belief, taken, [here, there])
    assert choice.proposal.distance_m == there.distance_m and choice.promises_something


def test_dispersion_is_told_from_a_stroke_at_another_wavelength(bench: BenchInProcess) -> None:
    taken = _taken(bench).subset(np.array([0]))
    factor = Dispersion().path_factor(bench.rig.wavelengths_m[0], {"slope": 0.02, "offset": 0.0, "curvature": 0.0})
    belief = _belief(taken, {"stroke": {"stroke_error": factor - 1}}, {"dispersion": {"slope": 0.02}})
    here, there = _proposal(bench, 0, 1), _proposal(bench, 1, 1)
    assert not _choose(bench, belief, taken, [here]).promises_something
    choice = _choose(bench, belief, taken, [here, there])
    assert choice.proposal.wavelength_m == there.wavelength_m and choice.promises_something


def test_effects_without_derivatives_at_their_identity_are_never_open(bench: BenchInProcess) -> None:
    """No capture would exclude fringes without amplitude, and a loop would wait for it."""
    taken = _taken(bench)
    belief = _belief(taken, {})
    names = ["camera_blur", "camera_fringes", "gap", "ghost", "slm1_fringes"]
    found = open_hypotheses(belief.leader, 0.0, names, belief.comparison, belief.context, 1.0)
    assert {h.name for h in found} == {"camera_blur", "gap"}


@pytest.mark.parametrize("seed", range(5))
def test_proposals_hold_every_kind(bench: BenchInProcess, seed: int) -> None:
    """Of 20: both exposures, both powers, both wavelengths and all planes, whatever the seed."""
    drawn = draw_proposals(bench.rig, np.random.default_rng(seed), 20)
    assert {p.brightness for p in drawn} == {0.1, 1.0} and len({p.power for p in drawn}) == 2
    places = {(p.wavelength_m, p.distance_m) for p in drawn}
    assert {*itertools.product(bench.rig.wavelengths_m, planes_of(bench.rig))} <= places


def test_the_first_captures_show_every_effect_that_the_rig_can_show(bench: BenchInProcess) -> None:
    first = starting_proposals(bench.rig, seed=0)
    for differ in ("wavelength_m", "distance_m", "power"):
        assert len({getattr(p, differ) for p in first}) == len(first) == START_COUNT


def test_where_nothing_is_to_separate_the_capture_that_narrows_the_values_is_taken(bench: BenchInProcess) -> None:
    """More light tells more of a gap, where settling takes so long that the exposure doesn't count."""
    taken = _taken(bench)
    context = loop_context(taken, [get_effect("gap")], SearchConfig(), NEVER, {})
    fit = CandidateFit(("gap",), {"gap": {"gap_error": 0.0}}, 0.0)
    comparison = context.model_weighted_comparison(context.kept, fit.values)
    leader = fitted_hypothesis(fit, comparison, context, 1.0)
    belief = Belief((leader,), np.ones(1), 1.0, True, 1.0, context, comparison)
    proposals = [_proposal(bench, 0, 0, brightness) for brightness in (0.1, 1.0)]
    chooser = CaptureChooser(belief, taken, bench.rig.limits, BenchTime(1e6), 0.0)
    assert chooser.sharpest(proposals).brightness == chooser.sharpest(proposals[::-1]).brightness == 1.0
