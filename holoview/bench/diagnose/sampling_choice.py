"""How predictions sample the light of a bench: whether camera pixels integrate, and how fine a simulation has to be.

A real camera's pixel measures the mean light over its area; many simulations take the light at its middle. Where the
light's grains are a few pixels wide, the difference looks like a blur of 0.29 pixels (the standard deviation across a
pixel), and so do samples that are too coarse for a steep iris: a grid knows only some directions, so that light which
a stop diffracts widely comes in again on the other side. Where directions at the edge of a stop pass by the share of
their cell that is inside, most of that is gone. None of these is a fault of the bench. What the captures state holds.
Where they state nothing, it is decided by likelihood, and said:

- On a Fourier bench, where nothing else depends on samples, pixels integrate unless the captures fit points better.
- In the near field the nominal bench is predicted with ever finer samples, of stops too. They are taken where they
  explain what the usual ones leave; a fault isn't explained so.
- On a chain of elements samples are open also where it is stated what pixels do: each element makes new sharp edges.

Far from the truth whatever smooths fits better. So both are compared once more beside the causes that a search names
(`nuisances.drop_sampling_artefacts`), and the search is repeated where the other one fits better. On a chain and in the
near field that is done already before further causes are searched, which else would be named for what samples leave
(`nuisances.samples_that_explain`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import PLAIN, SamplingConfig
from holoview.bench.captures.prepared_captures import Images, Masks, prepare_captures
from holoview.bench.captures.unknown_settings import GAIN, READ_NOISE
from holoview.bench.diagnose.capture_split import spread_over_wavelengths
from holoview.bench.diagnose.extended_model import PredictorWithKnownEffects
from holoview.bench.diagnose.likelihood import Comparison, Values
from holoview.light.numerics.sampling import AREA

MOST_UPSAMPLING = 16  # [samples] A modulator pixel has along each side; `Sampling` refuses more.
_POINTS, _AREAS = SamplingConfig(points=1), SamplingConfig(points=AREA)
_LADDERS = (
    (_AREAS, SamplingConfig(2, 2, AREA), SamplingConfig(2, 3, AREA), SamplingConfig(2, 4, AREA)),
    tuple(SamplingConfig(*finer, AREA, has_weighted_stops=True) for finer in ((1, 2), (2, 2), (2, 3), (2, 4))),
)
"""[1] Of the near field, each finer than the one before: with stops by samples, as simulations have them, and by
shares. Evidence: measured: four fault-free benches, simulated in a window five times as wide as 32 × 40 pixels, left an
excess χ²/n of 4.2 to 5.3 with (1, 2), 2.3 to 3.2 with (2, 2) and 0.7 to 1.0 with (2, 3) by samples, and by shares of
2.1 to 2.8, 0.5 to 0.6 and 0.2 to 0.4."""
REFITTED = _LADDERS[1][1:]
"""[1] With which causes of many fields are fitted again, and by which they are judged. Without the first step, which
changes mostly what such causes take."""
_CHAIN_LADDER = ((1, 2), (1, 4), (2, 2), (2, 3), (2, 4), (4, 4))
"""[1] Finer samples and padding of a chain, by cost. Evidence: measured: of a simulation with 4 samples a pixel and 4
times the width of 32 pixels, χ²/n of the true bench was 4 to 30 with (1, 2), 2 to 6 with (2, 2) and 1.02 to 1.08 with
(2, 4); of one with 8 samples 1.05 to 1.8 with (2, 4) and 1.01 to 1.05 with (4, 4)."""
_MAX_CHAIN_SAMPLES = 1 << 22
"""[samples] Larger grids of a chain aren't tried unasked, since the search may go on with them. Evidence: derivation: a
field takes about a second."""
_OTHERS = (
    SamplingConfig(1, 2, 2),
    SamplingConfig(2, 2, 1),
    SamplingConfig(2, 2, 2),
    SamplingConfig(1, 3, 1),
    SamplingConfig(1, 4, 1),
    SamplingConfig(2, 3, 2),
)
"""[1] Further ways that are tried beside causes. Evidence: the screening study: data made with samples a fourth as
large and read with half as large ones were misread as partial coherence."""
_MAX_SAMPLES = 1 << 26
"""[samples] Larger grids aren't tried. Evidence: derivation: half a gigabyte for a field in single precision."""
_CAPTURES = 4  # [captures] That are predicted with each.
_CACHE_MB = 64  # [MB] Cache of each predictor. Evidence: none recorded.
_NOISE_ROUNDS = 4  # [1] The variances follow the gain that was found, within 1 % after so many.
_ROUNDING = 1 / 12  # [counts²] Variance of whole counts, which `Camera.noise_variance` adds.
_MOST_ALIKE = 0.1
"""[1] Correlation of neighbouring residuals of noise alone. Evidence: derivation: that of 10 000 pixels is 0.01; errors
of a bench extend over a grain, where it is 0.5."""
_CHANCE, _SURELY_ALIKE = 3.0, 0.3  # standard errors that chance reaches; a correlation that is never called chance
_MIN_DELTA_CHI2 = 25.0  # [Δχ²] As `VerdictConfig.min_delta_chi2`.
_MAX_STEP_SHARE = 0.7
"""[1] A finer step of the ladder leaves less than this share of the excess. Evidence: measured on drawn benches: each
of the first three leaves a third to two thirds; at the floor a step leaves all."""
_MAX_LEFT_SHARE = 0.3
"""[1] Finer samples are taken if they leave less than this share of the excess. Evidence: a reason: what is left may be
a weak cause, which more than twice as large an error would hide; a bandwidth of an independent program left 7 %."""
MOST_BY_SAMPLES = 0.1
"""[1] Error of the light, over the mean light, beyond which finer samples aren't tried beside causes. Evidence:
measured: of the light of four near fields, one of them behind two modulators, they changed 3 to 5 %."""
_AS_GOOD = 1.1  # [1] Of samples as good as the best the excess is at most so many times as large. Evidence: a reason.
_LEFT, _LEFT_BY_SAMPLES = 1 / 15, 1 / 5
"""[1] What finer samples leave of χ²/n, over what they took of that of the first step; the latter of a near field with
stops by samples. Evidence: derivation: half the step leaves a quarter of an error of second order, a sixteenth of its
square. Measured on four simulated near fields with 6 and 8 samples a pixel in a window five times as wide: with stops
by shares 0.015 to 0.05, by samples 0.17 and 0.18."""


