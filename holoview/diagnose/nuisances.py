"""What isn't perfect on any bench and nobody's fault: pixels of unequal sensitivity, a camera that shakes, drift.

Pixels and shaking are looked for where a model is good enough to show them: under the nominal one, and again under the
best. What they explain is no cause's to explain.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from holoview.diagnose.bench import Bench
from holoview.diagnose.decide import Decision, Verdict, quiet
from holoview.diagnose.drift import DRIFTING, drift
from holoview.diagnose.judge import Selection
from holoview.diagnose.noise import fixed_pattern
from holoview.diagnose.unknowns import Found

_PATTERN_BELOW = 3.0  # χ²/n up to which residuals tell the pixels' own sensitivity from errors of the model
_MOST_PATTERN = 0.1
_LEAST_PATTERN = 0.005  # of χ²/n: less is as good as none
_SHAKEN = 0.5  # of the excess: movements that explain so much are real, those that a wrong model feigns explain little


def with_nuisances(bench: Bench, values: Found) -> Bench:
    """The bench with a shaking camera and unequal pixels, where a model with these values shows them."""
    return _with_pattern(_with_shaking(bench, values), values)


def forgiving(bench: Bench, selection: Selection, decision: Decision) -> tuple[Decision, list[str]]:
    """Consistent after all, where what drifts and shakes without direction accounts for what is left; with a note."""
    if decision.verdict is not Verdict.UNEXPLAINED:
        return decision, []
    if DRIFTING not in bench.effects:
        return decision, []
    found = drift(selection.comparison, {})
    if found.has_direction or found.chi2 - 1.0 > quiet(selection.pixels):
        return decision, []
    note = f"The wavelengths drift by {found.rms_m * 1e9:.2g} nm (r.m.s.) between captures; that explains what is left."
    return Decision(Verdict.CONSISTENT, None), [note]


def _with_shaking(bench: Bench, values: Found) -> Bench:
    """The bench with a camera that moves from capture to capture, where that explains most of what is left."""
    comparison = bench.judged_by(bench.split.held_out, values)
    still = comparison.chi2(values) - 1.0
    if bench.shaking or still < quiet(comparison.count) or len(bench.split.held_out) < 2:
        return bench
    shaking = replace(bench, shaking=True)
    left = shaking.judged_by(bench.split.held_out, values).chi2(values) - 1.0
    return shaking if left < _SHAKEN * still else bench


def _with_pattern(bench: Bench, values: Found) -> Bench:
    """The bench with the camera's fixed pattern, where the residuals of two disjoint sets of captures show one."""
    sets = [bench.split.fine, bench.split.held_out]
    comparisons = [bench.judged_by(indices, values) for indices in sets]
    if bench.fixed_pattern or max(c.chi2(values) for c in comparisons) > _PATTERN_BELOW:
        return bench
    residuals, expected, usable = [], [], []
    for comparison in comparisons:
        fitted = comparison.fit(values)
        seen = comparison.weight > 0
        residuals.append(np.where(seen, fitted.residual / np.where(seen, comparison.weight, 1.0), 0.0))
        expected.append(fitted.expected)
        usable.append(seen)
    pattern = min(fixed_pattern(residuals, expected, usable), _MOST_PATTERN)
    counts = [np.square(pattern * e * c.weight).sum() / c.count for e, c in zip(expected, comparisons, strict=True)]
    return replace(bench, fixed_pattern=pattern) if max(counts) > _LEAST_PATTERN else bench
