"""Confidence intervals of values, and correlations between effects, from derivatives at a solution.

With J the derivatives of the whitened residuals r (gains and movements of the camera projected out), photon noise
alone gives the covariance (JᵀJ)⁻¹. Where the model doesn't reach the noise floor, neighbouring pixels share the same
error, and only the scores g_k = J_kᵀ r_k of whole captures are independent samples:

    (JᵀJ)⁻¹ (Σ g_k g_kᵀ) (JᵀJ)⁻¹ · K/(K − 1)

The larger of the two is used. White, Econometrica 48, 817 (1980); for clusters Liang & Zeger, Biometrika 73, 13
(1986).

Derivatives mislead where χ² isn't a parabola: an edge of a stop that passes samples of the grid, as the wavelength
changes, makes slopes steep and χ² flat. So χ² is computed at both ends of every interval, with the other parameters
moved along as the covariance says, and with these held. An end at which either has risen by less than the parabola
rises moves outwards, until both have risen as much (profile likelihood, from above).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from holoview.bench.diagnose.config import SearchConfig
from holoview.bench.diagnose.fit import CandidateFit, FreeParameters, free_parameters_of, residual_function
from holoview.bench.diagnose.likelihood import Comparison
from holoview.bench.diagnose.search_context import NEVER, SearchEnd
from holoview.light.model.effects.effect import Effect, Parameter
from holoview.light.model.effects.registry import get_effect
from holoview.light.numerics.minimise import (
    Minimum,
    ResidualFunction,
    SearchDomain,
    Vector,
    jacobian,
    profile_half_width,
)
from holoview.util import units

Slopes = NDArray[np.float32]

LEVEL = 0.95
"""[1] Probability that an interval holds the true value. Evidence: a convention."""

MODEL_ACCURACY = 1e-3
"""[1] Share of a value that the model's own accuracy adds to its standard deviation. Evidence: two programs for the
same physics hardly agree better on grids of this size; the value: none recorded."""


_FAR_CHI2 = 25.0
"""[χ²/n] Of fits that leave more, how χ² rises away from the solution isn't measured. Evidence: a reason: what is
missing decides it. Cost: twenty numbers of a light that speckle found took four minutes."""
_PARABOLA_SHARE = 0.9  # [1] Where χ² rises by this share of a parabola's rise, the interval stays.
_MAX_WIDENING = 8.0  # [1] An interval becomes at most so many times as wide as derivatives say.
_EDGE_STEPS = (0.25, 8.0)  # [steps] The shortest and the longest move of a hard edge that is tried.


@dataclass(frozen=True)
class Interval:
    """A value with its standard deviation and half the width of its interval, 95 % by default; SI units."""

    value: float
    sigma: float
    half_width: float


@dataclass(frozen=True)
class LocalJacobian:
    """Derivatives of the residuals at a solution by the causes' parameters, and the residuals.

    slopes (parameter, capture × y × x): per prior. residual: flat. capture_count: number of captures in both.
    """

    parameters: FreeParameters
    slopes: Slopes
    residual: NDArray[np.float32]
    capture_count: int


@dataclass(frozen=True)
class LocalInformation:
    """The information in captures on the causes' parameters at a solution, in units of the priors.

    normal (parameter, parameter): JᵀJ. scores (capture, parameter): Jᵀr of each capture. residual: flat.
    """

    parameters: FreeParameters
    normal: NDArray[np.float64]
    scores: NDArray[np.float64]
    residual: NDArray[np.float32]

    @classmethod
    def of(cls, at: LocalJacobian) -> LocalInformation:
        """From derivatives."""
        count, captures = len(at.parameters), at.capture_count
        residual = at.residual.reshape(captures, -1)
        slopes = at.slopes.reshape(count, *residual.shape)  # there may be no parameter
        scores = np.einsum("pkn,kn->kp", slopes, residual, dtype=np.float64)
        return cls(at.parameters, (at.slopes @ at.slopes.T).astype(np.float64), scores, at.residual)


def local_jacobian(fit: CandidateFit, effects: Sequence[Effect], comparison: Comparison) -> LocalJacobian:
    """The derivatives by all parameters of the effects that the fit varied."""
    free = free_parameters_of(effects, fit.values)
    residual = comparison.residual(fit.values)
    function = residual_function(free, fit.values, comparison)
    slopes = jacobian(function, free.pack(fit.values), residual, free.bounds())
    return LocalJacobian(free, slopes, residual, len(comparison.indices))


def local_information(fit: CandidateFit, effects: Sequence[Effect], comparison: Comparison) -> LocalInformation:
    """The same information as from `local_jacobian`, for some captures at a time where there are many pixels."""
    parts = [LocalInformation.of(local_jacobian(fit, effects, part)) for _, part in comparison.parts()]
    normal = np.sum([part.normal for part in parts], axis=0)
    scores, residual = (np.concatenate(rows) for rows in zip(*((p.scores, p.residual) for p in parts), strict=True))
    return LocalInformation(parts[0].parameters, normal, scores, residual)


def confidence_intervals(
    fit: CandidateFit, at: LocalInformation, comparison: Comparison, config: SearchConfig, end: SearchEnd = NEVER
) -> dict[tuple[str, str], Interval]:
    """The interval of each (effect, parameter); infinite where the captures hold no information about it.

    end: until which intervals are widened to where χ² has risen; those that are left follow from derivatives alone.
    Parameters at their identity that these captures can't show, such as those of a laser that wasn't on, are left out.
    """
    factor = float(student.ppf(0.5 + LEVEL / 2, max(len(at.scores) - 1, 1)))
    half_widths = _half_widths(fit, at, comparison, factor, end)
    unknown = np.diag(at.normal) <= 0.0
    scale = at.parameters.value_derivatives(at.parameters.pack(fit.values))
    edges, result = _edge_half_widths(fit, at, comparison, config), {}
    for i, (effect, parameter) in enumerate(at.parameters.entries):
        value = parameter.read(fit.values[effect])
        if unknown[i] and value == parameter.identity:
            continue
        sigma = float("inf") if unknown[i] else float(half_widths[i] * abs(scale[i]) / factor)
        away = abs(value - parameter.identity) if math.isfinite(parameter.identity) else abs(value)
        sigma = float(np.hypot(sigma, MODEL_ACCURACY * away))
        if parameter.non_smooth:
            sigma = max(sigma, edges[effect] * abs(scale[i]) / factor)
        result[effect, parameter.name] = Interval(value, sigma, factor * sigma)
    return result


def _half_widths(
    fit: CandidateFit, at: LocalInformation, comparison: Comparison, factor: float, end: SearchEnd
) -> Vector:
    """Half the interval of each parameter, in priors: so many standard deviations, or more where χ² rises less.

    The variance is the larger of the noise's and the captures' scores'.
    """
    captures, count = len(at.scores), len(at.parameters)
    if not count:
        return np.empty(0)
    inverse = np.linalg.pinv(at.normal, rcond=1e-10, hermitian=True)
    robust = inverse @ (at.scores.T @ at.scores * (captures / max(captures - 1, 1))) @ inverse
    chi2 = float(np.mean(np.square(at.residual[at.residual != 0.0])))
    noise = inverse * max(1.0, chi2)
    half_widths = factor * np.sqrt(np.maximum(np.diag(robust), np.diag(noise)))
    if chi2 > _FAR_CHI2:
        return half_widths
    function, minimum, bounds = _at_solution(fit, at, comparison)
    for i, (_, parameter) in enumerate(at.parameters.entries):
        if end.seconds_left < 0:
            break
        if inverse[i, i] > 0 and not parameter.non_smooth:
            width = float(half_widths[i])
            ways, rise = (inverse[:, i] / inverse[i, i], np.eye(count)[i]), _PARABOLA_SHARE * width**2 / inverse[i, i]
            reach = {"known": width, "shortest": width, "longest": _MAX_WIDENING * width}
            half_widths[i] = profile_half_width(function, minimum, ways, bounds, rise, **reach)
    return half_widths


def _at_solution(
    fit: CandidateFit, at: LocalInformation, comparison: Comparison
) -> tuple[ResidualFunction, Minimum, SearchDomain]:
    """The residuals as a function of the parameters, the solution, and the bounds."""
    cost = float(np.square(at.residual, dtype=np.float64).sum())
    minimum = Minimum(at.parameters.pack(fit.values), cost, at.residual, 0)
    return residual_function(at.parameters, fit.values, comparison), minimum, at.parameters.bounds()


def _edge_half_widths(
    fit: CandidateFit, at: LocalInformation, comparison: Comparison, config: SearchConfig
) -> dict[str, float]:
    """For each effect with hard edges, half the interval of its parameters that move them, in priors.

    An edge may move between two samples and change nothing. Size and centre of a stop both move each of its sides:
    varied alone, a parameter ends where the first side passes a sample, while both together could go on. The root of
    the sum of squares of their profiles allows for this: for two opposite sides, anywhere between samples, the true
    range is at most √5/2 of the root.
    """
    squares: dict[str, float] = {}
    for axis, (effect, parameter) in enumerate(at.parameters.entries):
        if parameter.non_smooth:
            half_width = _profile_of_edge(fit, at, axis, comparison, config)
            squares[effect] = squares.get(effect, 0.0) + half_width**2
    return {effect: float(np.sqrt(total)) for effect, total in squares.items()}


def _profile_of_edge(
    fit: CandidateFit, at: LocalInformation, axis: int, comparison: Comparison, config: SearchConfig
) -> float:
    """How far a parameter with a hard edge may move alone before the captures object, in priors.

    Of large pictures only some captures are asked: where few object, all do, so that the result is rather too large.
    """
    where, some = comparison.parts()[-1]
    part = replace(at, residual=at.residual[where])
    function, minimum, bounds = _at_solution(fit, part, some)
    rise = config.verdict.min_delta_chi2 * max(1.0, minimum.cost / some.pixel_count)
    step, along = float(bounds.step[axis]), np.eye(len(at.parameters))[axis]
    return profile_half_width(
        function, minimum, (along,), bounds, rise, shortest=_EDGE_STEPS[0] * step, longest=_EDGE_STEPS[1] * step
    )


def canonical_correlation(first: Slopes, second: Slopes, known: Slopes | None = None) -> float:
    """The largest correlation between any two combinations of two sets of slopes, each (parameter, pixel).

    known: slopes whose span is projected out of both sets first.
    """
    a, b = (_orthonormal(_project_out(slopes, known)) for slopes in (first, second))
    if not len(a) or not len(b):
        return 0.0
    return float(min(1.0, np.linalg.svd((a @ b.T).astype(np.float64), compute_uv=False)[0]))


def share_in_span(change: Slopes, slopes: Slopes, known: Slopes) -> float:
    """The share 0 … 1 of a change's square, (pixel,), that lies in the span of slopes (parameter, pixel).

    known: slopes whose span is projected out of both first. 0 where nothing is left of the change.
    """
    left = _project_out(change[None], known)[0]
    inside = _orthonormal(_project_out(slopes, known)) @ left
    return float(min(1.0, inside @ inside / max(float(left @ left), 1e-30)))


def _project_out(slopes: Slopes, known: Slopes | None) -> Slopes:
    if known is None or not len(known):
        return slopes
    basis = _orthonormal(known)
    return np.asarray(slopes - (slopes @ basis.T) @ basis, dtype=np.float32)


def _orthonormal(slopes: Slopes) -> Slopes:
    """An orthonormal basis (rows) of the rows' span; rows that are numerically dependent are left out."""
    norms = np.linalg.norm(slopes, axis=1)
    unit = slopes[norms > 0] / norms[norms > 0, None]
    if not len(unit):
        return unit
    gram = (unit @ unit.T).astype(np.float64)
    values, vectors = np.linalg.eigh(gram)
    good = values > 1e-4 * values.max()
    return np.asarray((vectors[:, good] / np.sqrt(values[good])).T @ unit, dtype=np.float32)


def format_value(effect_id: str, parameter: str, interval: Interval) -> str:
    """A parameter of an effect as text: value ± half the width of its interval, and the unit."""
    whole = parameter.partition("[")[0]  # of an entry of a list, the list
    p = next(p for p in get_effect(effect_id).parameters if p.name == whole)
    value, half = (_number(p, x) for x in (interval.value, interval.half_width))
    if not math.isfinite(half):
        return f"{value:.3g} ± unknown {p.display_unit}".rstrip()
    decimals = max(0, min(12, 1 - math.floor(math.log10(half)))) if half > 0 else 6
    return f"{value:.{decimals}f} ± {half:.{decimals}f} {p.display_unit}".rstrip()


def format_number(effect_id: str, parameter: str, value: float) -> str:
    """A value to three digits, and its unit."""
    p = next(p for p in get_effect(effect_id).parameters if p.name == parameter)
    return f"{_number(p, value):.3g} {p.display_unit}".rstrip()


def _number(p: Parameter, value: float) -> float:
    """The value in the unit that the parameter is written in."""
    if not p.is_quantity or not math.isfinite(value):
        return value
    return float(units.format_exact(value, p.display_unit).split()[0])
