"""Placements of pictures whose speckle no simple beam makes stand: by the light that is retrieved from the pictures.

A placement counts if held-out speckle stands far better with the pattern that is said to be shown than with other
patterns of the same far field: a retrieved light has many numbers, and fits a little of any picture.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from scipy.ndimage import gaussian_filter

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.picture_geometry import SpectrumPlacement
from holoview.bench.captures.prepared_captures import PreparedCaptures, prepare_captures
from holoview.bench.captures.speckle_measure import window_of
from holoview.bench.captures.speckle_retrieval import LightRetrieval
from holoview.light.numerics.speckle_match import SpeckleMatch

_PART_PX = 192, 384  # [px] Of the brightest window.
_PLACEMENTS = 3
_STROKES = 0.5, 0.65, 0.85, 1.1, 1.35  # of the assumed one
_SCALE_STEPS = -2, -1, 1, 2
_SCALE_STEP = 0.005
_REFINED, _STEPS = 2, 20
_LEAST = 0.4  # [1] Of the correlation of held-out speckle, below which no other patterns are tried.
_OTHERS = 2  # patterns that weren't shown
_ENVELOPE = 3.0, 3.0  # samples of the spectrum, over which the other patterns' far fields are like that of the shown


def retrieved_placement(
    placements: Sequence[SpectrumPlacement], captures_of: Callable[[SpectrumPlacement], Captures]
) -> tuple[SpectrumPlacement, list[SpeckleMatch]]:
    """The placement at which retrieved light makes the held-out speckle of the pictures stand best, with each picture's
    match.

    placements: the best first. captures_of: the captures of pictures that are placed so.
    """
    found = []
    for placement in placements[:_PLACEMENTS]:
        nominal = _part(captures_of, placement, 1.0)
        retrieval = LightRetrieval(nominal)
        starts = [(retrieval.start(stroke), retrieval, nominal, 1.0) for stroke in _STROKES]
        best = max(starts, key=lambda one: one[0].correlation)
        for step in _SCALE_STEPS:
            factor = 1 + step * _SCALE_STEP
            part = _part(captures_of, placement, factor)
            retrieval = LightRetrieval(part)
            starts.append((retrieval.start(best[0].stroke), retrieval, part, factor))
        starts.sort(key=lambda one: -one[0].correlation)
        for start, retrieval, part, factor in starts[:_REFINED]:
            found.append((retrieval.ascend(start, _STEPS), retrieval, part, placement, factor))
    light, retrieval, part, placement, factor = max(found, key=lambda one: one[0].held_out)
    others = range(_OTHERS if light.held_out > _LEAST else 0)
    chance = max((_by_chance(part, light.stroke, seed) for seed in others), default=_LEAST)
    matches = retrieval.matches(light, chance)
    placed = dataclasses.replace(
        placement, scale_px=placement.scale_px * factor, stroke=light.stroke, speckle=matches[0]
    )
    return placed, matches


def _part(
    captures_of: Callable[[SpectrumPlacement], Captures], placement: SpectrumPlacement, factor: float
) -> PreparedCaptures:
    placed = dataclasses.replace(placement, scale_px=placement.scale_px * factor)
    return prepare_captures(window_of(captures_of(placed), _PART_PX))


def _by_chance(part: PreparedCaptures, stroke: float, seed: int) -> float:
    """Correlation of held-out speckle with light retrieved for patterns of the same far field that weren't shown."""
    captures, rng = part.captures, np.random.default_rng(seed)
    highest = captures.slms[0].num_levels - 1
    turns = captures.levels[:, 0] / highest
    power = np.abs(np.fft.fft2(np.exp(2j * np.pi * turns))) ** 2
    envelope = np.sqrt(gaussian_filter(power, (0, *_ENVELOPE), mode="wrap"))
    other = np.fft.ifft2(envelope * np.exp(2j * np.pi * rng.random(power.shape)))
    levels = np.round(np.angle(other) / (2 * np.pi) % 1 * highest).astype(captures.levels.dtype)
    wrong = dataclasses.replace(part, captures=dataclasses.replace(captures, levels=levels[:, None]))
    retrieval = LightRetrieval(wrong)
    return retrieval.ascend(retrieval.start(stroke), _STEPS).held_out
