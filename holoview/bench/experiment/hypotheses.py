"""Hypotheses on the cause: sets of effects with values, their evidence, and their probabilities.

Hypothesis, Belief   a set of causes with the captures' evidence on it; all of them with their probabilities
log_evidence, …      evidence of a fit, and probabilities
loop_context         the captures so far as fits need them: all of them fitted, large modulators cut to their middle
HypothesisFits       the fits: found by the search of a diagnosis, and fitted anew to every further capture

Fitted hypotheses are the nominal bench, single effects, and pairs. Once one of them leads, effects that could act
beside it join as open hypotheses: each has its effect at the identity, with the uncertainty that the captures leave. An
open hypothesis keeps captures coming until it is excluded. It is fitted as soon as the χ² that the effect would gain is
significant; smaller gains also come from errors of the model.

The evidence is Laplace's approximation. With χ² at the fit x̂, the derivatives J of the residuals there and a normal
prior of width w about the identity x₀,

    ln E = −½ χ²/T − ½ ln |I + w² JᵀJ/T| − ½ |x̂ − x₀|²/w²

so that a parameter costs as much as the captures narrow it down (MacKay, Neural Computation 4, 415 (1992)). Where no
hypothesis reaches the noise floor, T > 1 is the χ²/n of the best one: neighbouring pixels share the model's error, and
differences of χ² mean less by that factor.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import PLAIN
from holoview.bench.diagnose.capture_split import CaptureSplit
from holoview.bench.diagnose.config import SearchConfig
from holoview.bench.diagnose.correct.bad_captures import find_useless_captures
from holoview.bench.diagnose.correct.wrong_records import check_records
from holoview.bench.diagnose.crop import middle_captures, pixel_ratio
from holoview.bench.diagnose.fit import (
    CandidateFit,
    FittedValues,
    FreeParameters,
    cost_or_inf,
    free_parameters_of,
    identity_values,
    refit,
    residual_function,
)
from holoview.bench.diagnose.judge import NOMINAL_FIT, explained_excess, first_per_cause_set, jitter_excess
from holoview.bench.diagnose.likelihood import Comparison, Values
from holoview.bench.diagnose.nuisances import detect_nuisances
from holoview.bench.diagnose.pipeline import prepare_search
from holoview.bench.diagnose.power_law import changes_only_power
from holoview.bench.diagnose.refine import refine_fit
from holoview.bench.diagnose.screening import fit_over_range
from holoview.bench.diagnose.search import select_causes
from holoview.bench.diagnose.search_context import SearchContext, SearchEnd, field_samples
from holoview.bench.diagnose.worker_pool import WorkerPool
from holoview.light.model.effects.effect import Effect
from holoview.light.numerics.minimise import jacobian
from holoview.util.errors import UserError
from holoview.util.progress import ProgressCallback, no_progress

Floats = NDArray[np.float64]
PRIOR_WIDTH = 3.0
"""Width of the prior in units of a parameter's `prior`, its usual size: gross errors happen too."""
FURTHER_CAUSE = 0.1
"""Odds of one cause more, before any capture."""
_SEARCH_SHARE = 0.2  # of the fields of a diagnosis; the loop searches several times
_MAX_FITTED = 6  # hypotheses that are kept fitted, beside the nominal bench
_REFITTED = 4  # of these hypotheses: they are fitted again to every further capture
_MAX_OPEN = 4  # effects beside the leader that take part in a choice
_NEW_SEARCH = 1.5  # times the captures of the last search, after which unexplained captures are searched again
_LEADS = 0.9  # probability from which effects beside the leader are looked at
_EXCLUDED = 1e-4  # share of all weights below which further captures need no look at an effect
_SHOWS = 25.0  # Δχ² from which an open hypothesis is fitted: 5 σ of one parameter


@dataclass(frozen=True)
class Hypothesis:
    """Causes with values, and the evidence of the captures so far.

    free: the parameters that are known as `root` says, L with L Lᵀ their covariance in priors². log_weight: evidence
    and prior. gain: by how much an open one, whose last cause is at its identity, would lower χ²; None for fitted ones.
    """

    causes: tuple[str, ...]
    values: FittedValues
    free: FreeParameters
    root: Floats
    log_weight: float
    gain: float | None = None

    @property
    def is_open(self) -> bool:
        """Whether its last cause is at its identity."""
        return self.gain is not None

    @property
    def name(self) -> str:
        """In words."""
        return " and ".join(self.causes) or "the nominal bench"


