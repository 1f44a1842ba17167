"""Measures how many captures a choice can save at most, on benches whose pictures depend on small faults linearly.

    python -m benchmarks.capture_bound --derivatives out/derivatives.npz --benches 120 -o out/capture_bound.jsonl
    python -m benchmarks.capture_bound --summary out/capture_bound.jsonl

The loop's own captures to begin with, and a pool of its proposals, are taken once on a virtual bench of 64 × 48 pixels
(`benchmarks.rig_adaptive`); derivatives of these pictures by all listed effects that have some are kept. Each bench
hides one effect, every fourth two, and has noise of its own. Hypotheses are all effects, and pairs with the most
probable of them. Fits, evidence and criteria are those of `holoview.bench.experiment`, exact here, and cost no fields,
so that many benches can be tried, and an oracle: it knows the truth from the first capture on, and takes the proposal
that raises its odds most. Choices are made among 20 proposals of the pool; all end once the leader has 0.99.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import append_line, lines_or_summary, read_lines
from benchmarks.rig_adaptive import are_same, hidden_candidates, make_rig, sample_effects
from holoview.bench.captures.dataset import join_captures
from holoview.bench.diagnose.config import SearchConfig
from holoview.bench.diagnose.fit import effect_jacobian, free_parameters_of, identity_values
from holoview.bench.diagnose.power_law import changes_only_power
from holoview.bench.diagnose.search_context import NEVER
from holoview.bench.experiment.capture_choice import (
    START_COUNT,
    Response,
    draw_proposals,
    expected_delta_chi2,
    expected_information,
    pairwise_delta_chi2,
    starting_proposals,
)
from holoview.bench.experiment.hypotheses import (
    PRIOR_WIDTH,
    covariance_root,
    log_evidence,
    log_prior,
    loop_context,
    probabilities,
    shows_at_identity,
)
from holoview.bench.rig.measurement import Measurement
from holoview.light.model.effects.registry import get_effect, listed_effects
from tests.experiment.next_capture.benches import BenchInProcess

SIZES = (0.01, 0.03, 0.1)  # of the edge of the range that a diagnosis scans
POOL, OFFERED, MAX_CAPTURES, CERTAINTY = 36, 20, 20, 0.99
_BASES, _COMPARED = 6, 8  # single effects of which pairs are tried; hypotheses that a choice compares
Floats = NDArray[np.float64]
Causes = tuple[str, ...]


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of all pictures by all parameters in priors, in σ, with free gains.

    owner: (parameter,), the effect. places: (capture, 2), wavelength and distance in metres.
    roots: (capture, parameter, parameter), F with F Fᵀ the scalar products of the derivatives of a capture: rows of F
    stand for pictures.
    """

    owner: NDArray[np.str_]
    places: Floats
    roots: Floats

    def show_all(self, taken: Sequence[int]) -> bool:
        """Whether captures of several wavelengths and planes are among these."""
        return all(len(np.unique(column)) > 1 for column in self.places[list(taken)].T)

    def rows(self, causes: Causes) -> NDArray[np.intp]:
        """The parameters of these causes."""
        return np.concatenate([np.flatnonzero(self.owner == name) for name in causes] or [np.zeros(0, np.intp)])


def measure_derivatives(seed: int) -> Derivatives:
    """Takes the captures and differentiates them; about a minute of one core."""
    nothing: dict[str, Any] = {"seed": seed, "one_plane": False, "truth": {}}
    with tempfile.TemporaryDirectory() as folder:
        rig = make_rig(nothing, Path(folder))
        proposals = [*starting_proposals(rig, 0), *draw_proposals(rig, np.random.default_rng(seed), POOL)]
        with BenchInProcess(rig).devices() as devices:
            measurement = Measurement(rig, devices)
            captures = join_captures([measurement.take(p.request, p.levels) for p in proposals])
    context = loop_context(captures, list(listed_effects().values()), SearchConfig(), NEVER, {})
    comparison = context.model_weighted_comparison(context.kept, {})
    nominal = comparison.residual({})
    owner, slopes = list[str](), []
    for name, effect in context.effects.items():
        found = effect_jacobian(effect, {name: identity_values(effect)}, comparison, nominal)
        if shows_at_identity(found) and not changes_only_power(effect):
            owner += [name] * len(found)
            slopes.append(found.reshape(len(found), len(captures), -1))
    pictures = np.concatenate(slopes).transpose(1, 0, 2)
    values, vectors = np.linalg.eigh(np.stack([(one @ one.T).astype(np.float64) for one in pictures]))
    places = np.array([(p.wavelength_m, p.distance_m) for p in proposals])
    return Derivatives(np.array(owner), places, vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])


