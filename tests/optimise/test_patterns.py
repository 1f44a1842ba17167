"""Initial patterns, what modulators show of them, and Adam's step."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from holoview.model.bench_parts import Modulator
from holoview.model.system import System
from holoview.optimise.settings import Settings
from holoview.optimise.variables import PatternVariables, initial_drive

Bench = Callable[..., System]


def _start(bench: Bench, begin: str, seed: int = 0, **changes: Any) -> np.ndarray:
    system = bench(**({"shape": [96, 128], "amplitudes": [[1.0, 1.0, 1.0]] * 2} | changes))
    drive = initial_drive(system, Settings(begin=begin, seed=seed))
    assert drive.dtype == torch.float32
    assert tuple(drive.shape) == system.drive_shape
    return drive.numpy()


def test_a_random_start_is_uniform_over_the_stroke(bench: Bench) -> None:
    values = np.sort(_start(bench, "random").ravel())
    uniform = (np.arange(values.size) + 0.5) / values.size
    # Kolmogorov–Smirnov: 1.95/√n is passed by chance once in a thousand times; the seed is fixed.
    assert np.abs(values - uniform).max() <= 1.95 / math.sqrt(values.size)
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
    assert float(drive.mean()) == pytest.approx(0.5, abs=0.01)
    assert drive.min() > 0 and drive.max() < 1


def test_modulators_of_different_strokes_begin_with_the_phases_of_equal_ones(bench: Bench) -> None:
    paths = []
    for strokes in ([700e-9, 700e-9], [500e-9, 1200e-9]):
        modulators = tuple(Modulator(pitch_m=8e-6, shape=(96, 128), stroke_m=stroke) for stroke in strokes)
        drive = initial_drive(bench(modulators=modulators), Settings(begin="smooth")).double().numpy()
        paths.append((drive - 0.5) * np.reshape(strokes, (1, 2, 1, 1)))
    np.testing.assert_allclose(paths[1], paths[0], rtol=0, atol=1e-6 * 700e-9)  # drives are float32


def test_a_smooth_start_is_smooth(bench: Bench) -> None:
    drive = _start(bench, "smooth") - 0.5
    steps = np.diff(drive, axis=-1).std() / drive.std()
    # A Gaussian filter of width s leaves a correlation exp(−1/4s²) at one pixel: √(2 − 2·that) = 1/(√2·8).
    assert steps == pytest.approx(1 / (math.sqrt(2) * 8), rel=0.1)
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
