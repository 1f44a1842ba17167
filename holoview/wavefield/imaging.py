"""Fields that a bench can show: far images brought near, samples of one pitch along y and x.

A bench propagates by the angular spectrum in the field's own window. A field whose image lies so far away that it
leaves this window is brought to its image by one Fresnel or Fourier transform, and planes count from there.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from holoview.optics.free_space import Window
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.memory_limit import require_memory
from holoview.wavefield.field_bench import lit_field
from holoview.wavefield.propagation import choose_method, propagate_field
from holoview.wavefield.request import Propagation
from holoview.wavefield.wavefield import Wavefield

_AT_CORNERS = -0.25  # balance between the middle (1) and the edges (−1) of an axis; ±0.02 of light spread at random
_FAR_MEANS = 64  # along a side of a far field
_FILLED = (0.04, 0.9)
_LEAST_EDGES = 0.03
_EQUAL = 1e-5  # amplitudes of exp(iφ) in float32 differ by less
_MOST_SAMPLES = 16384  # along a side of the window of a far image


def is_at_corners(field: Wavefield, seen: Wavefield) -> bool:
    """Whether the image lies in four pieces at the corners, as of a transform whose zero frequency stands there.

    seen: of `image_field`. Light that goes around the corners of its window, or near by of the samples' band, has
    Σ I·cos(2πk/N)/ΣI near −1 along both axes, k counted from the middle; light around the middle has it near 1, and
    light that is spread evenly 0.
    """
    power = _power(seen.values) if seen is not field else np.fft.fftshift(_power(np.fft.fft2(field.values)))
    cosines = [np.cos(2 * np.pi * (np.arange(n) - n // 2) / n) for n in power.shape]
    total = float(power.sum()) or 1.0
    balances = [float(power.sum(axis=1 - axis) @ cosine) / total for axis, cosine in enumerate(cosines)]
    return max(balances) <= _AT_CORNERS


def has_phases_alone(field: Wavefield) -> bool:
    """Whether all samples of the field have the same amplitude, as the pattern of a phase modulator has."""
    amplitude = np.abs(field.values)
    return bool(amplitude.max() - amplitude.min() <= _EQUAL * amplitude.max())


def has_far_image(field: Wavefield) -> bool:
    """Whether the far field of a pattern of phases, without its middle, looks like a picture.

    Means over a 64th of a side, or eight samples, which average the speckles out, fill between a twenty-fifth and nine
    tenths of the far field, (Σm)²/(N·Σm²); a near image of a rough object fills it evenly, that of a smooth object its
    middle alone. Neighbours among them differ as in pictures with edges: by at least 3 % of the variance.
    """
    power = np.fft.fftshift(_power(np.fft.fft2(field.values)))
    middle = tuple(slice(max(n // 2 - 2, 0), n // 2 + 3) for n in power.shape)
    power[middle] = np.median(power)
    blocks = [min(max(8, n // _FAR_MEANS), n) for n in power.shape]
    rows, columns = (n // block for n, block in zip(power.shape, blocks, strict=True))
    cut = power[: rows * blocks[0], : columns * blocks[1]]
    means = cut.reshape(rows, blocks[0], columns, blocks[1]).mean(axis=(1, 3), dtype=np.float64)
    if not means.sum() > 0:
        return False
    means /= means.mean()
    speckles = math.prod(blocks)
    square = float(np.square(means).mean()) / (1 + 1 / speckles)
    steps = sum(float(np.square(np.diff(means, axis=axis)).mean()) for axis in (0, 1)) / 4 - square / speckles
    return _FILLED[0] <= 1 / square <= _FILLED[1] and steps >= _LEAST_EDGES * (square - 1)


def in_lens(field: Wavefield) -> Wavefield:
    """The field at the distance of a lens in whose focal plane the shortest wavelength's far field has its own size."""
    shortest_m = float(field.wavelengths_m.min())
    return replace(
        field, distance_m=max(n * p**2 for n, p in zip(field.shape, field.pitch_m, strict=True)) / shortest_m
    )


def _power(values: NDArray[np.complexfloating]) -> NDArray[np.floating]:
    """The power (y, x) of values (frame, wavelength, y, x), summed over frames and wavelengths."""
    return (np.square(values.real) + np.square(values.imag)).sum(axis=(0, 1))


def with_square_pitch(field: Wavefield) -> tuple[Wavefield, str]:
    """The field at samples of its smaller pitch along y and x, and a sentence that says so; empty if nothing was done.

    It is the sum over the frequencies of its samples, evaluated at other places: exact for a field that the samples
    determine. Sharp edges of its window ring. Raises UserError for more samples than a bench may have.
    """
    pitch_m = min(field.pitch_m)
    if np.isclose(*field.pitch_m, rtol=1e-6):
        return field, ""
    shape = (round(field.shape[0] * field.pitch_m[0] / pitch_m), round(field.shape[1] * field.pitch_m[1] / pitch_m))
    own = " × ".join(units.format_rounded(pitch, "um") for pitch in field.pitch_m)
    if max(shape) > _MOST_SAMPLES:
        found = f"{own} (y, x), at one pitch {shape[1]} × {shape[0]} samples"
        raise UserError("pitch", found, expected=f"at most {_MOST_SAMPLES} along a side")
    require_memory("field", field.values.size // math.prod(field.shape) * math.prod(shape) * 32)
    lit = replace(field, values=lit_field(field), reference_radius_m=None)
    seen = propagate_field(lit, 0.0, "asm", Window(shape, (pitch_m, pitch_m)))
    values = seen.values.numpy().astype(np.complex64)
    note = f"its pitch of {own} (y, x) was resampled to {units.format_rounded(pitch_m, 'um')}, by its spectrum"
    return replace(lit, values=values, pitch_m=(pitch_m, pitch_m)), note


def image_field(field: Wavefield, propagation: Propagation = "auto") -> tuple[Wavefield, str]:
    """The field as a bench can show it, and a sentence that says what was done; empty if nothing was done.

    propagation: "auto" follows `choose_method`; "asm" leaves the field in its plane; the other methods bring it to its
    distance, from which planes then count.
    """
    choice = choose_method(field, field.distance_m, propagation)
    if choice.method == "asm":
        return field, ""
    pitch_m = min(choice.window.pitch_m)
    rows, columns = (min(max(round(side / pitch_m), 2), _MOST_SAMPLES) for side in choice.window.side_m)
    seen = propagate_field(field, field.distance_m, choice.method, Window((rows, columns), (pitch_m, pitch_m)))
    there = Wavefield(
        seen.values.numpy().astype(np.complex64), (pitch_m, pitch_m), field.wavelengths_m, name=field.name
    )
    how = "Fresnel" if choice.method == "fresnel" else "Fourier"
    distance = units.format_rounded(field.distance_m, "mm")
    return there, f"brought {distance} to its image by one {how} transform ({choice.reason}); planes count from there"
