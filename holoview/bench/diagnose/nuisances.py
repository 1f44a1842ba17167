"""Differences between every bench and its model that are no fault: PRNU, a camera that moves, laser drift, sampling.

PRNU (pixels of unequal sensitivity) and movements of the camera are looked for where a model is good enough to show
them: under the nominal model, and again under the best model. No cause may take the place of either.

Lasers may drift: each capture chooses its own wavelength among a few near the nominal wavelength. Derivatives can't
replace the trials, because a small drift moves the edge of an iris over whole samples. Drift is no fault where it takes
the residuals to the noise and its mean isn't significant.

Coarse samples of the model look like lost contrast, which a blur, bandwidth and an extended source partly explain. So
the held-out captures are predicted once more with finer samples, larger grids, and camera pixels that integrate or
don't (`sampling_choice`). A cause that such samples make superfluous isn't named. Where nobody stated whether pixels
integrate, that counts as much as a cause: one that isn't needed beside it isn't named even if it explains all.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from holoview.bench.captures.predictor import PLAIN, SamplingConfig
from holoview.bench.captures.prepared_captures import estimate_prnu
from holoview.bench.diagnose.capture_split import spread_over_wavelengths
from holoview.bench.diagnose.config import SearchConfig
from holoview.bench.diagnose.fit import CandidateFit, FittedValues, local_fit
from holoview.bench.diagnose.judge import (
    Decision,
    HeldOutScore,
    SearchResult,
    Verdict,
    chance_excess,
    jitter_excess,
    score_on_held_out,
)
from holoview.bench.diagnose.likelihood import Comparison, Values, mean_is_significant
from holoview.bench.diagnose.sampling_choice import (
    MOST_BY_SAMPLES,
    REFITTED,
    finer_samples,
    further_samples,
    other_samplings,
)
from holoview.bench.diagnose.screening import COSTLY_FIELDS, field_count
from holoview.bench.diagnose.search_context import SearchContext
from holoview.light.numerics.sampling import AREA

_SAMPLING_CAPTURES = 4  # [captures] Held-out captures that are predicted with each sampling.
_NEAR_CANDIDATES = 3  # [candidates] The best, beside which finer samples of a near field are tried.
_CACHE_MB = 64
"""[MB] Cache of each predictor. Evidence: causes are left out one after the other, which changes only a part of a
prediction."""
_REFIT_CAPTURES = 2
"""[captures] To which a candidate of many fields is fitted with finer samples, and that judge these. Evidence: reason:
each takes hundreds of fields."""
_MAX_LEFT_SHARE = 0.5
"""[1] Other samples count if they leave less than this share of the excess; a cause is needed beside them if it removes
this share of their excess."""
_PRNU_MAX_CHI2 = 3.0  # [χ²/n] Up to here residuals tell PRNU from errors of the model.
_MAX_PRNU = 0.1  # [1] Largest standard deviation of the pixels' relative sensitivity; the benchmark has 0.01.
_MIN_PRNU_CHI2 = 0.005  # [χ²/n] PRNU that adds less than this is ignored.
_JITTER_MAX_EXCESS = 0.5
"""[1] The camera moves if taking movements out leaves less than this share of the excess. Evidence: real movements
explain nearly all of the excess, apparent movements under a wrong model little."""
DRIFT_STEP_M = 0.02e-9
"""[m] Distance between two wavelengths that are tried; the screening study detected an offset of 0.0026 nm in bright
captures."""
DRIFT_STEPS = 10
"""[1] Steps tried either way, ± 0.2 nm with the default step. Evidence: the benchmark drifts by 0.05 nm r.m.s., of
which this is 4 σ."""
_DRIFT_P_VALUE = 1e-3
"""[1] A mean drift with less than this probability under jitter alone is systematic."""


def detect_nuisances(context: SearchContext, values: FittedValues) -> SearchContext:
    """The context with movements of the camera and PRNU, where a model with these values shows them."""
    return _detect_prnu(_detect_camera_jitter(context, values), values)


def excuse_laser_drift(context: SearchContext, result: SearchResult, decision: Decision) -> tuple[Decision, list[str]]:
    """The decision, consistent where undirected drift of the lasers leaves no more than jitter does; with a note."""
    if decision.verdict is not Verdict.UNEXPLAINED or DRIFT_EFFECT not in context.effects:
        return decision, []
    drift = estimate_laser_drift(result.comparison, {})
    max_excess = jitter_excess(result.pixel_count)
    if drift.is_systematic or drift.chi2_per_pixel - 1.0 > max_excess:
        return decision, []
    note = f"The wavelengths drift by {drift.rms_m * 1e9:.2g} nm (r.m.s.) between captures; that explains what is left."
    return Decision(Verdict.CONSISTENT, None), [note]


def _detect_camera_jitter(context: SearchContext, values: FittedValues) -> SearchContext:
    """The context with a camera that moves from capture to capture, where that explains most of the excess."""
    comparison = context.model_weighted_comparison(context.split.held_out, values)
    excess = comparison.chi2_per_pixel(values) - 1.0
    small = excess < jitter_excess(comparison.pixel_count)
    if context.has_camera_jitter or small or len(context.split.held_out) < 2:
        return context
    moving = replace(context, has_camera_jitter=True)
    left = moving.model_weighted_comparison(context.split.held_out, values).chi2_per_pixel(values) - 1.0
    return moving if left < _JITTER_MAX_EXCESS * excess else context


def _detect_prnu(context: SearchContext, values: FittedValues) -> SearchContext:
    """The context with PRNU, where the residuals of two disjoint sets of captures show the same pattern."""
    sets = [context.split.fine, context.split.held_out]
    comparisons = [context.model_weighted_comparison(indices, values) for indices in sets]
    if context.prnu or max(c.chi2_per_pixel(values) for c in comparisons) > _PRNU_MAX_CHI2:
        return context
    fits = [c.fit_gains(values) for c in comparisons]
    expected = [fitted.expected for fitted in fits]
    residuals = [c.residual_counts(fitted) for c, fitted in zip(comparisons, fits, strict=True)]
    prnu = min(estimate_prnu(residuals, expected, [c.weight > 0 for c in comparisons]), _MAX_PRNU)
    added = [np.square(prnu * e * c.weight).sum() / c.pixel_count for e, c in zip(expected, comparisons, strict=True)]
    return replace(context, prnu=prnu) if max(added) > _MIN_PRNU_CHI2 else context


DRIFT_EFFECT, _PARAMETER = "wavelength_offset", "offset"


@dataclass(frozen=True)
class LaserDrift:
    """R.m.s. drift (m) over the captures, χ²/n with a wavelength for each capture, and whether the mean stands out."""

    rms_m: float
    chi2_per_pixel: float
    is_systematic: bool


def estimate_laser_drift(comparison: Comparison, values: FittedValues) -> LaserDrift:
    """The wavelength that suits each capture best, and the excess that these wavelengths leave."""
    known = values.get(DRIFT_EFFECT, {})
    offsets_m = DRIFT_STEP_M * np.arange(-DRIFT_STEPS, DRIFT_STEPS + 1)
    squares = [
        comparison.fit_gains(
            {**values, DRIFT_EFFECT: {**known, _PARAMETER: known.get(_PARAMETER, 0.0) + float(offset)}}
        ).squares
        for offset in offsets_m
    ]
    drifts = offsets_m[np.argmin(squares, axis=0)]
    return LaserDrift(
        rms_m=float(np.sqrt(np.mean(np.square(drifts)))),
        chi2_per_pixel=float(np.min(squares, axis=0).sum() / comparison.pixel_count),
        is_systematic=bool(mean_is_significant(drifts, _DRIFT_P_VALUE)),
    )


AlternativeComparisons = Mapping[SamplingConfig, Comparison]


def drop_sampling_artefacts(
    context: SearchContext, result: SearchResult, decision: Decision
) -> tuple[Decision, list[str], SamplingConfig | None]:
    """The decision without causes that other samples make superfluous; with notes, and with the sampling that would
    explain the captures better where nobody stated whether camera pixels integrate.

    A model that predicts the captures down to their noise is compared with the other kind of pixels alone. A nominal
    bench that leaves no more than chosen samples may is consistent.
    """
    best, config = decision.best, context.config
    at_noise = best is not None and best.excess <= chance_excess(result.pixel_count)
    is_open = context.has_open_sampling
    if decision.verdict is Verdict.CONSISTENT or (at_noise and not is_open):
        return decision, [], None
    if may_be_samples(context, result.nominal.excess, result.pixel_count):
        note = (
            f"Nothing is named: of finer samples that were assumed, still finer ones may take what the nominal bench "
            f"leaves (χ²/n {result.nominal.chi2_per_pixel:.4g}, of which {context.left_by_samples:.2g} may be theirs)."
        )
        return Decision(Verdict.CONSISTENT, None), [note], None
    notes = []
    if best is not None and not at_noise and may_be_samples(context, best.excess, result.pixel_count):
        notes.append(f"Of what is left, still finer samples than those assumed may take {context.left_by_samples:.2g}.")
    comparison = _check_comparison(context, decision)
    alternatives = _alternative_comparisons(context, comparison, at_noise)
    needed_gain = (-1.0 if at_noise else 1.0) * config.verdict.min_delta_chi2
    dropped: list[str] = []
    better: SamplingConfig | None = None
    while best is not None and (found := _dispensable_cause(config, comparison, alternatives, best, needed_gain)):
        dropped.append(found[0])
        better = found[1]
        fewer = best.fit.without(found[0])
        best = score_on_held_out(fewer, result.comparison, result.tolerant_comparison) if fewer.causes else None
    as_much = "as much as" if at_noise else "more than"
    notes += [f"{name} is not named: other samples of the same bench explain {as_much} it does." for name in dropped]
    if dropped:
        decision = Decision(Verdict.PARTLY if best else Verdict.UNEXPLAINED, best)
    if decision.verdict in (Verdict.PARTLY, Verdict.UNEXPLAINED):
        values = best.fit.values if best else {}
        decision, more, credited = _credit_sampling(config, comparison, alternatives, decision, values)
        notes, better = notes + more, credited or better
    if context.data.captures.chain is None:
        is_open &= better is not None and (better.points == AREA) != (context.sampling.points == AREA)
    return decision, notes, better if is_open and decision.verdict is not Verdict.CONSISTENT else None


def may_be_samples(context: SearchContext, excess: float, pixels: float) -> bool:
    """Whether an excess of χ²/n over so many pixels is no more than still finer samples than those that were chosen may
    take."""
    may_leave = context.left_by_samples
    return may_leave > 0 and excess <= math.hypot(jitter_excess(pixels), may_leave)


def samples_that_explain(context: SearchContext, result: SearchResult) -> SamplingConfig | None:
    """The samples that explain what one of the best candidates leaves, where nobody stated how the light is sampled.

    In the near field they have to explain nearly all of it, as of a nominal bench. Candidates without one of their
    causes are asked too, since it may already have been fitted to what samples leave.
    """
    captures = context.data.captures
    if not context.has_open_sampling or captures.is_fourier or not result.best.causes:
        return None
    if captures.chain is not None:
        decision = Decision(Verdict.PARTLY, result.best)
        comparison = _check_comparison(context, decision)
        alternatives = _alternative_comparisons(context, comparison, only_pixels=False)
        return _credit_sampling(context.config, comparison, alternatives, decision, result.best.fit.values)[2]
    if context.sampling != PLAIN:
        return _further_near(context, result.best)
    return next(filter(None, (_explaining_near(context, one) for one in result.candidates[:_NEAR_CANDIDATES])), None)


def _further_near(context: SearchContext, best: HeldOutScore) -> SamplingConfig | None:
    """Samples finer than those that were chosen, where the best candidate leaves what they take."""
    comparison, values = _check_comparison(context, Decision(Verdict.PARTLY, best)), best.fit.values
    if context.relative_model_error(values, comparison.indices) > MOST_BY_SAMPLES:
        return None

    def measured(sampling: SamplingConfig) -> float:
        return _with_sampling(context, comparison, sampling).chi2_per_pixel(values)

    left, pixels = comparison.chi2_per_pixel(values), comparison.pixel_count
    return further_samples(context.data.captures, context.sampling, left, pixels, measured)


def _explaining_near(context: SearchContext, candidate: HeldOutScore) -> SamplingConfig | None:
    """The samples of a near field that explain what a candidate leaves, or what it leaves without one of its causes."""
    if field_count(context, candidate.fit.values) >= COSTLY_FIELDS:
        return _explaining_costly(context, candidate.fit)
    comparison = _check_comparison(context, Decision(Verdict.PARTLY, candidate))

    def measured(values: Values, sampling: SamplingConfig) -> float:
        return _with_sampling(context, comparison, sampling).chi2_per_pixel(values)

    needed_gain = context.config.verdict.min_delta_chi2 / comparison.pixel_count
    most = comparison.chi2_per_pixel(candidate.fit.values) - needed_gain
    fewer = [candidate.fit.without(name) for name in candidate.causes] if len(candidate.causes) > 1 else []
    for values in (fit.values for fit in (candidate.fit, *fewer)):
        if context.relative_model_error(values, comparison.indices) > MOST_BY_SAMPLES:
            continue
        left, pixels = comparison.chi2_per_pixel(values), comparison.pixel_count
        chosen = finer_samples(context.data.captures, left, pixels, partial(measured, values))
        if chosen is not None and chosen.chi2 <= most:
            return chosen.sampling
    return None


def _explaining_costly(context: SearchContext, candidate: CandidateFit) -> SamplingConfig | None:
    """As `_explaining_near`, for a candidate that takes detail away in many fields, as pixels that integrate do: it is
    fitted again with the samples of which it may have taken the part."""
    captures, own = context.data.captures, candidate.values
    judging, fitting = (
        spread_over_wavelengths(captures, indices, _REFIT_CAPTURES)
        for indices in (context.split.held_out, context.split.coarse)
    )
    error = context.relative_model_error(own, judging)
    if error > MOST_BY_SAMPLES or REFITTED[0] not in other_samplings(captures, PLAIN):
        return None
    effects = [context.effects[name] for name in candidate.causes]
    tolerant = _with_sampling(context, context.tolerant_comparison(fitting, error), REFITTED[0])
    again = local_fit(effects, own, tolerant).values
    by_model = context.model_weighted_comparison(judging, own)
    left, pixels = by_model.chi2_per_pixel(own), by_model.pixel_count

    def measured(sampling: SamplingConfig) -> float:
        return _with_sampling(context, by_model, sampling).chi2_per_pixel(again)

    chosen = finer_samples(captures, left, pixels, measured, is_dear=True)
    return None if chosen is None else chosen.sampling


def _with_sampling(context: SearchContext, comparison: Comparison, sampling: SamplingConfig) -> Comparison:
    """A comparison with a predictor of other samples."""
    return comparison.with_predictor(context.predictor.create(**sampling.keywords, cache_mb=_CACHE_MB))


def _credit_sampling(
    config: SearchConfig,
    comparison: Comparison,
    alternatives: AlternativeComparisons,
    decision: Decision,
    values: Values,
) -> tuple[Decision, list[str], SamplingConfig | None]:
    """The decision with a note on other samples that explain much of the remaining excess, and these samples;
    consistent if they explain all of it."""
    alternative, left = _best_alternative(alternatives, values), comparison.chi2_per_pixel(values)
    if alternative is None:
        return decision, [], None
    sampling, chi2 = alternative
    gained = (left - chi2) * comparison.pixel_count
    max_excess = _MAX_LEFT_SHARE * (left - 1.0)
    if gained < config.verdict.min_delta_chi2 or chi2 - 1.0 > max_excess:
        return decision, [], None
    note = f"With {sampling.description} χ²/n is {chi2:.4g}, not {left:.4g}; {sampling.cli_options} diagnoses so."
    if decision.best is None and chi2 - 1.0 < jitter_excess(comparison.pixel_count):
        decision = Decision(Verdict.CONSISTENT, None)
    return decision, [note], sampling


def _best_alternative(alternatives: AlternativeComparisons, values: Values) -> tuple[SamplingConfig, float] | None:
    """The best other sampling with these causes, and its χ²/n; None where there is no other."""
    return min(
        ((sampling, other.chi2_per_pixel(values)) for sampling, other in alternatives.items()),
        key=lambda pair: pair[1],
        default=None,
    )


def _alternative_comparisons(
    context: SearchContext, comparison: Comparison, only_pixels: bool
) -> dict[SamplingConfig, Comparison]:
    """The comparison with each other sampling; only_pixels: with those that differ in the camera's pixels alone."""
    captures, own = context.data.captures, context.sampling
    possible = other_samplings(captures, own)
    if only_pixels:
        possible = [one for one in possible if replace(one, points=None) == replace(own, points=None)]
    return {sampling: _with_sampling(context, comparison, sampling) for sampling in possible}


