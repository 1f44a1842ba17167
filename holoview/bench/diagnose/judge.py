"""How candidates are accepted: ranked on captures that no fit has used, and the verdict on the best of them.

All candidates are ranked with the same frozen weights: with one variance for all, the log-likelihoods of two candidates
differ by half the difference of their χ². Of the variances that the best candidates predict, the likeliest is taken; χ²
alone would choose the largest (docs/diagnosis-evidence.md#one-noise-for-all-candidates). The true cause is recognised
by how close it comes to the noise floor on held-out captures, not by the share of the excess that it explains, of which
a blur often explains nine tenths.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2 as chi_squared
from scipy.stats import t as student

from holoview.bench.captures.predictor import SamplingConfig
from holoview.bench.diagnose.config import SearchConfig, VerdictConfig
from holoview.bench.diagnose.fit import CandidateFit, FittedValues, cost_or_inf
from holoview.bench.diagnose.likelihood import Comparison
from holoview.bench.diagnose.search_context import MAX_TOLERATED_ERROR, SearchContext

MIN_EXPLAINED_SHARE = 0.5
"""[1] Causes are named only if they explain this share of the excess. Evidence: the screening study: no false alarm in
10 runs each of no fault, PRNU, and jitter of exposure, wavelength and camera; jitter gives many causes a little."""
JITTER_EXCESS = 0.02
"""[χ²/n] Excess that jitter of an ordinary laboratory leaves: consistent below it, and a single cause that reaches it
ends the search. Evidence: the search study."""
CHANCE_SIGMAS = 2.5
"""[σ] A search takes an excess within so many standard deviations √(2/n) for chance. Evidence: the deviation is a
derivation."""
FALSE_ALARM = 1e-6
"""[1] Chance that a verdict blames captures of a right model, or correct records of the noise. Evidence: a convention;
2.5 σ blamed one of 200 to 500 files."""
EXPLAINED_MAX_SHARE = 0.2
"""[1] A verdict is `explained` up to this share of the nominal excess. Evidence: the search study; of a large error a
blur explains nine tenths."""
RIVAL_FACTOR = 2.0
"""[1] Causes that leave less than so many times the best excess aren't excluded. Evidence: the search study."""
RIVAL_EXCESS = 0.01
"""[χ²/n] For `RIVAL_FACTOR` the best excess counts as at least this. Evidence: the search study; smaller differences
may be the model's own accuracy."""
RIVAL_EXCESS_SHARE = 0.1
"""[1] `RIVAL_EXCESS` is at most this share of the nominal excess. Evidence: small faults are told apart too."""
NEAR_CHI2 = 1.3
"""[χ²/n] Below it the weights of the noise order candidates, above it tolerant weights; a single cause that reaches it
is ranked at once. Evidence: weights from a wrong model favour similar errors."""
_TIE_EXCESS_SHARE = 0.02
"""[1] Candidates within this share of the best excess tie, apart from the next two. Evidence: the search study."""
_TIE_EXCESS = 0.02  # [χ²/n] … or within that share and this χ²/n together. Evidence: the search study.
_TIE_NEAR_SHARE = 0.1
"""[1] `_TIE_EXCESS` counts at most as this share of the excess, so that near the floor small differences decide."""
_NOISE_MODELS = 4  # [candidates] Whose noise is compared. Evidence: the cost, two predictions for each.
_SAME_LIGHT_COST = 1.1
"""[1] The noise of a candidate is compared only if its tolerant cost is below this factor times the lowest tolerant
cost of all. Evidence: a reason: a fit that predicts the light clearly worse has no better noise to offer; light of the
room and a black level of 45 counts differed by 0.1 %."""
NOISE_ACCURACY = 0.02
"""[χ²/n] Deficit that isn't blamed. Evidence: electrons per count, by which variances scale, are seldom measured
better; as much as `JITTER_EXCESS` on the other side."""
_NOISE_BLOCK_PX = 8
"""[px] Side of a block. Evidence: a reason: readout correlates a few neighbours; a picture of 64 × 64 pixels still has
64 blocks."""
_MIN_NOISE_BLOCKS = 10  # [blocks] Of fewer the scatter isn't known.
_LEAST_NOISE = 1.0 / 3.0
"""[counts²] Pixels of less noise, rounding included, aren't counted. Evidence: derivation: rounding adds 1/12 to noise
of standard deviation σ only if that is half a count or more (the error is below 2·exp(−2π²σ²) = 1.4 %); in the dark of
a camera of few bits every pixel may read the same."""
_CLEAR_OF_0 = 3.0
"""[σ] Pixels that are expected nearer to 0 counts aren't counted, since no camera reads less. Evidence: derivation:
noise that ends 3 σ below its mean has 0.3 % less variance, at 1.5 σ 11 %."""
FLOOR_CHI2 = 1.05  # [χ²/n] Below it no further cause is searched. Evidence: the search study.
JITTER_CHI2 = 1.0 + JITTER_EXCESS  # [χ²/n] Left by jitter of an ordinary laboratory.


