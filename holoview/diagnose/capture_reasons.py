"""Why a capture isn't what its record says: the change of the record, or of the picture, that explains it.

The picture is compared with the predictions of other records: those of the other captures, its own with their patterns,
its own for a moved camera and for other distances, and its own blurred. What leaves less than half of its excess is the
reason. What nothing explains is noise if the residuals of neighbouring pixels don't correlate, else another pattern or
a disturbance.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from holoview.captures.prepared_captures import Images
from holoview.diagnose.correct.bad_captures import DUPLICATE, BadCapture, equal_pictures
from holoview.diagnose.likelihood import Values
from holoview.diagnose.search_context import SearchContext
from holoview.diagnose.starts.picture import measure_displacement

ANOTHER_PATTERN, MOVED, OUT_OF_FOCUS, NOISY, DISTURBED = (
    "another pattern",
    "moved",
    "out of focus",
    "noisy",
    "disturbed",
)

EXAMINED = 6
"""[captures] Bad captures whose pictures are compared with all other patterns, the worst first. Evidence: the cost must
not grow with the square of the session; the value: none recorded."""

REASON_MAX_SHARE = 0.5
"""[1] A reason must leave less than this share of a capture's excess. Evidence: none recorded."""

DEFOCUS_DEPTHS = (0.06, 0.12, 0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0)
"""[depths] Distances, in depths of field λ/NA², by which a capture may be out of focus, either way. Evidence:
derivation: speckle decorrelates within one depth, so that steps of half a depth miss nothing, and of small errors half
a step too much or too little leaves a quarter of the excess."""

BLURS_PX = (0.4, 0.6, 0.8, 1.2, 1.8, 2.7, 4.0)
"""[px] Blurs that a capture out of focus may have. Evidence: steps of a factor of 1.5, as for `defocus_depths`."""

WHITE_CORRELATION = 0.15
"""[1] Residuals of a noisy capture correlate with their neighbours' by less. Evidence: neighbouring pixels of speckle
correlate by 0.5 and more; the value: none recorded."""


@dataclass(frozen=True)
class Suspects:
    """Captures that stand out, the worst first.

    values: the effects of the model that judged them, under which half of the captures have an excess of at most
    `median_excess`. not_of_their_record: captures whose pictures are nearer to unrelated predictions than to what
    others reach with theirs. predicted: signals of all captures under the model, (capture, y, x), by which pictures are
    compared with other records.
    """

    indices: tuple[int, ...]
    values: Values
    median_excess: float
    not_of_their_record: frozenset[int]
    predicted: Images


@dataclass(frozen=True)
class _Reason:
    """What explains a picture. record: the capture whose record does, if one does."""

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
        self._limit = REASON_MAX_SHARE * self._excess(self._own[None])[0]

    def reason(self, is_examined: bool) -> _Reason:
        """The first kind of change that explains the picture. is_examined: compute further predictions."""
        for candidates in self._candidates() if is_examined else [self._other_records()]:
            if candidates and (best := min(candidates, key=lambda pair: pair[0]))[0] < self._limit:
                return best[1]
        if self._k not in self._suspects.not_of_their_record and self._has_white_residual():
            return _Reason(NOISY, "It has more noise than the camera's data sheet says.")
        if self._k in self._suspects.not_of_their_record:
            return _Reason(ANOTHER_PATTERN, "Its picture resembles the prediction for none of the session's patterns.")
        return _Reason(DISTURBED, "A part of its picture differs from its prediction.")

    def _candidates(self) -> Iterator[list[tuple[float, _Reason]]]:
        """The kinds of change, the cheapest first: (excess, reason) of each."""
        yield self._other_records()
        yield self._moved()
        if self._k in self._suspects.not_of_their_record:
            yield self._other_patterns([j for j in self._suspects.indices if j != self._k])
            yield self._other_patterns([j for j in range(len(self._captures)) if j not in self._suspects.indices])
        yield self._defocused() + self._blurred()

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
        sine = self._captures.relay2.first_order_sine(wavelength_m, self._captures.slms[0].pitch_m)
        depths = np.array(DEFOCUS_DEPTHS)
        offsets = np.concatenate([depths, -depths]) * wavelength_m / sine**2
        if not self._captures.is_fourier:
            offsets = offsets[distance_m + offsets > 0]
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
        for number, signal in enumerate(signals):  # one at a time: few large pictures fit into memory
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
