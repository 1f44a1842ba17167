"""Pictures that measurements can rely on: well exposed, checked, and dark ones for comparison.

take_exposed     an exposure time that uses the camera's range without saturation, found from picture to picture
CheckedCamera    takes a picture again that a camera can't have taken: of another shape or range, repeated, or torn
DarkFrame        the mean of pictures with all lasers off, compared with the black level and read noise that are stated

Noise makes two pictures of the same scene differ, which tells repeated and torn pictures apart. Whole counts of two
pixels with normal noise of standard deviation σ are equal with a probability of at most 1/(2√π·σ); the product over the
pixels that are equal to those of the picture before says how improbable it is that they were taken anew.

`measure_settling` finds how fast a modulator settles: patterns take turns, and a picture is taken ever later after
the change.

    r(t) = ⟨I₊(t) − I₋(t), I₊ − I₋⟩ / |I₊ − I₋|² = a·exp(−t/τ)

I₊ and I₋ are the settled pictures of two patterns that differ from a third pattern by a small step up and down; I₊(t)
and I₋(t) are taken a time t after the third pattern followed them. In the difference, terms that are quadratic in the
step cancel, and r is the share of the step that remains. The length of an exposure changes a, not τ.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import curve_fit

from holoview.bench.captures.dataset import Camera
from holoview.bench.rig.devices import (
    BenchClock,
    CameraDevice,
    Counts,
    DeviceError,
    DeviceGone,
    Levels,
    ModulatorDevice,
    Wrapped,
)
from holoview.light.numerics.sample_bits import find_bits
from holoview.util.progress import TextCallback

BRIGHT_QUANTILE = 0.999
"""This quantile of the pixels counts as a picture's brightest; single brighter pixels may be dust or hot."""

_TARGET, _ENOUGH, _TOO_MUCH = 0.8, 0.4, 0.95  # of the range above black
_STEP, _TRIES = 8.0, 12

ATTEMPTS = 4
"""How often a picture is tried in all, before the camera counts as out of order."""

_IMPROBABLE = math.log(1e-12)
_DARK_SIGMAS = 6.0  # of dark noise below the black level: no pixel has 0 counts by chance
_REMEDY = "check its cable, trigger and time-out; the same command goes on"

DARK_PICTURES = 16
"""Pictures whose mean is a dark frame."""

_SAME_EXPOSURE = 1.25  # factor within which two exposures share a dark frame
_LEVEL_COUNTS, _NOISE_FACTOR = 0.5, 1.25  # by which level and noise may differ from those that rig.toml states
_RATE_COUNTS = 0.5  # difference between the longest and the shortest exposure that is told


def take_exposed(
    camera: CameraDevice, facts: Camera, start_s: float, bright_quantile: float = BRIGHT_QUANTILE
) -> tuple[Counts, float]:
    """A picture whose brightest pixels reach 0.4 to 0.95 of the range, or as near as exposures reach; and its exposure.

    start_s: the first exposure that is tried. bright_quantile: of the pixels, those above are the brightest.
    """
    low, high = camera.exposures_s
    exposure = camera.set_exposure(float(np.clip(start_s, low, high)))
    picture = camera.take()
    for _ in range(_TRIES):
        share = range_share(picture, facts, bright_quantile)
        if _ENOUGH <= share <= _TOO_MUCH:
            break
        factor = 1 / _STEP if share > _TOO_MUCH else float(np.clip(_TARGET / max(share, 1e-6), 1 / _STEP, _STEP))
        wanted = float(np.clip(exposure * factor, low, high))
        if wanted == exposure:
            break
        exposure = camera.set_exposure(wanted)
        picture = camera.take()
    return picture, exposure


def range_share(picture: Counts, facts: Camera, bright_quantile: float = BRIGHT_QUANTILE) -> float:
    """The share of the range above the black level that the brightest pixels reach."""
    bright = float(np.quantile(picture, bright_quantile))
    return (bright - facts.black_level) / (facts.saturation - facts.black_level)


def exposure_note(picture: Counts, facts: Camera) -> str:
    """In words, how a picture is exposed badly; "" if it isn't."""
    share = range_share(picture, facts)
    if share > _TOO_MUCH:
        return "too bright"
    return "too dark" if share < _ENOUGH else ""