@dataclass(frozen=True)
class HeldOutScore:
    """A fit and its χ²/n on held-out captures.

    tolerant_chi2: the same with weights that tolerate the present error of the model.
    """

    fit: CandidateFit
    chi2_per_pixel: float
    tolerant_chi2: float

    @property
    def causes(self) -> tuple[str, ...]:
        """The effects that are on."""
        return self.fit.causes

    @property
    def excess(self) -> float:
        """χ²/n beyond the noise floor."""
        return self.chi2_per_pixel - 1.0


Correlations = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class Lookalikes:
    """Effects that change the captures much as the causes of a fit do.

    correlations: {cause: {effect: canonical correlation}}, the largest first. shares: {cause: {effect: share of the
    square of the cause's change that the effect's derivatives explain}}, of effects that aren't the same physics on
    every bench.
    """

    fit: CandidateFit
    correlations: Correlations
    shares: Correlations


@dataclass(frozen=True)
class SearchResult:
    """The result of a search. nominal: the nominal bench. candidates: best first, all with the same frozen weights.

    lookalikes: of the best candidate's causes, where rivals were looked for. unseen_rivals: fits that predict the same
    as the best candidate, with an effect that only other captures can tell from its cause. better_sampling: explains
    what a candidate leaves, so that the search ended.
    """

    nominal: HeldOutScore
    candidates: tuple[HeldOutScore, ...]
    comparison: Comparison
    tolerant_comparison: Comparison
    lookalikes: Lookalikes | None = None
    unseen_rivals: tuple[CandidateFit, ...] = ()
    better_sampling: SamplingConfig | None = None

    @property
    def best(self) -> HeldOutScore:
        """The best candidate; the nominal bench where there is none."""
        return self.candidates[0] if self.candidates else self.nominal

    @property
    def pixel_count(self) -> float:
        """Number of held-out pixels."""
        return self.comparison.pixel_count


NOMINAL_FIT = CandidateFit((), {}, float("inf"))

HasCauses = TypeVar("HasCauses", CandidateFit, HeldOutScore)


def rank_on_held_out(context: SearchContext, fits: Sequence[CandidateFit]) -> SearchResult:
    """All fits on the held-out captures, with weights frozen at the likeliest noise that the best of them predict.

    Weights from a wrong prediction favour similar errors. So while even the best fit is far off, the order is by
    weights that tolerate its error.
    """
    indices, all_fits = context.split.held_out, [NOMINAL_FIT, *fits]
    rough = context.data_weighted_comparison(indices, MAX_TOLERATED_ERROR)
    first = min(all_fits, key=lambda f: cost_or_inf(rough, f.values))
    tolerant = context.tolerant_comparison(indices, context.relative_model_error(first.values, indices))
    comparison = _likeliest_noise(context, tolerant, all_fits)
    scores = [score_on_held_out(f, comparison, tolerant) for f in fits]
    near = min((s.chi2_per_pixel for s in scores), default=np.inf) < NEAR_CHI2
    if near:
        ordered = sorted(scores, key=lambda s: s.chi2_per_pixel)
        ordered = _simpler_first(ordered, comparison.pixel_count, context.config)
    else:
        ordered = sorted(scores, key=lambda s: s.tolerant_chi2)
    nominal = score_on_held_out(NOMINAL_FIT, comparison, tolerant)
    result = SearchResult(nominal, tuple(first_per_cause_set(ordered)), comparison, tolerant)
    context.best_so_far.note(result)
    return result


