"""Which captures stand out from the others: by their excess, and by whose prediction they resemble.

All figures are relative to the other captures, by medians: an error of the model, which concerns all of them, blames
none. Two tests complement each other.

- *Excess.* With excess e = χ²/n − 1 of a capture and δ the excess that ordinary jitter and chance leave, log(e + δ) is
  compared with a straight line over the logarithm of the patterns' roughness (Theil–Sen) and with the median of the
  captures of its wavelength; a capture that exceeds them by more than the scatter of all allows stands out.
- *Records.* Every picture is correlated with the predictions of all captures. A picture that is nearer to unrelated
  predictions than to what its peers, captures with patterns at least as rough, reach with theirs, isn't of its record.
  That stays true where a large error of the model has decorrelated part of the speckle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import median_abs_deviation, norm, theilslopes

from holoview.captures.prepared_captures import Images
from holoview.diagnose.config import JudgementConfig

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


def excess_stands_out(
    excess: Floats,
    ordinary: Floats,
    roughness: Floats,
    group: Floats,
    min_ratio: float,
    config: JudgementConfig,
    plane: Floats | None = None,
) -> Flags:
    """Whether each capture's excess is larger than those of the others allow, (capture,).

    excess: χ²/n − 1. ordinary: the excess that jitter and chance leave. roughness: of the patterns. group: a number
    that captures of one wavelength share. min_ratio: excess + ordinary over the trend that is at least needed.
    plane: the same of a plane; where given, what a plane's captures have in common beyond the others blames none.
    """
    if len(excess) < config.min_captures:
        return np.zeros(len(excess), dtype=bool)
    logarithm = np.log(np.maximum(excess, 0.0) + ordinary)
    beyond = logarithm.copy()
    if len(excess) >= config.trend_captures:
        beyond -= _trend(np.log(np.maximum(roughness, 1e-12)), logarithm)
    for one in np.unique(group):
        same = group == one
        if same.sum() >= config.min_captures:
            beyond[same] -= np.median(beyond[same])
    beyond -= np.median(beyond)
    for one in np.unique(plane) if plane is not None else ():
        same = plane == one
        if same.sum() >= config.min_plane_captures:
            beyond[same] -= max(0.0, _lower_median(beyond[same]))
    sigma = float(median_abs_deviation(beyond, scale="normal"))
    quantile = float(norm.isf(config.false_alarm / len(excess)))
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


def reach_of_records(correlations: Floats) -> tuple[Floats, float]:
    """By how much each picture's correlation with its own record exceeds that with others; the scatter of the latter.

    correlations: (picture, record), square.
    """
    count = len(correlations)
    others = correlations[~np.eye(count, dtype=bool)].reshape(count, count - 1)
    unrelated = np.median(others, axis=1)
    scatter = float(median_abs_deviation((others - unrelated[:, None]).ravel(), scale="normal"))
    return np.diag(correlations) - unrelated, scatter


def record_stands_out(
    correlations: Floats, roughness: Floats, config: JudgementConfig, *, max_sigmas: float = np.inf
) -> Flags:
    """Whether each picture isn't of its own record, (capture,).

    correlations: (picture, record). max_sigmas: largest correlation with its own record beyond that with others, in
    standard deviations of the latter.
    """
    count = len(correlations)
    if count < config.min_captures:
        return np.zeros(count, dtype=bool)
    reach, scatter = reach_of_records(correlations)
    flags = np.zeros(count, dtype=bool)
    for k in range(count):
        peers = np.flatnonzero(roughness >= config.roughness_share * roughness[k])
        peers = peers[peers != k]
        if len(peers) < config.min_peers:
            continue
        usual = float(np.median(reach[peers]))
        limit = min(config.min_reach * usual, max_sigmas * scatter)
        flags[k] = usual > config.reach_sigmas * scatter and reach[k] < limit
    return flags


def without_planes(flags: Flags, plane: Floats, correlations: Floats, config: JudgementConfig) -> Flags:
    """The flags without those of planes that are off as a whole: more than half of their captures are flagged.

    plane: a number that captures of one plane share. correlations: (picture, record). A picture that another record
    predicts better than its own stays flagged.
    """
    if not flags.any() or len(flags) < config.min_captures:
        return flags
    _, scatter = reach_of_records(correlations)
    elsewhere = correlations - np.diag(correlations)[:, None]
    is_anothers = np.asarray((elsewhere > config.reach_sigmas * scatter).any(axis=1))
    kept = flags.copy()
    for one in np.unique(plane):
        same = np.asarray(plane == one)
        is_off = same.sum() >= config.min_plane_captures and 2 * flags[same].sum() > same.sum()
        if is_off and not same.all():
            kept[same] &= is_anothers[same]
    return kept


def _lower_median(values: Floats) -> float:
    """The median; of two in the middle the smaller one."""
    return float(np.sort(values)[(len(values) - 1) // 2])


def _trend(x: Floats, y: Floats) -> Floats:
    """A robust straight line through points, at their positions; the median where all x are equal."""
    if np.ptp(x) == 0:
        return np.full(len(y), np.median(y))
    slope, intercept, *_ = theilslopes(y, x)
    return np.asarray(intercept + slope * x)
