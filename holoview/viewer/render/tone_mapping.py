"""Tone mapping: from XYZ to 8-bit sRGB as the view settings say; the viewport's shader computes the same.

    value = (channel · 2^exposure − low) / (high − low), clipped to 0…1, of colours so that their hue stays
    code  = sRGB transfer function of the value, to the power 1/gamma

A single channel is shown in grey or through a colour map of 256 colours.

grey: linear in the sRGB code. cubehelix: perceived brightness rises monotonically while the hue rotates (Green, Bull.
Astr. Soc. India 39, 289, 2011). hue: cyclic, for phases. signed: diverging, white in the middle, blue below, red above.

`field_picture` draws a complex field: amplitude, phase, real and imaginary part, colour for phase, or its spectrum.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from holoview.light.colour import LMS_TO_XYZ, XYZ_TO_SRGB, gamut_map, srgb_decode, srgb_encode
from holoview.util.errors import UserError
from holoview.viewer.render.view_settings import FIELD_QUANTITIES, ViewSettings

_LMS = np.linalg.inv(LMS_TO_XYZ)
_ROWS = {
    "luminance": np.array([0.0, 1.0, 0.0]),
    **{name: np.eye(3)[i] for i, name in enumerate("XYZ")},
    **{name: XYZ_TO_SRGB[i] for i, name in enumerate("RGB")},
    **{name: _LMS[i] / _LMS[i].sum() for i, name in enumerate("LMS")},
}


def channel_matrix(channel: str) -> NDArray[np.float64]:
    """The matrix from XYZ to linear sRGB (3, 3), or to a channel (1, 3); L, M, S of equal-energy white are 1."""
    return XYZ_TO_SRGB if channel == "colour" else _ROWS[channel][None]


def tone_map(xyz: NDArray[np.floating], view: ViewSettings) -> NDArray[np.uint8]:
    """8-bit sRGB (y, x, 3) of XYZ (y, x, 3)."""
    matrix = channel_matrix(view.channel) * 2.0**view.exposure_stops
    values = (np.asarray(xyz, dtype=np.float32) @ matrix.T.astype(np.float32) - view.low) / (view.high - view.low)
    if view.channel == "colour":
        return _levels(gamut_map(values, "hue") if view.keeps_hue else values, view)
    levels = _levels(values, view)
    return colour_map(view.false_colour or "grey")[levels[..., 0]]


def colour_bar(view: ViewSettings, count: int) -> NDArray[np.uint8]:
    """The colours (count, 3) of even steps of a single channel, from the value shown black to the one shown white.

    Of a difference, from the least to the greatest one that is shown.
    """
    steps = np.linspace(0.0, 1.0, count)
    if view.compare == "difference":
        return colour_map("signed")[np.rint(255 * steps).astype(np.uint8)]
    return colour_map(view.false_colour or "grey")[_levels(steps, view)]


def compose_comparison(
    a: NDArray[np.floating], b: NDArray[np.floating] | None, view: ViewSettings
) -> NDArray[np.uint8]:
    """8-bit sRGB of two images XYZ (y, x, 3) as the view settings compare them.

    Shows `a` alone without a comparison, without `b`, and for different shapes. A wipe shows `a` left of its line. A
    difference shows |a − b| in colour; for a single channel a − b from blue to red.
    """
    if view.compare == "off" or b is None or a.shape != b.shape:
        return tone_map(a, view)
    if view.compare == "difference":
        return _difference(a, b, view)
    left, right = tone_map(a, view), tone_map(b, view)
    if view.compare == "side-by-side":
        return np.concatenate([left, right], axis=1)
    if view.compare == "wipe":
        edge = round(view.wipe * a.shape[1])
        return np.concatenate([left[:, :edge], right[:, edge:]], axis=1)
    return left


def _difference(a: NDArray[np.floating], b: NDArray[np.floating], view: ViewSettings) -> NDArray[np.uint8]:
    """The difference of both images; `low` cancels, so that only the span from `low` to `high` matters."""
    matrix = channel_matrix(view.channel) * 2.0**view.exposure_stops / (view.high - view.low)
    difference = (np.asarray(a, dtype=np.float64) - b) @ matrix.T
    if view.channel == "colour":
        return _levels(np.abs(difference), view)
    return colour_map("signed")[np.rint(255 * np.clip(0.5 + 0.5 * difference[..., 0], 0, 1)).astype(np.uint8)]


def _levels(values: NDArray[np.floating], view: ViewSettings) -> NDArray[np.uint8]:
    codes = srgb_encode(np.clip(values, 0, 1)) ** (1 / view.gamma)
    return np.rint(255 * codes).astype(np.uint8)


NAMES = ("grey", "cubehelix", "hue", "signed")
_COUNT = 256
_START, _ROTATIONS = 0.5, -1.5  # Green's default: starts with blue, one and a half rotations
_HELIX = np.array([[-0.14861, 1.78277], [-0.29227, -0.90649], [1.97294, 0.0]])  # Green 2011, equation 2


@cache
def colour_map(name: str) -> NDArray[np.uint8]:
    """The colour map (256, 3) in 8-bit sRGB, read-only. Raises KeyError for a name that isn't in NAMES."""
    tables = {"grey": _grey, "cubehelix": _cubehelix, "hue": _hue, "signed": _diverging}
    table = np.rint(255 * np.clip(tables[name](np.linspace(0.0, 1.0, _COUNT)), 0, 1)).astype(np.uint8)
    table.setflags(write=False)
    return table


