"""Where the orders of a binary grating are in a camera's pictures, and how strong they are.

find_orders   on a Fourier bench: spots; in the near field: stripes

Half of the grating's bars stay at level 0, the others show a level of phase φ. Its Fourier coefficients are
c₀ = (1 + e^iφ)/2, c_n ∝ 1 − e^iφ for odd n, and 0 for the other even n (bars of equal width).

Fourier bench   power of the zero order, and of both first orders together, from which cancels what leaks from the zero
                order beside a small modulator
near field      the orders interfere. Stripes of half the grating's period are products of two odd coefficients,
                ∝ sin²(φ/2) at any distance and behind any pupil that passes both first orders, as the power of a first
                order is. Stripes of its period are products with c₀, ∝ sin φ, as a difference of powers in an
                interferometer is. The contrast of both depends on the distance z (Talbot, Phil. Mag. 9, 401 (1836)):
                the order n is late by n²·πλz/p², n² = 1 + 8k for odd n. Near the modulator a phase has no contrast; at
                z = p²/8λ the orders ±1 and ±3 are opposite, and add.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from holoview.light.numerics.sampling import next_fast_length

Floats = NDArray[np.float64]

_PITCH_DOUBT = 0.07  # by which the scale of a picture may differ from what rig.toml says
_FINEST = 0.45  # cycles a camera pixel
_LEAST_STRIPES = 8.0  # amplitude of stripes over the median of those in their neighbourhood
_LEAST_BEAT = 0.1  # range of the stripes of the grating's period, as a share of that of half of it
_LEAST_SPOT = 10.0  # rise of a spot over the noise of such boxes
_RING = 0.2  # half width of the ring in which first orders are looked for, as a share of their distance
_LARGEST_BOX = 0.4  # half width of a spot's box, as a share of the distance between orders
_SPOT_SHARE, _SPOT_MARGIN = 0.9, 1.5  # light of a spot within its radius; half width of its box over that


def best_distance_m(length_m: float, wavelength_m: float) -> float:
    """Where the stripes of a grating of this period have contrast: p²/8λ behind it."""
    return length_m**2 / (8 * wavelength_m)


class UnseenGrating(Exception):
    """A grating whose orders a picture doesn't show; the message says why."""


class GratingOrders(Protocol):
    """The orders of a grating in pictures (y, x) of light."""

    @property
    def orders(self) -> tuple[str, ...]:
        """Names as tables of sweeps have them: 1, 0, interferometer."""

    def read(self, light: Floats) -> dict[str, float]:
        """The reading of each order."""

    def reference(self, light: Floats) -> float:
        """The light by which readings are divided, in a picture of unpatterned modulators."""


def find_orders(lights: Sequence[Floats], cycles_px: float | None, distance_px: float | None) -> GratingOrders:
    """The orders in pictures (y, x) of light of a grating whose level rises from 0 to the last one.

    cycles_px: of the grating in the near field, cycles a camera pixel. distance_px: on a Fourier bench, between the
    orders. Raises UnseenGrating.
    """
    if distance_px is not None:
        return _find_spots(lights, distance_px)
    assert cycles_px is not None
    return _find_stripes(lights, cycles_px)


# --- Fourier bench ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Spots:
    """Boxes (rows, columns) around the spots of orders: of the zero order, and of one or both first orders."""

    boxes: dict[str, list[tuple[slice, slice]]]

    @property
    def orders(self) -> tuple[str, ...]:
        return tuple(self.boxes)

    def read(self, light: Floats) -> dict[str, float]:
        return {order: float(sum(light[box].sum() for box in own)) for order, own in self.boxes.items()}

    def reference(self, light: Floats) -> float:
        return self.read(light)["0"]


def _find_spots(lights: Sequence[Floats], distance_px: float) -> Spots:
    """The zero order is the brightest spot without a grating; first orders are where most light comes, at both ends of
    a line through it that is as long as the geometry says."""
    flat = lights[0]
    smooth = 3 if distance_px < 40 else 5
    place = np.unravel_index(int(uniform_filter(flat, smooth).argmax()), flat.shape)
    zero = np.array([int(place[0]), int(place[1])])
    gain = uniform_filter(np.max([light - flat for light in lights[1:]], axis=0), smooth)
    y, x = np.indices(flat.shape) - zero[:, None, None]
    ring = np.abs(np.hypot(y, x) - distance_px) <= max(_RING * distance_px, 2)
    half = _half_width(flat, zero, distance_px)
    inside = np.zeros(flat.shape, bool)
    inside[half : flat.shape[0] - half, half : flat.shape[1] - half] = True
    candidates = np.where(ring & inside, gain, -np.inf)
    expected = f"first orders {distance_px:.0f} camera pixels from the zero order"
    if not (ring & inside).any():
        raise UnseenGrating(f"the picture ends before {expected}")
    best = np.array(np.unravel_index(int(candidates.argmax()), flat.shape))
    noise = float(np.median(np.abs(gain - np.median(gain)))) / 0.6745
    if float(gain[tuple(best)]) < _LEAST_SPOT * max(noise, 1e-12):
        raise UnseenGrating(f"no light comes where there are {expected}")
    mate = 2 * zero - best
    is_there = bool((mate >= half).all() and (mate < np.array(flat.shape) - half).all())
    centres = {"1": [best, mate] if is_there else [best], "0": [zero]}
    return Spots({order: [_box(centre, half) for centre in own] for order, own in centres.items()})


