"""The objects of an in-line recording, each at the distance at which its edges are sharp.

The picture is divided into tiles. Each tile has two curves over the distance (`holoview.holograms.fields.depth_sweep`),
and votes for every maximum that rises above both its flanks by more than noise does. A baseline, towards an end of the
range or around an object beside the tile, has no such maximum. An object is where votes of both measures meet within a
depth of focus; light that an edge or a lens-like object gathers elsewhere has few. Then finer bands move the distance,
in the tiles that voted for it.

Without a place that gathers a good part of the votes no focus is clear. The objects that are found are then taken out
of the recording (`holoview.holograms.fields.remaining_light`): those that go with another's light were its rings, and
where votes are left something else stands, without a clear focus. The share of the structure that is left says how much
is in focus elsewhere, or nowhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.fields.depth_sweep import MOST_SAMPLES, RELATIVE_DEPTHS, Level, Swept, squared_slopes
from holoview.holograms.fields.remaining_light import without_objects

_NOISE = (2.2 * math.sqrt(2), 0.4 * math.sqrt(2))
"""Standard deviation of ln kurtosis and ln sparsity of speckle, times the square root of a tile's samples, every second
of which is independent."""
_ABOVE_NOISE = 5.0  # standard deviations of a maximum that votes
_FULL = (1.0, 0.3)  # rise above it of a full vote
_TOGETHER = 1.5  # depths of focus over which votes meet
_APART = 2.5  # depths of focus between objects
_LEAST, _LEAST_TOGETHER = ((2.0, 0.4), (3.0, 0.75)), 0.8
"""Votes of the first object and their share, with each depth of focus; or else the share of all objects."""
_SHADED, _SHADOW_SAMPLES = 0.7, 256  # of the incident light, within a large opaque object; of the band
_LEAST_IN_TILE, _LEAST_IN_ONE = 0.3, 1.9  # votes of each of a further object's tiles, of two, and of a single tile
_NEAR, _LEAST_NEAR = 10.0, 0.75
"""Objects nearer than so many depths of focus, and bright ones alone, need so many of all votes."""
APART_DEPTHS, _LEAST_BESIDE = (
    6.0,
    0.7,
)  # an object nearer to another than so many depths of focus needs so many of its votes
_BRIGHT, _DARK, _MANY_OF_FIRST = 1.4, 0.85, 0.3
"""Most of the incident light at the edges of an object; and of one with few of the first one's votes."""
_MOST_OBJECTS = 8
_LEAST_OF_FIRST = 0.04  # votes of a further object, over those of the first
_LEAST_FURTHER = 0.7
_EXAMINED_SAMPLES = 256  # of the band, where objects are taken away
_LEAST_TWICE = 3.0  # votes of a further object, and its votes once the first one's light is taken away, together
_LEAST_LEFT, _KNOWN = 0.7, 4.0
"""Votes of something without a clear focus, once the light of all objects is taken away, so many depths of focus from
them."""
MOST_UNEXPLAINED, _LEAST_ALONE = 0.11, 5.0
"""Most of the structure that the light of all objects may leave; if it is more and the first one has few votes, none is
clear. Of 49 drawn recordings of objects at one distance that was found 2 leave more, of 27 with a missed depth 9."""
_AROUND = 5  # distances on each side of an object, in a finer band


@dataclass(frozen=True)
class FocusedObject:
    """A distance at which a part of the picture is sharp.

    depth_of_focus_m: λ/NA² there, of the light that stands above the noise. share: of all votes. centre_m: (y, x) from
    the middle of the field, m, of what is sharp, None if it isn't known. votes: of tiles, of an in-line recording's.
    """

    distance_m: float
    depth_of_focus_m: float
    share: float
    centre_m: tuple[float, float] | None = None
    votes: float = 0.0


@dataclass(frozen=True)
class Unclear:
    """Something in the picture that has no clear focus. centre_m: (y, x) from the middle of the field, m."""

    centre_m: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Votes:
    """The maxima (k,) of tiles.

    weight: 0 … 1. depth_m: λ/NA² of the level. place, side: the tile's centre (k, 2) and side, as parts of the picture.
    """

    distance_m: NDArray[np.float64]
    weight: NDArray[np.float64]
    depth_m: NDArray[np.float64]
    measure: NDArray[np.int64]
    place: NDArray[np.float64]
    side: NDArray[np.float64]

    def met(self, weight: NDArray[np.float64]) -> NDArray[np.float64]:
        """Around each vote, twice the geometric mean of both measures' votes."""
        ways = np.abs(self.distance_m[:, None] - self.distance_m) / self.depth_m[:, None]
        near = weight * np.clip(_TOGETHER - ways, 0, 1)
        both = [near[:, self.measure == measure].sum(axis=1) for measure in (0, 1)]
        return 2 * np.sqrt(both[0] * both[1])


