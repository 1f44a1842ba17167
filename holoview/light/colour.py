"""Colorimetry: intensities of lasers to CIE XYZ and sRGB, gamut mapping, and laser powers for white.

    XYZ = Σ_λ I_λ·w_λ            observer_weights: of eyes, people, cameras (`holoview.light.observers`)
    rgb = XYZ_TO_SRGB·XYZ        xyz_to_linear_srgb: may leave 0…1, since lasers lie outside the sRGB gamut
    gamut_map, srgb_encode       what a screen can show

The scale is fixed: Y = 1 is the white of the display, and no image is normalised by itself. XYZ_F of the eye's cone
fundamentals is shown as if it were CIE 1931 XYZ, as CIE 170-2 intends; the white point is that of sRGB in both cases.
To every person light of equal energy at all wavelengths is the same white, of the same luminance: eyes are used to the
daylight in which they live.

The tables of the observers are those of the package colour-science, stored in `assets/observers`: the package takes
over a second to import and is needed for colour differences only.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holoview.light.observers import (
    TABLES as TABLES,
)
from holoview.light.observers import (
    Observer,
    cones_of,
    observer_rows,
    parse_observer,
    table_of,
)
from holoview.light.observers import (
    constant as _constant,
)
from holoview.util.errors import UserError, suggest_matches

FloatArray = NDArray[np.float64]

GAMUT_MAPS = ("clip", "desaturate", "hue")


def _xyz_of_chromaticity(x: float, y: float) -> list[float]:
    """XYZ of a chromaticity (x, y), with Y = 1."""
    return [x / y, 1.0, (1.0 - x - y) / y]


def rgb_to_xyz(chromaticities: Sequence[tuple[float, float]]) -> FloatArray:
    """The matrix (3, 3) from linear RGB to XYZ for primaries with these chromaticities and the white D65.

    chromaticities: (x, y) of red, green and blue. Further ones, such as a file's white point, are ignored: white is
    always shown as the white of the display.
    """
    primaries = np.array([_xyz_of_chromaticity(*xy) for xy in chromaticities[:3]]).T
    matrix: FloatArray = primaries * np.linalg.solve(primaries, D65_WHITE)
    return matrix


LMS_TO_XYZ = _constant([[1.94735469, -1.41445123, 0.36476327], [0.68990272, 0.34832189, 0.0], [0.0, 0.0, 1.93485343]])
"""Cone fundamentals (energy-based, 2°) to XYZ_F: CIE 170-2:2015."""

_LMS_TO_XYZ_10 = _constant(
    [[1.93986443, -1.34664359, 0.43044935], [0.69283932, 0.34967567, 0.0], [0.0, 0.0, 2.14687945]]
)
"""The same of 10°."""

D65_WHITE = _constant(_xyz_of_chromaticity(0.3127, 0.3290))
"""XYZ of the sRGB white (x = 0.3127, y = 0.3290), Y = 1."""

SRGB_TO_XYZ = _constant(rgb_to_xyz([(0.64, 0.33), (0.30, 0.60), (0.15, 0.06)]))
"""Linear sRGB (IEC 61966-2-1) to XYZ in float64; the standard prints it rounded to four decimals,
which would tint white by 1e-4."""

XYZ_TO_SRGB = _constant(np.linalg.inv(SRGB_TO_XYZ))
"""XYZ to linear sRGB: the exact inverse of `SRGB_TO_XYZ`."""


@dataclass(frozen=True)
class ColourSpace:
    """A colour space of pictures, with the white D65 and Y = 1 for its white.

    title: its name in full. chromaticities: (x, y) of red, green and blue. code_points: its primaries and its curve in
    ITU-T H.273, which PNG files state.
    """

    title: str
    chromaticities: tuple[tuple[float, float], ...]
    code_points: tuple[int, int]

    @property
    def from_xyz(self) -> FloatArray:
        """The matrix (3, 3) from XYZ to linear RGB."""
        return np.asarray(np.linalg.inv(rgb_to_xyz(self.chromaticities)))

    def encode(self, xyz: ArrayLike) -> FloatArray:
        """The signal (…, 3), 0 to 1, of XYZ (…, 3): channels are clipped, then take the curve of the space.

        Rec. ITU-R BT.2020 has its own curve (table 4); sRGB and Display P3 have that of IEC 61966-2-1.
        """
        linear = np.clip(np.asarray(xyz, dtype=np.float64) @ self.from_xyz.T, 0.0, 1.0)
        if self.code_points[1] == _SRGB_CURVE:
            return srgb_encode(linear)
        return np.where(linear < _BETA, 4.5 * linear, _ALPHA * linear**0.45 - (_ALPHA - 1.0))


_ALPHA, _BETA = 1.09929682680944, 0.018053968510807  # of BT.2020


def bt2020_decode(signal: ArrayLike) -> FloatArray:
    """The light, 0 to 1, of a signal with the curve of Rec. ITU-R BT.2020, which is that of BT.709 with more digits."""
    values = np.asarray(signal, dtype=np.float64)
    return np.where(values < 4.5 * _BETA, values / 4.5, ((values + _ALPHA - 1.0) / _ALPHA) ** (1 / 0.45))


_SRGB_CURVE = 13  # of H.273
COLOUR_SPACES = {
    "srgb": ColourSpace("sRGB", ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06)), (1, _SRGB_CURVE)),
    "p3": ColourSpace("Display P3", ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060)), (12, _SRGB_CURVE)),
    "rec2020": ColourSpace("Rec. 2020", ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046)), (9, 14)),
}
"""The colour spaces in which pictures can be written. Lasers leave sRGB; Rec. 2020 holds most of their mixtures."""


@cache
def import_colour_science() -> Any:
    """The package colour-science, imported at the first call.

    The import warns of missing optional packages, which aren't needed here, and changes numpy's print options and the
    warning filters of the process; both are restored.
    """
    with warnings.catch_warnings(), np.printoptions():
        warnings.filterwarnings("ignore", message=".*related API features are not available")
        import colour  # here: takes over a second
    return colour


def _at(wavelengths_m: ArrayLike, nm: FloatArray, values: FloatArray, title: str, offset_nm: float = 0.0) -> Any:
    """A table at wavelengths plus an offset, clipped to its range: the wavelengths (n,) in nm and values (n, 3)."""
    asked_nm = np.atleast_1d(np.asarray(wavelengths_m, dtype=np.float64)) * 1e9
    first, last = nm[0], nm[-1]
    rounding = 1e-6  # 390e-9·1e9 needn't be exactly 390
    outside = ~((asked_nm >= first - rounding) & (asked_nm <= last + rounding))
    if outside.any():
        raise UserError(
            "wavelength",
            f"{asked_nm[outside][0]:g} nm",
            expected=f"{first:g}…{last:g} nm, the range of the {title}",
            remedy="wavelengths here are in metres: 532 nm is 532e-9",
        )
    at_nm = np.clip(asked_nm + offset_nm, first, last)
    return at_nm, np.stack([np.interp(at_nm, nm, column) for column in values.T], axis=-1)


def cone_fundamentals(wavelengths_m: ArrayLike, age: float | None = None, field_deg: float = 2.0) -> FloatArray:
    """Responses (n, 3) of the L, M and S cones to unit energy at wavelengths (n,) in metres; each peaks at 1.

    Stockman & Sharpe (2000), 2°, energy-based, as adopted by CIE 170-1:2006; linear between table entries 1 nm apart.
    age, field_deg: those of another age in years and size of the field in degrees, by CIE 170-1:2006.
    Raises UserError outside 390…830 nm, 20…80 years and 1…10°.
    """
    table = observer_rows("cones")
    if age is not None:
        table = cones_of(parse_observer(f"age {age:g}, field {field_deg:g}"))
    return np.asarray(_at(wavelengths_m, *table, TABLES["cones"][0])[1])


@cache
def observer_table(observer: str) -> tuple[FloatArray, FloatArray]:
    """Wavelengths (n,) in nm, 1 nm apart, and XYZ (n, 3) of unit intensity, between which an observer is linear.

    Raises UserError for an unknown observer, and for "mono", which has no table.
    """
    who = parse_observer(observer)
    if who.kind == "eye":
        nm, cones = observer_rows("cones")
        return nm, _constant(cones @ LMS_TO_XYZ.T)
    if who.kind == "person":
        nm, cones = cones_of(who)
        return nm, _constant(cones / cones.sum(axis=0) @ _area_matrix(who.field_deg).T)
    if who.kind == "mono":
        raise UserError("observer", '"mono"', expected="an observer whose response depends on the wavelength")
    if not who.rows:
        return observer_rows(who.kind)
    return _of_table(who)


def _area_matrix(field_deg: float) -> FloatArray:
    """XYZ_F (3, 3) of cone fundamentals of unit area, in which light of equal energy has the XYZ that "eye" gives it.

    CIE 170-2:2015 states the matrices for 2° and 10°; between them it is interpolated.
    """
    two, ten = (cones_of(Observer("person", field_deg=degrees))[1].sum(axis=0) for degrees in (2.0, 10.0))
    small, large = LMS_TO_XYZ * two, _LMS_TO_XYZ_10 * ten
    share = min(max((field_deg - 2.0) / 8.0, 0.0), 1.0)
    return np.asarray((1 - share) * small + share * large * (small[1].sum() / large[1].sum()))


def _of_table(who: Observer) -> tuple[FloatArray, FloatArray]:
    """XYZ of own cones, which are treated as a person's of 2°, or of a camera, to which equal energy is white."""
    nm, values = table_of(who)
    if who.kind == "cones":
        return nm, _constant(values / values.sum(axis=0) @ _area_matrix(2.0).T)
    if values.shape[1] == 1:
        return nm, _constant(values / values.max() * D65_WHITE)
    xyz = values / values.sum(axis=0) @ SRGB_TO_XYZ.T
    return nm, _constant(xyz / xyz[:, 1].max())


