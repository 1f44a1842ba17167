"""What varies on every bench and is no fault: pixels of unequal sensitivity (PRNU), a camera that moves, laser drift.

PRNU and movements are looked for where a model is good enough to show them: under the nominal one, and again under the
best. No cause may explain what they explain.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from holoview.captures.prepared_captures import estimate_prnu
from holoview.diagnose.free_parameters import FittedValues
from holoview.diagnose.held_out_ranking import SearchResult
from holoview.diagnose.laser_drift import DRIFT_EFFECT, estimate_laser_drift
from holoview.diagnose.search_context import SearchContext
from holoview.diagnose.verdict import Decision, Verdict, jitter_excess


def detect_nuisances(context: SearchContext, values: FittedValues) -> SearchContext:
    """The context with movements of the camera and PRNU, where a model with these values shows them."""
    return _detect_prnu(_detect_camera_jitter(context, values), values)


def excuse_laser_drift(context: SearchContext, result: SearchResult, decision: Decision) -> tuple[Decision, list[str]]:
    """Consistent after all where undirected drift of the lasers leaves no more than jitter does; with a note."""
    if decision.verdict is not Verdict.UNEXPLAINED or DRIFT_EFFECT not in context.effects:
        return decision, []
    drift = estimate_laser_drift(result.comparison, {}, context.config.laser_drift)
    max_excess = jitter_excess(result.pixel_count, context.config.verdict)
    if drift.is_systematic or drift.chi2_per_pixel - 1.0 > max_excess:
        return decision, []
    note = f"The wavelengths drift by {drift.rms_m * 1e9:.2g} nm (r.m.s.) between captures; that explains what is left."
    return Decision(Verdict.CONSISTENT, None), [note]


def _detect_camera_jitter(context: SearchContext, values: FittedValues) -> SearchContext:
    """The context with a camera that moves from capture to capture, where that explains most of the excess."""
    comparison = context.model_weighted_comparison(context.split.held_out, values)
    excess = comparison.chi2_per_pixel(values) - 1.0
    small = excess < jitter_excess(comparison.pixel_count, context.config.verdict)
    if context.has_camera_jitter or small or len(context.split.held_out) < 2:
        return context
    moving = replace(context, has_camera_jitter=True)
    left = moving.model_weighted_comparison(context.split.held_out, values).chi2_per_pixel(values) - 1.0
    return moving if left < context.config.nuisances.jitter_max_excess * excess else context


def _detect_prnu(context: SearchContext, values: FittedValues) -> SearchContext:
    """The context with PRNU, where the residuals of two disjoint sets of captures show the same pattern."""
    config = context.config.nuisances
    sets = [context.split.fine, context.split.held_out]
    comparisons = [context.model_weighted_comparison(indices, values) for indices in sets]
    if context.prnu or max(c.chi2_per_pixel(values) for c in comparisons) > config.prnu_max_chi2:
        return context
    fits = [c.fit_gains(values) for c in comparisons]
    expected = [fitted.expected for fitted in fits]
    residuals = [c.residual_counts(fitted) for c, fitted in zip(comparisons, fits, strict=True)]
    prnu = min(estimate_prnu(residuals, expected, [c.weight > 0 for c in comparisons]), config.max_prnu)
    added = [np.square(prnu * e * c.weight).sum() / c.pixel_count for e, c in zip(expected, comparisons, strict=True)]
    return replace(context, prnu=prnu) if max(added) > config.min_prnu_chi2 else context
