"""Captures that don't fit their records: dark, saturated, given twice, or unlike what is predicted for them.

What a capture should hold is what the nominal bench predicts for its patterns and settings, up to a gain that the
captures of a wavelength have in common: the light of a smooth pattern and that of a rough one differ a hundredfold on
many benches. An error of the bench moves many captures alike. So a capture is blamed only if it also differs from its
siblings, the captures of its wavelength whose patterns are about as rough.

Dark and saturated pictures show nothing. A picture that is given twice with the same record counts once, because a
held-out copy would confirm every fit to the other copy. The light that is predicted tells these before any search
(`find_useless_captures`).

Other bad captures stand out under a model. An error of the model concerns all captures, and blames none: captures are
judged by how much worse than others they fit their own predictions. Two tests complement each other.

- *Excess* (`excess_stands_out`). With excess e = χ²/n − 1 of a capture and δ the excess that ordinary jitter and chance
  leave, log(e + δ) is compared with a straight line over the logarithm of the patterns' roughness (Theil–Sen) and with
  the median of the captures of its wavelength. A capture stands out whose log(e + δ) exceeds both by more than the
  scatter of all captures allows.
- *Records* (`record_stands_out`). Every picture is correlated with the predictions of all captures. How much more its
  own prediction resembles it than the others do, is compared with the same of a picture that is as predicted. Its peers
  are the captures with patterns at least as rough. A picture isn't of its record if it reaches little of what is
  predicted, while its peers reach clearly more. The test works although a large error of the model has decorrelated
  part of the speckle.

Neither test blames a capture whose picture is as predicted within the noise (`exceeds_noise`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray
from scipy.stats import median_abs_deviation, norm, theilslopes

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.patterns import pattern_roughness
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.prepared_captures import Images
from holoview.bench.captures.records.light import CaptureLight, measure_light
from holoview.bench.captures.records.trials import central_region
from holoview.bench.diagnose.likelihood import Values

DARK, SATURATED, DUPLICATE = "dark", "saturated", "duplicate"
Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

DARK_SIGMAS = 3.0
"""[σ] A capture is dark if its mean light is below so many standard deviations of a dark mean. Evidence: derivation:
the chance of a dark picture to pass is 0.1 %."""

DARK_SHARE = 0.02
"""[1] A capture is also dark if its gain is below this share of the gain of its wavelength and of its siblings.
Evidence: jitter of exposures and power laws change gains by less than a factor of ten."""

FLAT_VARIANCE = 2.0
"""[1] A picture whose variance is below so many times that of the noise shows no pattern. Evidence: derivation:
speckle varies by its mean, hundreds of times as much."""

DIM_SHARE = 0.5
"""[1] A picture without a pattern is dark if its gain is below this share of the usual one: a black level that is
higher than recorded isn't light. Evidence: flat patterns, which show no speckle either, are as bright as predicted."""

SIBLINGS = 3
"""[captures] Nearest in roughness, of the same wavelength, to which a capture is compared. Evidence: derivation: their
median bears one bad one."""

LIGHT_REGION_PX = 128
"""[px] Modulator pixels across the middle of the pictures whose light is compared. Evidence: the cost, as for the
check of records."""

SATURATED_SHARE = 0.05
"""[1] A capture is saturated if a larger share of its pixels is. Evidence: derivation: speckle has an exponential
distribution; exposed as advised, a thousandth of the pixels is near saturation, and a twentieth at three times that
exposure."""

SATURATED_FACTOR = 5.0
"""[1] Its share of saturated pixels must also exceed by this factor the predicted share, that of its siblings, and the
median of all captures. Evidence:
where the zero order or every capture is saturated, one capture isn't to blame; the value: none recorded."""

USELESS_SHARE = 0.99
"""[1] Above this share a capture counts as saturated, whatever is predicted. Evidence: a reason: hardly a pixel is left
to compare."""

