"""Where dots fall on the camera, as a function of all that is unknown, and its fit with uncertainties.

    r' = (1 + m₂)·R(ρ₂)·T₂·r + d₂           place of a block of modulator 2, r in what it displays (modulator 1: r' = r)
    ν' = R(ρ₂)·T₂·ν / (1 + m₂)
    z  = offset + (1 + scale)·Z                              Z: the stage's setting
    near field:     q = r' + L·tan(asin(λν')),  L = z, for modulator 1 of two z + gap
    Fourier bench:  q = f·λν − (z/f)·r
    pixel           = R(ρ)·q / pitch + walk·z / pitch + centre

T₂ and the camera's own turn are whole turns, which are known before; pixels are those of the picture turned back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from holoview.captures.orientations import orientation_matrix

Floats = NDArray[np.float64]
NAMES = (
    "centre_y", "centre_x", "log_pitch", "rotation", "offset", "scale", "walk_y", "walk_x",
    "shift2_y", "shift2_x", "rotation2", "magnification2", "gap",
)  # fmt: skip
"""All that may be unknown, in SI units; the centre in pixels."""

_UNITS = np.array([1, 1, 1e-3, 1e-3, 1e-4, 1e-2, 1e-3, 1e-3, 1e-6, 1e-6, 1e-3, 1e-3, 1e-4])
_COMMON_COUNT = 16
_OUTLIER = 4.0  # times the robust standard deviation
_MAD = 1.4826
# Of the error that dots share over the scatter beyond noise: blur, crosstalk, wrong strokes and look-up tables moved
# planes by one to four times what this states with 1 (benchmarks/rig_alignment.py --faults).
_SHARED_PER_EXCESS = 3.0


@dataclass(frozen=True)
class Dots:
    """Dots seen at one setting of the stage, made by one modulator.

    centre_m, frequency: (dot, 2), as in `Probes`. position_px: (dot, 2), in the picture turned back.
    """

    slm: int
    stage_m: float
    centre_m: Floats
    frequency: Floats
    position_px: Floats


@dataclass(frozen=True)
class BenchFacts:
    """Wavelength, focal length (None: near field), number of modulators, and how the second one is turned."""

    wavelength_m: float
    focal_length_m: float | None
    modulators: int
    slm2_turn: str = "none"


@dataclass(frozen=True)
class Geometry:
    """Values of `NAMES` with their covariance. used: dots fitted, of how many. residual_px: r.m.s. along an axis."""

    values: Floats
    covariance: Floats
    used: tuple[int, int] = (0, 0)
    residual_px: float = 0.0

    def __getitem__(self, name: str) -> float:
        return float(self.values[NAMES.index(name)])

    def uncertainty(self, name: str) -> float:
        """Standard deviation of one value; 0 for one that wasn't fitted."""
        k = NAMES.index(name)
        return float(self.covariance[k, k] ** 0.5)

    def is_near(self, other: Geometry, deviations: float) -> bool:
        """Whether all values are within so many standard deviations of another geometry's."""
        return bool((np.abs(self.values - other.values) <= deviations * np.diag(self.covariance) ** 0.5).all())

    def uncertain_by(self, other: Geometry) -> Geometry:
        """This geometry, with its difference from another one as a further uncertainty."""
        step = np.diag((self.values - other.values) ** 2)
        return replace(self, covariance=self.covariance + step)


def predicted_px(
    values: Floats, facts: BenchFacts, slm: int, stage_m: float, centre_m: Floats, frequency: Floats
) -> Floats:
    """Places (dot, 2) on the camera of dots of one modulator."""
    v = dict(zip(NAMES, values, strict=True))
    place, ν = centre_m, frequency
    if slm == 1:
        turn = rotation_matrix(v["rotation2"]) @ orientation_matrix(facts.slm2_turn)
        scale = 1 + v["magnification2"]
        place = scale * place @ turn.T + np.array([v["shift2_y"], v["shift2_x"]])
        ν = ν @ turn.T / scale
    z = v["offset"] + (1 + v["scale"]) * stage_m
    sines = facts.wavelength_m * ν
    if facts.focal_length_m is None:
        distance = z + (v["gap"] if slm + 1 < facts.modulators else 0.0)
        point = place + distance * sines / np.sqrt(1 - (sines**2).sum(axis=1, keepdims=True))
    else:
        point = facts.focal_length_m * sines - z / facts.focal_length_m * place
    point = point @ rotation_matrix(v["rotation"]).T + z * np.array([v["walk_y"], v["walk_x"]])
    return np.asarray(point / np.exp(v["log_pitch"]) + np.array([v["centre_y"], v["centre_x"]]))


