"""Opens a complex field: an array of the caller's, or a file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.io.hologram import Hologram, load_hologram
from holoview.util import units
from holoview.util.errors import UserError
from holoview.wavefield.wavefield import Wavefield

Length = float | str
_AXES = "(y, x), (wavelength, y, x) or (frame, wavelength, y, x)"


def load_field(
    source: str | os.PathLike[str] | NDArray[Any],
    *,
    pitch: Length | tuple[Length, Length] | None = None,
    wavelengths: Sequence[Length] | Length | None = None,
    distance: Length = 0.0,
) -> Hologram:
    """A complex field as a hologram, which `simulate` and `export_html` take as any other.

    source: an array (y, x), (wavelength, y, x) or (frame, wavelength, y, x) of complex numbers, also a tensor on the
    CPU; or the path of a file.
    pitch: distance between samples, or a pair (y, x); metres or text such as "8 um".
    wavelengths: of each laser, metres or text such as "532 nm", in the medium.
    distance: from the plane of the field to where its image is expected; negative where it lies before the plane.

    Returns a `Hologram` whose system has the plane of the field in place of modulators. Raises UserError for an array
    of another shape or of real numbers, for impossible lengths and lengths that are missing, and for a file that can't
    be read.

    >>> import holoview as hv, numpy as np
    >>> y, x = np.mgrid[-32:32, -32:32] * 8e-6
    >>> lens = np.exp(-1j * np.pi * (x**2 + y**2) / (532e-9 * 0.05))  # converges to a point 5 cm behind it
    >>> field = hv.load_field(lens, pitch="8 um", wavelengths="532 nm", distance="5 cm")
    >>> hv.simulate(field, backend="torch").intensity[0, 0].argmax() // 64
    31
    """
    if isinstance(source, str | os.PathLike):
        return load_hologram(source)
    values = np.asarray(source)
    if values.dtype.kind != "c":
        remedy = "a phase is np.exp(1j * phase), an intensity np.sqrt(intensity) + 0j"
        raise UserError("field", f"values of type {values.dtype}", expected="complex numbers", remedy=remedy)
    if not 2 <= values.ndim <= 4:
        raise UserError("field", f"an array of shape {values.shape}", expected=_AXES)
    if pitch is None or wavelengths is None:
        missing = "pitch" if pitch is None else "wavelengths"
        raise UserError(missing, "is missing", expected="pitch and wavelengths: an array doesn't tell them")
    pair = pitch if isinstance(pitch, tuple) else (pitch, pitch)
    lasers = [wavelengths] if isinstance(wavelengths, str | float) else list(wavelengths)
    return Hologram.of_field(
        Wavefield(
            values[(None,) * (4 - values.ndim)],
            (units.parse(pair[0], "pitch"), units.parse(pair[1], "pitch")),
            np.array([units.parse(λ, f"wavelengths[{i}]") for i, λ in enumerate(lasers)]),
            units.parse(distance, "distance"),
        )
    )
