"""The causes of a decision as they are reported: values, intervals, share explained, look-alikes, wrong records.

A look-alike of a cause is an effect that changes the captures in nearly the same way. Where rivals are left, the
capture is proposed that would separate the named causes best from the first rival.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.prepared_captures import FitQuality
from holoview.bench.diagnose.correct.wrong_records import RecordGain
from holoview.bench.diagnose.fit import (
    CandidateFit,
    FittedValues,
    free_parameters_of,
)
from holoview.bench.diagnose.fit_statistics import fit_quality
from holoview.bench.diagnose.intervals import (
    Interval,
    confidence_intervals,
    local_information,
)
from holoview.bench.diagnose.judge import Decision, Lookalikes, SearchResult
from holoview.bench.diagnose.likelihood import Values
from holoview.bench.diagnose.power_law import PowerLawFit
from holoview.bench.diagnose.report.diagnosis import Cause
from holoview.bench.diagnose.rivals import find_lookalikes
from holoview.bench.diagnose.search_context import SearchContext, SearchEnd
from holoview.light.model.effects.effect import Effect, ListParameter
from holoview.util.errors import UserError

MEAN_LIGHT = 0.1
"""[1] Mean signal of a proposed capture over saturation. Evidence: none recorded."""


def intervals_of(fitted: SearchContext, decision: Decision, end: SearchEnd) -> dict[tuple[str, str], Interval]:
    """The interval of each (effect, parameter) that a decision names.

    fitted: the captures, or parts of large ones, from which they follow. end: as of `confidence_intervals`.
    """
    if decision.best is None:
        return {}
    fit = decision.best.fit
    effects = [fitted.effects[name] for name in fit.causes]
    last = fitted.model_weighted_comparison(fitted.split.rough if fit.is_final else fitted.split.fine, fit.values)
    return confidence_intervals(fit, local_information(fit, effects, last), last, fitted.config, end)


def describe_causes(
    context: SearchContext,
    near: SearchContext,
    result: SearchResult,
    decision: Decision,
    intervals: Mapping[tuple[str, str], Interval],
) -> list[Cause]:
    """The causes that a decision names, the one that gains most first.

    near: the same captures, or the middle of large ones, in which look-alikes are computed. intervals: of each (effect,
    parameter), of other causes too.
    """
    if decision.best is None:
        return []
    fit, held_out = decision.best.fit, result.comparison
    after = fit_quality(held_out, held_out.fit_gains(fit.values))
    effects = [context.effects[name] for name in fit.causes]
    alike = result.lookalikes
    lookalikes = alike if alike is not None and alike.fit is fit else find_lookalikes(near, fit)
    rivals = [*(rival.fit for rival in decision.rivals), *result.unseen_rivals]
    separate = best_separating_capture(near, fit, rivals[0]) if rivals else None
    causes = []
    for effect in effects:
        before = fit_quality(held_out, held_out.fit_gains(fit.without(effect.id).values))
        share = (before.chi2_per_pixel - after.chi2_per_pixel) / max(before.chi2_per_pixel - 1.0, 1e-9)
        causes.append(
            Cause(
                effect=effect.id,
                sentence=effect.format_finding(context.system, fit.values[effect.id]),
                intervals={name: interval for (e, name), interval in intervals.items() if e == effect.id},
                units=_units(effect, fit.values),
                lists=_lists(effect, fit.values),
                excess_explained=float(np.clip(share, 0.0, 1.0)),
                gain_db=after.psnr_db - before.psnr_db,
                before=before,
                after=after,
                confounded_with=_alike(effect.id, fit, rivals, lookalikes),
                separate_by=separate,
            )
        )
    return sorted(causes, key=lambda c: -c.gain_db)


def _alike(cause: str, fit: CandidateFit, rivals: Sequence[CandidateFit], lookalikes: Lookalikes) -> dict[str, float]:
    """Look-alikes of a cause of a fit; first the effects that rivals have in its place, which predict the same here."""
    without = [rival.causes for rival in rivals if cause not in rival.causes]
    same = {name: 1.0 for causes in without for name in causes if name not in fit.causes}
    return same | {name: value for name, value in lookalikes.correlations[cause].items() if name not in same}


def describe_wrong_records(gains: Sequence[RecordGain]) -> tuple[Cause, ...]:
    """Wrong records as causes."""
    return tuple(
        Cause(
            effect=gain.correction.effect,
            choice=gain.correction.choice,
            sentence=gain.correction.sentence,
            intervals={},
            units={},
            excess_explained=float(np.clip(gain.share, 0.0, 1.0)),
            gain_db=gain.gain_db,
            before=gain.before,
            after=gain.after,
        )
        for gain in gains
    )


def describe_power_law(context: SearchContext, law: PowerLawFit) -> Cause:
    """A law of the laser's power as a cause. Its gain is that of the spread of the gains; no image shows it."""
    effect = context.effects[law.effect]
    no_image = FitQuality(float("nan"), float("nan"))
    return Cause(
        effect=effect.id,
        sentence=effect.format_finding(context.system, law.values[effect.id]),
        intervals={name: interval for (_, name), interval in law.intervals.items()},
        units=_units(effect, law.values),
        excess_explained=1.0 - (law.spread_after / law.spread_before) ** 2,
        gain_db=20 * float(np.log10(law.spread_before / max(law.spread_after, 1e-9))),
        before=no_image,
        after=no_image,
    )