def _check_comparison(context: SearchContext, decision: Decision) -> Comparison:
    """A few held-out captures, with the weights of the noise at the best model."""
    count = _SAMPLING_CAPTURES
    few = spread_over_wavelengths(context.data.captures, context.split.held_out, count)
    return context.model_weighted_comparison(few, decision.best.fit.values if decision.best else {})


def _dispensable_cause(
    config: SearchConfig,
    comparison: Comparison,
    alternatives: AlternativeComparisons,
    best: HeldOutScore,
    needed_gain: float,
) -> tuple[str, SamplingConfig] | None:
    """A cause that other samples make superfluous, and these samples: without it they leave so much less of χ² than the
    model with it, and adding it gains nothing."""
    left = comparison.chi2_per_pixel(best.fit.values)
    for name in reversed(best.causes):
        alternative = _best_alternative(alternatives, best.fit.without(name).values)
        if alternative is None:
            continue
        sampling, chi2 = alternative
        if (left - chi2) * comparison.pixel_count < needed_gain:
            continue
        gain = chi2 - alternatives[sampling].chi2_per_pixel(best.fit.values)
        needed = _MAX_LEFT_SHARE * (chi2 - 1.0)
        if gain < max(needed, config.verdict.min_delta_chi2 / comparison.pixel_count):
            return name, sampling
    return None