COPY_BY_CHANCE = 1e-6
"""[1] Equal pictures are copies if noise leaves them equal less often. Evidence: the chance that a verdict blames
captures of a right model (`judge.FALSE_ALARM`)."""

MIN_CAPTURES = 3
"""[captures] Captures are judged against each other from so many on. Evidence: derivation: a bad capture spoils the
median of fewer."""

MIN_PLANE_CAPTURES = 2
"""[captures] Where more than half of a plane's captures stand out before the search, and there are so many, the plane
is searched with the others, since its distance may be wrong. Evidence: derivation: a single capture may be bad
itself."""

TREND_CAPTURES = 8
"""[captures] From so many on, excesses are compared with a trend over roughness. Evidence: derivation: of eight, the
line bears two bad ones (29 %)."""

ROUGHNESS_SHARE = 0.8
"""[1] The peers of a capture are the others whose roughness is at least this share of its own. Evidence: an error of
the model decorrelates rough patterns first, so that a good capture resembles its prediction at least as much as its
peers do."""

MIN_PEERS = 2
"""[captures] A capture with fewer peers isn't judged by them. Evidence: derivation: `MIN_CAPTURES` with itself."""

MIN_REACH = 0.5
"""[1] A picture isn't of its record if its correlation with its own prediction, less its correlation with other
captures' predictions, is a smaller share of the predicted one than this share of its peers'. Evidence: halfway between
another pattern and a good capture."""

REACH_SIGMAS = 5.0
"""[σ] `MIN_REACH` counts only if the peers' share exceeds this many standard deviations. Evidence: derivation: else the
model resembles nothing."""

FALSE_ALARM = 0.01
"""[1] Chance that a file without a bad capture gets a capture blamed for its χ², if the logarithms of the excesses are
normally distributed; each capture has this chance over their number. Evidence: a convention."""

MAX_BAD_SHARE = 0.2
"""[1] With a larger share of bad captures, the verdict is neither consistent nor explained. Evidence: derivation:
medians and trends of the others bear up to 29 % (Theil–Sen)."""


@dataclass(frozen=True)
class BadCapture:
    """A capture that was left out.

    index: in the file, from 0. why: the reason in a few words. sentence: the reason with the measured numbers.
    """

    index: int
    why: str
    sentence: str


def find_useless_captures(captures: Captures, known: Values) -> tuple[BadCapture, ...]:
    """Captures that are dark, saturated, or copies of an earlier one, by index. known: effects of the nominal bench."""
    found: dict[int, BadCapture] = {}
    siblings = siblings_of(captures)
    light = measure_light(central_region(captures, LIGHT_REGION_PX), known)
    least = DARK_SIGMAS * captures.camera.dark_noise / np.sqrt(np.maximum(light.pixels, 1.0))
    usual = _usual_gain(captures, light, light.seen >= least)
    for k in np.flatnonzero(_is_dark(captures, light, least, usual, siblings)).tolist():
        expected = light.predicted[k] * usual[k]
        sentence = f"Its mean light is {light.seen[k]:.2g} counts above black"
        found[k] = BadCapture(k, DARK, sentence + (f"; {expected:.2g} were expected." if expected > 0 else "."))
    saturated = captures.saturated_shares
    common = float(np.median(saturated))
    for k in np.flatnonzero(saturated > SATURATED_SHARE).tolist():
        is_useless = saturated[k] > USELESS_SHARE or light.pixels[k] < 1
        if not is_useless and saturated[k] > SATURATED_FACTOR * common:
            ordinary = float(np.median(saturated[siblings[k]])) if siblings[k] else 0.0
            expected = _predicted_saturation(captures, k, known, float(usual[k]))
            is_useless = saturated[k] > SATURATED_FACTOR * max(expected, ordinary)
        if is_useless:
            found[k] = BadCapture(k, SATURATED, f"{saturated[k]:.0%} of its pixels are saturated.")
    for first, *copies in equal_pictures(captures):
        for k in copies:
            if has_same_record(captures, first, k):
                found.setdefault(k, BadCapture(k, DUPLICATE, f"It is capture {first} once more, which counts once."))
    return tuple(found[k] for k in sorted(found))