def other_samplings(captures: Captures, own: SamplingConfig) -> list[SamplingConfig]:
    """The ways of sampling beside `own` that these captures may have been made with, and that memory allows."""
    most_samples = _MAX_SAMPLES if captures.chain is None else _MAX_CHAIN_SAMPLES // 4
    if captures.is_fourier:
        possible: Sequence[SamplingConfig] = (_AREAS, _POINTS)
    elif captures.chain is not None:
        possible = [SamplingConfig(*finer, points) for finer in _CHAIN_LADDER for points in (AREA, 1)]
    else:
        possible = (*_OTHERS, *_LADDERS[0], *_LADDERS[1])
    stated = captures.camera.integrates
    if stated is not None:
        possible = [one for one in possible if _integrates(one, captures) == stated]
    return [
        one
        for one in possible
        if _as_stated(one, captures) != _as_stated(own, captures)
        and one.finer * captures.upsample <= MOST_UPSAMPLING
        and one.padded_samples(captures) // 4 <= most_samples
    ]


@dataclass(frozen=True)
class ChosenSampling:
    """A sampling that was assumed. chi2: χ²/n of the nominal bench with it; other: with the other kind of pixels.
    may_leave: excess of χ²/n that still finer samples might take; none where the kind of pixels alone was chosen."""

    sampling: SamplingConfig
    chi2: float
    other: float
    may_leave: float = 0.0

    @property
    def note(self) -> str:
        """What was assumed, and why."""
        return (
            f"Assumed, because nobody stated it: {_describe(self.sampling)}; χ²/n of the nominal bench is "
            f"{self.chi2:.4g} so, otherwise {self.other:.4g}."
        )


def describe_better(sampling: SamplingConfig) -> str:
    """A note on a sampling that was assumed after a search."""
    return f"Assumed, because nobody stated it and the causes fit better so: {_describe(sampling)}."


def _describe(sampling: SamplingConfig) -> str:
    where = "the light at their middle" if sampling.points in (None, 1) else "the mean light over their area"
    finer = sampling.without_points
    return f"camera pixels measure {where}" + (f", with {finer.description}" if finer != PLAIN else "")