@dataclass(frozen=True)
class DotErrors:
    """How well the places of dots are known, standard deviations in pixels.

    common_px: of an error that neighbouring dots share, which more dots don't average out: it counts as if only 16
    coordinates had been measured. noise_px: the scatter by noise and unequal pixels of dots whose
    pictures are as the model has them. More scatter means that modulators or camera aren't as described, which moves
    dots together by several times their scatter.
    """

    common_px: float = 0.0
    noise_px: float = float("inf")

    def shared_px(self, residual_px: float) -> float:
        """The shared error of dots with this residual (r.m.s. along an axis)."""
        return float(np.hypot(self.common_px, _SHARED_PER_EXCESS * self.excess_px(residual_px)))

    def excess_px(self, residual_px: float) -> float:
        """How much of a residual noise doesn't explain."""
        return max(residual_px - self.noise_px, 0.0)


def fit_geometry(start: Floats, facts: BenchFacts, dots: Sequence[Dots], errors: DotErrors | None = None) -> Geometry:
    """The geometry that explains dots best, without outliers. start: values of `NAMES`. errors: none without them.

    Values that the dots can't tell stay: walk and the stage's scale at one setting, modulator 2 where there is none.
    """
    free = _free(facts, dots)
    seen = np.concatenate([d.position_px for d in dots])
    kept = np.isfinite(seen).all(axis=1)
    values = start.copy()

    def residuals(x: Floats) -> Floats:
        every = values.copy()
        every[free] = x * _UNITS[free]
        parts = [predicted_px(every, facts, d.slm, d.stage_m, d.centre_m, d.frequency) for d in dots]
        return np.asarray(np.concatenate(parts) - seen)

    x = values[free] / _UNITS[free]
    for loss in ("soft_l1", "linear", "linear"):
        x = least_squares(lambda x, kept=kept: residuals(x)[kept].ravel(), x, loss=loss).x
        off = np.abs(residuals(x)).max(axis=1)
        limit = _OUTLIER * max(_MAD * float(np.median(np.abs(residuals(x)[kept]))), 0.01)
        kept = np.isfinite(off) & (off < limit)
    solved = least_squares(lambda x: residuals(x)[kept].ravel(), x)
    freedom = max(2 * int(kept.sum()) - len(x), 1)
    variance = float(2 * solved.cost) / freedom
    shared_px = (errors or DotErrors()).shared_px(variance**0.5)
    stated = variance + shared_px**2 * max(2 * int(kept.sum()) / _COMMON_COUNT, 1.0)
    covariance = np.zeros((len(NAMES), len(NAMES)))
    covariance[np.ix_(free, free)] = (
        stated * np.linalg.pinv(solved.jac.T @ solved.jac) * np.outer(_UNITS[free], _UNITS[free])
    )
    values[free] = solved.x * _UNITS[free]
    return Geometry(values, covariance, (int(kept.sum()), len(kept)), variance**0.5)


def _free(facts: BenchFacts, dots: Sequence[Dots]) -> NDArray[np.intp]:
    """Which of `NAMES` these dots can tell."""
    names = set(NAMES[:5])
    if len({d.stage_m for d in dots}) > 1:
        names |= {"scale", "walk_y", "walk_x"}
    if facts.modulators == 2:
        names |= {"shift2_y", "shift2_x", "rotation2", "magnification2", "gap"}
    return np.array([k for k, name in enumerate(NAMES) if name in names])


def rotation_matrix(angle_rad: float) -> Floats:
    """R for positions (y, x): positive from +x towards +y."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, s], [-s, c]])
