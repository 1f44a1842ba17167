"""Every capture judged by a model: which ones stand out from the others, and what to leave out of fits.

Before the search, robustly: only what stands out far is left out for the time being, since an effect that isn't yet
explained leaves more in some captures than in others. After it, strictly, all captures again; what was left out before
and fits the model is good.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from holoview.captures.patterns import pattern_roughness
from holoview.captures.prepared_captures import Images
from holoview.diagnose.capture_reasons import Suspects
from holoview.diagnose.capture_split import MAX_SET_PIXELS, split_captures
from holoview.diagnose.correct.bad_captures import (
    equal_pictures,
    excess_stands_out,
    has_same_record,
    record_correlations,
    record_stands_out,
    without_planes,
)
from holoview.diagnose.judge import SearchResult, jitter_excess
from holoview.diagnose.likelihood import Values
from holoview.diagnose.screening import is_very_costly
from holoview.diagnose.search_context import SearchContext

MIN_RATIO = 3.0
"""[1] … and the capture's excess, with that of ordinary jitter added to all, must be so many times that of the others.
Evidence: what jitter leaves differs between captures; the value: none recorded."""

TOLERANT_RATIO = 30.0
"""[1] The same before the search, and where the model leaves more than `VerdictConfig.explained_excess` in half of the
captures: what an effect that isn't explained leaves differs between captures. Evidence: measured: of 900 captures with
one effect each and judged without it, 1 % exceeded this or the next."""

UNRELATED_SIGMAS = 3.0
"""[σ] … and less than so many standard deviations of correlations with other captures' predictions. Evidence:
derivation: it can't be told from an unrelated picture."""

CORRELATED_PIXELS = 500_000
"""[px] Of each picture by which it is correlated with predictions, spread over it. Evidence: derivation: a correlation
scatters by 1/√n, by 0.0014 for so many pixels, or by 0.02 where a speckle has two hundred of them."""

CANDIDATES = 4
"""[candidates] Tried as the model that suits most captures, where what is named doesn't. Evidence: none recorded."""


def find_suspects(context: SearchContext, values: Values, useless: Iterable[int], *, is_final: bool) -> Suspects:
    """The captures, beside the useless ones, that stand out under the model with these values.

    is_final: whether it is the model that a search ended with. Only such a model that explains most captures judges
    strictly; another one leaves an excess that differs between good captures. Before the search, a plane of which most
    captures stand out blames none of them, since its distance may be wrong; afterwards nothing excuses them.
    """
    captures = context.data.captures
    judged = np.setdiff1d(np.arange(len(captures)), np.fromiter(useless, dtype=np.intp))
    every = np.zeros((len(captures), *captures.shape), dtype=np.float32)
    excess, pixels = _fit_all(context, judged, values, every)
    ordinary = np.array([jitter_excess(n) for n in pixels])
    median = float(np.median(excess))
    is_strict = is_final and median <= context.config.verdict.explained_excess
    min_ratio = MIN_RATIO if is_strict else TOLERANT_RATIO
    roughness = pattern_roughness(captures)[judged]
    few = _spread_pixels(captures.shape, CORRELATED_PIXELS)
    data = context.data
    correlations = record_correlations(data.light[few][judged], data.usable[few][judged], every[few][judged])
    unlike = record_stands_out(correlations, roughness)
    bad = record_stands_out(correlations, roughness, max_sigmas=UNRELATED_SIGMAS)
    wavelength, plane = captures.wavelength_m[judged], None if is_final else captures.distance_m[judged]
    bad |= excess_stands_out(excess, ordinary, roughness, wavelength, min_ratio, plane)
    if plane is not None:
        bad = without_planes(bad, plane, correlations)
    bad |= _is_copy_of_better(context, judged, correlations)
    worst_first = np.flatnonzero(bad)[np.argsort(-excess[bad], kind="stable")]
    indices, not_of_record = (tuple(int(k) for k in judged[found]) for found in (worst_first, unlike))
    return Suspects(indices, values, median, frozenset(not_of_record), every)


def _fit_all(
    context: SearchContext, judged: NDArray[np.intp], values: Values, predicted: Images
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """χ²/n − 1 of the judged captures and the number of their pixels; what was expected is written to `predicted`.

    Few large pictures are compared at a time: a comparison keeps some ten arrays of them.
    """
    at_once = max(MAX_SET_PIXELS // predicted[0].size, 2)
    squares, pixels = list[NDArray[np.float64]](), list[NDArray[np.float64]]()
    for part in np.array_split(judged, math.ceil(len(judged) / at_once)):
        comparison = context.model_weighted_comparison(part, values)
        fitted = comparison.fit_gains(values)
        squares.append(fitted.squares)
        pixels.append(comparison.pixels_per_capture)
        predicted[part] = np.abs(fitted.expected)
    count = np.concatenate(pixels)
    return np.concatenate(squares) / np.maximum(count, 1.0) - 1.0, count


def _spread_pixels(shape: tuple[int, int], most: int) -> tuple[slice, ...]:
    """Of the pixels of every picture at most about `most`, at equal distances along rows and columns."""
    step = max(1, math.ceil((shape[0] * shape[1] / most) ** 0.5))
    return (slice(None), slice(step // 2, None, step), slice(step // 2, None, step))


def judge_by_search(context: SearchContext, values: Values, result: SearchResult, useless: Iterable[int]) -> Suspects:
    """The captures that stand out under the model that a search ended with, or under one that suits more of them.

    values: the effects that were named. While these leave an excess in half of the captures, the best candidates are
    tried as well: a bad capture among those held out hides which of them is right, but not from the others' median.
    """
    suspects = find_suspects(context, values, useless, is_final=True)
    if suspects.median_excess <= context.config.verdict.explained_excess:
        return suspects
    tried = [c.fit for c in result.candidates[:CANDIDATES] if c.fit.values != values]
    others = [f for f in tried if not is_very_costly(context, f)]
    judged = [find_suspects(context, f.values, useless, is_final=True) for f in others]
    return min([suspects, *judged], key=lambda s: s.median_excess)


def leave_out(context: SearchContext, indices: Iterable[int]) -> SearchContext:
    """The context with a split that has none of these captures; unchanged where fewer than two would be left."""
    captures, left_out = context.data.captures, tuple(sorted(set(indices)))
    if len(captures) - len(left_out) < 2:
        return context
    split = split_captures(captures, pattern_roughness(captures), left_out)
    return replace(context, split=split, left_out=left_out)


def _is_copy_of_better(
    context: SearchContext, judged: NDArray[np.intp], correlations: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether a capture's picture is also that of another one whose record it fits better, (judged capture,)."""
    position = {int(k): n for n, k in enumerate(judged)}
    bad = np.zeros(len(judged), dtype=bool)
    for group in equal_pictures(context.data.captures):
        members = [position[k] for k in group if k in position]
        best = max(members, key=lambda n: float(correlations[n, n]), default=None)
        for n in members:
            bad[n] = n != best and not has_same_record(context.data.captures, int(judged[n]), int(judged[best]))
    return bad
