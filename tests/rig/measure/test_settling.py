"""Settling: the fit on shares that are known, and the whole measurement on a bench whose time constant is hidden."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.bench.rig.camera_pictures import REMAINING, fit_settling, measure_settling
from holoview.bench.rig.capture_plan import default_plan
from tests.rig.conftest import LASERS_M, MakeRig, direct_devices

DELAYS = np.array([0.0, 0.002, 0.004, 0.008, 0.016, 0.032, 0.064, 0.128, 0.256])


@pytest.mark.parametrize("constant", [0.003, 0.02, 0.09])
@pytest.mark.parametrize(("amplitude", "dead_s"), [(1.0, 0.0), (0.6, 0.0), (1.0, 0.006)])
def test_the_fit_finds_the_time_constant_beside_a_dead_time_or_an_average(
    constant: float, amplitude: float, dead_s: float
) -> None:
    deviation = 1e-3
    shares = amplitude * np.minimum(np.exp(-(DELAYS - dead_s) / constant), 1.0)
    errors = []
    for seed in range(20):
        noisy = shares + deviation * np.random.default_rng(seed).standard_normal(len(DELAYS))
        found = fit_settling(DELAYS, noisy, deviation)
        errors.append((found.constant_s - constant) / found.deviation_s)
        remaining = amplitude * np.exp(-(found.wait_s - dead_s) / constant)
        assert remaining < 2 * REMAINING  # exp of the error of a few per cent of ln(1000) time constants
    assert np.abs(np.mean(errors)) < 5 / 20**0.5 and np.max(np.abs(errors)) < 6


def test_a_modulator_that_is_settled_at_once_needs_no_waiting() -> None:
    noise = 1e-3 * np.random.default_rng(0).standard_normal(len(DELAYS))
    found = fit_settling(DELAYS, noise, 1e-3)
    assert (found.constant_s, found.wait_s) == (0.0, 0.0)


def test_one_that_hasnt_begun_to_move_is_waited_for_twice_as_long() -> None:
    found = fit_settling(DELAYS, np.full(len(DELAYS), 0.99), 1e-3)
    assert found.wait_s == 2 * DELAYS[-1]


@pytest.mark.parametrize("constant", [0.005, 0.5, 3.0])
def test_the_bench_s_hidden_time_constant_is_found(make_rig: MakeRig, constant: float) -> None:
    """To two per cent: what is left of the picture's answer to the step is of third order, (0.15 rad)²."""
    rig = make_rig({"virtual.settle": constant})
    devices = direct_devices(rig)
    levels = default_plan(rig).requests[1].levels(rig)
    devices.stage.move_to(5e-3)
    devices.lasers.switch_on(LASERS_M[1], 1.0)
    for modulator, own in zip(devices.modulators, levels, strict=True):
        modulator.show(own)
    facts, number = rig.bench.camera, 1
    found = measure_settling(devices.modulators[number], devices.camera, facts, devices.clock, levels[number], 256)
    assert found.constant_s == pytest.approx(constant, abs=0.02 * constant + 5 * found.deviation_s)
    # Of pictures of 1536 pixels 3.5 %; its logarithm scatters by 0.28 from pattern to pattern, and is 6 of these below.
    assert found.deviation_s < 0.2 * constant
    # The step's amplitude, 1, is known better than to a fifth, and counts by its logarithm.
    assert found.wait_s == pytest.approx(found.constant_s * np.log(1 / REMAINING), rel=0.03)