def _box(centre: NDArray[np.int64], half: int) -> tuple[slice, slice]:
    y, x = (slice(max(int(c) - half, 0), int(c) + half + 1) for c in centre)
    return y, x


def _half_width(flat: Floats, zero: NDArray[np.int64], distance_px: float) -> int:
    """Half the width of a box that holds a spot, from the radius that holds most of the zero order's light."""
    most = max(int(_LARGEST_BOX * distance_px), 1)
    y, x = np.indices(flat.shape) - zero[:, None, None]
    near = np.maximum(np.abs(y), np.abs(x))
    sums = np.bincount(near[near <= most].ravel(), np.maximum(flat[near <= most], 0).ravel(), most + 1).cumsum()
    radius = int(np.searchsorted(sums, _SPOT_SHARE * sums[-1]))
    return int(min(max(math.ceil(_SPOT_MARGIN * radius), 2), most))


# --- near field -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Stripes:
    """Stripes in the near field. waves: {order: (y, x)}, real, whose products with a picture are the readings."""

    waves: dict[str, Floats]

    @property
    def orders(self) -> tuple[str, ...]:
        return tuple(self.waves)

    def read(self, light: Floats) -> dict[str, float]:
        return {order: float((wave * light).sum()) for order, wave in self.waves.items()}

    def reference(self, light: Floats) -> float:
        return float(light.sum())


def _find_stripes(lights: Sequence[Floats], cycles_px: float) -> Stripes:
    """The wave of half the grating's period is where the spectrum of the pictures' changes is greatest, and has the
    direction of these changes in the complex plane; that of its period likewise, where it is strong enough."""
    shape = lights[0].shape
    if 2 * cycles_px * (1 - _PITCH_DOUBT) > _FINEST:
        raise UnseenGrating(f"stripes of {0.5 / cycles_px:.2g} camera pixels are too fine for the camera")
    if 2 * cycles_px * max(shape) < 4:
        raise UnseenGrating("fewer than two bars lie in the picture")
    window = np.outer(np.hanning(shape[0] + 2)[1:-1], np.hanning(shape[1] + 2)[1:-1])
    padded = tuple(next_fast_length(2 * n) for n in shape)
    fy, fx = np.meshgrid(*(np.fft.fftfreq(n) for n in padded), indexing="ij")
    changes = [(light - lights[0]) * window for light in lights[1:]]
    spectrum = np.max([np.abs(np.fft.fft2(change, padded)) for change in changes], axis=0)
    spectrum = np.where(fx + 1e-9 * fy > 0, spectrum, 0.0)  # of each pair ±f one
    radius, width = np.hypot(fy, fx), 2.0 / max(shape)
    near = np.abs(radius - 2 * cycles_px) <= np.maximum(2 * _PITCH_DOUBT * cycles_px, width)
    near &= spectrum > 0
    best = np.unravel_index(int(np.where(near, spectrum, 0.0).argmax()), padded)
    if float(spectrum[best]) < _LEAST_STRIPES * float(np.median(spectrum[near])):
        raise UnseenGrating(
            f"the picture has no stripes of {0.5 / cycles_px:.3g} camera pixels: the first orders don't pass, or the "
            "camera looks elsewhere"
        )
    f = np.array([fy[best], fx[best]])
    y, x = np.indices(shape)

    def wave(scale: float) -> tuple[Floats, float]:
        """A real wave, and the range of the pictures' changes along it."""
        complex_wave = window * np.exp(-2j * math.pi * scale * (f[0] * y + f[1] * x))
        values = np.array([0j, *((complex_wave * (light - lights[0])).sum() for light in lights[1:])])
        angle = 0.5 * float(np.angle(((values - values.mean()) ** 2).sum()))
        along = np.real(values * np.exp(-1j * angle))
        first = int(np.argmax(np.abs(along) > 0.5 * np.abs(along).max()))
        sign = 1.0 if along[first] >= 0 else -1.0
        return sign * np.real(complex_wave * np.exp(-1j * angle)), float(np.ptp(along))

    (double, range_of_double), (single, range_of_single) = wave(1.0), wave(0.5)
    has_beat = range_of_single > _LEAST_BEAT * range_of_double
    return Stripes({"1": double} | ({"interferometer": single} if has_beat else {}))
