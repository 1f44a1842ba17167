"""No cause is named that takes away detail which the pictures show, does nothing, or leaves the speckle elsewhere.

Far from the truth predicted grains stand elsewhere than measured ones, and whatever smooths the prediction lowers χ²: a
blur, an extended source, a bandwidth. But detail that such a cause takes away isn't in the pictures either, if the
cause is real. So the detail of the measured and of the predicted pictures is compared, wherever their grains stand.
Effects are judged by what they do to the prediction, none by its name.

A cause without which held-out pictures are predicted as well, even though the other causes aren't fitted again, has
nothing to tell; nor has one whose numbers may all be nominal, as their intervals say. And where the predicted grains
stand nowhere in pictures that show grains, a lower χ² is no evidence.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from holoview.bench.diagnose.capture_split import spread_over_wavelengths
from holoview.bench.diagnose.fit import has_list
from holoview.bench.diagnose.fit_statistics import speckle_change
from holoview.bench.diagnose.intervals import Interval
from holoview.bench.diagnose.judge import (
    Decision,
    HeldOutScore,
    SearchResult,
    Verdict,
    chance_excess,
    decide,
    explained_excess,
    rank_on_held_out,
    score_on_held_out,
)
from holoview.bench.diagnose.likelihood import Values
from holoview.bench.diagnose.refine import refine_fit
from holoview.bench.diagnose.search_context import SearchContext
from holoview.bench.diagnose.speckle_evidence import FAR_CHI2
from holoview.light.model.effects.registry import get_effect
from holoview.light.numerics.speckle_match import local_mean

_CAPTURES = 4  # [captures] Held-out ones whose detail is compared.
_LEAST_DETAIL = 0.6
"""[1] Detail that a true cause leaves, over that of the pictures, is about 1."""
_LIT_NOISES = 4.0  # [σ] Local light above the noise, below which there is nothing to see.
_LEAST_LIT = 500  # [pixels] Of fewer, detail isn't told.

_LEAST_SHARE = 0.01
"""[1] Of the excess χ²/n that a fit leaves: what a cause has to gain at least. Evidence: a reason: what is missing in a
model far from the pictures takes or gives a hundredth by chance; near the floor the least Δχ² counts."""
_NO_SIZE_SHARE = 0.1
"""[1] Of the excess χ²/n, by how much more is left at most without a cause whose numbers may all be nominal: of what
causes leave, or of the nominal bench's where they explain it. Evidence: a reason: the other causes aren't always fitted
again, and take a part of that; near the floor, another program's samples of the same bench differ by hundredths."""
_NO_SIZE_SHARE_REFITTED, _NO_SIZE_SHARE_OF_LEFT = 0.25, 1.0
"""[1] The same where the others were fitted again: of the nominal bench's excess, and of what causes leave. Evidence: a
reason: that the interval, in which the others follow too, holds the nominal value says the same already, with errors as
large as what the model lacks; what takes less than is left may be a part of it."""
_UNCORRELATED = 0.3
"""[1] Correlation of local contrasts below which speckle stands nowhere. Evidence: a real bench: 0.14 with a blur that
wasn't there, 0.77 with the true light."""
_BY_CHANCE, _LEAST_SIGNIFICANCE = 0.6, 4.0
"""[1, σ] A higher correlation is chance's, too, if it is below the first and stands out by less than the second.
Evidence: drawn benches: in a picture of few grains 0.36 and 2.1 σ with a blur that wasn't there; with true causes 5 σ
and more."""
Floats = NDArray[np.float64]
Masks = NDArray[np.bool_]


def veto_lost_detail(context: SearchContext, result: SearchResult, decision: Decision) -> tuple[Decision, list[str]]:
    """The decision without causes that leave less detail than the pictures have, while the prediction without them has
    as much; with notes. A decision that explains the captures stays as it is.
    """
    best, notes = decision.best, list[str]()
    if decision.verdict is not Verdict.PARTLY or best is None:
        return decision, notes
    for name in reversed(best.causes):
        fewer = best.fit.without(name)
        left, without = _detail_share(context, best.fit.values), _detail_share(context, fewer.values)
        if left is None or without is None or left >= _LEAST_DETAIL or abs(np.log(without)) > abs(np.log(left)) / 2:
            continue
        notes.append(
            f"{name} is not named: with it the prediction keeps {left:.0%} of the detail that the pictures show, "
            f"without it {without:.0%}."
        )
        if not fewer.causes:
            return Decision(Verdict.UNEXPLAINED, None), notes
        best = score_on_held_out(fewer, result.comparison, result.tolerant_comparison)
    return (Decision(Verdict.PARTLY, best), notes) if notes else (decision, notes)


