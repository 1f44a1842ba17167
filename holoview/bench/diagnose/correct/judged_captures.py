"""Every capture judged by a model: the captures that stand out, and why they don't belong to their records.

`find_suspects` finds the captures that stand out. Before a search, only captures that stand out far are left out for
the time being, since an effect that isn't explained yet leaves more excess in some captures than in others. After the
search, all captures are judged again, strictly; a capture that was left out before and fits the model is good.

`explain_suspects` finds the reasons. A picture is compared with predictions from other records: those of the other
captures, its own record with their patterns, with a moved camera and with other distances, and its own prediction
blurred. The first prediction that leaves less than half of the picture's excess is the reason. Where none does, the
picture is noisy if the residuals of neighbouring pixels don't correlate; otherwise it shows another pattern or a
disturbance.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.patterns import pattern_roughness
from holoview.bench.captures.prepared_captures import Images
from holoview.bench.diagnose.capture_split import MAX_SET_PIXELS, split_captures
from holoview.bench.diagnose.correct.bad_captures import (
    DUPLICATE,
    BadCapture,
    equal_pictures,
    exceeds_noise,
    excess_stands_out,
    has_same_record,
    predicted_reach,
    record_correlations,
    record_stands_out,
    without_planes,
)
from holoview.bench.diagnose.judge import SearchResult, chance_excess, jitter_excess
from holoview.bench.diagnose.likelihood import Values
from holoview.bench.diagnose.screening import is_very_costly
from holoview.bench.diagnose.search_context import SearchContext
from holoview.bench.diagnose.starts.picture import measure_displacement

MIN_RATIO = 3.0
"""[1] A bad capture's excess must also be this factor times the excess of the others, ordinary jitter added to all.
Evidence: the excess of jitter differs between captures; the value: none recorded."""

TOLERANT_RATIO = 30.0
"""[1] The same before the search, and where the model leaves more than `VerdictConfig.explained_excess` in half of the
captures: an effect that isn't explained leaves different excesses in different captures. Evidence: measured: of 900
captures with one effect each and judged without it, 1 % exceeded this or `UNRELATED_SIGMAS`."""

UNRELATED_SIGMAS = 3.0
"""[σ] A picture isn't of its record only if its correlation with its own prediction exceeds those with other captures'
predictions by fewer standard deviations than this. Evidence:
derivation: it can't be told from an unrelated picture."""

CORRELATED_PIXELS = 500_000
"""[px] Pixels of each picture, spread over it, that are correlated with predictions. Evidence: derivation: a
correlation scatters by 1/√n, by 0.0014 for so many pixels, or by 0.02 where a speckle has two hundred of them."""

CANDIDATES = 4
"""[candidates] Tried as models where the named causes leave an excess in most captures. Evidence: none recorded."""


def find_suspects(context: SearchContext, values: Values, useless: Iterable[int], *, is_final: bool) -> Suspects:
    """The captures, beside the useless ones, that stand out under the model with these values.

    is_final: whether a search ended with this model. Only a final model that explains most captures judges strictly;
    any other model leaves an excess that differs between good captures. Before the search, a plane of which most
    captures stand out blames none of them, since its distance may be wrong; afterwards nothing excuses them.
    """
    captures = context.data.captures
    judged = np.setdiff1d(np.arange(len(captures)), np.fromiter(useless, dtype=np.intp))
    every = np.zeros((len(captures), *captures.shape), dtype=np.float32)
    excess, pixels = _fit_all(context, judged, values, every)
    ordinary = np.array([jitter_excess(n, chance_excess) for n in pixels])
    median = float(np.median(excess))
    is_strict = is_final and median <= context.config.verdict.explained_excess
    min_ratio = MIN_RATIO if is_strict else TOLERANT_RATIO
    roughness = pattern_roughness(captures)[judged]
    few = _spread_pixels(captures.shape, CORRELATED_PIXELS)
    data = context.data
    correlations = record_correlations(data.light[few][judged], data.usable[few][judged], every[few][judged])
    expected = every[few][judged]
    reach = predicted_reach(expected, data.usable[few][judged], captures.camera.noise_variance(expected))
    unlike = record_stands_out(correlations, reach, roughness)
    bad = record_stands_out(correlations, reach, roughness, max_sigmas=UNRELATED_SIGMAS)
    wavelength, plane = captures.wavelength_m[judged], None if is_final else captures.distance_m[judged]
    bad |= excess_stands_out(excess, ordinary, roughness, wavelength, min_ratio, plane)
    bad &= exceeds_noise(excess, np.array([jitter_excess(n) for n in pixels]))
    if plane is not None:
        bad = without_planes(bad, plane, correlations)
    bad |= _is_copy_of_better(context, judged, correlations)
    worst_first = np.flatnonzero(bad)[np.argsort(-excess[bad], kind="stable")]
    indices, not_of_record = (tuple(int(k) for k in judged[found]) for found in (worst_first, unlike))
    return Suspects(indices, values, median, frozenset(not_of_record), every)