def search_objects(
    swept: Swept, low_m: float, high_m: float, progress: Callable[[int, int, str], None] | None
) -> tuple[list[FocusedObject], list[Unclear], float | None, list[Level]]:
    """The objects in a range of distances above 0, what else stands in the picture, the share of its structure that
    they don't explain, and the measures over the range.

    With a small depth of focus objects at several distances are told apart; where nothing is clear, as the edges are
    hidden by noise, a larger one follows.
    """
    plans = [
        [(n, (first_m, last_m), swept.nodes(first_m, last_m, n)) for n, first_m, last_m in levels]
        for levels in (swept.levels(low_m, high_m, depth) for depth in RELATIVE_DEPTHS)
    ]
    total, done = sum(len(nodes) for plan in plans for *_, nodes in plan), 0

    def told(distance_m: float) -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, total, f"{distance_m * 1e3:.4g} mm")

    first: list[Level] = []
    for plan, least in zip(plans, _LEAST, strict=True):
        levels = [swept.level(samples, own, told, nodes) for samples, own, nodes in plan]
        first = first or levels
        objects = find_objects(swept, levels, least)
        if objects:
            break
    return *(examined(swept, low_m, high_m, objects) if objects else ([], [], None)), first


def examined(
    swept: Swept, low_m: float, high_m: float, objects: list[FocusedObject]
) -> tuple[list[FocusedObject], list[Unclear], float | None]:
    """The objects that are clear, with and without the first one's light, what is left without the light of these, and
    its share of the structure.

    Rings and gathered light of the first object go with it; what else was found is not clear. An object of few
    votes that leaves much of the light is none.
    """
    coarse = swept.coarse(_EXAMINED_SAMPLES)
    kept, unclear = objects[:1], []
    if len(objects) > 1:
        rest, _ = without_objects(coarse, [objects[0].distance_m], finely=True)
        votes = _votes_over(rest, low_m, high_m)
        met = votes.met(votes.weight)
        for thing in objects[1:]:
            near = np.abs(votes.distance_m - thing.distance_m) < _APART * votes.depth_m
            if thing.votes + float(met[near].max(initial=0.0)) >= _LEAST_TWICE:
                kept.append(thing)
            else:
                unclear.append(Unclear(thing.centre_m or (0.0, 0.0)))
    rest, _ = without_objects(coarse, [thing.distance_m for thing in kept], finely=True)
    votes = _votes_over(rest, low_m, high_m)
    weight = votes.weight.copy()
    for thing in kept:
        weight[np.abs(votes.distance_m - thing.distance_m) < _KNOWN * votes.depth_m] = 0.0
    while (met := votes.met(weight)).max(initial=0.0) >= _LEAST_LEFT:
        best = int(np.argmax(met))
        near = np.abs(votes.distance_m - votes.distance_m[best]) < _APART * votes.depth_m[best]
        mine = near & (weight > 0)
        if _brightness(coarse, votes, float(votes.distance_m[best]), mine) <= _DARK:
            unclear.append(Unclear(_centre(swept, votes, mine)))
            break
        weight[near] = 0.0  # gathered light
    _, left = without_objects(coarse, [thing.distance_m for thing in kept])
    is_clear = left <= MOST_UNEXPLAINED or kept[0].votes >= _LEAST_ALONE
    return (kept, unclear, left) if is_clear else ([], [], None)


def _votes_over(swept: Swept, low_m: float, high_m: float) -> Votes:
    """The votes over a range, with the small depth of focus."""
    levels = [
        swept.level(samples, (first_m, last_m), lambda _: None, swept.nodes(first_m, last_m, samples))
        for samples, first_m, last_m in swept.levels(low_m, high_m, RELATIVE_DEPTHS[0])
    ]
    return votes_of(swept, levels)


def _centre(swept: Swept, votes: Votes, mine: NDArray[np.bool_]) -> tuple[float, float]:
    """(y, x) of some votes from the middle of the field, m."""
    centre = np.average(votes.place[mine], axis=0, weights=votes.weight[mine])
    y, x = ((float(part) - 0.5) * side for part, side in zip(centre, swept.sides_m, strict=True))
    return y, x