def choose_sampling(captures: Captures, left_out: Sequence[int], known: Values) -> ChosenSampling | None:
    """How the nominal bench, with known effects, is to be sampled, where the captures don't state it.

    None for the usual sampling: it explains the captures as well as another one, or nothing explains them. left_out:
    captures that don't count.
    """
    kept = np.setdiff1d(np.arange(len(captures)), np.array(left_out, dtype=np.intp))
    if not len(kept):
        return None
    few = captures.subset(spread_over_wavelengths(captures, kept, _CAPTURES))
    data, indices, usual = prepare_captures(few), np.arange(len(few)), _predictor(few, known, PLAIN)
    variance = few.camera.noise_variance(np.maximum(data.light, 0.0))
    expected = Comparison(usual, data, indices, variance).fit_gains({}).expected
    comparison = Comparison(usual, data, indices, few.camera.noise_variance(expected))
    nominal, pixels = comparison.chi2_per_pixel({}), comparison.pixel_count

    def measured(sampling: SamplingConfig) -> float:
        return comparison.with_predictor(_predictor(few, known, sampling)).chi2_per_pixel({})

    if few.chain is not None:
        return _climbed(nominal, pixels, measured, other_samplings(few, PLAIN), is_patient=True)
    if not few.is_fourier:
        return _best_climbed(few, nominal, pixels, measured)
    areas = measured(_AREAS)
    if abs(nominal - areas) * pixels < _MIN_DELTA_CHI2:
        return None
    return ChosenSampling(_AREAS, areas, nominal) if areas < nominal else ChosenSampling(_POINTS, nominal, areas)


def finer_samples(
    captures: Captures,
    left: float,
    pixels: float,
    measured: Callable[[SamplingConfig], float],
    is_dear: bool = False,
) -> ChosenSampling | None:
    """The finer samples of a near field that explain what the usual ones leave beside causes; None where they don't.

    left: χ²/n with the usual samples, of so many pixels. measured: χ²/n with other ones. A cause may take what a step
    of the ladder would, as a camera's place that pixels integrate. is_dear: a prediction has many fields, so that only
    a real bench's stops are tried, no finer than needed.
    """
    if is_dear:
        return _climbed(left, pixels, measured, _possible(REFITTED, captures))
    return _best_climbed(captures, left, pixels, measured, is_patient=True)


def further_samples(
    captures: Captures,
    own: SamplingConfig,
    left: float,
    pixels: float,
    measured: Callable[[SamplingConfig], float],
) -> SamplingConfig | None:
    """Finer samples of a near field than those that were chosen by its nominal bench, where causes leave so little that
    a further step shows; None where it doesn't. The other arguments are as of `finer_samples`."""
    ladder = next((ladder for ladder in _LADDERS if own in ladder), ())
    finer = [one for one in _possible(ladder, captures) if one.samples_factor > own.samples_factor]
    chosen = _climbed(left, pixels, measured, finer, most_left=1.0)
    return None if chosen is None else chosen.sampling


def _possible(ladder: Sequence[SamplingConfig], captures: Captures) -> list[SamplingConfig]:
    """The steps of a ladder that captures may have been made with, and that memory allows."""
    others = other_samplings(captures, PLAIN)
    return [one for one in ladder if one in others]


def _best_climbed(
    captures: Captures,
    nominal: float,
    pixels: float,
    measured: Callable[[SamplingConfig], float],
    is_patient: bool = False,
) -> ChosenSampling | None:
    """The best that `_climbed` finds on the ladders of the near field; of two as good ones the one of fewer samples."""
    climbed = [
        _climbed(nominal, pixels, measured, _possible(ladder, captures), is_patient, leaves=leaves)
        for ladder, leaves in zip(_LADDERS, (_LEFT_BY_SAMPLES, _LEFT), strict=True)
    ]
    found = sorted(filter(None, climbed), key=lambda chosen: chosen.chi2)
    as_good = [one for one in found if one.chi2 - 1 <= _AS_GOOD * (found[0].chi2 - 1) + _MIN_DELTA_CHI2 / pixels]
    return min(as_good, key=lambda chosen: chosen.sampling.samples_factor, default=None)


def _climbed(
    nominal: float,
    pixels: float,
    measured: Callable[[SamplingConfig], float],
    ladder: Sequence[SamplingConfig],
    is_patient: bool = False,
    most_left: float = _MAX_LEFT_SHARE,
    leaves: float = _LEFT,
) -> ChosenSampling | None:
    """The finest sampling of the ladder that is needed, where it leaves less than a share of what the usual one does.
    is_patient: it climbs beyond a step that gains nothing. leaves: share of its gain that finer samples might take."""
    best, left, found = PLAIN, nominal, list[float]()
    for sampling in ladder:
        found.append(measured(sampling))
        if (left - found[-1]) * pixels >= _MIN_DELTA_CHI2 and found[-1] - 1 <= _MAX_STEP_SHARE * (left - 1):
            best, left = sampling, found[-1]
        elif not is_patient:
            break
    if best == PLAIN or left - 1 > most_left * (nominal - 1):
        return None
    return ChosenSampling(best, left, nominal, leaves * (found[0] - left))


