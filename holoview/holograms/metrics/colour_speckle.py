"""Colour speckle: how chromaticity scatters over a region that should have one colour.

In the manner of IEC 62906-5-4:2018: the scatter of (u′, v′) of CIE 1976, its mean, its covariance and the area of the
ellipse that holds 95 % of a normal law of that covariance. (a) From the contrasts of the lasers, measured one by one
and taken as independent; (b) from the light of all lasers together. Lasers that share the patterns of a modulator
aren't independent, so that (a) and (b) differ. Chromaticity stretches where light is short; Jzazbz
(Safdar, Cui, Kim & Luo, Opt. Express 25, 15131 (2017)) is nearly uniform, and has lightness too.

A camera's noise scatters colours as well. It is independent from pixel to pixel and from channel to channel, so that
its covariance adds to that of the speckle. With the standard deviation σ_l of the noise of channel l in a pixel, the
change Δ_l = (f(s + σ_l) − f(s − σ_l))/2 of its colour f gives the mean of Σ_l Δ_l·Δ_lᵀ over the pixels, which is taken
off, and the curvature Σ_l (f(s + σ_l) + f(s − σ_l) − 2f(s))/2 is taken off the mean. Both are exact to the second order
in σ/s: pixels whose light isn't five times its noise have no colour, and don't count.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

INSIDE_95 = -2 * math.log(0.05)
"""Squared Mahalanobis radius of the ellipse that holds 95 % of a normal law in a plane: χ² of two degrees, 5.991."""

WHITE_CD_M2 = 100.0
"""Luminance of Y = 1 in Jzazbz, which is defined on absolute luminances."""

DRAWN = 100_000
"""Samples that are drawn of independent lasers."""

DRAW_SEED = 62906
"""Seed of the colours that are drawn."""

_WHOLE = np.array([1.0, 15.0, 3.0])  # X + 15Y + 3Z, by which chromaticity divides
_ROUNDING = 1e-12  # of the greater variance of u'v', below which the smaller one is rounding
_LEAST_SIGMAS = 5.0  # of its noise, in the light of a pixel whose colour counts


@dataclass(frozen=True, eq=False)
class ColourSpeckle:
    """The scatter of colour in a region.

    mean_uv: (2,) mean u′ and v′. covariance_uv: (2, 2). area: of the 95 % ellipse. area_error: its standard error; None
    where the number of grains isn't known. mean_jzazbz, covariance_jzazbz: (3,) and (3, 3), white being 100 cd/m².
    uv, jzazbz: (n, 2) and (n, 3), the scatter itself, with a camera's noise. noise_share: the trace of the covariance
    of u′v′ that was that noise, over the whole; it is in none of the other numbers. too_dark: share of the pixels that
    are too dark for a colour.
    """

    mean_uv: Floats
    covariance_uv: Floats
    area: float
    area_error: float | None
    mean_jzazbz: Floats
    covariance_jzazbz: Floats
    uv: Floats = field(repr=False)
    jzazbz: Floats = field(repr=False)
    noise_share: float = 0.0
    too_dark: float = 0.0

    @property
    def is_noise(self) -> bool:
        """Whether noise was taken off and what is left may be nothing, by two standard errors of the area."""
        return self.noise_share > 0 and self.area <= 2 * (self.area_error or 0.0)

    @property
    def jzazbz_scatter(self) -> float:
        """Root mean square distance from the mean in Jzazbz."""
        return math.sqrt(max(float(np.trace(self.covariance_jzazbz)), 0.0))

    def without_samples(self) -> ColourSpeckle:
        """The same numbers without the scatter itself."""
        return replace(self, uv=self.uv[:0], jzazbz=self.jzazbz[:0])

    def as_json(self) -> dict[str, Any]:
        """For programs, without the scatter."""
        return {
            "mean_uv": self.mean_uv.tolist(),
            "covariance_uv": self.covariance_uv.tolist(),
            "ellipse_95_area": self.area,
            "ellipse_95_area_error": self.area_error,
            "mean_jzazbz": self.mean_jzazbz.tolist(),
            "covariance_jzazbz": self.covariance_jzazbz.tolist(),
            "jzazbz_rms": self.jzazbz_scatter,
        }


def colour_speckle(
    xyz: ArrayLike, grains: float | None = None, noise: ArrayLike | None = None, gain_error: float = 0.0
) -> ColourSpeckle | None:
    """The scatter of colours XYZ (n, 3), Y = 1 for white; None where fewer than two samples have light.

    grains: independent ones among the samples. noise: (channel, n, 3) change of XYZ by one standard deviation of the
    noise of each channel of a camera, whose scatter is taken off. gain_error: relative, of the noise's variance.

    Of n grains of a normal law with the covariance S = A + N, N being that of the noise, the area, which goes with the
    root of det A, has the relative standard error √(tr((A⁻¹S)²)/2n) (the law of Wishart), 1/√n without noise; the
    error of a gain adds gain_error·tr(A⁻¹N)/2.
    """
    samples = np.asarray(xyz, dtype=np.float64).reshape(-1, 3)
    changes = np.zeros((0, *samples.shape)) if noise is None else np.asarray(noise, dtype=np.float64)
    dark = _LEAST_SIGMAS * np.linalg.norm(changes @ _WHOLE, axis=0)
    lit = samples @ _WHOLE > dark
    if lit.sum() < 2:
        return None
    samples, changes = samples[lit], changes[:, lit]
    uv, uv_bias, uv_noise = _with_noise(uv_prime, samples, changes)
    uniform, bias, of_noise = _with_noise(lambda values: jzazbz(WHITE_CD_M2 * values), samples, changes)
    measured = np.atleast_2d(np.cov(uv.T, bias=True))
    covariance = measured - uv_noise
    least, most = np.linalg.eigvalsh(covariance)
    is_left = bool(least > _ROUNDING * most > 0)  # the colours of two lasers lie on a line
    area, error = ellipse_area(covariance) if is_left else 0.0, None
    if grains is not None and is_left:
        ratio = np.linalg.solve(covariance, measured)
        by_gain = gain_error * float(np.trace(np.linalg.solve(covariance, uv_noise))) / 2
        error = area * math.hypot(math.sqrt(float(np.trace(ratio @ ratio)) / (2 * grains)), by_gain)
    elif grains is not None:
        error = ellipse_area(measured) / math.sqrt(grains)
    return ColourSpeckle(
        mean_uv=uv.mean(axis=0) - uv_bias,
        covariance_uv=covariance,
        area=area,
        area_error=error,
        mean_jzazbz=uniform.mean(axis=0) - bias,
        covariance_jzazbz=np.cov(uniform.T, bias=True) - of_noise,
        uv=uv,
        jzazbz=uniform,
        noise_share=float(np.trace(uv_noise) / max(np.trace(measured), np.finfo(float).tiny)),
        too_dark=0.0 if noise is None else float(1 - lit.mean()),
    )


def mean_colour(found: Sequence[ColourSpeckle | None]) -> ColourSpeckle | None:
    """The mean over several regions of the same light, of the first's scatter; None where one has no colour speckle.

    The area is that of the mean covariance; its standard error that of the scatter of areas, where each has one.
    """
    known = [of for of in found if of is not None]
    if len(known) < len(found) or len(known) < 2:
        return found[0] if len(found) == 1 else None

    def mean(of: Callable[[ColourSpeckle], ArrayLike]) -> Floats:
        return np.mean([np.asarray(of(one)) for one in known], axis=0)

    covariance = mean(lambda one: one.covariance_uv)
    scatter = float(np.std([one.area for one in known], ddof=1)) / math.sqrt(len(known))
    return replace(
        known[0],
        mean_uv=mean(lambda one: one.mean_uv),
        covariance_uv=covariance,
        area=ellipse_area(covariance),
        area_error=None if any(one.area_error is None for one in known) else scatter,
        mean_jzazbz=mean(lambda one: one.mean_jzazbz),
        covariance_jzazbz=mean(lambda one: one.covariance_jzazbz),
        noise_share=float(mean(lambda one: one.noise_share)),
        too_dark=float(mean(lambda one: one.too_dark)),
    )


def _with_noise(colour: Callable[[Floats], Floats], samples: Floats, changes: Floats) -> tuple[Floats, Floats, Floats]:
    """Colours (n, k) of samples (n, 3), and what noise adds to their mean (k,) and to their covariance (k, k).

    changes: (channel, n, 3), by one standard deviation of each channel's noise.
    """
    found = colour(samples)
    mean, covariance = np.zeros(found.shape[1]), np.zeros((found.shape[1],) * 2)
    for change in changes:
        above, below = colour(samples + change), colour(samples - change)
        half = (above - below) / 2
        mean += ((above + below) / 2 - found).mean(axis=0)
        covariance += half.T @ half / len(samples)
    return found, mean, covariance


def uv_prime(xyz: ArrayLike) -> Floats:
    """CIE 1976 (u′, v′) (…, 2) of XYZ (…, 3) with light: 4X/(X + 15Y + 3Z) and 9Y/(X + 15Y + 3Z)."""
    values = np.asarray(xyz, dtype=np.float64)
    whole = values @ _WHOLE
    return np.stack([4 * values[..., 0] / whole, 9 * values[..., 1] / whole], axis=-1)


def ellipse_area(covariance: ArrayLike) -> float:
    """Area π·5.991·√det of the ellipse that holds 95 % of a normal law of a covariance (2, 2)."""
    return math.pi * INSIDE_95 * math.sqrt(max(float(np.linalg.det(np.asarray(covariance))), 0.0))


def independent_covariance(laser_xyz: ArrayLike, contrasts: ArrayLike) -> Floats:
    """The covariance (2, 2) of (u′, v′) of independent lasers of small contrast: Σ_l C_l²·d_l·d_lᵀ.

    laser_xyz: (laser, 3) mean XYZ of each. contrasts: (laser,) C_l. d_l is the change of (u′, v′) by a relative change
    of laser l: with the weights q = (1, 15, 3) and the whole w = q·ΣXYZ, d_l = ((4X_l, 9Y_l) − (u′, v′)·q·XYZ_l)/w.
    Exact to the first order in C (Kuroda, Opt. Rev. 21, 83 (2014)).
    """
    means, squares = np.asarray(laser_xyz, dtype=np.float64), np.square(np.asarray(contrasts, dtype=np.float64))
    wholes = means @ _WHOLE
    changes = (means[:, :2] * [4.0, 9.0] - uv_prime(means.sum(axis=0)) * wholes[:, None]) / wholes.sum()
    covariance: Floats = (changes.T * squares) @ changes
    return covariance


def independent_colours(
    laser_xyz: ArrayLike, contrasts: ArrayLike, count: int = DRAWN, seed: int = DRAW_SEED
) -> Floats:
    """XYZ (n, 3) of independent lasers whose intensities follow gamma laws of their contrasts, drawn.

    laser_xyz, contrasts: as of `independent_covariance`. A gamma law of shape 1/C² has the contrast C.
    """
    rng, means = np.random.default_rng(seed), np.asarray(laser_xyz, dtype=np.float64)
    drawn = [_relative(rng, float(contrast), count) for contrast in np.asarray(contrasts)]
    colours: Floats = np.stack(drawn, axis=1) @ means
    return colours


def _relative(rng: np.random.Generator, contrast: float, count: int) -> Floats:
    """Intensities (n,) of mean 1 with a gamma law of a contrast."""
    if contrast < 1e-6:
        return np.ones(count)
    return rng.gamma(contrast**-2, contrast**2, count)


# --- Jzazbz -----------------------------------------------------------------------------------------------------------

_TO_LMS = np.array(
    [[0.41478972, 0.579999, 0.0146480], [-0.2015100, 1.120649, 0.0531008], [-0.0166008, 0.2648, 0.6684799]]
)
_TO_IZAZBZ = np.array([[0.5, 0.5, 0.0], [3.524, -4.066708, 0.542708], [0.199076, 1.096799, -1.295875]])
_B, _G, _D, _D0 = 1.15, 0.66, -0.56, 1.6295499532821566e-11
_C1, _C2, _C3, _N, _P = 3424 / 2**12, 2413 / 2**7, 2392 / 2**7, 2610 / 2**14, 1.7 * 2523 / 2**5


def jzazbz(xyz_cd_m2: ArrayLike) -> Floats:
    """Jz, az and bz (…, 3) of XYZ (…, 3) with the white D65, Y in cd/m² (Safdar et al. 2017, equations 8 to 13)."""
    values = np.asarray(xyz_cd_m2, dtype=np.float64)
    x, y, z = np.moveaxis(values, -1, 0)
    cones = np.stack([_B * x - (_B - 1) * z, _G * y - (_G - 1) * x, z], axis=-1) @ _TO_LMS.T
    powers = np.power(np.maximum(cones, 0.0) / 10_000, _N)
    coded = np.power((_C1 + _C2 * powers) / (1 + _C3 * powers), _P)
    found = coded @ _TO_IZAZBZ.T
    lightness = (1 + _D) * found[..., 0] / (1 + _D * found[..., 0]) - _D0
    result: Floats = np.concatenate([lightness[..., None], found[..., 1:]], axis=-1)
    return result
