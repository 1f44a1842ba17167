"""The simplest name: of effects that no data can tell apart, the one with fewer numbers is named, the other a rival.

A wrong gap is a defocus of relay 1, one of the aberrations that it may have: gap states it by one number, aberration1
by many. A search may come to either first, alone or together with other causes. A second line that has most of the
light isn't an offset of the wavelength, but comes so near that a search may not look further.
"""

from __future__ import annotations

from functools import partial

from holoview.diagnose.effect_fit import CandidateFit
from holoview.diagnose.free_parameters import FittedValues, number_count
from holoview.diagnose.held_out_ranking import SearchResult, rank_on_held_out
from holoview.diagnose.refine import refine_fit
from holoview.diagnose.screening import fit_over_range
from holoview.diagnose.search_context import SearchContext
from holoview.diagnose.verdict import Decision


def prefer_fewer_numbers(context: SearchContext, result: SearchResult) -> SearchResult:
    """The result with fits in which a cause of the best candidate is replaced by an equal, or a like, of fewer numbers.

    Ranked with the others, such a fit comes first if it explains the held-out captures as well.
    """
    best = result.best
    jobs = [
        partial(_fit_over_range, context, best.fit.without(cause).values, simple, _first_values(result, simple))
        for cause in best.causes
        for simple in sorted(_simpler_names(context, cause))
        if simple not in best.causes
    ]
    if not jobs:
        return result
    return rank_on_held_out(context, [*context.run_parallel(jobs), *(c.fit for c in result.candidates)])


def wider_names(context: SearchContext, decision: Decision) -> list[tuple[str, ...]]:
    """The causes that are named, with one of them replaced by an equal of more numbers, which contains it."""
    causes = decision.best.causes if decision.best else ()
    return [
        tuple(wide if name == cause else name for name in causes)
        for cause in causes
        for wide in sorted(context.equivalents.get(cause, ()))
        if number_count(context.effects[wide]) > number_count(context.effects[cause])
    ]


def _simpler_names(context: SearchContext, cause: str) -> set[str]:
    """Effects of fewer numbers that are the same physics as a cause, or that the cause imitates."""
    names = {*context.equivalents.get(cause, ()), *context.effects[cause].degenerate_limit} & context.effects.keys()
    return {name for name in names if number_count(context.effects[name]) < number_count(context.effects[cause])}


def _first_values(result: SearchResult, name: str) -> list[dict[str, float]]:
    """The values of an effect in the best candidate that has it."""
    return [c.fit.values[name] for c in result.candidates if name in c.fit.values][:1]


def _fit_over_range(
    context: SearchContext, base: FittedValues, name: str, starts: list[dict[str, float]]
) -> CandidateFit:
    """An effect on top of a base: over its range and from other starts, then all causes together."""
    return refine_fit(context, fit_over_range(context, base, context.effects[name], starts))