class PictureCheck:
    """Compares each picture with the one before. shape: rows and columns of a raw picture."""

    def __init__(self, facts: Camera, shape: tuple[int, int]) -> None:
        self._facts, self._shape = facts, shape
        self._before: Counts | None = None

    def fault(self, picture: Counts) -> str | None:
        """A fault of a picture, in words, or None. The next picture is compared with it."""
        facts = self._facts
        if picture.shape != self._shape:
            return f"a picture of {' × '.join(map(str, picture.shape))} pixels, not {' × '.join(map(str, self._shape))}"
        if picture.dtype.kind != "u":
            return f"counts of type {picture.dtype}, not unsigned whole numbers"
        if int(picture.max()) > facts.saturation:
            bits = find_bits(picture) if picture.dtype == np.uint16 else None
            layout = f"; they are {bits.describe()}" if bits and bits.layout != "plain" else ""
            return f"{int(picture.max())} counts, more than {facts.bit_depth} bits{layout}"
        before, self._before = self._before, picture.copy()
        if self._is_empty(picture[-1]) and not self._is_empty(picture[0]):
            return "a picture whose lower part is empty"
        if before is None:
            return None
        improbable = self._improbable_rows(picture, before)
        if improbable.all():
            return "the picture before, again"
        if improbable[0] or improbable[-1]:
            return "a picture with a part of the one before"
        return None

    def _is_empty(self, row: Counts) -> bool:
        """Whether there are no counts at all where there should be the black level's."""
        return bool((row == 0).all()) and self._facts.black_level > _DARK_SIGMAS * self._facts.dark_noise

    def _improbable_rows(self, picture: Counts, before: Counts) -> NDArray[np.bool_]:
        """Rows (y,) of blocks at the edges, or of the whole, that can't equal those of the picture before by chance."""
        equal = (picture == before).all(axis=1)
        found = np.zeros(len(equal), np.bool_)
        if not (equal[0] or equal[-1]):
            return found
        first = len(equal) if equal.all() else int(np.argmin(equal))
        last = len(equal) if equal.all() else int(np.argmin(equal[::-1]))
        chance = np.where(equal, self._log_chance(picture), 0.0)
        found[:first] = chance[:first].sum() < _IMPROBABLE
        found[len(equal) - last :] = chance[len(equal) - last :].sum() < _IMPROBABLE
        return found

    def _log_chance(self, picture: Counts) -> NDArray[np.float64]:
        """Logarithm of the probability (y,) that a row taken anew is equal. Saturated pixels are so for certain."""
        facts = self._facts
        signal = picture.astype(np.float64) - facts.black_level
        deviation = np.sqrt(np.maximum(facts.noise_variance(signal) - 1 / 12, 1e-12))  # without quantisation
        chance = np.minimum(1.0, 1 / (2 * math.sqrt(math.pi) * deviation))
        chance[(picture == 0) | (picture >= facts.saturation)] = 1.0
        return np.log(chance).sum(axis=1)


class CheckedCamera(Wrapped[CameraDevice]):
    """A camera whose pictures are checked, and taken again where one is wrong or doesn't come.

    tell: called with a sentence on each of those.
    """

    def __init__(self, camera: CameraDevice, facts: Camera, tell: TextCallback) -> None:
        super().__init__(camera)
        self._tell, self._check = tell, PictureCheck(facts, camera.shape)

    def take(self) -> Counts:
        """A picture with which nothing is wrong. Raises DeviceError after ATTEMPTS, and DeviceGone at once."""
        for attempt in range(1, ATTEMPTS + 1):
            try:
                picture = self.device.take()
                fault = self._check.fault(picture)
                if fault is None:
                    return picture
            except DeviceGone:
                raise
            except DeviceError as error:
                fault = error.found
            if attempt < ATTEMPTS:
                self._tell(f"camera: {fault}; taken again")
        raise DeviceError("camera", f"{fault}, {ATTEMPTS} times in a row", remedy=_REMEDY)

    def close(self) -> None:
        """Does nothing: the camera is closed by its owner."""


@dataclass(frozen=True)
class DarkFrame:
    """mean: (y, x), counts, of `pictures` pictures. noise: standard deviation (counts) from picture to picture."""

    exposure_s: float
    mean: NDArray[np.float32]
    noise: float
    pictures: int

    @property
    def level(self) -> float:
        """Counts of a pixel without light, mean over the picture."""
        return float(self.mean.mean(dtype=np.float64))


def take_dark_frame(camera: CameraDevice, exposure_s: float, pictures: int = DARK_PICTURES) -> DarkFrame:
    """Averages pictures. The lasers are off."""
    exposure_s = camera.set_exposure(exposure_s)
    total, squares = np.zeros(camera.shape), np.zeros(camera.shape)
    for _ in range(pictures):
        picture = camera.take().astype(np.float64)
        total += picture
        squares += picture**2
    mean = total / pictures
    variance = (squares - pictures * mean**2) / (pictures - 1)
    noise = math.sqrt(max(float(variance.mean()), 0.0))
    return DarkFrame(exposure_s, mean.astype(np.float32), noise, pictures)


def dark_exposures(exposures_s: Sequence[float], there_s: Sequence[float]) -> list[float]:
    """The shortest and the longest exposure of captures, without those for which there are dark frames already."""
    wanted: list[float] = []
    for exposure_s in (min(exposures_s, default=0.0), max(exposures_s, default=0.0)):
        known = [*there_s, *wanted]
        if exposure_s > 0 and not any(max(exposure_s / t, t / exposure_s) <= _SAME_EXPOSURE for t in known):
            wanted.append(exposure_s)
    return wanted


