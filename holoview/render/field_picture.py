"""Pictures of a complex field: amplitude, phase, real and imaginary part, colour for phase, and its spectrum."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.colour import srgb_decode, srgb_encode
from holoview.render.tone_mapping import colour_map
from holoview.render.view_settings import QUANTITIES
from holoview.util.errors import UserError

_BRIGHT_PERCENT = 99.9  # of the samples: a few brighter ones are clipped
_DECADES = 5.0  # of power below the strongest frequency, which are shown


@dataclass(frozen=True, eq=False)
class FieldPicture:
    """A picture of a field. srgb8: (y, x, 3). scale: what its colours mean, in words."""

    srgb8: NDArray[np.uint8]
    scale: str


def field_picture(values: NDArray[np.complexfloating], quantity: str) -> FieldPicture:
    """A picture of a field (y, x).

    quantity: one of QUANTITIES. "amplitude": grey, linear in the sRGB code. "phase": the hue, a turn a cycle, red at 0.
    "real", "imaginary": blue below 0, white at 0, red above. "phase-colour": the hue of the phase, as bright as the
    amplitude. "spectrum": the power of the field's Fourier transform, 0 in the middle, in decades.

    Raises UserError for another quantity.
    """
    if quantity not in QUANTITIES:
        raise UserError("quantity", f'"{quantity}"', expected=", ".join(QUANTITIES))
    if quantity == "phase":
        return FieldPicture(colour_map("hue")[_hue_level(values)], "hue: red 0, green 2π/3, blue 4π/3")
    if quantity == "spectrum":
        return _spectrum(values)
    if quantity in ("real", "imaginary"):
        part = values.real if quantity == "real" else values.imag
        most = _bright(np.abs(part))
        share = np.clip(0.5 + 0.5 * part / most, 0, 1)
        return FieldPicture(colour_map("signed")[_level(share)], f"blue {-most:.4g}, white 0, red {most:.4g}")
    amplitude = np.abs(values)
    most = _bright(amplitude)
    share = np.clip(amplitude / most, 0, 1)
    if quantity == "amplitude":
        return FieldPicture(colour_map("grey")[_level(share)], f"black 0, white {most:.4g}")
    hue = srgb_decode(colour_map("hue")[_hue_level(values)] / 255) * srgb_decode(share)[..., None]
    return FieldPicture(_level(srgb_encode(hue)), f"hue: red 0, green 2π/3, blue 4π/3; black 0, bright {most:.4g}")


def _spectrum(values: NDArray[np.complexfloating]) -> FieldPicture:
    power = np.square(np.abs(np.fft.fftshift(np.fft.fft2(values))))
    strongest = float(power.max()) or 1.0
    decades = np.log10(np.maximum(power / strongest, 10.0**-_DECADES))
    share = 1 + decades / _DECADES
    return FieldPicture(
        colour_map("cubehelix")[_level(share)], f"white: the strongest frequency; black: 1e-{_DECADES:g}"
    )


def _bright(amplitude: NDArray[np.floating]) -> float:
    return float(np.percentile(amplitude, _BRIGHT_PERCENT)) or float(amplitude.max()) or 1.0


def _hue_level(values: NDArray[np.complexfloating]) -> NDArray[np.uint8]:
    """The entry of a cyclic map of 256 colours for each phase; the last colour equals the first."""
    return _level(np.angle(values) / (2 * math.pi) % 1.0)


def _level(share: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.rint(255 * share).astype(np.uint8)
