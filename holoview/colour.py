"""From light at laser wavelengths to the colours of a screen.

Light becomes colour in three linear steps and one curve:

    XYZ = Σ_λ I_λ · w_λ          observer_weights: an eye, the CIE 1931 observer, or a mono camera
    rgb = XYZ_TO_SRGB · XYZ      xyz_to_linear_srgb: may leave 0…1, since lasers lie outside the sRGB gamut
    gamut_map, srgb_encode       what a screen can show

The scale is fixed throughout: Y = 1 is the white of the display, and nothing is normalised per image. An eye's XYZ_F is
shown as if it were CIE 1931 XYZ, which is how CIE 170-2 intends it; the white point is that of sRGB in both cases.

The observers' tables are colour-science's, kept as files beside the pictures: the package itself takes over a second to
import and is loaded for colour differences only.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holoview.util.errors import UserError, suggest_matches
from holoview.util.files import data_dir

FloatArray = NDArray[np.float64]

OBSERVERS = ("eye", "cie1931", "mono")
GAMUT_MAPS = ("clip", "desaturate")


def _constant(values: ArrayLike) -> FloatArray:
    """A read-only float64 array, since module constants and cached tables are shared by every caller."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def _xyz_of_chromaticity(x: float, y: float) -> list[float]:
    """XYZ with Y = 1 of the chromaticity (x, y)."""
    return [x / y, 1.0, (1.0 - x - y) / y]


def rgb_to_xyz(chromaticities: Sequence[tuple[float, float]]) -> FloatArray:
    """The matrix that takes (1, 1, 1) to D65 and each channel to its primary's chromaticity.

    chromaticities: (x, y) of red, green, blue and, after them, of a white that isn't needed: every white is shown as
    that of the display.
    """
    primaries = np.array([_xyz_of_chromaticity(*xy) for xy in chromaticities[:3]]).T
    matrix: FloatArray = primaries * np.linalg.solve(primaries, D65_WHITE)
    return matrix


LMS_TO_XYZ = _constant([[1.94735469, -1.41445123, 0.36476327], [0.68990272, 0.34832189, 0.0], [0.0, 0.0, 1.93485343]])
"""Cone fundamentals (energy-based, 2°) to XYZ_F: CIE 170-2:2015."""

D65_WHITE = _constant(_xyz_of_chromaticity(0.3127, 0.3290))
"""XYZ of the sRGB white (x = 0.3127, y = 0.3290), Y = 1."""

SRGB_TO_XYZ = _constant(rgb_to_xyz([(0.64, 0.33), (0.30, 0.60), (0.15, 0.06)]))
"""Linear sRGB (IEC 61966-2-1) to XYZ in float64; the standard prints it rounded to four decimals,
which would tint white by 1e-4."""

XYZ_TO_SRGB = _constant(np.linalg.inv(SRGB_TO_XYZ))
"""XYZ to linear sRGB: the exact inverse of `SRGB_TO_XYZ`."""


@cache
def import_colour_science() -> Any:
    """The colour-science package, imported at the first call.

    Importing it warns about each optional package that is missing (matplotlib for its plots), none of which is used
    here, and sets numpy's print options and warning filters for the whole process: both are put back.
    """
    with warnings.catch_warnings(), np.printoptions():
        warnings.filterwarnings("ignore", message=".*related API features are not available")
        import colour
    return colour


TABLES = {
    "cones": ("Stockman & Sharpe 2 Degree Cone Fundamentals", "L,M,S"),
    "cie1931": ("CIE 1931 2 Degree Standard Observer", "x,y,z"),
}
"""The tables in `assets/observers`: the name that each has in colour-science, and its columns."""


@cache
def _table(name: str) -> tuple[FloatArray, FloatArray]:
    """Wavelengths (n,) in nm and values (n, 3) of one of `TABLES`, at 1 nm steps."""
    rows = np.loadtxt(data_dir("assets") / "observers" / f"{name}.csv", delimiter=",")
    return _constant(rows[:, 0]), _constant(rows[:, 1:])