def _fit_all(
    context: SearchContext, judged: NDArray[np.intp], values: Values, predicted: Images
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """χ²/n − 1 of the judged captures and the number of their pixels; the expected light is written to `predicted`.

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
    """At most about `most` pixels of every picture, at equal distances along rows and columns."""
    step = max(1, math.ceil((shape[0] * shape[1] / most) ** 0.5))
    return (slice(None), slice(step // 2, None, step), slice(step // 2, None, step))


def judge_by_search(context: SearchContext, values: Values, result: SearchResult, useless: Iterable[int]) -> Suspects:
    """The captures that stand out under the model that a search ended with, or under a candidate that suits more
    captures. values: the effects that were named. While these leave an excess in half of the captures, the best
    candidates are tried as well: a bad held-out capture may lower the rank of the right candidate, but hardly its
    median excess.
    """
    suspects = find_suspects(context, values, useless, is_final=True)
    if suspects.median_excess <= context.config.verdict.explained_excess:
        return suspects
    tried = [c.fit for c in result.candidates[:CANDIDATES] if c.fit.values != values]
    others = [f for f in tried if not is_very_costly(context, f)]
    judged = [find_suspects(context, f.values, useless, is_final=True) for f in others]
    return min([suspects, *judged], key=lambda s: s.median_excess)


def leave_out(context: SearchContext, indices: Iterable[int]) -> SearchContext:
    """The context with a split without these captures; unchanged where they are left out already, and where fewer than
    two captures would be left."""
    captures, left_out = context.data.captures, tuple(sorted(set(indices)))
    if left_out == context.left_out or len(captures) - len(left_out) < 2:
        return context
    split = split_captures(captures, pattern_roughness(captures), left_out)
    return replace(context, split=split, left_out=left_out)


def _is_copy_of_better(
    context: SearchContext, judged: NDArray[np.intp], correlations: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether a capture's picture is also that of another capture whose record it fits better, (judged capture,)."""
    position = {int(k): n for n, k in enumerate(judged)}
    bad = np.zeros(len(judged), dtype=bool)
    for group in equal_pictures(context.data.captures):
        members = [position[k] for k in group if k in position]
        best = max(members, key=lambda n: float(correlations[n, n]), default=None)
        for n in members:
            bad[n] = n != best and not has_same_record(context.data.captures, int(judged[n]), int(judged[best]))
    return bad


ANOTHER_PATTERN, MOVED, OUT_OF_FOCUS, NOISY, DISTURBED = (
    "another pattern",
    "moved",
    "out of focus",
    "noisy",
    "disturbed",
)

EXAMINED = 6
"""[captures] Bad captures whose pictures are compared with all other patterns, the worst first. Evidence: the cost must
not grow with the square of the number of captures; the value: none recorded."""

REASON_MAX_SHARE = 0.5
"""[1] A reason must leave less than this share of a capture's excess. Evidence: none recorded."""

DEFOCUS_DEPTHS = (0.015, 0.03, 0.06, 0.12, 0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0)
"""[depths] Distances, in depths of field, by which a capture may be out of focus, either way. Evidence:
derivation: speckle decorrelates within one depth, so that steps of half a depth miss nothing; for small errors, a step
that is off by half leaves a quarter of the excess."""

BLURS_PX = (0.4, 0.6, 0.8, 1.2, 1.8, 2.7, 4.0)
"""[px] Blurs that a capture out of focus may have. Evidence: steps of a factor of 1.5, as for `DEFOCUS_DEPTHS`."""

WHITE_CORRELATION = 0.15
"""[1] Residuals of a noisy capture correlate less with their neighbours' than this. Evidence: neighbouring pixels of
speckle correlate by 0.5 and more; the value: none recorded."""


@dataclass(frozen=True)
class Suspects:
    """Captures that stand out, the worst first.

    values: the effects of the model that judged them, under which half of the captures have an excess of at most
    `median_excess`. not_of_their_record: captures that `record_stands_out` finds. predicted: signals of all
    captures under the model, (capture, y, x), by which pictures are compared with other records.
    """

    indices: tuple[int, ...]
    values: Values
    median_excess: float
    not_of_their_record: frozenset[int]
    predicted: Images


@dataclass(frozen=True)
class _Reason:
    """The explanation of a picture. record: the capture whose record explains it, if there is one."""

    why: str
    sentence: str
    record: int | None = None


def explain_suspects(context: SearchContext, suspects: Suspects) -> tuple[BadCapture, ...]:
    """The suspects with the reasons why they are bad, by index."""
    examined = suspects.indices[:EXAMINED]
    reasons = {k: _Examination(context, k, suspects).reason(k in examined) for k in suspects.indices}
    copies = equal_pictures(context.data.captures)
    found = []
    for k, reason in sorted(reasons.items()):
        other, equals = reason.record, next((group for group in copies if k in group), [])
        twin = next((j for j in equals if j not in reasons), None)
        if twin is not None:
            found.append(BadCapture(k, DUPLICATE, f"Its picture is that of capture {twin}, whose record it fits."))
        elif other is not None and other in reasons and reasons[other].record == k:
            found.append(BadCapture(k, f"exchanged with {other}", f"Its picture shows what capture {other} should."))
        else:
            found.append(BadCapture(k, reason.why, reason.sentence))
    return tuple(found)


class _Examination:
    """One suspect: its picture with weights of the noise, and the excess that its own record leaves."""

    def __init__(self, context: SearchContext, k: int, suspects: Suspects) -> None:
        self._context, self._values, self._k, self._suspects = context, suspects.values, k, suspects
        self._captures = context.data.captures
        self._comparison = context.data_weighted_comparison(np.array([k]), 0.0)
        self._own = suspects.predicted[k]
        prediction = self._comparison.predictor(np.array([k]), self._values)
        self._dark = prediction.counts_without_lasers(self._captures.camera.black_level)
        floor = min(0.0, suspects.median_excess)
        self._limit = floor + REASON_MAX_SHARE * (float(self._excess(self._own[None])[0]) - floor)
        self._by_noise = floor + (1.0 + floor) * jitter_excess(self._comparison.pixel_count)

    def reason(self, is_examined: bool) -> _Reason:
        """The first kind of change that explains the picture. is_examined: compute further predictions."""
        for candidates in self._candidates() if is_examined else [self._other_records()]:
            if candidates and (best := min(candidates, key=lambda pair: pair[0]))[0] < self._limit:
                return best[1]
        if self._k not in self._suspects.not_of_their_record and self._has_white_residual():
            return _Reason(NOISY, "It has more noise than the camera's data sheet says.")
        if self._k in self._suspects.not_of_their_record:
            return _Reason(ANOTHER_PATTERN, "Its picture resembles the prediction for none of the file's patterns.")
        return _Reason(DISTURBED, "A part of its picture differs from its prediction.")

    def _candidates(self) -> Iterator[list[tuple[float, _Reason]]]:
        """The kinds of change, the cheapest first: (excess, reason) of each."""
        yield self._other_records()
        moved = self._moved()
        yield [one for one in moved if one[0] <= self._by_noise]
        if self._k in self._suspects.not_of_their_record:
            yield self._other_patterns([j for j in self._suspects.indices if j != self._k])
            yield self._other_patterns([j for j in range(len(self._captures)) if j not in self._suspects.indices])
        yield moved + self._defocused() + self._blurred()

    def _other_records(self) -> list[tuple[float, _Reason]]:
        excess = self._excess(self._suspects.predicted)
        return [(float(e), _shows(j)) for j, e in enumerate(excess) if j != self._k]

    def _other_patterns(self, others: Sequence[int]) -> list[tuple[float, _Reason]]:
        """The patterns of other captures at the suspect's own wavelength and distance."""
        if not others:
            return []
        records = self._captures.subset([self._k] * len(others))
        records = dataclasses.replace(records, levels=self._captures.levels[list(others)])
        predicted = self._context.predictor.create(captures=records)(np.arange(len(others)), self._values)
        excess = self._excess(np.asarray(predicted.signal))
        return [(float(e), _shows(j)) for j, e in zip(others, excess, strict=True)]

    def _moved(self) -> list[tuple[float, _Reason]]:
        light = np.where(self._comparison.weight > 0, self._comparison.light, 0.0)
        shift = measure_displacement(light, self._own[None])
        moved = self._comparison.predict_moved_camera(self._values, shift[None])
        sentence = "Its picture has moved by ({:.2g}, {:.2g}) pixels, (y, x).".format(*shift)
        return [] if moved is None else [(float(self._excess(moved)[0]), _Reason(MOVED, sentence))]

    def _defocused(self) -> list[tuple[float, _Reason]]:
        wavelength_m, distance_m = (c[self._k] for c in (self._captures.wavelength_m, self._captures.distance_m))
        depths = np.array(DEFOCUS_DEPTHS)
        offsets = np.concatenate([depths, -depths]) * _depth_of_field_m(self._captures, wavelength_m)
        focal_length_m = self._captures.focal_length_m
        at_m = distance_m + offsets
        offsets = offsets[at_m > 0] if focal_length_m is None else offsets[np.abs(at_m) < focal_length_m]
        if not len(offsets):
            return []
        records = self._captures.subset([self._k] * len(offsets))
        records = dataclasses.replace(records, distance_m=distance_m + offsets)
        predicted = self._context.predictor.create(captures=records)(np.arange(len(offsets)), self._values)
        excess = self._excess(np.asarray(predicted.signal))
        return [
            (
                float(e),
                _Reason(OUT_OF_FOCUS, f"Its camera was about {abs(z) * 1e3:.2g} mm out of focus."),
            )
            for z, e in zip(offsets, excess, strict=True)
        ]

    def _blurred(self) -> list[tuple[float, _Reason]]:
        blurs = BLURS_PX
        excess = self._excess(np.stack([gaussian_filter(self._own, sigma) for sigma in blurs]))
        return [
            (float(e), _Reason(OUT_OF_FOCUS, f"Its picture is blurred by about {sigma:g} pixels."))
            for sigma, e in zip(blurs, excess, strict=True)
        ]

    def _excess(self, signals: Images) -> NDArray[np.float64]:
        """χ²/n − 1 of the picture for each signal (record, y, x), each with its own gain."""
        weight, light = self._weighted_light()
        explained = np.zeros(len(signals))
        for number, signal in enumerate(signals):  # one signal at a time: few large pictures fit into memory
            model = np.asarray(weight * signal, dtype=np.float64)
            power = max(float(np.square(model).sum()), 1e-30)
            explained[number] = max(float((light * model).sum()), 0.0) ** 2 / power
        return (float(np.square(light).sum()) - explained) / self._comparison.pixel_count - 1.0

    def _has_white_residual(self) -> bool:
        weight, light = self._weighted_light()
        model = np.asarray(weight * self._own, dtype=np.float64)
        residual = light - model * float((light * model).sum() / max(float(np.square(model).sum()), 1e-30))
        return max(_neighbour_correlation(residual, weight > 0)) < WHITE_CORRELATION

    def _weighted_light(self) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        weight = self._comparison.weight[0]
        return weight, np.asarray(weight * (self._comparison.light - self._dark)[0], dtype=np.float64)


def _depth_of_field_m(captures: Captures, wavelength_m: float) -> float:
    """λ/NA²: on a Fourier bench of light from the modulator's edge, else of the first order that stops pass."""
    pitch_m = captures.slms[0].pitch_m
    if captures.focal_length_m is not None:
        sine = max(captures.levels.shape[2:]) * pitch_m / (2 * captures.focal_length_m)
    else:
        sine = captures.relay2.first_order_sine(wavelength_m, pitch_m)
    return float(wavelength_m / sine**2)


def _shows(record: int) -> _Reason:
    return _Reason(ANOTHER_PATTERN, f"Its picture shows the pattern of capture {record}.", record)


def _neighbour_correlation(residual: NDArray[np.float64], usable: NDArray[np.bool_]) -> tuple[float, float]:
    """Correlation of residuals (y, x) of neighbouring pixels along y and along x; unusable pixels don't count."""
    pairs = (
        (residual[1:] * residual[:-1], usable[1:] & usable[:-1]),
        (residual[:, 1:] * residual[:, :-1], usable[:, 1:] & usable[:, :-1]),
    )
    variance = float(np.square(residual[usable]).mean()) if usable.any() else 1.0
    along_y, along_x = (float(abs(product[both].mean())) / max(variance, 1e-30) for product, both in pairs)
    return along_y, along_x
