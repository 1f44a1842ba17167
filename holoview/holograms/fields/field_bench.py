"""The bench of a field: the System that shows it, and the field as the drive of its plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.fields.wavefield import Wavefield
from holoview.light.colour import observer_weights, white_amplitudes
from holoview.light.model.bench_parts import Modulator, Sampling
from holoview.light.model.system import EYE_RANGE_M, System
from holoview.light.numerics.sampling import positions
from holoview.util import units
from holoview.util.errors import UserError

MEAN_LUMINANCE = 0.25
"""Of the picture of a field at any plane, in that of white: fields have amplitudes in units of their own."""
_MOST_POWER = 1e12
_FARTHEST_M = 2.0


def bench_of_field(field: Wavefield) -> System:
    """The bench that shows a field: a plane with its samples, its wavelengths, and the plane of its image.

    The lasers make white, as fields of colour holograms are computed for the primaries of a picture, and have such
    powers that the picture has the mean luminance `MEAN_LUMINANCE`. The observer is an eye, or where it doesn't see
    every wavelength a camera with a flat response, which shows grey.

    Raises UserError for a pitch that differs between y and x, and for sizes and lengths that no bench has.
    """
    if not np.isclose(*field.pitch_m, rtol=1e-6):
        pitch = " x ".join(units.format_rounded(p, "um") for p in field.pitch_m)
        raise UserError(
            "pitch", f"{pitch} (y, x)", expected="the same along y and x", remedy="resample the field to one pitch"
        )
    if abs(field.distance_m) > _FARTHEST_M:
        raise UserError("distance", units.format_rounded(field.distance_m, "m"), expected="from -2 m to 2 m")
    λ = field.wavelengths_m
    observer = "eye" if np.all((λ >= EYE_RANGE_M[0]) & (λ <= EYE_RANGE_M[1])) else "mono"
    white = white_amplitudes(observer_weights(observer, λ), np.ones((field.frames, len(λ))))
    luminance = float(white[0] * mean_intensities(field) @ observer_weights(observer, λ)[:, 1])
    power = min(MEAN_LUMINANCE / luminance, _MOST_POWER / white.max()) if luminance > 0 else 1.0
    return System(
        wavelengths_m=λ,
        amplitudes=white * power,
        modulators=(Modulator(field.pitch_m[0], field.shape, content="field"),),
        planes_m=np.array([field.distance_m]),
        observer=observer,
        sampling=Sampling(upsample=1),
        name=field.name,
        description=f"a field of {field.describe()}",
    )


def mean_intensities(field: Wavefield) -> NDArray[np.float64]:
    """Mean of |field|² over frames and samples, (wavelength,); 1 for a field that is 1 everywhere."""
    real, imaginary = field.values.real, field.values.imag
    squares = np.square(real).mean(axis=(0, 2, 3), dtype=np.float64)
    total: NDArray[np.float64] = squares + np.square(imaginary).mean(axis=(0, 2, 3), dtype=np.float64)
    return total


def lit_field(field: Wavefield) -> NDArray[np.complex64]:
    """The values (frame, wavelength, y, x) in the light that the field is made for.

    A field without `reference_radius_m` has them already; one with a radius R is lit by exp(−πi·r²/(λR)), the spherical
    wave, paraxial, that converges to a point R behind the plane.
    """
    if field.reference_radius_m is None:
        return field.values
    y, x = (positions(n, p) for n, p in zip(field.shape, field.pitch_m, strict=True))
    turns = (y[:, None] ** 2 + x[None, :] ** 2) / (2 * field.reference_radius_m)
    wave = np.exp(-2j * np.pi * (turns[None] / field.wavelengths_m[:, None, None] % 1.0))
    return (field.values * wave.astype(np.complex64)).astype(np.complex64, copy=False)
