"""Measures how fast a modulator settles: patterns take turns, and a picture is taken ever later after the change.

    r(t) = ⟨I₊(t) − I₋(t), I₊ − I₋⟩ / |I₊ − I₋|² = a·exp(−t/τ)

I₊ and I₋ are the settled pictures of two patterns that differ from a third one by a small step up and down, I₊(t) and
I₋(t) those taken a time t after the third one followed them. In the difference, terms that are quadratic in the step
cancel, and r is the share of the step that remains. That an exposure takes time changes a, not τ.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import curve_fit

from holoview.captures.dataset import Camera
from holoview.rig.devices import BenchClock, CameraDevice, Levels, ModulatorDevice
from holoview.rig.measure.camera_pictures import take_exposed

REMAINING = 1e-3
"""Share of the pattern before that may remain when a picture is taken."""

_STEP = 0.015  # of the levels
_DELAYS_S = (0.0, 0.002, 0.004, 0.008, 0.016, 0.032, 0.064, 0.128, 0.256)
_SETTLED_S, _SLOWER, _SLOWEST_S = 1.0, 4.0, 20.0  # s to wait for a settled picture; then this factor longer, up to that
_FIRST_SHARE = 0.9  # above it, a dead time hasn't passed yet
_SEEN_SIGMAS = 5.0
_MOVING = 0.04  # of |I₊ − I₋|²: what two pictures of a settled pattern may differ by beyond their noise


@dataclass(frozen=True)
class Settling:
    """constant_s: time constant. deviation_s: its standard deviation. wait_s: until REMAINING is left.

    All 0 for a modulator that is settled in its first picture.
    """

    constant_s: float
    deviation_s: float
    wait_s: float


def measure_settling(
    modulator: ModulatorDevice, camera: CameraDevice, facts: Camera, clock: BenchClock, levels: Levels, num_levels: int
) -> Settling:
    """How one modulator settles. levels: a random pattern (y, x) for it; a laser is on, and the others don't change."""
    patterns = _three_patterns(levels, num_levels)
    settled_s = _SETTLED_S
    while True:
        is_last = settled_s * _SLOWER > _SLOWEST_S
        *difference, is_settled = _difference(modulator, camera, facts, clock, patterns, settled_s)
        if is_settled or is_last:
            delays, shares, deviation = _follow(modulator, camera, facts, clock, patterns, settled_s, *difference)
            if shares[-1] < max(0.1, _SEEN_SIGMAS * deviation) or is_last:
                return fit_settling(delays, shares, deviation)
        settled_s *= _SLOWER


def fit_settling(delays_s: NDArray[np.float64], shares: NDArray[np.float64], deviation: float) -> Settling:
    """The exponential through the shares of the pattern before that remain after these delays.

    deviation: standard deviation of each share.
    """
    used = np.flatnonzero(shares > _FIRST_SHARE)
    start = int(used[-1]) + 1 if len(used) else 0
    t, r = delays_s[start:], shares[start:]
    if len(t) < 3 or float(np.max(r)) < _SEEN_SIGMAS * deviation:
        last_s = float(delays_s[start - 1]) if start else 0.0
        return Settling(last_s, 0.0, 2 * last_s)
    guess_s = float(t[int(np.argmin(np.abs(r - r[0] / math.e)))] - t[0]) or float(t[1] - t[0])
    bounds = ([0.0, 1e-6], [1e3, 1e3])
    found, covariance = curve_fit(
        lambda t, a, τ: a * np.exp(-t / τ),
        t,
        r,
        p0=(max(float(r[0]), deviation), guess_s),
        sigma=np.full(len(t), deviation),
        absolute_sigma=True,
        bounds=bounds,
    )
    amplitude, constant_s = (float(value) for value in found)
    misfit = float((((amplitude * np.exp(-t / constant_s) - r) / deviation) ** 2).sum()) / (len(t) - 2)
    wait_s = constant_s * math.log(max(amplitude, 1.0) / REMAINING)
    return Settling(constant_s, (max(misfit, 1.0) * float(covariance[1, 1])) ** 0.5, wait_s)


def _three_patterns(levels: Levels, num_levels: int) -> tuple[Levels, Levels, Levels]:
    """The pattern, pressed into the middle of the range: a step up or down in each pixel, the opposite, and none."""
    step = max(round(_STEP * (num_levels - 1)), 1)
    middle = step + levels.astype(np.int64) * max(num_levels - 1 - 2 * step, 0) // (num_levels - 1)
    steps = step * np.random.default_rng(0).choice([-1, 1], levels.shape)
    up, down, none = (
        np.clip(middle + change, 0, num_levels - 1).astype(levels.dtype) for change in (steps, -steps, 0 * steps)
    )
    return up, down, none


def _difference(
    modulator: ModulatorDevice,
    camera: CameraDevice,
    facts: Camera,
    clock: BenchClock,
    patterns: tuple[Levels, Levels, Levels],
    settled_s: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], bool]:
    """(I₊ − I₋, its variance) in counts, and whether the pictures no longer changed.

    The third pattern comes first, so that a step is small. A picture that goes on changing would pass for I₊ − I₋, in
    which the shares of the step are then lost.
    """
    modulator.show(patterns[2])
    clock.wait(settled_s)
    pairs: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    for own in patterns[:2]:
        modulator.show(own)
        clock.wait(settled_s)
        if not pairs:
            take_exposed(camera, facts, 1e-2)
        early = camera.take().astype(np.float64)
        clock.wait(settled_s)
        pairs.append((early, camera.take().astype(np.float64)))
    means = [np.mean(pair, axis=0) for pair in pairs]
    difference, variance = means[0] - means[1], 2 * facts.noise_variance(means[0] - facts.black_level)
    changes = [float(((late - early) ** 2 - variance).sum()) for early, late in pairs]
    chance = _SEEN_SIGMAS * math.sqrt(2 * float((variance**2).sum()))
    return difference, variance, max(changes) < max(_MOVING * float((difference**2).sum()), chance)


def _follow(
    modulator: ModulatorDevice,
    camera: CameraDevice,
    facts: Camera,
    clock: BenchClock,
    patterns: tuple[Levels, Levels, Levels],
    settled_s: float,
    difference: NDArray[np.float64],
    variance: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Delays (s), shares of the step that remained then, and the standard deviation of a share."""
    up, down, none = patterns
    norm = max(float((difference**2).sum()), 1e-12)
    delays, shares = [], []
    for delay_s in np.array(_DELAYS_S) * settled_s / _SETTLED_S:
        share = 0.0
        for own, sign in ((up, 1), (down, -1)):
            modulator.show(own)
            clock.wait(settled_s)
            modulator.show(none)
            begin = clock.now()
            clock.wait(delay_s)
            waited_s = clock.now() - begin
            share += sign * float((camera.take() * difference).sum()) / norm
        delays.append(waited_s)
        shares.append(share)
    deviation = float((variance * difference**2).sum()) ** 0.5 / norm
    return np.array(delays), np.array(shares), deviation