def veto_without_effect(context: SearchContext, result: SearchResult, decision: Decision) -> tuple[Decision, list[str]]:
    """The decision without causes that gain nothing on held-out pictures, though no other cause takes their place, or
    only the others as the search has fitted them without it; with notes. One cause stays."""
    best, notes = decision.best, list[str]()
    if best is None:
        return decision, notes
    needed = _needed(context, result, best.excess, _LEAST_SHARE)
    for name in reversed(best.causes):
        if len(best.causes) == 1:
            break
        fewer = _best_without(name, best, result)
        if _lost(fewer, best, result) < needed:
            notes.append(f"{name} is not named: without it the held-out pixels are predicted as well.")
            best = fewer
    return (replace(decision, best=best), notes) if notes else (decision, notes)


def fit_what_stays(context: SearchContext, result: SearchResult, decision: Decision) -> tuple[SearchResult, Decision]:
    """The result and the decision once the causes that no veto dropped are fitted again, with their secondary numbers,
    if they then predict held-out pictures better; candidates with dropped causes no longer count."""
    best = decision.best
    if best is None:
        return result, decision
    fitted = refine_fit(context, best.fit, include_fine=True)
    if score_on_held_out(fitted, result.comparison, result.tolerant_comparison).chi2_per_pixel >= best.chi2_per_pixel:
        return result, decision
    dropped = {*result.best.causes} - {*best.causes}
    result = rank_on_held_out(context, [fitted, *(c.fit for c in result.candidates if not dropped & {*c.causes})])
    return result, decide(result, context.equivalents, context.config.verdict)


def veto_no_size(
    context: SearchContext,
    result: SearchResult,
    decision: Decision,
    intervals: Mapping[tuple[str, str], Interval],
    fitted: SearchContext | None = None,
) -> tuple[SearchResult, Decision, list[str]]:
    """The result and the decision without causes whose every number has its nominal value in its interval, or changes
    nothing once the others have it, as long as held-out pictures are predicted about as well without them; with notes.
    One cause stays. Causes that predict the captures down to their noise explain them without the others too; of those
    that leave more, the captures may be partly explained without the others.

    intervals: of each (effect, parameter). fitted: the captures, or parts of large ones, to which the others are fitted
    again where the cause can't just be left out; None without that.
    """
    best, notes = decision.best, list[str]()
    if best is None:
        return result, decision, notes
    named, nominal = best, result.nominal.excess
    explains = decision.verdict is not Verdict.PARTLY
    limit = explained_excess(nominal, result.pixel_count, context.config.verdict) if explains else math.inf
    most = limit if best.excess <= chance_excess(result.pixel_count) else math.inf
    for name in reversed(named.causes):
        if len(best.causes) == 1 or not _may_be_nominal(name, intervals):
            continue
        fewer = _best_without(name, best, result)
        of_excess = nominal if explains else best.excess
        needed = _needed(context, result, of_excess, _NO_SIZE_SHARE)
        is_missed = _lost(fewer, best, result) >= needed or fewer.excess > limit
        if is_missed and fitted is not None and fitted.end.seconds_left > 0:
            again = refine_fit(fitted, best.fit.without(name))
            fewer = score_on_held_out(again, result.comparison, result.tolerant_comparison)
            share = _NO_SIZE_SHARE_REFITTED if explains else _NO_SIZE_SHARE_OF_LEFT
            needed = _needed(context, result, of_excess, share)
        if _lost(fewer, best, result) < needed and fewer.excess <= most:
            notes.append(f"{name} is not named: each of its numbers may be the nominal one, within its interval.")
            best = fewer
    if not notes:
        return result, decision, notes
    alike, dropped = result.lookalikes, {*named.causes} - {*best.causes}
    if alike is not None and alike.fit is named.fit:
        result = replace(result, lookalikes=replace(alike, fit=best.fit))  # not computed again for those that stay
    rivals = tuple(one for one in decision.rivals if not dropped & {*one.causes})
    verdict = Verdict.PARTLY if best.excess > limit else decision.verdict
    return result, replace(decision, verdict=verdict, best=best, rivals=rivals), notes


def _best_without(name: str, best: HeldOutScore, result: SearchResult) -> HeldOutScore:
    """The best candidate without one of its causes: as it is, or a candidate whose other numbers were fitted again."""
    unfitted = score_on_held_out(best.fit.without(name), result.comparison, result.tolerant_comparison)
    refitted = [one for one in result.candidates if {*one.causes} == {*unfitted.causes}]
    return min([unfitted, *refitted], key=lambda score: score.chi2_per_pixel)