def observer_range_m(observer: str) -> tuple[float, float]:
    """The least and the greatest wavelength, m, at which an observer's response is known."""
    if observer == "mono":
        return 0.0, math.inf
    nm = observer_table(observer)[0]
    return float(nm[0]) / 1e9, float(nm[-1]) / 1e9


def observer_weights(observer: str, wavelengths_m: ArrayLike) -> FloatArray:
    """XYZ (n, 3) of unit intensity at wavelengths (n,) in metres; the colour of an image is Σ_λ I_λ·w_λ.

    observer: "eye": the 2° cone fundamentals as XYZ_F (CIE 170-2:2015); "cie1931", "cie1964": the CIE colour-matching
    functions of 2° and 10°; "mono": D65 with Y = 1 at every wavelength, a camera with a flat response, shown as neutral
    grey; others as in `holoview.light.observers`.

    Raises UserError for another observer, and for a wavelength outside its table.
    """
    if observer == "mono":
        return np.tile(D65_WHITE, (np.atleast_1d(np.asarray(wavelengths_m)).size, 1))
    return np.asarray(_at(wavelengths_m, *observer_table(observer), _table_title(observer))[1])


def observer_weight_derivatives(observer: str, wavelengths_m: ArrayLike) -> FloatArray:
    """Derivatives (n, 3) of `observer_weights` with respect to the wavelength, 1/m.

    The linear interpolant has a kink at each whole nanometre, at which lasers usually are. A centred difference over
    ±0.001 nm is exact between table entries and the mean of both slopes at an entry; one-sided at the table's ends.
    """
    if observer == "mono":
        return np.zeros((np.atleast_1d(np.asarray(wavelengths_m)).size, 3))
    table, title = observer_table(observer), _table_title(observer)
    below_nm, below = _at(wavelengths_m, *table, title, -1e-3)
    above_nm, above = _at(wavelengths_m, *table, title, 1e-3)
    return np.asarray((above - below) / ((above_nm - below_nm) * 1e-9)[:, None])