def _grey(share: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.repeat(share[:, None], 3, axis=1)


def _cubehelix(share: NDArray[np.float64]) -> NDArray[np.float64]:
    angle = 2 * np.pi * (_START / 3 + 1 + _ROTATIONS * share)
    turn = np.stack([np.cos(angle), np.sin(angle)])
    helix: NDArray[np.float64] = share[:, None] + (share * (1 - share) / 2)[:, None] * (_HELIX @ turn).T
    return helix


def _hue(share: NDArray[np.float64]) -> NDArray[np.float64]:
    """Three cosines with phases a third of a turn apart: cyclic, with a constant sum."""
    return 0.5 + 0.5 * np.cos(2 * np.pi * (share[:, None] - np.array([0.0, 1 / 3, 2 / 3])))


def _diverging(share: NDArray[np.float64]) -> NDArray[np.float64]:
    below, above = np.clip(2 * share, 0, 1)[:, None], np.clip(2 - 2 * share, 0, 1)[:, None]
    blue, red = np.array([0.13, 0.30, 0.70]), np.array([0.72, 0.12, 0.16])
    return np.where(share[:, None] < 0.5, blue + (1 - blue) * below, red + (1 - red) * above)


# --- complex fields ---------------------------------------------------------------------------------------------------


_BRIGHT_SAMPLES_PERCENT = 99.9  # of the samples: a few brighter samples are clipped
_DECADES = 5.0  # of power below the strongest frequency, which are shown


@dataclass(frozen=True, eq=False)
class FieldPicture:
    """A picture of a field. srgb8: (y, x, 3). scale: the meaning of its colours, in words."""

    srgb8: NDArray[np.uint8]
    scale: str


def field_picture(values: NDArray[np.complexfloating], quantity: str) -> FieldPicture:
    """A picture of a field (y, x).

    quantity: one of FIELD_QUANTITIES. "amplitude": grey, linear in the sRGB code. "phase": the hue, a turn a cycle, red
    at 0. "real", "imaginary": blue below 0, white at 0, red above. "phase-colour": the hue of the phase, as bright as
    the amplitude. "spectrum": the power of the field's Fourier transform, 0 in the middle, in decades.

    Raises UserError for another quantity.
    """
    if quantity not in FIELD_QUANTITIES:
        raise UserError("quantity", f'"{quantity}"', expected=", ".join(FIELD_QUANTITIES))
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


def linear_picture(values: NDArray[np.floating], unit: str) -> FieldPicture:
    """Real numbers (y, x) in grey, from their smallest to their largest value, linear in the sRGB code."""
    low, high = float(values.min()), float(values.max())
    share = (values - low) / ((high - low) or 1.0)
    return FieldPicture(colour_map("grey")[_level(share)], f"black {low:.4g} {unit}, white {high:.4g} {unit}")


def _spectrum(values: NDArray[np.complexfloating]) -> FieldPicture:
    power = np.square(np.abs(np.fft.fftshift(np.fft.fft2(values))))
    strongest = float(power.max()) or 1.0
    decades = np.log10(np.maximum(power / strongest, 10.0**-_DECADES))
    share = 1 + decades / _DECADES
    return FieldPicture(
        colour_map("cubehelix")[_level(share)], f"white: the strongest frequency; black: 1e-{_DECADES:g}"
    )


def _bright(amplitude: NDArray[np.floating]) -> float:
    return float(np.percentile(amplitude, _BRIGHT_SAMPLES_PERCENT)) or float(amplitude.max()) or 1.0


def _hue_level(values: NDArray[np.complexfloating]) -> NDArray[np.uint8]:
    """The entry of a cyclic map of 256 colours for each phase; the last colour equals the first."""
    return _level(np.angle(values) / (2 * math.pi) % 1.0)


def _level(share: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.rint(255 * share).astype(np.uint8)


# --- light in units of its own ---


_BRIGHTEST = 99.5  # percentile of a picture in units of its own that is white
_DECADES = 4.0  # of power that the picture of a local spectrum spans


def in_own_units(xyz: NDArray[np.float32]) -> NDArray[np.float32]:
    """A picture XYZ (y, x, 3) in units of its own, in which only its brightest parts are beyond white."""
    white = float(np.percentile(xyz[..., 1], _BRIGHTEST))
    return xyz / np.float32(white) if white > 0 else xyz


def by_decades(xyz: NDArray[np.float32]) -> NDArray[np.float32]:
    """A picture XYZ (y, x, 3) of the same colours whose brightness rises with the logarithm of the power."""
    power = xyz[..., 1:2]
    most = float(power.max())
    if not most > 0:
        return xyz
    level = np.clip(1 + np.log10(np.maximum(power / most, 1e-30)) / _DECADES, 0, 1)
    return np.asarray(xyz / np.maximum(power, np.float32(most * 1e-30)) * level**2, dtype=np.float32)
