"""Captures that could be taken: patterns of several classes, planes, wavelengths, powers and exposures."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from holoview.captures.patterns import BLUR_SIGMAS_PX, random_levels
from holoview.rig.description import RigDescription
from holoview.rig.devices import Levels
from holoview.rig.measure.capture_plan import CaptureRequest, default_plan

T = TypeVar("T")

START_COUNT = 4

_START_SIGMAS_PX = (6.0, 3.0, 6.0, 0.0)  # smooth ones survive large errors, rough ones show small errors
_PERIODS_PX = (4, 6, 8, 12, 16)
_LOW_POWER = 0.5  # of the highest: a power law needs two
_LOW_POWER_SHARE, _DIM_SHARE = 0.25, 0.125  # of the proposals
_DIM = 0.1  # of the exposure: light of the room and the camera's response show there


@dataclass(frozen=True)
class Proposal:
    """A capture that could be taken.

    levels: (modulator, y, x). words: what its patterns are. brightness: its exposure over one that uses the camera's
    range. exposure_s: None where it has to be searched.
    """

    wavelength_m: float
    distance_m: float
    power: float
    levels: Levels
    words: str
    brightness: float = 1.0
    exposure_s: float | None = None

    @property
    def request(self) -> CaptureRequest:
        """The request for a measurement; its patterns are `levels`."""
        return CaptureRequest(self.wavelength_m, self.distance_m, self.power, 0.0, (0, 0), self.exposure_s)

    @property
    def place(self) -> str:
        """Wavelength, plane, patterns, and what is unusual of power and exposure, in words."""
        dim = ", a tenth of the exposure" if self.brightness < 1 else ""
        return f"{self.wavelength_m * 1e9:.0f} nm at {self.distance_m * 1e3:.3g} mm, {self.words}{dim}"


def starting_proposals(rig: RigDescription, seed: int) -> list[Proposal]:
    """The captures to begin with: smooth and rough, of wavelengths, planes and powers as different as possible."""
    rng = np.random.default_rng((seed, 0))
    planes, lasers = planes_of(rig), rig.wavelengths_m
    wavelengths = (lasers[0], lasers[-1], lasers[len(lasers) // 2], lasers[0])
    distances = (planes[0], planes[0], planes[-1], planes[-1])
    powers = (1.0, _LOW_POWER, 1.0, _LOW_POWER)
    return [
        Proposal(λ, z, power * rig.limits.power, _blurred(rng, rig, sigma), _blur_words(rig, sigma))
        for λ, z, power, sigma in zip(wavelengths, distances, powers, _START_SIGMAS_PX, strict=True)
    ]


def draw_proposals(rig: RigDescription, rng: np.random.Generator, count: int) -> list[Proposal]:
    """Random ones; every pair of wavelength and plane, and every class of patterns, comes about as often."""
    low, high = rig.limits.stage_m
    planes = [*planes_of(rig)]
    if len(planes) > 1:
        planes.append(float(rng.uniform(low, high)))
    places = _cycled(rng, list(itertools.product(rig.wavelengths_m, planes)), count)
    classes = _cycled(rng, _classes(rig), count)
    drawn = []
    for (λ, z), pattern in zip(places, classes, strict=True):
        levels, words = pattern(rng)
        power = rig.limits.power * (_LOW_POWER if rng.random() < _LOW_POWER_SHARE else 1.0)
        drawn.append(Proposal(λ, z, power, levels, words, _DIM if rng.random() < _DIM_SHARE else 1.0))
    return drawn


def planes_of(rig: RigDescription) -> list[float]:
    """The planes of the default plan, nearest first."""
    return sorted({request.distance_m for request in default_plan(rig).requests})


def _cycled(rng: np.random.Generator, values: Sequence[T], count: int) -> list[T]:
    """`count` of the values in random order, each about as often."""
    order: list[int] = []
    while len(order) < count:
        order += rng.permutation(len(values)).tolist()
    return [values[k] for k in order[:count]]


PatternClass = Callable[[np.random.Generator], tuple[Levels, str]]


def _classes(rig: RigDescription) -> list[PatternClass]:
    """Blurred noise of every width on all modulators, one modulator flat, gratings."""
    numbers = range(len(rig.bench.slms))
    classes: list[PatternClass] = [_blur_class(rig, sigma) for sigma in BLUR_SIGMAS_PX]
    classes += [_grating_class(rig, number) for number in numbers]
    if len(numbers) > 1:
        classes += [_one_flat_class(rig, number, sigma) for number in numbers for sigma in (0.0, 3.0)]
    return classes


def _blur_class(rig: RigDescription, sigma_px: float) -> PatternClass:
    return lambda rng: (_blurred(rng, rig, sigma_px), _blur_words(rig, sigma_px))


def _one_flat_class(rig: RigDescription, flat: int, sigma_px: float) -> PatternClass:
    def draw(rng: np.random.Generator) -> tuple[Levels, str]:
        levels = _blurred(rng, rig, sigma_px)
        levels[flat] = rig.bench.slms[flat].num_levels // 2
        return levels, f"{_noise(sigma_px)} on modulator {2 - flat}, the other flat"

    return draw


def _grating_class(rig: RigDescription, number: int) -> PatternClass:
    def draw(rng: np.random.Generator) -> tuple[Levels, str]:
        levels = _blurred(rng, rig, 3.0)
        period, angle = int(rng.choice(_PERIODS_PX)), float(rng.uniform(0, np.pi))
        y, x = np.indices(rig.slm_shape)
        wave = 0.5 + 0.5 * np.sin(2 * np.pi * (x * np.cos(angle) + y * np.sin(angle)) / period)
        levels[number] = np.rint(wave * (rig.bench.slms[number].num_levels - 1))
        beside = f", {_noise(3.0)} on the other" if len(levels) > 1 else ""
        return levels, f"grating of {period} px on modulator {number + 1}{beside}"

    return draw


def _blurred(rng: np.random.Generator, rig: RigDescription, sigma_px: float) -> NDArray[np.unsignedinteger]:
    return np.stack([random_levels(rng, rig.slm_shape, slm.num_levels, sigma_px) for slm in rig.bench.slms])


def _blur_words(rig: RigDescription, sigma_px: float) -> str:
    return f"{_noise(sigma_px)} on {'both modulators' if len(rig.bench.slms) > 1 else 'the modulator'}"


def _noise(sigma_px: float) -> str:
    return f"noise blurred by {sigma_px:g} px" if sigma_px else "white pattern"