def _needed(context: SearchContext, result: SearchResult, excess: float, share: float) -> float:
    """The χ² that a cause has to gain: a share of an excess χ²/n, and what any cause has to."""
    return max(context.config.verdict.min_delta_chi2, share * max(excess, 0.0) * result.pixel_count)


def _lost(fewer: HeldOutScore, best: HeldOutScore, result: SearchResult) -> float:
    """By how much χ² is higher with fewer causes."""
    return (fewer.chi2_per_pixel - best.chi2_per_pixel) * result.pixel_count


def _may_be_nominal(name: str, intervals: Mapping[tuple[str, str], Interval]) -> bool:
    """Whether the interval of every number of an effect holds its nominal value, but for numbers that change nothing
    once these have it; entries of a list have none."""
    if has_list(get_effect(name)):
        return False
    nominal = {one.name: one.identity for one in get_effect(name).parameters if not one.modifies}
    own = {part: interval for (effect, part), interval in intervals.items() if effect == name and part in nominal}
    return bool(own) and all(abs(one.value - nominal[part]) <= one.half_width for part, one in own.items())


def veto_uncorrelated(context: SearchContext, result: SearchResult, decision: Decision) -> tuple[Decision, list[str]]:
    """No causes, with a note, where a prediction far from the pictures has its grains there by chance at most."""
    best = decision.best
    if decision.verdict is not Verdict.PARTLY or best is None or best.chi2_per_pixel < FAR_CHI2:
        return decision, []
    nominal, fitted = (result.comparison.fit_gains(values) for values in ({}, best.fit.values))
    speckle = speckle_change(result.comparison, nominal, fitted)  # unknown in small pictures
    is_chance = speckle.after < _BY_CHANCE and speckle.significance < _LEAST_SIGNIFICANCE
    is_elsewhere = speckle.after < _UNCORRELATED and _detail_share(context, best.fit.values) is not None
    if not (is_chance or is_elsewhere):
        return decision, []
    note = (
        f"{' and '.join(best.causes)} would lower χ²/n from {result.nominal.chi2_per_pixel:.3g} to "
        f"{best.chi2_per_pixel:.3g}, but the predicted speckle doesn't stand in the pictures (correlation "
        f"{speckle.after:.2f}, {max(speckle.significance, 0.0):.1f} σ above chance): nothing is named."
    )
    return Decision(Verdict.UNEXPLAINED, None), [note]


def _detail_share(context: SearchContext, values: Values) -> float | None:
    """The detail of predicted pictures over that of the measured ones, noise taken out; None where none is seen."""
    few = spread_over_wavelengths(context.data.captures, context.split.held_out, _CAPTURES)
    comparison = context.data_weighted_comparison(few, 0.0)
    expected = comparison.fit_gains(values).expected.astype(np.float64)
    seen = predicted = 0.0
    lit_pixels = 0
    for light, model, weight in zip(comparison.light.astype(np.float64), expected, comparison.weight, strict=True):
        usable = weight > 0
        variance = context.data.camera.noise_variance(np.maximum(light, 0.0))
        mean = local_mean(light, usable)
        lit = usable & (mean > _LIT_NOISES * np.sqrt(variance)) & (local_mean(model, usable) > 0)
        lit_pixels += int(lit.sum())
        seen += detail(light, mean, lit) - _noise_of_detail(variance, mean, lit)
        predicted += detail(model, local_mean(model, usable), lit)
    return predicted / seen if lit_pixels >= _LEAST_LIT and seen > 0 and predicted > 0 else None


def detail(light: Floats, mean: Floats, lit: Masks) -> float:
    """Σ of the squared differences of neighbouring lit pixels (y, x), relative to their local mean."""
    relative = light / np.maximum(mean, 1e-30)
    return float(sum(np.square(np.diff(relative, axis=a))[_both(lit, a)].sum() for a in (0, 1)))


def _noise_of_detail(variance: Floats, mean: Floats, lit: Masks) -> float:
    """What noise of this variance adds to `detail` on average."""
    relative = variance / np.maximum(mean, 1e-30) ** 2
    total = 0.0
    for axis in (0, 1):
        moved, both = np.moveaxis(relative, axis, 0), np.moveaxis(_both(lit, axis), axis, 0)
        total += float((moved[1:] + moved[:-1])[both].sum())
    return total


def _both(lit: Masks, axis: int) -> Masks:
    moved = np.moveaxis(lit, axis, 0)
    return np.moveaxis(moved[1:] & moved[:-1], 0, axis)