@dataclass(frozen=True)
class LinearBench:
    """A bench. truth: its causes. x: their values in priors, by parameter. pictures: (capture, number), with noise."""

    derivatives: Derivatives
    truth: Causes
    x: Floats
    pictures: Floats


def draw_bench(derivatives: Derivatives, seed: int) -> LinearBench:
    """A bench with one hidden effect, or two in every fourth."""
    rng = np.random.default_rng((seed, 3))
    size, names = float(rng.choice(SIZES)), [n for n in hidden_candidates() if n in derivatives.owner]
    while True:
        truth = tuple(sorted(rng.choice(names, 1 if seed % 4 else 2, replace=False).tolist()))
        values = sample_effects(truth, size, rng)
        free = free_parameters_of([get_effect(name) for name in truth], values)
        x = free.pack(values) - free.identity
        if np.isfinite(x).all():
            break
    roots = derivatives.roots
    pictures = x @ roots[:, derivatives.rows(truth)] + rng.standard_normal(roots.shape[:2])
    return LinearBench(derivatives, truth, x, pictures)


@dataclass(frozen=True)
class Fit:
    """A hypothesis after some captures. x: values. normal: JJᵀ of the captures; None for values that are known."""

    causes: Causes
    x: Floats
    normal: Floats | None
    log_weight: float

    @cached_property
    def root(self) -> Floats:
        """As `Hypothesis.root`."""
        return np.zeros((len(self.x), 0)) if self.normal is None else covariance_root(self.normal, 1.0)

    def response(self, derivatives: Derivatives, capture: int) -> Response:
        """Its prediction of a capture."""
        rows = derivatives.roots[capture][derivatives.rows(self.causes)]
        return Response(self.x @ rows, self.root.T @ rows)


def fit_all(bench: LinearBench, taken: Sequence[int]) -> list[Fit]:
    """The hypotheses, the most probable first."""
    roots, pictures = bench.derivatives.roots[list(taken)], bench.pictures[list(taken)]
    normal, gradient = np.einsum("kpn,kqn->pq", roots, roots), np.einsum("kpn,kn->p", roots, pictures)
    power, names = float(np.square(pictures).sum()), list(dict.fromkeys(bench.derivatives.owner.tolist()))

    def fit(causes: Causes) -> Fit:
        rows = bench.derivatives.rows(causes)
        own, b = normal[np.ix_(rows, rows)], gradient[rows]
        x = np.linalg.solve(own + np.eye(len(rows)) / PRIOR_WIDTH**2, b)
        cost = power - 2 * float(b @ x) + float(x @ own @ x)
        weight = log_evidence(cost, own, x, 1.0) + log_prior(len(causes), len(names))
        return Fit(causes, x, own, weight)

    singles = sorted((fit((name,)) for name in names), key=lambda f: -f.log_weight)
    bases = [single.causes[0] for single in singles[:_BASES]]
    pairs = {tuple(sorted((base, name))) for base in bases for name in names if name != base}
    return sorted([fit(()), *singles, *(fit(pair) for pair in pairs)], key=lambda f: -f.log_weight)


Policy = Callable[[LinearBench, list[Fit], Sequence[int]], int]


def by_information(bench: LinearBench, fits: list[Fit], offered: Sequence[int]) -> int:
    """The capture that the loop would choose."""
    compared = fits[:_COMPARED]
    p = probabilities([fit.log_weight for fit in compared])

    def value(capture: int) -> tuple[float, float]:
        deltas = pairwise_delta_chi2([fit.response(bench.derivatives, capture) for fit in compared])
        return expected_information(p, deltas), float(deltas[0].sum())

    return max(offered, key=value)