def _table_title(observer: str) -> str:
    who = parse_observer(observer)
    return TABLES[who.kind][0] if who.kind in TABLES else f"observer {who.title}"


def srgb_encode(x: ArrayLike) -> FloatArray:
    """Linear light to the sRGB signal (IEC 61966-2-1), of any shape.

    Odd: srgb_encode(−x) = −srgb_encode(x), so that values outside the gamut survive a round trip.
    """
    x = np.asarray(x, dtype=np.float64)
    magnitude = np.abs(x)
    curve = 1.055 * np.maximum(magnitude, 0.0031308) ** (1 / 2.4) - 0.055
    encoded: FloatArray = np.copysign(np.where(magnitude <= 0.0031308, 12.92 * magnitude, curve), x)
    return encoded


def srgb_decode(x: ArrayLike) -> FloatArray:
    """The sRGB signal to linear light (IEC 61966-2-1), of any shape; odd like `srgb_encode`."""
    x = np.asarray(x, dtype=np.float64)
    magnitude = np.abs(x)
    curve = ((np.maximum(magnitude, 0.04045) + 0.055) / 1.055) ** 2.4
    linear: FloatArray = np.copysign(np.where(magnitude <= 0.04045, magnitude / 12.92, curve), x)
    return linear


def xyz_to_linear_srgb(xyz: ArrayLike) -> FloatArray:
    """XYZ (…, 3) to linear sRGB (…, 3), not clipped: colours outside the gamut have channels outside 0…1."""
    return np.asarray(xyz, dtype=np.float64) @ XYZ_TO_SRGB.T


