"""What isn't perfect on any bench and nobody's fault: pixels of unequal sensitivity, a camera that shakes, drift.

Pixels and shaking are looked for where a model is good enough to show them: under the nominal one, and again under the
best. What they explain is no cause's to explain.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from holoview.captures.noise_model import estimate_prnu
from holoview.diagnose.free_parameters import FittedValues
from holoview.diagnose.held_out_ranking import SearchResult
from holoview.diagnose.laser_drift import DRIFTING, estimate_laser_drift
from holoview.diagnose.search_context import SearchContext
from holoview.diagnose.verdict import Decision, Verdict, jitter_excess

_PATTERN_BELOW = 3.0  # χ²/n up to which residuals tell the pixels' own sensitivity from errors of the model
_MOST_PATTERN = 0.1
_LEAST_PATTERN = 0.005  # of χ²/n: less is as good as none
_SHAKEN = 0.5  # of the excess: movements that explain so much are real, those that a wrong model feigns explain little


def detect_nuisances(context: SearchContext, values: FittedValues) -> SearchContext:
    """The bench with a shaking camera and unequal pixels, where a model with these values shows them."""
    return _detect_prnu(_detect_camera_jitter(context, values), values)


def excuse_laser_drift(
    context: SearchContext, selection: SearchResult, decision: Decision
) -> tuple[Decision, list[str]]:
    """Consistent after all, where what drifts and shakes without direction accounts for what is left; with a note."""
    if decision.verdict is not Verdict.UNEXPLAINED:
        return decision, []
    if DRIFTING not in context.effects:
        return decision, []
    found = estimate_laser_drift(selection.comparison, {})
    if found.is_systematic or found.chi2_per_pixel - 1.0 > jitter_excess(selection.pixel_count):
        return decision, []
    note = f"The wavelengths drift by {found.rms_m * 1e9:.2g} nm (r.m.s.) between captures; that explains what is left."
    return Decision(Verdict.CONSISTENT, None), [note]


def _detect_camera_jitter(context: SearchContext, values: FittedValues) -> SearchContext:
    """The bench with a camera that moves from capture to capture, where that explains most of what is left."""
    comparison = context.model_weighted_comparison(context.split.held_out, values)
    still = comparison.chi2_per_pixel(values) - 1.0
    if context.has_camera_jitter or still < jitter_excess(comparison.pixel_count) or len(context.split.held_out) < 2:
        return context
    shaking = replace(context, has_camera_jitter=True)
    left = shaking.model_weighted_comparison(context.split.held_out, values).chi2_per_pixel(values) - 1.0
    return shaking if left < _SHAKEN * still else context


def _detect_prnu(context: SearchContext, values: FittedValues) -> SearchContext:
    """The bench with the camera's fixed pattern, where the residuals of two disjoint sets of captures show one."""
    sets = [context.split.fine, context.split.held_out]
    comparisons = [context.model_weighted_comparison(indices, values) for indices in sets]
    if context.prnu or max(c.chi2_per_pixel(values) for c in comparisons) > _PATTERN_BELOW:
        return context
    residuals, expected, usable = [], [], []
    for comparison in comparisons:
        fitted = comparison.fit_gains(values)
        seen = comparison.weight > 0
        residuals.append(np.where(seen, fitted.residual / np.where(seen, comparison.weight, 1.0), 0.0))
        expected.append(fitted.expected)
        usable.append(seen)
    pattern = min(estimate_prnu(residuals, expected, usable), _MOST_PATTERN)
    counts = [
        np.square(pattern * e * c.weight).sum() / c.pixel_count for e, c in zip(expected, comparisons, strict=True)
    ]
    return replace(context, prnu=pattern) if max(counts) > _LEAST_PATTERN else context