def by_truth(bench: LinearBench, fits: list[Fit], offered: Sequence[int]) -> int:
    """The capture that raises the odds of the truth most against all its rivals together."""
    own = next((f.log_weight for f in fits if are_same(f.causes, bench.truth)), fits[-1].log_weight)
    truth = Fit(bench.truth, bench.x, None, own)
    rivals = [f for f in fits if not are_same(f.causes, bench.truth)][: 2 * _COMPARED]

    def value(capture: int) -> float:
        seen = truth.response(bench.derivatives, capture)
        deltas = [expected_delta_chi2(seen, f.response(bench.derivatives, capture)) for f in rivals]
        odds = [f.log_weight - own - 0.5 * delta for f, delta in zip(rivals, deltas, strict=True)]
        return -float(np.logaddexp.reduce(odds))

    return max(offered, key=value)


def by_chance(bench: LinearBench, fits: list[Fit], offered: Sequence[int]) -> int:
    """The first of the captures, which come in random order."""
    return offered[0]


POLICIES: dict[str, tuple[Policy, int, int]] = {
    "chance, judged from the fourth on": (by_chance, 0, 4),
    "chance": (by_chance, 0, START_COUNT),
    "the loop": (by_information, START_COUNT, START_COUNT),
    "oracle": (by_truth, 0, START_COUNT),
    "oracle, judged from the first on": (by_truth, 0, 1),
}
"""Name: the policy, how many of the loop's own captures come first, and from which on a verdict may fall. From the
second on, it also takes captures that show every effect, as in the loop; whoever chooses knows that."""


def run(bench: LinearBench, policy: Policy, started: int, least: int, rng: np.random.Generator) -> dict[str, Any]:
    """One bench measured by one policy."""
    taken, pool = list(range(started)), list(range(START_COUNT, len(bench.pictures)))
    while True:
        fits = fit_all(bench, taken)
        p = probabilities([fit.log_weight for fit in fits])
        certainty = float(sum(q for fit, q in zip(fits, p, strict=True) if are_same(fit.causes, fits[0].causes)))
        may_end = len(taken) >= least and (least != START_COUNT or bench.derivatives.show_all(taken))
        if may_end and (certainty >= CERTAINTY or len(taken) >= MAX_CAPTURES):
            break
        offered = rng.permutation(pool)[:OFFERED].tolist()
        showing = [k for k in offered if least == START_COUNT and taken and bench.derivatives.show_all([*taken, k])]
        capture = policy(bench, fits, offered if policy is by_chance else showing or offered)
        taken.append(capture)
        pool.remove(capture)
    right = are_same(fits[0].causes, bench.truth)
    return {"captures": len(taken), "certain": certainty >= CERTAINTY, "right": right, "named": fits[0].causes}


def summarise(file: Path) -> None:
    """Prints a table: how many captures each policy took, and how often it was right."""
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for row in read_lines(file):
        groups[row["policy"]].append(row)
    print("| captures by | benches | captures | median | certain and right | certain and wrong |")
    print("| --- | --- | --- | --- | --- | --- |")
    for policy, rows in groups.items():
        counts = [row["captures"] for row in rows]
        right, wrong = (sum(row["certain"] and row["right"] is is_right for row in rows) for is_right in (True, False))
        print(f"| {policy} | {len(rows)} | {sum(counts)} | {statistics.median(counts):g} | {right} | {wrong} |")


def main() -> None:
    """Measures, or prints a summary of a measurement."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--derivatives", type=Path, default=Path("out/derivatives.npz"), help="made if it isn't there")
    parser.add_argument("--first", type=int, default=0, help="seed of the first bench")
    parser.add_argument("--benches", type=int, default=120)
    args = lines_or_summary(parser, "capture_bound", summarise)
    if not args.derivatives.exists():
        made = measure_derivatives(seed=1)
        np.savez(args.derivatives, owner=made.owner, places=made.places, roots=made.roots)
    with np.load(args.derivatives) as stored:
        derivatives = Derivatives(stored["owner"], stored["places"], stored["roots"])
    for seed in range(args.first, args.first + args.benches):
        bench = draw_bench(derivatives, seed)
        for name, (policy, started, least) in POLICIES.items():
            row = run(bench, policy, started, least, np.random.default_rng((seed, 4)))
            append_line(args.output, {"seed": seed, "truth": bench.truth, "policy": name} | row)
    summarise(args.output)


if __name__ == "__main__":
    main()