def _likeliest_noise(context: SearchContext, tolerant: Comparison, fits: Sequence[CandidateFit]) -> Comparison:
    """Weights of the likeliest of the noises that the best fits predict. Light of the room has shot noise, a wrong
    black level has none, and both may predict the same picture.
    """
    costs = [cost_or_inf(tolerant, fit.values) for fit in fits]
    order = sorted(range(len(fits)), key=costs.__getitem__)
    close = [fits[k] for k in order[:_NOISE_MODELS] if costs[k] <= _SAME_LIGHT_COST * costs[order[0]]]
    comparisons = [context.model_weighted_comparison(tolerant.indices, fit.values) for fit in close]
    if len(close) == 1:
        return comparisons[0]
    deviances = [one.deviance(fit.values) for one, fit in zip(comparisons, close, strict=True)]
    return comparisons[int(np.argmin(deviances))]


def score_on_held_out(fit: CandidateFit, comparison: Comparison, tolerant_comparison: Comparison) -> HeldOutScore:
    """One fit, with weights that were frozen before."""
    tolerant = cost_or_inf(tolerant_comparison, fit.values) / tolerant_comparison.pixel_count
    return HeldOutScore(fit, comparison.chi2_per_pixel(fit.values), tolerant)


def first_per_cause_set(items: Sequence[HasCauses]) -> list[HasCauses]:
    """The first score of each set of causes."""
    seen: dict[frozenset[str], HasCauses] = {}
    for item in items:
        seen.setdefault(frozenset(item.causes), item)
    return list(seen.values())


def _simpler_first(scores: Sequence[HeldOutScore], pixels: float, config: SearchConfig) -> list[HeldOutScore]:
    """Scores sorted by χ²/n; among those that tie with the best, fewer causes and parameters come first.

    Ties are within a share of the excess, an excess, and the Δχ² that a cause must gain.
    """
    if not scores:
        return []
    best = scores[0]
    excess = max(best.excess, 0.0)
    tolerance = _TIE_EXCESS_SHARE * excess
    limit = best.chi2_per_pixel + tolerance + min(_TIE_EXCESS, _TIE_NEAR_SHARE * excess)
    limit += config.verdict.min_delta_chi2 / pixels
    leaders = [s for s in scores if s.chi2_per_pixel <= limit]
    rest = [s for s in scores if s.chi2_per_pixel > limit]
    return sorted(leaders, key=lambda s: (len(s.causes), s.fit.parameter_count, s.chi2_per_pixel)) + rest


Equivalents = Mapping[str, frozenset[str]]


class Verdict(StrEnum):
    """The verdict on a diagnosis."""

    CONSISTENT = "consistent"
    EXPLAINED = "explained"
    PARTLY = "partly-explained"
    AMBIGUOUS = "ambiguous"
    UNEXPLAINED = "unexplained"

    @property
    def is_open(self) -> bool:
        """Whether causes are left to find."""
        return self in (Verdict.UNEXPLAINED, Verdict.PARTLY)