def dark_notes(frames: Sequence[DarkFrame], facts: Camera) -> dict[str, str]:
    """Sentences on differences between rig.toml and the dark frames, under the keys level, noise and growth."""
    notes: dict[str, str] = {}
    if not frames:
        return notes
    ordered = sorted(frames, key=lambda frame: frame.exposure_s)
    shortest, longest = ordered[0], ordered[-1]
    if abs(shortest.level - facts.black_level) > _LEVEL_COUNTS:
        stated = f"rig.toml states black_level = {facts.black_level:g}"
        notes["level"] = f"dark pictures have {shortest.level:.1f} counts, but {stated}"
    if not 1 / _NOISE_FACTOR <= shortest.noise / facts.dark_noise <= _NOISE_FACTOR:
        measured = math.sqrt(max(shortest.noise**2 - 1 / 12, 0.0)) * facts.electrons_per_count
        stated = f"a read noise of {measured:.2g} electrons, but rig.toml states read_noise = {facts.read_noise:g}"
        notes["noise"] = f"dark pictures vary by {shortest.noise:.2g} counts, which is {stated}"
    grown = longest.level - shortest.level
    if abs(grown) > _RATE_COUNTS and longest.exposure_s > shortest.exposure_s:
        rate = grown / (longest.exposure_s - shortest.exposure_s)
        reason = "dark current, or light beside the lasers'"
        notes["growth"] = f"dark pictures grow by {rate:.2g} counts a second: {reason}"
    return notes


# --- how fast a modulator settles -------------------------------------------------------------------------------------


REMAINING = 1e-3
"""Share of the pattern before that may remain when a picture is taken."""

_LEVEL_STEP = 0.015  # of the levels
_DELAYS_S = (0.0, 0.002, 0.004, 0.008, 0.016, 0.032, 0.064, 0.128, 0.256)
_SETTLED_S, _SLOWER, _SLOWEST_S = 1.0, 4.0, 20.0  # s to wait for a settled picture; then this factor longer, up to that
_FIRST_SHARE = 0.9  # above it, a dead time hasn't passed yet
_SEEN_SIGMAS = 5.0
_MOVING = 0.04  # of |I₊ − I₋|²: difference of two pictures of a settled pattern beyond their noise


@dataclass(frozen=True)
class SettlingTime:
    """constant_s: time constant. deviation_s: its standard deviation. wait_s: until REMAINING is left.

    All 0 for a modulator that is settled in its first picture.
    """

    constant_s: float
    deviation_s: float
    wait_s: float

    def wait_until(self, share: float) -> float:
        """Seconds until this share of the pattern before is left, at least REMAINING."""
        return max(self.wait_s - self.constant_s * math.log(share / REMAINING), 0.0)


def measure_settling(
    modulator: ModulatorDevice, camera: CameraDevice, facts: Camera, clock: BenchClock, levels: Levels, num_levels: int
) -> SettlingTime:
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


def share_deviation(
    modulator: ModulatorDevice, camera: CameraDevice, facts: Camera, clock: BenchClock, levels: Levels, num_levels: int
) -> float:
    """Standard deviation of a share of the pattern before as `measure_settling` would measure it: above 0.1 or so the
    pictures hardly show the steps of the pattern."""
    patterns = _three_patterns(levels, num_levels)
    difference, variance, _ = _difference(modulator, camera, facts, clock, patterns, _SETTLED_S)
    seen = float((difference**2 - variance / 2).sum())
    return math.inf if seen <= 0 else float((variance * difference**2).sum()) ** 0.5 / seen


def fit_settling(delays_s: NDArray[np.float64], shares: NDArray[np.float64], deviation: float) -> SettlingTime:
    """The exponential through the shares of the pattern before that remain after these delays.

    deviation: standard deviation of each share.
    """
    used = np.flatnonzero(shares > _FIRST_SHARE)
    start = int(used[-1]) + 1 if len(used) else 0
    t, r = delays_s[start:], shares[start:]
    if len(t) < 3 or float(np.max(r)) < _SEEN_SIGMAS * deviation:
        last_s = float(delays_s[start - 1]) if start else 0.0
        return SettlingTime(last_s, 0.0, 2 * last_s)
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
    return SettlingTime(constant_s, (max(misfit, 1.0) * float(covariance[1, 1])) ** 0.5, wait_s)


def _three_patterns(levels: Levels, num_levels: int) -> tuple[Levels, Levels, Levels]:
    """The pattern, pressed into the middle of the range: a step up or down in each pixel, the opposite, and none."""
    step = max(round(_LEVEL_STEP * (num_levels - 1)), 1)
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
    """I₊ − I₋ (counts), the variance of the difference of two single pictures, and whether these no longer changed.

    I₊ and I₋ are means of two pictures each, so that the variance of their difference is half of the one returned.
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