def gamut_map(rgb_linear: ArrayLike, how: str = "clip") -> FloatArray:
    """Linear sRGB (…, 3) mapped into 0…1.

    how: "clip" limits each channel by itself, which shifts hues; the PSNR of this package is defined on it.
    "desaturate" moves a colour towards the grey of its luminance until it is in gamut; luminances below 0 and above 1
    become black and white. "hue" keeps the hue: a colour with channels below 0 moves towards the grey of its luminance
    until none is, then all channels are divided by the largest where that is above 1.

    Raises UserError for another name.
    """
    rgb = np.asarray(rgb_linear, dtype=np.float64)
    if how == "clip":
        return np.clip(rgb, 0.0, 1.0)
    if how == "hue":
        return _with_hue(rgb)
    if how != "desaturate":
        raise UserError("gamut", repr(how), remedy=suggest_matches(how, GAMUT_MAPS))
    grey = np.clip(rgb @ SRGB_TO_XYZ[1], 0.0, 1.0)[..., None]
    chroma = rgb - grey
    available = np.where(chroma > 0, 1.0 - grey, grey)
    factor = np.divide(available, np.abs(chroma), out=np.ones_like(chroma), where=np.abs(chroma) > available)
    mapped: FloatArray = grey + chroma * factor.min(axis=-1, keepdims=True)
    return np.clip(mapped, 0.0, 1.0)  # removes rounding errors only


def _with_hue(rgb: FloatArray) -> FloatArray:
    """`gamut_map` by "hue"; black where the luminance isn't above 0."""
    luminance = np.maximum(rgb @ SRGB_TO_XYZ[1], 0.0)[..., None]
    least = np.minimum(rgb.min(axis=-1, keepdims=True), 0.0)
    share = np.divide(luminance, luminance - least, out=np.zeros_like(luminance), where=luminance > 0)
    inside = np.maximum(luminance + share * (rgb - luminance), 0.0)
    mapped: FloatArray = inside / np.maximum(inside.max(axis=-1, keepdims=True), 1.0)
    return mapped


def to_srgb8(rgb_linear: ArrayLike, gamut: str = "clip") -> NDArray[np.uint8]:
    """Linear sRGB (…, 3) as 8-bit sRGB, gamut-mapped and rounded to nearest."""
    return np.rint(255.0 * srgb_encode(gamut_map(rgb_linear, gamut))).astype(np.uint8)