@dataclass(frozen=True)
class Decision:
    """The verdict, the candidate that it rests on (None: no cause is named), and rivals that can't be excluded."""

    verdict: Verdict
    best: HeldOutScore | None
    rivals: tuple[HeldOutScore, ...] = ()

    @property
    def values(self) -> FittedValues:
        """The effects of the candidate; none where no cause is named."""
        return self.best.fit.values if self.best else {}


def decide(result: SearchResult, equivalents: Equivalents, config: VerdictConfig) -> Decision:
    """The verdict on a search. equivalents: for each effect those that are the same physics."""
    nominal, best, n = result.nominal, result.best, result.pixel_count
    excess = nominal.excess
    gain = (nominal.chi2_per_pixel - best.chi2_per_pixel) * n
    share = _share_explained(nominal, best)
    if not (result.candidates and gain > config.min_delta_chi2 and share >= MIN_EXPLAINED_SHARE):
        is_consistent = excess < jitter_excess(n)
        return Decision(Verdict.CONSISTENT if is_consistent else Verdict.UNEXPLAINED, None)
    if best.excess > explained_excess(excess, n, config):
        return Decision(Verdict.PARTLY, best)
    rivals = _rivals_of(best, result, equivalents, config)
    return Decision(Verdict.AMBIGUOUS if rivals else Verdict.EXPLAINED, best, rivals)


@dataclass(frozen=True)
class NoiseCheck:
    """χ²/n of pixels whose noise is more than rounding, and the least that correct records of the noise allow."""

    chi2_per_pixel: float
    least: float

    @property
    def is_overstated(self) -> bool:
        """Whether the captures scatter significantly less than their records say."""
        return self.chi2_per_pixel < self.least


def check_noise(comparison: Comparison, values: FittedValues) -> NoiseCheck:
    """Whether residuals are too small for the noise that the records state, where noise can't take a pixel below 0.

    Each of K captures has p fitted numbers, its gain and its movement, so that the mean of χ²/n is 1 − pK/n. Its
    scatter is taken from the sums of square blocks of pixels, whatever the distribution of the noise and however
    neighbouring pixels correlate; it is at least that of independent Gaussian noise, √(2/n). Student's t for the number
    of blocks gives the deviation that chance exceeds once in a million files.
    """
    fitted = comparison.fit_gains(values)
    noisy = (comparison.weight > 0) & (np.square(comparison.weight) < 1.0 / _LEAST_NOISE)
    counts_above_0 = fitted.expected + comparison.data.captures.camera.black_level
    noisy &= counts_above_0 * comparison.weight > _CLEAR_OF_0
    sums = _block_sums(np.where(noisy, np.square(fitted.residual), np.float32(0.0)))
    counts = _block_sums(noisy.astype(np.float32))
    sums, counts = sums[counts > 0], counts[counts > 0]
    pixels, blocks = float(counts.sum()), len(counts)
    if blocks < _MIN_NOISE_BLOCKS:
        return NoiseCheck(1.0, 0.0)
    chi2 = float(sums.sum()) / pixels
    scatter = math.sqrt(float(np.square(sums - chi2 * counts).sum()) * blocks / (blocks - 1)) / pixels
    chance = float(student.isf(FALSE_ALARM, blocks - 1)) * max(scatter, math.sqrt(2.0 / pixels))
    fitted_share = (3 if comparison.fit_shifts else 1) * len(comparison.indices) / pixels
    return NoiseCheck(chi2, 1.0 - fitted_share - math.hypot(NOISE_ACCURACY, chance))


def _block_sums(pictures: NDArray[np.float32]) -> NDArray[np.float64]:
    """Sums over square blocks of pictures (capture, y, x), flat; blocks at the far edges may be smaller."""
    starts = [np.arange(0, n, _NOISE_BLOCK_PX) for n in pictures.shape[1:]]
    rows = np.add.reduceat(pictures, starts[0], axis=1, dtype=np.float64)
    return np.asarray(np.add.reduceat(rows, starts[1], axis=2)).ravel()


