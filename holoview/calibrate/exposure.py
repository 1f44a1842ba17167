"""Exposure and laser power for every wavelength, so that captures use the camera's range and none clips.

    rate = (the brightest 0.1 % of a picture − black) / (power · exposure)     counts for each unit of both

The brightest of a wavelength's first captures decides. Of the lasers' powers the highest is chosen that the camera's
shortest exposure allows: short exposures suffer least from drift and vibration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.util.errors import UserError

HEADROOM = 0.9
"""Share of the range between black and saturation that the brightest 0.1 % is to reach."""

_BRIGHTEST = 1e-3  # share of the pixels that may clip
_BACK_OFF = 4.0  # a clipped picture tells only that it was too bright: try so many times less
_DIM = 0.02  # of the range: a dimmer picture's rate isn't worth much


@dataclass(frozen=True)
class ExposureLimits:
    """What can be set: relative laser powers and exposures (s), smallest and largest."""

    powers: tuple[float, float] = (0.05, 1.0)
    exposures_s: tuple[float, float] = (1e-4, 1.0)

    def __post_init__(self) -> None:
        for name in ("powers", "exposures_s"):
            low, high = getattr(self, name)
            if not 0 < low <= high < np.inf:
                raise UserError(name.removesuffix("_s"), f"{low:g} to {high:g}", expected="positive, rising numbers")


@dataclass(frozen=True)
class ExposureSetting:
    """What to set for a wavelength, the counts above black that the brightest 0.1 % then reaches, and a remark."""

    wavelength_m: float
    power: float
    exposure_s: float
    reached: float
    note: str = ""


_ANY = ExposureLimits()


def plan_exposures(
    captures: Captures,
    dark: NDArray[np.unsignedinteger] | None = None,
    limits: ExposureLimits = _ANY,
    headroom: float = HEADROOM,
) -> list[ExposureSetting]:
    """A line a wavelength, from first captures and a dark picture (y, x) in counts; nominal black without one.

    Raises UserError where the dark picture isn't of the camera's shape, or is no darker than the captures.
    """
    if not 0.05 <= headroom < 1:
        raise UserError("headroom", f"{headroom:g}", expected="from 0.05 to below 1")
    black = _black_level(captures, dark)
    return [_plan_wavelength(captures, λ, black, limits, headroom) for λ in captures.wavelengths_m]


def _black_level(captures: Captures, dark: NDArray[np.unsignedinteger] | None) -> float:
    if dark is None:
        return captures.camera.black_level
    if dark.shape != captures.shape:
        raise UserError("dark picture", f"{dark.shape} pixels", expected=f"{captures.shape}, as the captures")
    black = float(dark.mean(dtype=np.float64))
    if black >= float(captures.images.mean(axis=(1, 2)).min()):
        raise UserError(
            "dark picture", f"{black:g} counts", expected="a picture with the lasers off", remedy="retake it"
        )
    return black


def _plan_wavelength(
    captures: Captures, wavelength_m: float, black: float, limits: ExposureLimits, headroom: float
) -> ExposureSetting:
    saturation = captures.camera.saturation
    room = headroom * (saturation - black)
    mine = np.flatnonzero(captures.wavelength_m == wavelength_m)
    bright = np.quantile(captures.images[mine].reshape(len(mine), -1), 1 - _BRIGHTEST, axis=1) - black
    clipped = bright >= saturation - black
    bright = np.where(clipped, _BACK_OFF * bright, np.maximum(bright, 1e-3))
    rates = bright / (captures.power[mine] * captures.exposure_s[mine])
    note = ""
    if clipped.any():
        note = "a first capture was clipped: take this one and plan again"
    elif bright.max() < _DIM * (saturation - black):
        note = "the first captures were dim: take this one and plan again"
    return _choose_power_and_exposure(wavelength_m, float(rates.max()), room, limits, note)


def _choose_power_and_exposure(
    wavelength_m: float, rate: float, room: float, limits: ExposureLimits, note: str
) -> ExposureSetting:
    """Power and exposure whose product fills the room, inside the limits."""
    (weakest, strongest), (shortest, longest) = limits.powers, limits.exposures_s
    needed = room / rate
    power = float(np.clip(needed / shortest, weakest, strongest))
    exposure = float(np.clip(needed / power, shortest, longest))
    power, exposure = _round_down(power), _round_down(exposure)
    reached = rate * power * exposure
    if reached > 1.001 * room:
        note = "too bright at the lowest power and shortest exposure: dim the laser"
    elif reached < 0.5 * room and not note:
        note = "dim at the highest power and longest exposure"
    return ExposureSetting(float(wavelength_m), power, exposure, reached, note)


def _round_down(value: float) -> float:
    """Three digits, never more than the value."""
    scale = 10.0 ** (np.floor(np.log10(value)) - 2)
    return float(f"{np.floor(value / scale * (1 + 1e-12)) * scale:.3g}")
