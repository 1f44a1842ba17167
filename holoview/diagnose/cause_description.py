"""The causes of a decision as they are reported: values, intervals, share explained, look-alikes."""

from __future__ import annotations

import numpy as np

from holoview.captures.prepared_captures import FitQuality
from holoview.diagnose.confounders import best_separating_capture, lookalike_correlations
from holoview.diagnose.fit import free_parameters_of
from holoview.diagnose.fit_statistics import fit_quality
from holoview.diagnose.judge import Decision, SearchResult
from holoview.diagnose.likelihood import Values
from holoview.diagnose.power_law import PowerLawFit
from holoview.diagnose.report.diagnosis import Cause
from holoview.diagnose.screening import is_very_costly
from holoview.diagnose.search_context import SearchContext
from holoview.diagnose.uncertainty import confidence_intervals, local_information, local_jacobian
from holoview.model.effects.effect import Effect
from holoview.model.effects.list_parameter import ListParameter


def describe_causes(
    context: SearchContext, near: SearchContext, result: SearchResult, decision: Decision
) -> list[Cause]:
    """The causes that a decision names, the one that gains most first.

    near: the same captures, or the middle of large ones, in which look-alikes are computed.
    """
    if decision.best is None:
        return []
    fit, held_out = decision.best.fit, result.comparison
    after = fit_quality(held_out, held_out.fit_gains(fit.values))
    effects = [context.effects[name] for name in fit.causes]
    fine = context.model_weighted_comparison(context.split.fine, fit.values)
    intervals = confidence_intervals(fit, local_information(fit, effects, fine), fine, context.config)
    one_or_two = [0] if is_very_costly(context, fit) else [0, -1]
    few = near.model_weighted_comparison(near.split.coarse[one_or_two], fit.values)
    lookalikes = lookalike_correlations(near, fit, local_jacobian(fit, effects, few), few)
    separate = best_separating_capture(near, decision.best, decision.rivals[0]) if decision.rivals else None
    rivals = {name: 1.0 for rival in decision.rivals for name in rival.causes if name not in fit.causes}
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
                confounded_with=rivals | lookalikes[effect.id],
                separate_by=separate,
            )
        )
    return sorted(causes, key=lambda c: -c.gain_db)


def describe_power_law(context: SearchContext, law: PowerLawFit) -> Cause:
    """A law of the laser's power as a cause. Its gain is that of the gains' spread; no image shows it."""
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