@dataclass(frozen=True)
class Belief:
    """The hypotheses, the most probable first, with their probabilities.

    chi2_per_pixel: of the leader. explains: whether it leaves as little as an explanation may. temperature: by which
    differences of χ² are divided. comparison: with all captures so far.
    """

    hypotheses: tuple[Hypothesis, ...]
    probabilities: Floats
    chi2_per_pixel: float
    explains: bool
    temperature: float
    context: SearchContext = field(repr=False)
    comparison: Comparison = field(repr=False)

    @property
    def fields(self) -> int:
        """How many fields were computed for these hypotheses, and for choices among captures since."""
        return self.context.predictor.fields_requested

    @property
    def leader(self) -> Hypothesis:
        """The most probable fitted hypothesis."""
        return next(h for h in self.hypotheses if not h.is_open)

    @property
    def certainty(self) -> float:
        """Probability of the leader, with hypotheses of the same physics."""
        return float(sum(p for h, p in zip(self.hypotheses, self.probabilities, strict=True) if self._is_leader(h)))

    @property
    def rivals(self) -> tuple[Hypothesis, ...]:
        """The others, the most probable first."""
        return tuple(h for h in self.hypotheses if not self._is_leader(h))

    def _is_leader(self, other: Hypothesis) -> bool:
        leader, equal = self.leader, self.context.equivalents
        return len(other.causes) == len(leader.causes) and all(
            name in leader.causes or equal.get(name, frozenset()) & {*leader.causes} for name in other.causes
        )


def fitted_hypothesis(
    fit: CandidateFit, comparison: Comparison, context: SearchContext, temperature: float
) -> Hypothesis:
    """A fit as a hypothesis, with its evidence. fit: its cost is of this comparison."""
    effects = [context.effects[name] for name in fit.causes]
    free = free_parameters_of(effects, fit.values)
    x, slopes = free.pack(fit.values), slopes_of(free, fit.values, comparison, context)
    normal = (slopes @ slopes.T).astype(np.float64)
    away = x - free.identity
    weight = log_evidence(fit.cost, normal, np.where(np.isfinite(away), away, 0.0), temperature)
    root = covariance_root(normal, temperature)
    return Hypothesis(fit.causes, fit.values, free, root, weight + log_prior(len(fit.causes), len(context.effects)))


def open_hypotheses(
    leader: Hypothesis,
    cost: float,
    names: Sequence[str],
    comparison: Comparison,
    context: SearchContext,
    temperature: float,
) -> list[Hypothesis]:
    """The leader with each of these effects beside it, at its identity. cost: of the leader in this comparison."""
    residual = comparison.residual(leader.values)
    own = slopes_of(leader.free, leader.values, comparison, context)
    found = []
    for name in names:
        values = {**leader.values, name: identity_values(context.effects[name])}
        added = free_parameters_of([context.effects[name]], values)
        if not len(added):
            continue  # an effect of lists, which are empty at the identity: no parameter to vary
        free = FreeParameters((*leader.free.entries, *added.entries))
        try:
            beside = slopes_of(added, values, comparison, context)
        except UserError:
            continue
        if not shows_at_identity(beside):
            continue  # at its identity the effect changes no capture, so that captures can't exclude it
        slopes = np.vstack([own, beside])
        normal = (slopes @ slopes.T).astype(np.float64)
        gain = linear_gain(normal, (slopes @ residual).astype(np.float64), temperature)
        causes = (*leader.causes, name)
        weight = log_evidence(cost, normal, np.zeros(len(free)), temperature)
        root = covariance_root(normal, temperature)
        weight += log_prior(len(causes), len(context.effects))
        found.append(Hypothesis(causes, values, free, root, weight, gain))
    return sorted(found, key=lambda h: -h.log_weight)


def shows_at_identity(slopes: NDArray[np.float32]) -> bool:
    """Whether captures tell anything of an effect by its derivatives (parameter, pixel) at its identity, in priors.

    Fringes without amplitude and ghosts without distance have none but rounding errors. Such effects show at once where
    there are some, and the diagnosis looks for them.
    """
    return bool(PRIOR_WIDTH**2 * np.square(slopes, dtype=np.float64).sum() >= 1.0)


def slopes_of(
    free: FreeParameters, values: FittedValues, comparison: Comparison, context: SearchContext
) -> NDArray[np.float32]:
    """Derivatives (parameter, pixel) of the residuals at `values`, in units of the priors."""
    residual = comparison.residual(values)
    bounds = free.bounds()
    return jacobian(residual_function(free, values, comparison), free.pack(values), residual, bounds)