def is_noise_assumed(captures: Captures) -> bool:
    """Whether the electrons a count were estimated from the pictures alone."""
    return any(sentence.startswith(GAIN) for sentence in captures.estimated)


def with_noise_of_residuals(
    captures: Captures, left_out: Sequence[int], known: Values, sampling: SamplingConfig
) -> Captures:
    """The captures with the electrons a count and the read noise that the residuals of the nominal bench, with known
    effects, show, where these were estimated from the pictures alone; with a sentence on it.

    As they were where residuals of neighbouring pixels are alike: an error of the bench is alike over a grain.
    """
    kept = np.setdiff1d(np.arange(len(captures)), np.array(left_out, dtype=np.intp))
    if not len(kept) or not is_noise_assumed(captures):
        return captures
    few = captures.subset(spread_over_wavelengths(captures, kept, _CAPTURES))
    data, indices, predictor = prepare_captures(few), np.arange(len(few)), _predictor(few, known, sampling)
    camera, expected = few.camera, np.maximum(data.light, 0.0)
    for _ in range(_NOISE_ROUNDS):
        comparison = Comparison(predictor, data, indices, camera.noise_variance(expected))
        fitted, usable = comparison.fit_gains({}), comparison.weight > 0
        expected = np.maximum(fitted.expected, 0.0)
        if any(_are_alike(fitted.residual, usable, axis) for axis in (1, 2)):
            return captures
        square, light = np.square(comparison.residual_counts(fitted))[usable], expected[usable]
        weight = comparison.weight[usable].astype(np.float64) ** 4  # of the square's variance, 2σ⁴
        slope, dark = np.polyfit(light.astype(np.float64), square.astype(np.float64), 1, w=np.sqrt(weight))
        if slope <= 0 or dark <= _ROUNDING:
            return captures
        camera = replace(camera, electrons_per_count=1 / slope, read_noise=math.sqrt(dark - _ROUNDING) / slope)
    how = "from what the nominal bench leaves, which neighbouring pixels don't share"
    sentences = [f"{GAIN} {camera.electrons_per_count:.3g}: {how}"]
    sentences.append(f"{READ_NOISE} {camera.read_noise / camera.electrons_per_count:.2g} counts: {how}")
    others = [one for one in captures.estimated if not one.startswith((GAIN, READ_NOISE))]
    return replace(captures, camera=camera, estimated=(*others, *sentences))


def _are_alike(residual: Images, usable: Masks, axis: int) -> bool:
    """Whether whitened residuals (capture, y, x) of pixels that are neighbours along an axis correlate, more than by
    chance. Where an assumed noise is wrong, few bright pixels decide, so that chance is measured: the standard error is
    that of the sum of their products."""
    moved, seen = np.moveaxis(residual, axis, 0), np.moveaxis(usable, axis, 0)
    both = seen[1:] & seen[:-1]
    products = (moved[1:] * moved[:-1])[both].astype(np.float64)
    power = float(np.square(residual[usable], dtype=np.float64).mean()) * len(products) if len(products) else 0.0
    if not power:
        return False
    error = math.sqrt(float(np.square(products).sum())) / power
    return abs(float(products.sum())) / power > max(_MOST_ALIKE, min(_CHANCE * error, _SURELY_ALIKE))


def _predictor(captures: Captures, known: Values, sampling: SamplingConfig) -> PredictorWithKnownEffects:
    return PredictorWithKnownEffects(captures, known, cache_mb=_CACHE_MB, **sampling.keywords)


def _integrates(sampling: SamplingConfig, captures: Captures) -> bool:
    """Whether camera pixels average more than one place."""
    if sampling.points is None:
        return bool(captures.camera.integrates)
    return sampling.points != 1


def _as_stated(sampling: SamplingConfig, captures: Captures) -> SamplingConfig:
    """The sampling with the points that the captures state, where it says nothing; of a Fourier bench these alone."""
    points = sampling.points
    if points is None and captures.camera.integrates:
        points = AREA
    elif points is None and captures.is_fourier:
        points = 1
    return SamplingConfig(points=points) if captures.is_fourier else replace(sampling, points=points)