def siblings_of(captures: Captures) -> list[list[int]]:
    """For each capture the `SIBLINGS` others of its wavelength whose patterns are most nearly as rough."""
    roughness = np.log(np.maximum(pattern_roughness(captures), 1e-12))
    found = []
    for k in range(len(captures)):
        others = [j for j in np.flatnonzero(captures.wavelength_m == captures.wavelength_m[k]).tolist() if j != k]
        found.append(sorted(others, key=lambda j: abs(float(roughness[j] - roughness[k])))[:SIBLINGS])
    return found


def equal_pictures(captures: Captures) -> list[list[int]]:
    """Groups of two or more captures whose pictures are equal, count by count, and not by chance.

    Two readings of a pixel with noise of standard deviation σ counts are equal with a chance of at most 1/(2√π·σ).
    """
    groups: dict[bytes, list[int]] = {}
    for k, image in enumerate(captures.images):
        groups.setdefault(sha256(image.tobytes()).digest(), []).append(k)
    return [group for group in groups.values() if len(group) > 1 and not _is_equal_by_chance(captures, group[0])]


def _is_equal_by_chance(captures: Captures, k: int) -> bool:
    camera = captures.camera
    variance = camera.noise_variance(captures.images[k].astype(np.float64) - camera.black_level)
    chance = np.minimum(1.0, 1.0 / np.sqrt(4 * np.pi * variance[captures.images[k] < camera.saturation]))
    return float(np.log(chance).sum()) > float(np.log(COPY_BY_CHANCE))


def has_same_record(captures: Captures, first: int, second: int) -> bool:
    """Whether two captures have the same patterns, wavelength and distance."""
    same = (captures.levels, captures.wavelength_m, captures.distance_m)
    return all(np.array_equal(column[first], column[second]) for column in same)


def bad_share(bad: Sequence[BadCapture], count: int) -> float:
    """Share of bad captures among `count` captures, of which copies count once."""
    copies = sum(b.why == DUPLICATE for b in bad)
    return (len(bad) - copies) / max(count - copies, 1)


def _usual_gain(captures: Captures, light: CaptureLight, is_lit: Flags) -> Floats:
    """The median gain of the lit captures of each capture's wavelength, (capture,); 0 where there are none."""
    usual = np.zeros(len(captures))
    for wavelength in captures.wavelengths_m:
        same = captures.wavelength_m == wavelength
        gains = light.gain[same & is_lit & np.isfinite(light.gain)]
        usual[same] = float(np.median(gains)) if len(gains) else 0.0
    return usual


def _is_dark(
    captures: Captures, light: CaptureLight, least: Floats, usual: Floats, siblings: Sequence[Sequence[int]]
) -> Flags:
    """Whether each capture has no light, or little of it, or less and no structure, where light is predicted.

    least: mean counts of light that aren't noise. usual: gain.
    """
    variance = np.array(
        [float(image[captures.usable_pixels(k)].var(dtype=np.float64)) for k, image in enumerate(captures.images)]
    )
    is_flat = variance < FLAT_VARIANCE * captures.camera.noise_variance(light.seen)
    gain = np.nan_to_num(light.gain)
    around = [float(np.median(gain[list(near)])) if near else np.inf for near in siblings]
    relative = gain / np.maximum(np.minimum(usual, around), 1e-300)
    is_little = (relative < DARK_SHARE) | (is_flat & (relative < DIM_SHARE)) | (light.seen < least)
    is_without_any = (light.seen < least) & ((usual <= 0) | (light.pixels < 1))
    return np.asarray((is_little & (light.predicted * usual >= least)) | is_without_any)


