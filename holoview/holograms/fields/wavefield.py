"""A complex field on a plane, with its sampling and wavelengths; other programs call it a hologram."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from holoview.util import units
from holoview.util.errors import UserError

Origin = Literal["file", "given", "guessed", "remembered"]
"""The origin of a property of a field: its file, the command, a guess, the notes beside the file."""


@dataclass(frozen=True)
class Provenance:
    """The origin of one property of a field.

    key: the property, such as "pitch" or "sign of the phase". value: in people's units, such as "8 µm". origin: an
    `Origin`. reason: why this value was taken, in words.
    """

    key: str
    value: str
    origin: Origin
    reason: str


@dataclass(frozen=True, eq=False)
class Wavefield:
    """A complex field in a plane across the axis, centred on it. Frozen; the array is read-only.

    values: (frame, wavelength, y, x) complex64, the amplitude as it travels with exp(+2πi·z/λ·sqrt(1 − |λu|²)).
    pitch_m: distance (y, x) between samples, m.
    wavelengths_m: (wavelength,) m, in the medium: an index of refraction is divided out when a file is read.
    distance_m: from this plane to where the image is expected, m; negative where it lies before the plane.
    reference_radius_m: radius of the spherical wave with which the field has to be lit, m, as of Fourier holograms;
    None for a plane wave.
    name: of the file or of the program that sent it, as text.

    Raises UserError for another shape, for values that aren't finite and for impossible lengths.
    """

    values: NDArray[np.complex64]
    pitch_m: tuple[float, float]
    wavelengths_m: NDArray[np.float64]
    distance_m: float = 0.0
    reference_radius_m: float | None = None
    name: str = ""

    def __post_init__(self) -> None:
        values = np.asarray(self.values)
        if values.ndim != 4 or 0 in values.shape:
            raise UserError(
                "field", f"an array of shape {values.shape}", expected="(frame, wavelength, y, x), none of them 0"
            )
        wavelengths_m = np.asarray(self.wavelengths_m, dtype=np.float64)
        if wavelengths_m.shape != (values.shape[1],):
            raise UserError(
                "wavelengths", f"{wavelengths_m.size} of them", expected=f"{values.shape[1]}, as many as the field has"
            )
        for key, lengths in (("pitch", self.pitch_m), ("wavelengths", wavelengths_m)):
            for length in lengths:
                if not (math.isfinite(length) and length > 0):
                    raise UserError(key, f"{length:g} m", expected="a length above 0")
        if not math.isfinite(self.distance_m):
            raise UserError("distance", f"{self.distance_m:g} m", expected="a finite length")
        with np.errstate(over="ignore"):  # numbers beyond complex64 become infinite, and are refused
            values = values.astype(np.complex64, copy=False).view()  # the caller's own array stays writeable
        if not np.isfinite(values).all():
            raise UserError("field", "values that aren't finite (NaN or infinite)", expected="finite numbers")
        values.flags.writeable = False
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "wavelengths_m", wavelengths_m)

    @classmethod
    def of_array(
        cls,
        array: NDArray[Any],
        pitches_m: Sequence[float],
        wavelengths_m: Sequence[float],
        distance_m: float = 0.0,
        name: str = "",
    ) -> Wavefield:
        """The field of an array (y, x), (wavelength, y, x) or (frame, wavelength, y, x), complex or real amplitudes.

        pitches_m: one, or those of y and x. Raises UserError for arrays of another kind and lengths that don't fit it.
        """
        if array.dtype.kind not in "cf" or array.ndim not in (2, 3, 4):
            found = f"an array of shape {array.shape} and type {array.dtype}"
            raise UserError("field", found, expected="2 to 4 axes of complex numbers or real amplitudes")
        if len(pitches_m) not in (1, 2):
            raise UserError("pitch", f"{len(pitches_m)} lengths", expected="one, or two for y and x")
        values = array.reshape((1,) * (4 - array.ndim) + array.shape)
        return cls(values, (pitches_m[0], pitches_m[-1]), np.array(wavelengths_m), distance_m, name=name)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of samples."""
        return self.values.shape[2], self.values.shape[3]

    @property
    def frames(self) -> int:
        """Number of fields that are shown one after another in one image."""
        return self.values.shape[0]

    def describe(self) -> str:
        """The field in one line: "2048 × 2048 samples at 8 um, 3 wavelengths (640, 532, 473 nm)"."""
        rows, columns = self.shape
        pitch = " × ".join(sorted({units.format_rounded(p, "um") for p in self.pitch_m}))
        nm = ", ".join(f"{w * 1e9:.4g}" for w in self.wavelengths_m)
        count = len(self.wavelengths_m)
        return f"{columns} × {rows} samples at {pitch}, {count} wavelength{'s' * (count != 1)} ({nm} nm)"