def votes_of(swept: Swept, levels: list[Level]) -> Votes:
    """The votes of all tiles."""
    from scipy.signal import find_peaks  # slow start: opening a field needs no curve

    rows: list[tuple[float, float, float, int, float, float, float]] = []
    for level in levels:
        band = swept.band(level.samples)
        for measure, curves in enumerate((np.log(level.kurtosis), np.log(level.sparsity))):
            least = _ABOVE_NOISE * _NOISE[measure] / level.tile
            for y, x in np.ndindex(*curves.shape[1:]):
                peaks, found = find_peaks(curves[:, y, x], prominence=least)
                place = [(r + (i + 0.5) * level.tile) / n for i, r, n in zip((y, x), level.rim, band, strict=True)]
                for peak, prominence in zip(peaks, found["prominences"], strict=True):
                    distance_m = float(level.distances_m[peak])
                    if level.own[0] <= distance_m < level.own[1]:
                        depth_m = swept.depth_of_focus_m(distance_m, level.samples)
                        weight = min(1.0, (prominence - least) / _FULL[measure])
                        rows.append((distance_m, weight, depth_m, measure, *place, level.tile / min(band)))
    table = np.array(rows).reshape(-1, 7)
    distance, weight, depth, measure_of, *place_of, side = table.T
    return Votes(distance, weight, depth, measure_of.astype(np.int64), np.array(place_of).T, side)


def find_objects(swept: Swept, levels: list[Level], least: tuple[float, float]) -> list[FocusedObject]:
    """The objects that are clearly in focus somewhere, the one with most votes first; none if no focus is clear.

    least: votes that the first object needs, and their share of all.
    """
    votes = votes_of(swept, levels)
    if not len(votes.weight):
        return []
    left, total = votes.weight.copy(), float(votes.weight.sum())
    found: list[tuple[float, float, float, NDArray[np.bool_]]] = []
    while len(found) < _MOST_OBJECTS:
        met = votes.met(left)
        best = int(np.argmax(met))
        if met[best] < (max(_LEAST_FURTHER, _LEAST_OF_FIRST * found[0][1]) if found else least[0]):
            break
        depth_m = float(votes.depth_m[best])
        near = np.abs(votes.distance_m - votes.distance_m[best]) < _APART * depth_m
        mine = near & (left > 0)
        distance_m = float(np.average(votes.distance_m[mine], weights=left[mine]))
        beside = [votes_of_it for at, votes_of_it, *_ in found if abs(at - distance_m) < APART_DEPTHS * depth_m]
        tiles = len(np.unique(votes.place[mine], axis=0))
        is_weak = bool(found) and float(left[mine].sum()) < (_LEAST_IN_TILE if tiles > 1 else _LEAST_IN_ONE) * tiles
        if is_weak or met[best] < _LEAST_BESIDE * max(beside, default=0.0):
            left = np.where(near, 0.0, left)
            continue
        found.append((distance_m, float(met[best]), float(left[mine].sum()) / total, mine))
        left = np.where(near, 0.0, left * _unowned(votes, mine))
    if not found:
        return []
    bright = [_brightness(swept, votes, distance_m, mine) for distance_m, _, _, mine in found]
    passive = [i for i, light in enumerate(bright) if light <= _BRIGHT]
    leading = passive[0] if passive else 0
    is_dark = bright[leading] <= _DARK
    kept = [found[leading]]
    for i in passive[1:]:
        if _light_in(swept, votes, found[leading][0], found[i][3]) < _SHADED:
            continue
        many = not is_dark and found[i][1] >= _MANY_OF_FIRST * found[leading][1]
        kept += [found[i]] * (bright[i] <= _DARK or many)
    if is_dark:  # beside opaque objects what is brighter is light that they gather, and has no say
        votes_of_objects = 1 - sum(thing[2] for thing, light in zip(found, bright, strict=True) if light > _DARK)
        kept = [(at, met_there, share / votes_of_objects, mine) for at, met_there, share, mine in kept]
    first_m, _, share, mine = kept[0]
    together = sum(share for _, met_there, share, _ in kept if met_there >= least[0])
    is_doubtful = not passive or first_m < _NEAR * float(votes.depth_m[mine].min())
    if together < (_LEAST_NEAR if is_doubtful else _LEAST_TOGETHER) and (is_doubtful or share < least[1]):
        return []
    return [
        replace(_refined(swept, votes, distance_m, share, mine), votes=met_there)
        for distance_m, met_there, share, mine in kept
    ]


def _brightness(swept: Swept, votes: Votes, distance_m: float, mine: NDArray[np.bool_]) -> float:
    """The mean intensity at sharp edges of an object, over the incident light's.

    Objects absorb or delay light, and are no brighter than it; light that a round edge or a lens-like object gathers
    is. 0 where the incident light isn't known.
    """
    if swept.incident == 0:
        return 0.0
    samples = round(2 * swept.side_m / math.sqrt(swept.wavelength_m * float(votes.depth_m[mine].min())))
    samples = min(samples, swept.most_samples)
    (field,) = swept.seen(np.array([distance_m]), samples)
    squared = squared_slopes(field).double().numpy() ** 2
    light = (field[:-1, :-1] / swept.incident + 1).abs().square().double().numpy()
    inside = np.zeros(squared.shape, bool)
    for part in _tiles(votes, mine, swept.band(samples)):
        inside[part] = True
    return float((light * squared)[inside].sum() / max(float(squared[inside].sum()), 1e-300))


