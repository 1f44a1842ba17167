"""Plans laser power and exposure time for each wavelength so that captures fill the camera's range unclipped.

The camera is linear: the 99.9th percentile of an image above the black level grows in proportion to power · exposure.
From first captures of any brightness,

    rate = max over captures of (99.9th percentile − black) / (power · exposure),

and power · exposure = headroom · (saturation − black) / rate. Of the pairs with this product the one with the highest
power is chosen, because short exposures suffer least from drift and vibration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Captures
from holoview.light.model.fields import POSITIVE, Number, Span, described_field, spaced_key, validate, with_field_docs
from holoview.util.errors import UserError

_CLIPPED_SHARE = 1e-3  # share of the pixels that may clip
_BACK_OFF = 4.0  # a clipped image only bounds the rate from below: assume that it is so many times higher
_DIM = 0.02  # share of the range; the rate of a dimmer image is too uncertain


@with_field_docs
@dataclass(frozen=True)
class ExposureLimits:
    """What a plan of exposures may use. Raises UserError for settings that can't be.

    Fields:
    """

    powers: tuple[float, float] = described_field(
        Span(POSITIVE),
        "Lowest and highest power of the laser, in the unit of the captures.",
        flag="power",
        default=(0.05, 1.0),
    )
    exposures_s: tuple[float, float] = described_field(
        Span(POSITIVE), "Shortest and longest exposure, in seconds.", flag="exposure", default=(1e-4, 1.0)
    )
    headroom: float = described_field(
        Number(low=0.05, high=math.nextafter(1.0, 0.0), words="from 0.05 to below 1"),
        "Share of the range from black to saturation that the 99.9th percentile is to reach.",
        default=0.9,
    )

    def __post_init__(self) -> None:
        validate(self, spaced_key)


@dataclass(frozen=True)
class ExposureSetting:
    """The planned setting for a wavelength. The field names are keys of the JSON that `holoview captures plan` writes.

    reached: expected 99.9th percentile of an image, in counts above black.
    note: a warning, or "".
    """

    wavelength_m: float
    power: float
    exposure_s: float
    reached: float
    note: str = ""


_DEFAULT_LIMITS = ExposureLimits()


def plan_exposures(
    captures: Captures,
    dark: NDArray[np.unsignedinteger] | None = None,
    limits: ExposureLimits = _DEFAULT_LIMITS,
) -> list[ExposureSetting]:
    """One setting for each wavelength in ascending order, from at least one capture of each.

    dark: image (y, x) in counts with the lasers off; its mean replaces the camera's nominal black level.

    Raises UserError when `dark` doesn't have the camera's shape or isn't darker than the captures.
    """
    black = _black_level(captures, dark)
    return [_plan_wavelength(captures, λ, black, limits) for λ in captures.wavelengths_m]


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


def _plan_wavelength(captures: Captures, wavelength_m: float, black: float, limits: ExposureLimits) -> ExposureSetting:
    full_range = captures.camera.saturation - black
    indices = np.flatnonzero(captures.wavelength_m == wavelength_m)
    pictures = (captures.images[k][captures.usable_pixels(k)] for k in indices.tolist())
    brightest = np.array([float(np.quantile(counts, 1 - _CLIPPED_SHARE)) for counts in pictures]) - black
    clipped = brightest >= full_range
    brightest = np.where(clipped, _BACK_OFF * brightest, np.maximum(brightest, 1e-3))
    rates = brightest / (captures.power[indices] * captures.exposure_s[indices])
    note = ""
    if clipped.any():
        note = "a first capture was clipped: take this one and plan again"
    elif brightest.max() < _DIM * full_range:
        note = "the first captures were dim: take this one and plan again"
    return _choose_power_and_exposure(wavelength_m, float(rates.max()), limits.headroom * full_range, limits, note)


def _choose_power_and_exposure(
    wavelength_m: float, rate: float, target: float, limits: ExposureLimits, note: str
) -> ExposureSetting:
    """The highest power, with its exposure, at which rate · power · exposure is the target (counts above black)."""
    (weakest, strongest), (shortest, longest) = limits.powers, limits.exposures_s
    product = target / rate
    power = float(np.clip(product / shortest, weakest, strongest))
    exposure = float(np.clip(product / power, shortest, longest))
    power, exposure = _round_down(power), _round_down(exposure)
    reached = rate * power * exposure
    if reached > 1.001 * target:
        note = "too bright at the lowest power and shortest exposure: dim the laser"
    elif reached < 0.5 * target and not note:
        note = "dim at the highest power and longest exposure"
    return ExposureSetting(float(wavelength_m), power, exposure, reached, note)


def _round_down(value: float) -> float:
    """The value rounded down to three significant digits."""
    scale = 10.0 ** (np.floor(np.log10(value)) - 2)
    return float(f"{np.floor(value / scale * (1 + 1e-12)) * scale:.3g}")