def samples_of_degrees(
    distance_m: float, pitch_m: tuple[float, float], size_deg: tuple[float, float], centre_deg: tuple[float, float]
) -> tuple[tuple[int, int], tuple[float, float]]:
    """Rows and columns of a part of a hologram, and its centre (y, x) from that of the hologram in samples.

    size_deg, centre_deg: (y, x) in degrees as seen from the middle of the image: α degrees are 2·|z|·tan(α/2), a centre
    at β degrees |z|·tan β beside the axis.

    Raises UserError for angles beyond 90 degrees to a side, and without a distance.
    """
    if not (distance_m != 0 and all(0 < a < 180 for a in size_deg) and all(abs(a) < 90 for a in centre_deg)):
        found = f"{size_deg[1]:g} × {size_deg[0]:g} degrees at {distance_m:g} m"
        raise UserError("aperture", found, expected="angles below 90 degrees to each side, at a distance")
    rows, columns = (
        max(1, round(2 * abs(distance_m) * math.tan(math.radians(angle) / 2) / pitch))
        for angle, pitch in zip(size_deg, pitch_m, strict=True)
    )
    y, x = (
        abs(distance_m) * math.tan(math.radians(angle)) / pitch
        for angle, pitch in zip(centre_deg, pitch_m, strict=True)
    )
    return (rows, columns), (y, x)


def without_checkerboard(values: NDArray[Any], axes: tuple[bool, bool] = (True, True)) -> NDArray[Any]:
    """Values (…, y, x) times (−1)^(row + column), which moves their spectrum by half its width along both axes.

    axes: along which (y, x) they are alternated.
    """
    rows, columns = (
        np.where(np.arange(n) % 2 * is_alternated, np.float32(-1), np.float32(1))
        for n, is_alternated in zip(values.shape[-2:], axes, strict=True)
    )
    return values * rows[:, None] * columns


def shifted_colours(
    values: NDArray[Any], shifts_m: Sequence[tuple[float, float]], pitch_m: tuple[float, float]
) -> NDArray[np.complex64]:
    """Values (frame, colour, y, x), each colour moved by its shift (y, x), m, by its spectrum; the rim becomes dark.

    Raises UserError for another number of shifts than of colours, and for shifts by more than the field.
    """
    if len(shifts_m) != values.shape[1]:
        raise UserError("colour shifts", f"{len(shifts_m)}", expected=f"{values.shape[1]}, one for each colour")
    moved = np.zeros(values.shape, np.complex64)
    for colour, shift_m in enumerate(shifts_m):
        shift = [length / pitch for length, pitch in zip(shift_m, pitch_m, strict=True)]
        if any(abs(s) >= n for s, n in zip(shift, values.shape[-2:], strict=True)):
            found = " × ".join(f"{s:.4g}" for s in shift)
            raise UserError("colour shifts", f"{found} samples", expected=f"fewer than {values.shape[-2:]}")
        y, x = (_kept(s, n) for s, n in zip(shift, values.shape[-2:], strict=True))
        ramps = [np.exp(-2j * np.pi * np.fft.fftfreq(n) * s) for s, n in zip(shift, values.shape[-2:], strict=True)]
        for frame in range(len(values)):
            spectrum = np.fft.fft2(values[frame, colour]) * ramps[0][:, None] * ramps[1]
            moved[frame, colour, y, x] = np.fft.ifft2(spectrum)[y, x]
    return moved


def _kept(shift: float, count: int) -> slice:
    """The samples of a line that a shift fills from inside the line."""
    return slice(math.ceil(shift), count) if shift > 0 else slice(0, count + math.floor(shift))
