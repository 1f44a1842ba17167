"""Patterns, amplitudes and wavelengths: where they begin, when each moves, how far, and how they are restored."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import torch

from holoview.holograms.optimise.problem import LossEvaluation
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.variables import OptimisationVariables, PatternVariables, initial_drive
from holoview.light.model.bench_parts import Modulator
from holoview.light.model.system import System
from holoview.util.errors import UserError

Bench = Callable[..., System]
EVERYTHING = ("patterns", "amplitudes", "wavelengths")


def _variables(system: System, **settings: Any) -> OptimisationVariables:
    known = Settings(**{"iterations": 40, "amplitudes_every": 5, **settings})
    return OptimisationVariables(system, known, torch.full(system.drive_shape, 0.5))


def _evaluation(system: System, **parts: Any) -> LossEvaluation:
    return LossEvaluation(loss=1.0, psnr_db=0.0, picture=lambda: np.zeros(0), **parts)


def _requested_in(variables: OptimisationVariables, what: str) -> list[int]:
    return [i for i in range(variables.settings.iterations + 1) if getattr(variables.evaluation_request(i), what)]


def test_amplitudes_and_eyebox_are_due_now_and_then_and_at_the_end(bench: Bench) -> None:
    variables = _variables(bench(), iterations=12)
    assert _requested_in(variables, "optimal_amplitudes") == [0, 5, 10, 12]
    assert _requested_in(variables, "eyebox_variation") == [0, 5, 10, 12]
    assert _requested_in(variables, "path_gradient") == list(range(12))
    assert _requested_in(variables, "wavelength_gradient") == []


def test_a_curved_loss_has_a_closed_form_to_begin_with_only(bench: Bench) -> None:
    assert _requested_in(_variables(bench(), loss="srgb"), "optimal_amplitudes") == [0]


def test_amplitudes_that_are_not_free_are_not_asked_for(bench: Bench) -> None:
    assert _requested_in(_variables(bench(), free=("patterns",)), "optimal_amplitudes") == []


def test_wavelengths_move_in_the_first_half_with_the_amplitudes_and_more_often_in_short_runs(bench: Bench) -> None:
    long, short = (_variables(bench(), free=EVERYTHING, iterations=n) for n in (200, 40))
    assert long.wavelengths.iterations == 100
    assert _requested_in(long, "wavelength_gradient") == list(range(5, 100, 5))
    assert short.wavelengths.iterations == 20
    assert _requested_in(short, "wavelength_gradient") == list(range(2, 20, 2))


def test_modulators_of_levels_ask_for_slopes_to_their_neighbours_ever_stiffer(bench: Bench) -> None:
    assert _variables(bench()).evaluation_request(3).level_step_m is None
    variables = _variables(bench(levels=4))
    level_step_m = variables.patterns.level_step_m()
    assert level_step_m is not None
    requests = [variables.evaluation_request(i) for i in range(41)]
    assert all(w.level_step_m is not None and torch.equal(w.level_step_m, level_step_m) for w in requests)
    assert requests[0].curvature_weight == 0
    assert all(later.curvature_weight > earlier.curvature_weight for earlier, later in pairwise(requests))


def test_patterns_move_by_a_step_that_falls_to_nothing(bench: Bench) -> None:
    system = bench()
    moves = _steps(_variables(system, betas=(0.0, 0.0)), system)
    np.testing.assert_allclose(moves, moves[0] * np.sqrt(1 - np.arange(40) / 40), rtol=1e-4)  # float32 in 0…1


def test_the_patterns_steps_start_over_when_the_wavelengths_stay(bench: Bench) -> None:
    system = bench()
    moves = _steps(_variables(system, betas=(0.0, 0.0), free=EVERYTHING), system)
    np.testing.assert_allclose(moves, moves[0] * np.sqrt(1 - np.arange(40) % 20 / 20), rtol=1e-4)  # float32 in 0…1


def test_the_patterns_moments_start_over_too(bench: Bench) -> None:
    system = bench()
    variables = _variables(system, free=EVERYTHING)
    _steps(variables, system, range(21))
    assert variables.patterns.adam.step_count == 1


def _steps(variables: OptimisationVariables, system: System, iterations: range = range(40)) -> list[float]:
    """How far the patterns move in each iteration under a gradient that changes sign every time."""
    moves = []
    for i in iterations:
        before = variables.patterns.drive.clone()
        gradient = torch.full(system.drive_shape, 1e-3 * (-1) ** i)
        variables.step(_evaluation(system, path_gradient=gradient), i)
        moves.append(float((variables.patterns.drive - before).abs().max()))
    return moves


def test_what_is_not_free_stays(bench: Bench) -> None:
    system = bench()
    slopes = {"amplitude_gradient": np.ones((1, 3)), "path_gradient": torch.ones(system.drive_shape)}
    variables = _variables(system, free=("amplitudes",), loss="srgb")
    variables.step(_evaluation(system, **slopes), 1)
    assert torch.equal(variables.patterns.drive, torch.full(system.drive_shape, 0.5))
    assert (variables.amplitudes < 1).all()
    variables = _variables(system, free=("patterns",), loss="srgb")
    variables.step(_evaluation(system, **slopes), 1)
    np.testing.assert_array_equal(variables.amplitudes, system.amplitudes)
    assert (variables.patterns.drive < 0.5).all()


def test_amplitudes_take_their_closed_form_where_there_is_one(bench: Bench) -> None:
    system, solved = bench(), np.array([[0.3, 0.0, 2.0]])
    variables = _variables(system, loss="srgb")
    variables.step(_evaluation(system, optimal_amplitudes=solved, amplitude_gradient=np.ones((1, 3))), 0)
    np.testing.assert_array_equal(variables.amplitudes, solved)


def test_under_a_curved_loss_amplitudes_move_by_their_logarithm(bench: Bench) -> None:
    system = bench(amplitudes=[[2.0, 0.5, 0.0]])
    variables = _variables(system, loss="srgb")
    variables.step(_evaluation(system, amplitude_gradient=np.array([[1e-3, -1.0, 0.0]])), 1)
    # Adam's first step is one in size: 2 % down, 2 % up; a laser that is off stays off.
    np.testing.assert_allclose(variables.amplitudes, [[2 * np.exp(-0.02), 0.5 * np.exp(0.02), 0]], rtol=1e-9)


def test_a_laser_that_the_closed_form_left_nearly_dark_can_come_back(bench: Bench) -> None:
    variables = _variables(bench(amplitudes=[[1.0, 1e-30, 1.0]]), loss="srgb", betas=(0.0, 0.0))
    slopes = np.array([[0.0, -1.0, 0.0]])
    for _ in range(10):
        variables.step(_evaluation(bench(), amplitude_gradient=slopes), 1)
    assert variables.amplitudes[0, 1] == pytest.approx(1e-6 * np.exp(0.2), rel=1e-6)


def test_wavelengths_move_down_their_slope_by_the_settings_step(bench: Bench) -> None:
    system = bench()
    variables = _variables(system, free=EVERYTHING, wavelength_step_m=2e-9, amplitudes_every=10)
    assert variables.step(_evaluation(system, wavelength_gradient=np.array([1.0, -1e5, 0.0])), 10)
    step_m = 2e-9 * np.sqrt(0.5)  # half way through the search
    np.testing.assert_allclose(variables.wavelengths.values_m, [460e-9 - step_m, 532e-9 + step_m, 638e-9], rtol=1e-12)
    assert not variables.step(_evaluation(system), 11)


def test_wavelengths_stay_in_range_and_apart(bench: Bench) -> None:
    system = bench(wavelengths=["460 nm", "465 nm", "638 nm"])
    places = {"wavelength_range_m": (455e-9, 640e-9), "wavelength_spacing_m": 4e-9, "wavelength_step_m": 0.5e-9}
    variables = _variables(system, free=EVERYTHING, **places)
    for _ in range(30):
        variables.step(_evaluation(system, wavelength_gradient=np.array([-1.0, 1.0, -1.0])), 5)
    low, middle, high = np.sort(variables.wavelengths.values_m)
    assert high == pytest.approx(640e-9, rel=1e-12)
    assert middle - low == pytest.approx(4e-9, rel=1e-6)


def test_wavelengths_begin_inside_their_range_when_they_are_free(bench: Bench) -> None:
    narrow = {"wavelength_range_m": (450e-9, 600e-9)}
    assert not _variables(bench(), **narrow).wavelengths.adjusted
    free = _variables(bench(), free=EVERYTHING, **narrow)
    assert free.wavelengths.adjusted
    np.testing.assert_allclose(free.wavelengths.values_m, [460e-9, 532e-9, 600e-9], rtol=1e-12)
    with pytest.raises(UserError, match="wavelength range"):
        _variables(bench(), free=EVERYTHING, wavelength_range_m=(500e-9, 501e-9))


def test_unknowns_that_are_loaded_go_on_as_those_that_were_kept(bench: Bench) -> None:
    system = bench()
    found = _evaluation(
        system,
        path_gradient=torch.full(system.drive_shape, 1e-3),
        amplitude_gradient=np.array([[1.0, -0.2, 0.1]]),
        wavelength_gradient=np.array([3.0, -1.0, 2.0]),
    )
    settings = {"free": EVERYTHING, "loss": "srgb"}
    going_on, loaded = (_variables(system, **settings) for _ in range(2))
    for i in range(1, 4):
        going_on.step(_again(found), i)
    kept = going_on.state_dict()
    loaded.load_state_dict(kept)
    before = {name: value.copy() for name, value in kept.items()}
    for i in range(4, 8):
        going_on.step(_again(found), i)
        loaded.step(_again(found), i)
    for name, value in going_on.state_dict().items():
        np.testing.assert_array_equal(loaded.state_dict()[name], value, err_msg=name)
        np.testing.assert_array_equal(kept[name], before[name], err_msg=name)  # what was kept is a copy
        assert (value != before[name]).any(), name


def _again(found: LossEvaluation) -> LossEvaluation:
    """A copy: a move consumes the gradient."""
    assert found.path_gradient is not None
    return LossEvaluation(**(vars(found) | {"path_gradient": found.path_gradient.clone()}))


def _start(bench: Bench, begin: str, seed: int = 0, **changes: Any) -> np.ndarray:
    system = bench(**({"shape": [96, 128], "amplitudes": [[1.0, 1.0, 1.0]] * 2} | changes))
    drive = initial_drive(system, Settings(begin=begin, seed=seed))
    assert drive.dtype == torch.float32
    assert tuple(drive.shape) == system.drive_shape
    return drive.numpy()


def test_a_random_start_is_uniform_over_the_stroke(bench: Bench) -> None:
    values = np.sort(_start(bench, "random").ravel())
    uniform = (np.arange(values.size) + 0.5) / values.size
    # Kolmogorov–Smirnov: c/√n is passed by chance with probability 2·exp(−2c²), once in a million for 2.7.
    assert np.abs(values - uniform).max() <= 2.7 / math.sqrt(values.size)
    assert values.min() >= 0 and values.max() <= 1


@pytest.mark.parametrize("begin", ["random", "smooth"])
def test_one_seed_gives_one_start_and_another_another(begin: str, bench: Bench) -> None:
    np.testing.assert_array_equal(_start(bench, begin, seed=3), _start(bench, begin, seed=3))
    assert (_start(bench, begin, seed=3) != _start(bench, begin, seed=4)).mean() > 0.9


def test_a_random_start_has_no_correlation_between_neighbours_frames_or_modulators(bench: Bench) -> None:
    drive = _start(bench, "random") - 0.5
    pairs = [(drive[..., 1:], drive[..., :-1]), (drive[0], drive[1]), (drive[:, 0], drive[:, 1])]
    for one, other in pairs:
        correlation = np.corrcoef(one.ravel(), other.ravel())[0, 1]
        assert abs(correlation) < 5 / math.sqrt(one.size)  # five standard deviations


@pytest.mark.parametrize("stroke_m", [600e-9, 825e-9])
def test_a_smooth_start_has_half_a_radian_at_the_middle_wavelength_about_half_the_stroke(
    stroke_m: float, bench: Bench
) -> None:
    drive = _start(bench, "smooth", stroke=stroke_m).astype(np.float64)
    phase = 2 * math.pi * stroke_m * drive / 532e-9
    assert float(phase.std()) == pytest.approx(0.5, rel=1e-6)  # drives are float32
    # Of white noise a Gaussian filter of width s leaves the mean, and 1/(2√π·s) of the r.m.s.; six standard deviations.
    deviation = float(drive.std()) * 2 * math.sqrt(math.pi / drive.size) * 8
    assert float(drive.mean()) == pytest.approx(0.5, abs=6 * deviation)
    assert drive.min() > 0 and drive.max() < 1


def test_modulators_of_different_strokes_begin_with_the_phases_of_equal_ones(bench: Bench) -> None:
    paths = []
    for strokes in ([700e-9, 700e-9], [500e-9, 1200e-9]):
        modulators = tuple(Modulator(pitch_m=8e-6, shape=(96, 128), stroke_m=stroke) for stroke in strokes)
        drive = initial_drive(bench(modulators=modulators), Settings(begin="smooth")).double().numpy()
        paths.append((drive - 0.5) * np.reshape(strokes, (1, 2, 1, 1)))
    np.testing.assert_allclose(paths[1], paths[0], rtol=0, atol=1e-6 * 700e-9)  # drives are float32


def test_a_smooth_start_is_smooth(bench: Bench) -> None:
    drive = _start(bench, "smooth", shape=[384, 512]) - 0.5
    steps = np.diff(drive, axis=-1).std() / drive.std()
    # A Gaussian filter of width s leaves a correlation exp(−1/4s²) at one pixel: √(2 − 2·that) = 1/(√2·s). Of n pixels
    # that ratio varies by s·√(3π/4n), relatively, as the integral of the filter's squared spectrum says.
    assert steps == pytest.approx(1 / (math.sqrt(2) * 8), rel=5.5 * 8 * math.sqrt(0.75 * math.pi / drive.size))
    assert np.diff(_start(bench, "random"), axis=-1).std() > 0.3


def test_a_smooth_start_stays_inside_a_short_stroke(bench: Bench) -> None:
    drive = _start(bench, "smooth", stroke="50 nm")
    assert drive.min() == 0 and drive.max() == 1


def _patterns(system: System, **settings: Any) -> PatternVariables:
    return PatternVariables(system, Settings(**settings), torch.full(system.drive_shape, 0.5))


def test_the_first_move_is_a_step_of_the_settings_phase_against_the_gradient(bench: Bench) -> None:
    strokes = [700e-9, 825e-9]
    system = bench(modulators=tuple(Modulator(pitch_m=8e-6, shape=(12, 16), stroke_m=stroke) for stroke in strokes))
    patterns = _patterns(system, step_rad=0.3)
    gradient = torch.rand(system.drive_shape, generator=torch.Generator().manual_seed(0)) - 0.5
    before, signs = patterns.drive.clone(), torch.sign(gradient)
    patterns.step(gradient, scale=0.5)
    moved_m = (patterns.drive - before) * torch.tensor(strokes).reshape(1, -1, 1, 1)
    expected = -signs * 0.5 * 0.3 * 532e-9 / (2 * math.pi)
    torch.testing.assert_close(moved_m, expected.float(), rtol=1e-4, atol=0)  # float32 of 0.5 less a hundredth


def test_patterns_stay_inside_the_stroke(bench: Bench) -> None:
    patterns = _patterns(bench(), step_rad=3.0)
    for sign, end in ((-1, 1.0), (1, 0.0)):
        for _ in range(6):
            patterns.step(torch.full_like(patterns.drive, 1e-9 * sign), scale=1.0)
        assert torch.equal(patterns.drive, torch.full_like(patterns.drive, end))


def test_what_is_shown_are_levels_and_what_moves_is_the_drive(bench: Bench) -> None:
    continuous, stepped = (_patterns(bench(**c)) for c in ({}, {"levels": [0, 0.2, 0.7, 1]}))
    drive = torch.rand(continuous.drive.shape, generator=torch.Generator().manual_seed(2))
    for patterns in (continuous, stepped):
        patterns.drive = drive.clone()
    assert torch.equal(continuous.displayed_drive(), drive)
    table = torch.tensor([0, 0.2, 0.7, 1.0])
    assert torch.equal(stepped.displayed_drive(), table[(drive[..., None] - table).abs().argmin(dim=-1)])
    assert torch.equal(stepped.drive, drive)
    torch.testing.assert_close(stepped.optical_path_m(stepped.displayed_drive()), stepped.displayed_drive() * 825e-9)