def _interpolate(name: str, wavelengths_m: ArrayLike, offset_nm: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """Where the table was read (n,) in nm, after the offset and held inside the table, and its values there (n, 3)."""
    known_nm, values = _table(name)
    asked_nm = np.atleast_1d(np.asarray(wavelengths_m, dtype=np.float64)) * 1e9
    first, last = known_nm[0], known_nm[-1]
    rounding = 1e-6  # 390e-9 · 1e9 need not be 390
    outside = ~((asked_nm >= first - rounding) & (asked_nm <= last + rounding))
    if outside.any():
        raise UserError(
            "wavelength",
            f"{asked_nm[outside][0]:g} nm",
            expected=f"{first:g}…{last:g} nm, the range of the {TABLES[name][0]}",
            remedy="wavelengths here are in metres: 532 nm is 532e-9",
        )
    at_nm = np.clip(asked_nm + offset_nm, first, last)
    return at_nm, np.stack([np.interp(at_nm, known_nm, column) for column in values.T], axis=-1)


def cone_fundamentals(wavelengths_m: ArrayLike) -> FloatArray:
    """L, M, S cone responses (n, 3) to unit energy at each wavelength (m), each cone with a peak of 1.

    Stockman & Sharpe (2000), 2°, energy-based, as adopted by CIE 170-1:2006; linear between the 1 nm table entries.
    Raises UserError outside 390…830 nm.
    """
    return _interpolate("cones", wavelengths_m)[1]


def cone_fundamental_derivatives(wavelengths_m: ArrayLike) -> FloatArray:
    """Derivatives (n, 3), per metre, of `cone_fundamentals` with respect to the wavelength.

    The interpolant has a kink at each whole nanometre, where lasers usually sit. A centred difference over ±0.001 nm is
    exact between table entries and gives the mean of both slopes at one; at the ends of the table it's one-sided.
    """
    below_nm, below = _interpolate("cones", wavelengths_m, -1e-3)
    above_nm, above = _interpolate("cones", wavelengths_m, 1e-3)
    return (above - below) / ((above_nm - below_nm) * 1e-9)[:, None]


def observer_weights(kind: str, wavelengths_m: ArrayLike) -> FloatArray:
    """XYZ (n, 3) that unit intensity at each wavelength (m) makes; an image is XYZ = Σ_λ I_λ · weights.

    'eye': the 2° cone fundamentals taken to XYZ_F (CIE 170-2:2015). 'cie1931': the CIE 1931 2° colour-matching
    functions. 'mono': D65 white with Y = 1 at every wavelength, a mono camera of flat response shown as neutral grey.
    Raises UserError for another kind, and for a wavelength outside the observer's table.
    """
    if kind == "eye":
        return cone_fundamentals(wavelengths_m) @ LMS_TO_XYZ.T
    if kind == "cie1931":
        return _interpolate("cie1931", wavelengths_m)[1]
    if kind == "mono":
        return np.tile(D65_WHITE, (np.atleast_1d(np.asarray(wavelengths_m)).size, 1))
    raise UserError("observer", repr(kind), remedy=suggest_matches(kind, OBSERVERS))


def srgb_encode(x: ArrayLike) -> FloatArray:
    """Linear light to the sRGB signal (IEC 61966-2-1), any shape.

    Odd-symmetric: srgb_encode(−x) = −srgb_encode(x), so out-of-gamut values survive a round trip and none is NaN.
    """
    x = np.asarray(x, dtype=np.float64)
    magnitude = np.abs(x)
    curve = 1.055 * np.maximum(magnitude, 0.0031308) ** (1 / 2.4) - 0.055
    encoded: FloatArray = np.copysign(np.where(magnitude <= 0.0031308, 12.92 * magnitude, curve), x)
    return encoded


def srgb_decode(x: ArrayLike) -> FloatArray:
    """The sRGB signal to linear light (IEC 61966-2-1), any shape; odd-symmetric as `srgb_encode`."""
    x = np.asarray(x, dtype=np.float64)
    magnitude = np.abs(x)
    curve = ((np.maximum(magnitude, 0.04045) + 0.055) / 1.055) ** 2.4
    linear: FloatArray = np.copysign(np.where(magnitude <= 0.04045, magnitude / 12.92, curve), x)
    return linear


def xyz_to_linear_srgb(xyz: ArrayLike) -> FloatArray:
    """XYZ (…, 3) to linear sRGB (…, 3), not clipped: colours outside the gamut have channels outside 0…1."""
    return np.asarray(xyz, dtype=np.float64) @ XYZ_TO_SRGB.T


def gamut_map(rgb_linear: ArrayLike, how: str = "clip") -> FloatArray:
    """Linear sRGB (…, 3) brought into 0…1.

    'clip' limits each channel by itself; it's what the PSNR of this package is defined on, and it shifts hues.
    'desaturate' moves a pixel towards the grey of its own luminance just until it's in gamut: luminance inside 0…1 is
    kept, below it is black, above it is white. Raises UserError for another name.
    """
    rgb = np.asarray(rgb_linear, dtype=np.float64)
    if how == "clip":
        return np.clip(rgb, 0.0, 1.0)
    if how != "desaturate":
        raise UserError("gamut", repr(how), remedy=suggest_matches(how, GAMUT_MAPS))
    grey = np.clip(rgb @ SRGB_TO_XYZ[1], 0.0, 1.0)[..., None]
    chroma = rgb - grey
    room = np.where(chroma > 0, 1.0 - grey, grey)
    share = np.divide(room, np.abs(chroma), out=np.ones_like(chroma), where=np.abs(chroma) > room)
    mapped: FloatArray = grey + chroma * share.min(axis=-1, keepdims=True)
    return np.clip(mapped, 0.0, 1.0)  # removes rounding only


def to_srgb8(rgb_linear: ArrayLike, gamut: str = "clip") -> NDArray[np.uint8]:
    """Linear sRGB (…, 3) as 8-bit sRGB, rounded to nearest."""
    return np.rint(255.0 * srgb_encode(gamut_map(rgb_linear, gamut))).astype(np.uint8)


def _shares(weights: FloatArray, softness: float) -> FloatArray:
    """Positive shares s (n,) near equal ones, e, whose colour Σ s·w is D65.

    Minimises Σ [s·ln(s/e) − s + e] + |Σ s·w − D65|²/(2·softness), which leaves no share at zero. The minimum is
    s = e·exp(w·d) with d (3,) where the convex dual Σ s − d·D65 + softness·|d|²/2 is least: Newton, halving its steps.
    """
    equal = 1.0 / weights[:, 1].sum()
    dual = np.zeros(3)

    def cost(d: FloatArray) -> float:
        with np.errstate(over="ignore"):  # a step too far costs inf, and is halved
            return float(equal * np.exp(weights @ d).sum() - d @ D65_WHITE + softness * d @ d / 2)

    for _ in range(100):
        shares = equal * np.exp(weights @ dual)
        slope = shares @ weights - D65_WHITE + softness * dual
        if np.abs(slope).max() < 1e-12:
            break
        curvature = (weights.T * shares) @ weights + softness * np.eye(3)
        # Least squares, since lasers that look alike, or can't make white, make the curvature nearly singular.
        step = -np.linalg.lstsq(curvature, slope, rcond=None)[0]
        length, now, rounding = 1.0, cost(dual), 1e-14 * (1.0 + shares.sum())
        while cost(dual + length * step) > now + 0.1 * length * (slope @ step) + rounding and length > 1e-9:
            length /= 2
        dual = dual + length * step
    final: FloatArray = equal * np.exp(weights @ dual)
    return final


def white_amplitudes(weights: ArrayLike, sequence: ArrayLike) -> FloatArray:
    """Laser amplitudes (frames, n), factors on intensity, whose mean over frames is D65 with Y = 1 at unit intensity.

    `weights` (n, 3) come from `observer_weights`; `sequence` (frames, n) says with 0 and 1 which laser is on in which
    frame. A laser on in k of T frames gets T/k times its share. Of all mixtures that make white, the one nearest to
    equal shares (least relative entropy) is taken: it's unique, every laser that is ever on stays on, and under 'mono'
    all are equal. Where these lasers can't make white, the result has Y = 1 and trades its distance to D65 against even
    shares, because the nearest mixture by itself would switch most lasers off. Raises UserError for a sequence that
    isn't 0/1 of matching shape, or that shows no light.
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