def _units(effect: Effect, values: Values) -> dict[str, str]:
    """The unit of each parameter, entries of lists included."""
    return {p.name: p.unit for _, p in free_parameters_of([effect], values, include_fine=True).entries}


def _lists(effect: Effect, values: Values) -> dict[str, tuple[float, ...]]:
    """The effect's lists whose entries no fit varies, without empty ones."""
    lists = {p: p.read(values.get(effect.id, {})) for p in effect.parameters if isinstance(p, ListParameter)}
    return {p.name: own for p, own in lists.items() if own and not p.free_entries(own)}


@dataclass(frozen=True)
class ProposedCapture:
    """A proposed capture: in words, and as a data set of this capture alone, whose images are never used."""

    description: str
    captures: Captures


def best_separating_capture(context: SearchContext, first: CandidateFit, second: CandidateFit) -> str | None:
    """In words, the capture that would tell two explanations apart best; None if no proposal would."""
    smooth, rough = int(context.split.coarse[0]), int(context.split.held_out[-1])
    best, description = context.config.verdict.min_delta_chi2, None
    for proposed in proposed_captures(context.data.captures, smooth, rough):
        delta = _delta_chi2(proposed.captures, first.values, second.values)
        if delta > best:
            best, description = delta, proposed.description
    return description


def proposed_captures(captures: Captures, smooth_index: int, rough_index: int) -> list[ProposedCapture]:
    """Proposed captures, each of which differs from an existing capture in one respect."""
    smooth, rough = captures.subset([smooth_index]), captures.subset([rough_index])
    middles = np.array([slm.num_levels // 2 for slm in captures.slms], captures.levels.dtype)
    flat = np.broadcast_to(middles[:, None, None], smooth.levels.shape[1:])[None].copy()
    proposed = [
        ProposedCapture("a capture with a smoother pattern", smooth),
        ProposedCapture("a capture with a rougher pattern", rough),
        ProposedCapture("a capture with all modulators flat", replace(smooth, levels=flat)),
        ProposedCapture("a capture with half the laser power", replace(rough, power=rough.power / 2)),
        ProposedCapture("a capture with a tenth of the exposure", replace(rough, exposure_s=rough.exposure_s / 10)),
    ]
    if len(captures.slms) > 1:
        for name, number in zip(captures.slm_names, range(len(captures.slms)), strict=True):
            levels = rough.levels.copy()
            levels[:, number] = middles[number]
            others = "other" if len(captures.slms) == 2 else "others"
            words = f"a capture with {name} flat and a rough pattern on the {others}"
            proposed.append(ProposedCapture(words, replace(rough, levels=levels)))
    planes = np.unique(captures.distance_m)
    farther = planes.max() * 1.5 if planes.max() > 0 else planes.max() + 2e-3
    words = f"a capture in another plane, at {farther * 1e3:.3g} mm"
    proposed.append(ProposedCapture(words, replace(rough, distance_m=np.array([farther]))))
    longest = captures.wavelengths_m.max() * 1.1
    words = f"a capture at {longest * 1e9:.0f} nm"
    return [*proposed, ProposedCapture(words, replace(rough, wavelength_m=np.array([longest])))]


def _delta_chi2(captures: Captures, first: FittedValues, second: FittedValues) -> float:
    """Δχ² by which one capture would tell two predictions apart, its gain fitted.

    0 for values that the proposed bench can't have.
    """
    predictor = Predictor(captures, cache_mb=1)
    try:
        a, b = (predictor([0], values) for values in (first, second))
    except UserError:
        return 0.0
    m, n = (np.asarray(p.signal, dtype=np.float64) for p in (a, b))
    camera = captures.camera
    scale = MEAN_LIGHT * camera.saturation / max(float(m.mean()), 1e-30)
    dark, other_dark = (p.counts_without_lasers(camera.black_level) for p in (a, b))
    m, n = m * scale, n * scale + (other_dark - dark)
    weight = 1.0 / camera.noise_variance(m)
    gain = float((weight * m * n).sum() / (weight * n * n).sum())
    return float((weight * (m - gain * n) ** 2).sum())