def _shares(weights: FloatArray, softness: float) -> FloatArray:
    """Positive shares s (n,) of lasers with colours w (n, 3) that are nearest to equal ones e and mix to D65.

    Minimises Σ [s·ln(s/e) − s + e] + |Σ s·w − D65|²/(2·softness); the relative entropy keeps every share positive. The
    minimum is s = e·exp(w·d) for the d (3,) that minimises the convex dual Σ s − d·D65 + softness·|d|²/2, which
    Newton's method with step halving finds.
    """
    equal = 1.0 / weights[:, 1].sum()
    dual = np.zeros(3)

    def cost(d: FloatArray) -> float:
        with np.errstate(over="ignore"):  # too long a step costs inf, and is halved
            return float(equal * np.exp(weights @ d).sum() - d @ D65_WHITE + softness * d @ d / 2)

    for _ in range(100):
        shares = equal * np.exp(weights @ dual)
        slope = shares @ weights - D65_WHITE + softness * dual
        if np.abs(slope).max() < 1e-12:
            break
        curvature = (weights.T * shares) @ weights + softness * np.eye(3)
        # Least squares: with lasers of similar colour, or that can't make white, the curvature is nearly singular.
        step = -np.linalg.lstsq(curvature, slope, rcond=None)[0]
        length, now, rounding = 1.0, cost(dual), 1e-14 * (1.0 + shares.sum())
        while cost(dual + length * step) > now + 0.1 * length * (slope @ step) + rounding and length > 1e-9:
            length /= 2
        dual = dual + length * step
    final: FloatArray = equal * np.exp(weights @ dual)
    return final


def white_amplitudes(weights: ArrayLike, sequence: ArrayLike) -> FloatArray:
    """Laser amplitudes (frame, n), factors of the intensity, whose mean over the frames is D65 with Y = 1.

    weights: (n, 3) XYZ of each laser at unit intensity, from `observer_weights`.
    sequence: (frame, n) of 0 and 1: which laser is on in which frame.

    Of all mixtures that make white, the one nearest to equal shares in relative entropy: it is unique, every laser that
    is on in some frame has a positive amplitude, and for the observer "mono" all are equal. A laser that is on in k of
    T frames has T/k times its share. If the lasers can't make white, the mixture has Y = 1 and balances the distance
    to D65 against equal shares: the mixture nearest to D65 alone would switch most lasers off.

    Raises UserError for a sequence of another shape or with other values, and when no visible laser is on.
    """
    weights = np.asarray(weights, dtype=np.float64)
    on = np.asarray(sequence, dtype=np.float64)
    if on.ndim != 2 or on.shape[1:] != weights.shape[:1] or not np.isin(on, (0.0, 1.0)).all():
        raise UserError(
            "sequence",
            f"shape {on.shape}, values {on.min(initial=0):g}…{on.max(initial=0):g}",
            expected=f"(frames, {len(weights)}) of 0 and 1, a column a laser",
        )
    frames_on = on.sum(axis=0)
    used = frames_on > 0
    if weights[used, 1].sum() <= 0:
        raise UserError("sequence", "no visible laser is on in any frame", remedy="switch one on")
    shares = _shares(weights[used], softness=1e-13)
    if np.abs(shares @ weights[used] - D65_WHITE).max() > 1e-9:
        shares = _shares(weights[used], softness=1e-2)
        shares /= shares @ weights[used, 1]
    amplitudes = np.zeros_like(on)
    amplitudes[:, used] = on[:, used] * shares * (len(on) / frames_on[used])
    return amplitudes


_BRIGHT_PERCENT, _MOST_ABOVE_WHITE = 99, 16.0


def fitting_stops(xyz: NDArray[np.floating]) -> float:
    """The exposure in stops at which only the brightest hundredth of an image XYZ (…, 3) is beyond white; 0 if black.

    Brightness is the largest channel of linear sRGB. Speckle has a long tail, which a maximum would fit; where almost
    all is dark, the brightest sample is at most `_MOST_ABOVE_WHITE` times white.
    """
    brightness = (xyz @ XYZ_TO_SRGB.T).max(axis=-1)
    white = max(float(np.percentile(brightness, _BRIGHT_PERCENT)), float(brightness.max()) / _MOST_ABOVE_WHITE)
    return -math.log2(white) if white > 0 else 0.0