def _predicted_saturation(captures: Captures, k: int, known: Values, gain: float) -> float:
    """The share of a picture's pixels whose predicted light reaches saturation. gain: counts per predicted unit."""
    prediction, camera = Predictor(captures, cache_mb=1)([k], known), captures.camera
    dark = prediction.counts_without_lasers(camera.black_level)
    counts = gain * prediction.signal[0].numpy() + dark + camera.black_level
    return float((counts >= camera.saturation).mean())


def excess_stands_out(
    excess: Floats,
    ordinary: Floats,
    roughness: Floats,
    group: Floats,
    min_ratio: float,
    plane: Floats | None = None,
) -> Flags:
    """Whether each capture's excess is larger than the scatter of the other captures' excesses allows, (capture,).

    excess: χ²/n − 1. ordinary: the excess that jitter and chance leave. roughness: of the patterns. group: a number
    that captures of one wavelength share. min_ratio: the least ratio of excess + ordinary to the trend. plane: a number
    that captures of one plane share; where given, an excess that all captures of a plane have in common blames none of
    them.
    """
    if len(excess) < MIN_CAPTURES:
        return np.zeros(len(excess), dtype=bool)
    logarithm = np.log(np.maximum(excess, 0.0) + ordinary)
    beyond = logarithm.copy()
    if len(excess) >= TREND_CAPTURES:
        beyond -= _trend(np.log(np.maximum(roughness, 1e-12)), logarithm)
    for one in np.unique(group):
        same = group == one
        if same.sum() >= MIN_CAPTURES:
            beyond[same] -= np.median(beyond[same])
    beyond -= np.median(beyond)
    for one in np.unique(plane) if plane is not None else ():
        same = plane == one
        if same.sum() >= MIN_PLANE_CAPTURES:
            beyond[same] -= max(0.0, _lower_median(beyond[same]))
    sigma = float(median_abs_deviation(beyond, scale="normal"))
    quantile = float(norm.isf(FALSE_ALARM / len(excess)))
    return np.asarray(beyond > max(quantile * sigma, float(np.log(min_ratio))), dtype=bool)


def record_correlations(light: Images, usable: Flags, predicted: Images) -> Floats:
    """Pearson's correlation of each picture with each prediction, over the picture's usable pixels, (picture, record).

    light, usable: (capture, y, x), counts and which pixels count. predicted: (record, y, x).
    """
    mask = usable.reshape(len(usable), -1).astype(np.float32)
    count = np.maximum(mask.sum(axis=1, dtype=np.float64), 1.0)
    picture = light.reshape(len(light), -1) * mask
    picture = (picture - mask * (picture.sum(axis=1, dtype=np.float64) / count).astype(np.float32)[:, None]).astype(
        np.float32
    )
    records = predicted.reshape(len(predicted), -1)
    records = records / np.maximum(records.mean(axis=1, keepdims=True), 1e-30)  # squares stay in the range of f32
    covariance = (picture @ records.T).astype(np.float64)
    mean = (mask @ records.T).astype(np.float64) / count[:, None]
    variance = (mask @ np.square(records).T).astype(np.float64) / count[:, None] - np.square(mean)
    scale = np.sqrt(np.square(picture, dtype=np.float64).sum(axis=1) / count)[:, None] * np.sqrt(
        np.maximum(variance, 0.0)
    )
    return np.asarray(covariance / count[:, None] / np.maximum(scale, 1e-30))


def exceeds_noise(excess: Floats, ordinary: Floats) -> Flags:
    """Whether pictures differ from their predictions beyond the noise, (capture,).

    excess: χ²/n − 1. ordinary: the excess that jitter and chance leave. Where most captures scatter less than their
    records say, the noise is what the median capture leaves.
    """
    floor = min(0.0, float(np.median(excess)))
    return np.asarray(1.0 + excess > (1.0 + floor) * (1.0 + ordinary))