def limited_by_noise(decision: Decision, noise: NoiseCheck) -> tuple[Decision, list[str]]:
    """The decision, with a note, where the noise is overstated: such captures neither clear nor explain a bench."""
    if not noise.is_overstated:
        return decision, []
    note = (
        f"The noise is overstated: residuals have {noise.chi2_per_pixel:.3g} of the recorded variance, correct records "
        f"leave at least {noise.least:.3g}. Electrons per count, read noise or averaging are recorded wrongly."
    )
    return replace(decision, verdict=_LOWERED.get(decision.verdict, decision.verdict)), [note]


_LOWERED = {
    Verdict.CONSISTENT: Verdict.UNEXPLAINED,
    Verdict.EXPLAINED: Verdict.PARTLY,
    Verdict.AMBIGUOUS: Verdict.PARTLY,
}


def limited_by_bad_captures(decision: Decision, bad_share: float, max_share: float) -> Decision:
    """The decision where some captures are bad; beyond a share of `max_share` no bench is cleared or explained."""
    if bad_share <= max_share:
        return decision
    return replace(decision, verdict=_LOWERED.get(decision.verdict, decision.verdict))


def with_further_cause(verdict: Verdict) -> Verdict:
    """The verdict once a cause is named that the search for effects doesn't look for."""
    return {Verdict.CONSISTENT: Verdict.EXPLAINED, Verdict.UNEXPLAINED: Verdict.PARTLY}.get(verdict, verdict)


def chance_excess(pixels: float) -> float:
    """The excess χ²/n − 1 that a search takes for chance; its standard deviation is √(2/n)."""
    return float(CHANCE_SIGMAS * (2.0 / pixels) ** 0.5)


def most_by_chance(pixels: float) -> float:
    """The excess χ²/n − 1 that so many pixels of a right model exceed with the chance `FALSE_ALARM`."""
    return float(chi_squared.isf(FALSE_ALARM, pixels)) / pixels - 1.0


def explained_excess(nominal_excess: float, pixels: float, config: VerdictConfig) -> float:
    """The largest excess χ²/n − 1 that causes may leave to count as an explanation."""
    max_excess = min(config.explained_excess, EXPLAINED_MAX_SHARE * nominal_excess)
    return max(most_by_chance(pixels), max_excess)


def jitter_excess(pixels: float, by_chance: Callable[[float], float] = most_by_chance) -> float:
    """The excess χ²/n − 1 that jitter of an ordinary laboratory and chance leave, independent of each other."""
    return math.hypot(JITTER_EXCESS, by_chance(pixels))


def _share_explained(nominal: HeldOutScore, best: HeldOutScore) -> float:
    """Share of the excess that is explained, 0 … 1."""
    if nominal.excess <= 0:
        return 0.0
    return min(1.0, max(0.0, (nominal.chi2_per_pixel - best.chi2_per_pixel) / nominal.excess))


def _rivals_of(
    best: HeldOutScore, result: SearchResult, equivalents: Equivalents, config: VerdictConfig
) -> tuple[HeldOutScore, ...]:
    """Other causes, not more numerous, that come about as close to the floor as the best.

    A candidate that contains all of the best's causes, or the same physics under another name, isn't a rival.
    """
    accuracy = min(RIVAL_EXCESS, RIVAL_EXCESS_SHARE * result.nominal.excess)
    limit = RIVAL_FACTOR * max(best.excess, max(config.min_delta_chi2 / result.pixel_count, accuracy))
    return tuple(
        c
        for c in result.candidates
        if len(c.causes) <= len(best.causes)
        and c.excess < limit
        and not _are_equivalent(c.causes, best.causes, equivalents)
    )


def _are_equivalent(a: Sequence[str], b: Sequence[str], equivalents: Equivalents) -> bool:
    """Whether `b` has, for each cause of `a`, the cause itself or the same physics."""
    return all(any(x == y or y in equivalents.get(x, ()) or x in equivalents.get(y, ()) for y in b) for x in a)