def _light_in(swept: Swept, votes: Votes, distance_m: float, tiles_of: NDArray[np.bool_]) -> float:
    """The mean intensity at a distance in the tiles of some votes, over the incident light's; 1 where this isn't known.

    Light gathers behind a large opaque object; another object in its shadow isn't seen.
    """
    if swept.incident == 0:
        return 1.0
    samples = min(swept.most_samples, _SHADOW_SAMPLES)
    (field,) = swept.seen(np.array([distance_m]), samples)
    light = (field / swept.incident + 1).abs().square().numpy()
    return float(np.mean([light[part].mean() for part in _tiles(votes, tiles_of, swept.band(samples))]))


def _tiles(votes: Votes, mine: NDArray[np.bool_], band: tuple[int, int]) -> list[tuple[slice, slice]]:
    """The parts of a picture of so many samples in which the votes stand."""
    tiles = np.unique(np.round(np.column_stack([votes.place[mine], votes.side[mine]]), 4), axis=0)
    found = []
    for y, x, side in tiles:
        half = side * min(band) / 2
        rows, columns = (
            slice(max(0, round(at * n - half)), round(at * n + half)) for at, n in zip((y, x), band, strict=True)
        )
        found.append((rows, columns))
    return found


def _unowned(votes: Votes, mine: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Of each vote (k,), the part of its tile that an object with these votes leaves to others."""
    ways = np.abs(votes.place[:, None] - votes.place[mine]).max(axis=2)
    same = (ways < 0.1 * votes.side[mine]) & (votes.side[:, None] == votes.side[mine])
    return 1.0 - (same * votes.weight[mine]).max(axis=1)


def _refined(swept: Swept, votes: Votes, distance_m: float, share: float, mine: NDArray[np.bool_]) -> FocusedObject:
    """An object with the distance that finer bands give it, in the tiles that voted for it."""
    most = min(swept.most_samples, MOST_SAMPLES)
    samples = min(most, round(2 * swept.side_m / math.sqrt(swept.wavelength_m * float(votes.depth_m[mine].min()))))
    depth_m = float(votes.depth_m[mine].max())
    finest_m = swept.depth_of_focus_m(distance_m, most)
    is_seen = False
    while True:
        reach_m = 0.9 * depth_m
        nodes = distance_m + np.linspace(-1, 1, 2 * _AROUND + 1) * min(reach_m, 0.9 * distance_m)
        tiles = _tiles(votes, mine, swept.band(samples))
        values = _sparsity_in(swept, nodes, samples, tiles)
        noise = (_NOISE[0] + 2 * _NOISE[1]) / math.sqrt(sum(_area(tile) for tile in tiles))
        if is_seen and float(np.ptp(values)) < _ABOVE_NOISE * noise:
            break  # the finer edges are hidden by noise
        is_seen = True
        distance_m = _top(nodes, values)
        depth_m = swept.depth_of_focus_m(distance_m, samples)
        if samples >= most or depth_m <= 1.05 * finest_m:
            break
        samples = min(2 * samples, most)
    return FocusedObject(distance_m, depth_m, share, _centre(swept, votes, mine))


def _area(tile: tuple[slice, slice]) -> int:
    """Samples of a tile."""
    return int((tile[0].stop - tile[0].start) * (tile[1].stop - tile[1].start))


def _sparsity_in(
    swept: Swept, distances_m: NDArray[np.float64], samples: int, tiles: list[tuple[slice, slice]]
) -> NDArray[np.float64]:
    """ln⟨|∇u|⁴⟩ − 4·ln⟨|∇u|⟩, kurtosis times squared sparsity, in the mean over some tiles."""
    values = []
    for field in swept.seen(distances_m, samples):
        squared = squared_slopes(field).double().numpy()
        cuts = [squared[tile] for tile in tiles]
        values.append(np.mean([math.log((cut**2).mean() / np.sqrt(cut).mean() ** 4) for cut in cuts]))
    return np.array(values)


def _top(distances_m: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """The centre of gravity of the upper half of a maximum."""
    above = np.maximum(values - 0.5 * (values.max() + values.min()), 0)
    best = int(np.argmax(values))
    low, high = best, best
    while low > 0 and above[low - 1] > 0:
        low -= 1
    while high < len(values) - 1 and above[high + 1] > 0:
        high += 1
    inside = slice(low, high + 1)
    return (
        float(np.average(distances_m[inside], weights=above[inside])) if above[best] > 0 else float(distances_m[best])
    )