def with_probabilities(hypotheses: Sequence[Hypothesis]) -> tuple[tuple[Hypothesis, ...], Floats]:
    """The hypotheses, the most probable first, and their probabilities."""
    ordered = tuple(sorted(hypotheses, key=lambda h: -h.log_weight))
    return ordered, probabilities([h.log_weight for h in ordered])


def log_evidence(cost: float, normal: Floats, away: Floats, temperature: float) -> float:
    """ln E. cost: χ². normal: JᵀJ (parameter, parameter). away: x̂ − x₀, both in priors."""
    _, determinant = np.linalg.slogdet(np.eye(len(away)) + PRIOR_WIDTH**2 / temperature * normal)
    return -0.5 * (cost / temperature + float(determinant) + float(away @ away) / PRIOR_WIDTH**2)


def covariance_root(normal: Floats, temperature: float) -> Floats:
    """L with L Lᵀ = (JᵀJ/T + I/w²)⁻¹, the covariance of the parameters in priors²."""
    count = len(normal)
    if not count:
        return np.zeros((0, 0))
    values, vectors = np.linalg.eigh(normal / temperature + np.eye(count) / PRIOR_WIDTH**2)
    return np.asarray(vectors / np.sqrt(np.maximum(values, 1e-12)))


def log_prior(cause_count: int, effect_count: int) -> float:
    """Of a set of causes: each cause more is less likely, and of so many causes every set is as likely."""
    return cause_count * float(np.log(FURTHER_CAUSE / max(effect_count, 1)))


def probabilities(log_weights: Sequence[float]) -> Floats:
    """Weights as probabilities of sum 1."""
    weights = np.array(log_weights, dtype=np.float64)
    p = np.exp(weights - weights.max())
    return np.asarray(p / p.sum())


def linear_gain(normal: Floats, gradient: Floats, temperature: float) -> float:
    """By how much χ²/T falls if residuals depend linearly on the parameters. gradient: Jr, at the identity."""
    if not len(normal):
        return 0.0
    step = np.linalg.solve(normal / temperature + np.eye(len(normal)) / PRIOR_WIDTH**2, gradient / temperature)
    return max(0.0, float(gradient @ step) / temperature)


def loop_context(
    captures: Captures, effects: Sequence[Effect], config: SearchConfig, end: SearchEnd, known: Values
) -> SearchContext:
    """The context of fits to all captures, with right records. Raises UserError when no capture shows anything.

    end: when fits have to end. known: effects that the nominal model has.
    """
    cut = searched_part(check_records(captures, known).captures, config)
    useless = find_useless_captures(cut, known)
    context, _ = prepare_search(cut, useless, effects, known, PLAIN, config, WorkerPool(1))
    everything = context.kept
    budget = _SEARCH_SHARE * config.budget.fields_for(field_samples(cut, PLAIN))
    split = CaptureSplit(context.split.coarse, everything, everything, everything)
    context.predictor.end = end
    return dataclasses.replace(context, split=split, field_budget=budget, end=end)


def searched_part(captures: Captures, config: SearchConfig) -> Captures:
    """The captures, or their middle where that saves much."""
    cut = middle_captures(captures, config.region)
    return captures if pixel_ratio(captures, cut) < config.region.min_saving else cut


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

    def update(self, context: SearchContext, progress: ProgressCallback = no_progress) -> Belief:
        """The belief after the captures of this context, with every hypothesis fitted to them.

        progress: of a search, which isn't begun after every capture.
        """
        self._fits = [fit for fit in self._fits if all(name in context.effects for name in fit.causes)]
        context, comparison = self._fit_all(context)
        count = len(context.kept)
        if not self._is_explained(context, comparison) and count >= _NEW_SEARCH * self._searched:
            self._searched = count
            found = select_causes(context, _searched_effects(context), context.telling_time_left(progress))
            self._fits = first_per_cause_set([*(c.fit for c in found.candidates[:_MAX_FITTED]), *self._fits])
            context, comparison = self._fit_all(context)
            if not self._allows_movements and not self._is_explained(context, comparison):
                # in few captures movements explain as much as a cause would, so a cause is sought first
                self._allows_movements = True
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
        """The fits as hypotheses, and causes that could act beside the leader."""
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
        """The most probable causes that could act beside the leader, and all that show."""
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