def predicted_reach(expected: Images, usable: Flags, noise_variance: Images) -> Floats:
    """The reach (`reach_of_records`) that each picture has if it is as predicted, (capture,).

    Predictions resemble each other where their light has the same outlines, as about the axis of a Fourier bench; and
    noise lowers every correlation. expected, noise_variance: (capture, y, x), counts and counts². usable: which pixels
    count.
    """
    alike, _ = reach_of_records(record_correlations(expected, usable, expected))
    pixels = np.maximum(usable.sum(axis=(1, 2)), 1)
    mean, square, noise = (
        np.einsum("kyx,kyx->k", usable, values, dtype=np.float64) / pixels
        for values in (expected, np.square(expected, dtype=np.float64), noise_variance)
    )
    signal = np.maximum(square - np.square(mean), 0.0)
    return np.asarray(alike * np.sqrt(signal / np.maximum(signal + noise, 1e-30)))


def reach_of_records(correlations: Floats) -> tuple[Floats, float]:
    """How much more each picture correlates with its own record than with other records, and the scatter of the
    correlations with other records.

    correlations: (picture, record), square.
    """
    count = len(correlations)
    others = correlations[~np.eye(count, dtype=bool)].reshape(count, count - 1)
    unrelated = np.median(others, axis=1)
    scatter = float(median_abs_deviation((others - unrelated[:, None]).ravel(), scale="normal"))
    return np.diag(correlations) - unrelated, scatter


def record_stands_out(
    correlations: Floats, predicted: Floats, roughness: Floats, *, max_sigmas: float = np.inf
) -> Flags:
    """Whether each picture isn't of its own record, (capture,).

    correlations: (picture, record). predicted: the reach of pictures that are as predicted, (capture,). max_sigmas: a
    capture stands out only if its correlation with its own record exceeds its correlations with others by at most so
    many of their standard deviations.
    """
    count = len(correlations)
    if count < MIN_CAPTURES:
        return np.zeros(count, dtype=bool)
    reach, scatter = reach_of_records(correlations)
    share = reach / np.maximum(predicted, 1e-9)
    flags = np.zeros(count, dtype=bool)
    for k in range(count):
        peers = np.flatnonzero(roughness >= ROUGHNESS_SHARE * roughness[k])
        peers = peers[peers != k]
        if len(peers) < MIN_PEERS:
            continue
        usual = float(np.median(share[peers])) * predicted[k]
        limit = min(MIN_REACH * usual, max_sigmas * scatter)
        flags[k] = usual > REACH_SIGMAS * scatter and reach[k] < limit
    return flags


def without_planes(flags: Flags, plane: Floats, correlations: Floats) -> Flags:
    """The flags without those of planes that are off as a whole, of whose captures more than half are flagged.

    plane: a number that captures of one plane share. correlations: (picture, record). A picture that another record
    predicts better than its own stays flagged.
    """
    if not flags.any() or len(flags) < MIN_CAPTURES:
        return flags
    _, scatter = reach_of_records(correlations)
    elsewhere = correlations - np.diag(correlations)[:, None]
    is_anothers = np.asarray((elsewhere > REACH_SIGMAS * 2**0.5 * scatter).any(axis=1))  # both correlations scatter
    kept = flags.copy()
    for one in np.unique(plane):
        same = np.asarray(plane == one)
        is_off = same.sum() >= MIN_PLANE_CAPTURES and 2 * flags[same].sum() > same.sum()
        if is_off and not same.all():
            kept[same] &= is_anothers[same]
    return kept


def _lower_median(values: Floats) -> float:
    """The median; of an even number of values the smaller of the middle two."""
    return float(np.sort(values)[(len(values) - 1) // 2])


def _trend(x: Floats, y: Floats) -> Floats:
    """A robust straight line through points, at their positions; the median where all x are equal."""
    if np.ptp(x) == 0:
        return np.full(len(y), np.median(y))
    slope, intercept, *_ = theilslopes(y, x)
    return np.asarray(intercept + slope * x)
