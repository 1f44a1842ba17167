"""The fits of a loop's hypotheses: found by the search of a diagnosis, and fitted anew to every further capture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from holoview.diagnose.fit import CandidateFit, FittedValues, cost_or_inf, refit
from holoview.diagnose.judge import NOMINAL_FIT, explained_excess, first_per_cause_set, jitter_excess
from holoview.diagnose.likelihood import Comparison
from holoview.diagnose.nuisances import detect_nuisances
from holoview.diagnose.power_law import changes_only_power
from holoview.diagnose.refine import refine_fit
from holoview.diagnose.screening import fit_over_range
from holoview.diagnose.search import select_causes
from holoview.diagnose.search_context import SearchContext
from holoview.experiment.next_capture.hypotheses import (
    Belief,
    Hypothesis,
    fitted_hypothesis,
    open_hypotheses,
    with_probabilities,
)
from holoview.model.effects.effect import Effect
from holoview.util.progress import no_progress

_MAX_FITTED = 6  # hypotheses that are kept fitted, beside the nominal bench
_REFITTED = 4  # of them, that are fitted again to every further capture
_MAX_OPEN = 4  # effects beside the leader that take part in a choice
_NEW_SEARCH = 1.5  # times the captures of the last search, after which an unexplained session is searched again
_LEADS = 0.9  # probability from which effects beside the leader are looked at
_EXCLUDED = 1e-4  # share of all weights below which further captures need no look at an effect
_SHOWS = 25.0  # Δχ² from which an open hypothesis is fitted: 5 σ of one parameter


class HypothesisFits:
    """The fits that are kept from capture to capture."""

    def __init__(self) -> None:
        self._fits: list[CandidateFit] = [NOMINAL_FIT]
        self._searched, self._allows_movements = 0, False
        self._excluded: dict[tuple[str, ...], set[str]] = {}

    def include(self, context: SearchContext, sets: Sequence[Sequence[str]]) -> None:
        """Fits sets of causes that another search couldn't exclude, where they aren't among the hypotheses."""
        known = {frozenset(fit.causes) for fit in self._fits}
        for causes in sets:
            if frozenset(causes) in known or any(name not in context.effects for name in causes):
                continue
            base: FittedValues = {}
            for name in causes:
                base = fit_over_range(context, base, context.effects[name], []).values
            self._fits.append(refine_fit(context, CandidateFit(tuple(causes), base, float("inf"))))

    def update(self, context: SearchContext) -> Belief:
        """What the captures of this context say, with every hypothesis fitted to them."""
        self._fits = [fit for fit in self._fits if all(name in context.effects for name in fit.causes)]
        context, comparison = self._fit_all(context)
        count = len(context.kept)
        if not self._is_explained(context, comparison) and count >= _NEW_SEARCH * self._searched:
            self._searched = count
            found = select_causes(context, _searched_effects(context), no_progress)
            self._fits = first_per_cause_set([*(c.fit for c in found.candidates[:_MAX_FITTED]), *self._fits])
            context, comparison = self._fit_all(context)
            if not self._allows_movements and not self._is_explained(context, comparison):
                self._allows_movements = True  # of few captures they explain what a cause would, so it is sought first
                context, comparison = self._fit_all(context)
        belief = self._believe(context, comparison)
        shows = [h for h in belief.hypotheses if h.is_open and (h.gain or 0.0) > _SHOWS]
        if not shows:
            return belief
        self._fits += [refine_fit(context, CandidateFit(h.causes, h.values, float("inf"))) for h in shows]
        return self._believe(*self._fit_all(context))

    def _fit_all(self, context: SearchContext) -> tuple[SearchContext, Comparison]:
        """Fits the best again and orders all by χ², with weights of the best; forgets those far behind."""
        rough = context.data_weighted_comparison(context.kept, 0.0)
        best = min(self._fits, key=lambda f: cost_or_inf(rough, f.values))
        context = _with_nuisances(context, best, self._allows_movements)
        comparison = context.model_weighted_comparison(context.kept, best.values)
        fits = _by_cost(self._fits, comparison)
        again = [_refit(context, fit, comparison) for fit in fits[:_REFITTED]]
        comparison = context.model_weighted_comparison(context.kept, min(again, key=lambda f: f.cost).values)
        fits = _by_cost([*again, *fits[_REFITTED:]], comparison)
        self._fits = [*fits[:_MAX_FITTED], *(f for f in fits[_MAX_FITTED:] if not f.causes)]
        return context, comparison

    def _is_explained(self, context: SearchContext, comparison: Comparison) -> bool:
        """Whether the best leaves as little as an explanation, or the nominal bench as little as jitter."""
        config, n, best = context.config.verdict, comparison.pixel_count, self._fits[0]
        nominal = next(f.cost for f in self._fits if not f.causes) / n - 1.0
        if not best.causes:
            return nominal < jitter_excess(n)
        return best.cost / n - 1.0 < explained_excess(nominal, n, config)

    def _believe(self, context: SearchContext, comparison: Comparison) -> Belief:
        """The fits as hypotheses, and what could act beside the leader."""
        temperature = max(1.0, self._fits[0].cost / comparison.pixel_count)
        fitted = [fitted_hypothesis(fit, comparison, context, temperature) for fit in self._fits]
        ordered, p = with_probabilities(fitted)
        if p[0] > _LEADS:
            opened = self._open_beside(ordered[0], comparison, context, temperature)
            ordered, p = with_probabilities([*ordered, *opened])
        cost = cost_or_inf(comparison, next(h for h in ordered if not h.is_open).values)
        explains = self._is_explained(context, comparison)
        return Belief(ordered, p, cost / comparison.pixel_count, explains, temperature, context, comparison)

    def _open_beside(
        self, leader: Hypothesis, comparison: Comparison, context: SearchContext, temperature: float
    ) -> list[Hypothesis]:
        """The most probable of what could act beside the leader, and all that shows."""
        excluded = self._excluded.setdefault(tuple(sorted(leader.causes)), set())
        beside = {name for fit in self._fits if {*leader.causes} < {*fit.causes} for name in fit.causes}
        equal = {other for name in leader.causes for other in context.equivalents.get(name, ())}
        names = [e.id for e in _searched_effects(context) if e.id not in {*excluded, *beside, *equal, *leader.causes}]
        cost = cost_or_inf(comparison, leader.values)
        found = open_hypotheses(leader, cost, names, comparison, context, temperature)
        ranked, p = with_probabilities([leader, *found])
        excluded |= {h.causes[-1] for h, own in zip(ranked, p, strict=True) if h.is_open and own < _EXCLUDED}
        shown = [h for h in found[_MAX_OPEN:] if (h.gain or 0.0) > _SHOWS]
        return [*found[:_MAX_OPEN], *shown[:_MAX_OPEN]]


def _by_cost(fits: Sequence[CandidateFit], comparison: Comparison) -> list[CandidateFit]:
    """The fits with their costs in a comparison, the lowest first."""
    return sorted((replace(f, cost=cost_or_inf(comparison, f.values)) for f in fits), key=lambda f: f.cost)


def _refit(context: SearchContext, fit: CandidateFit, comparison: Comparison) -> CandidateFit:
    effects = [context.effects[name] for name in fit.causes]
    return refit(effects, fit.values, comparison) if fit.causes else fit


def _with_nuisances(context: SearchContext, fit: CandidateFit, allows_movements: bool) -> SearchContext:
    """The context with PRNU, and movements of the camera if allowed, which two disjoint sets of captures show."""
    split = replace(context.split, fine=context.kept[::2], held_out=context.kept[1::2])
    found = detect_nuisances(replace(context, split=split), fit.values)
    return replace(found, split=context.split, has_camera_jitter=found.has_camera_jitter and allows_movements)


def _searched_effects(context: SearchContext) -> list[Effect]:
    return [e for e in context.effects.values() if not changes_only_power(e)]
