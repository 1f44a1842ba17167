"""The light on the modulator that makes the predicted speckle stand in a picture, found far from the nominal bench.

Where a beam is small, its wavefront wrong by radians and the stroke half of what is assumed, no single cause brings
the speckle to its place, and every least-squares fit prefers what smooths the prediction. The correlation of local
contrasts (`numerics.speckle_match`) has a gradient there. Beam, wavefront over the beam, stroke and unmodulated light
are varied together, from several sizes and strokes, with the picture free to move by tilts of the wavefront. Parts of
that light without which held-out speckle stands as well are dropped; the others are handed on as values of effects.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from holoview.bench.captures.speckle_retrieval import LightRetrieval, NearestBeam, Retrieved
from holoview.bench.diagnose.search_context import SearchEnded
from holoview.bench.diagnose.speckle_light import (
    MIDDLE,
    NO_SHAPE,
    NO_VALUES,
    NOMINAL,
    NOMINAL_LENGTHS,
    PARTS,
    SECOND,
    TERMS,
    Circle,
    Lengths,
    NearBeam,
    Pictures,
    Point,
    SpeckleSearch,
    circle_of,
    rebased,
)
from holoview.light.effects.beam import WAVEFRONT_TERMS
from holoview.util.progress import ProgressCallback

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

_STROKES = 0.45, 0.6, 0.75, 0.9, 1.05, 1.2, 1.4  # over the assumed one, with which light is retrieved
_MOST_SCALE, _SCALE_STEPS = 0.0155, (0.006, 0.001)  # of the focal length
_MOST_FARTHER, _FARTHER_STEPS = 0.15, (0.03, 0.006)  # of the distance of near fields
_MOST_WIDER, _WIDER_STEPS = 0.3, (0.05, 0.01)  # of the gap
_PLACES_PX = np.arange(-3, 4) / 2  # of the second modulator, along each axis
_LEADERS = 2
_LONG = 100
"""[steps] Of an ascent of retrieved light where short ones from the strokes that stand best at the start lead nowhere.
Evidence: a drawn bench with one picture in a few grains: at the start its speckle stood best with twice the true
stroke; after 30 steps held-out grains told the stroke, after 130 they stood by 0.87."""
_START_SIZES, _START_STROKES = (0.7, 1.0, 1.5, 2.2, 3.3), (0.5, 0.9)  # of simple beams
_WAVE_SIZES, _WAVE_STROKES, _WAVE_TERMS = (1.0, 1.5, 2.2, 3.3), (0.7, 1.15), ("z4", "z7", "z8")
_WAVES = tuple(itertools.product((-1.1, 0.0, 1.1), repeat=len(_WAVE_TERMS)))
"""[rad] R.m.s. of the terms over the beam. Evidence: drawn benches: ascents lead to the light from within a radian."""
_WAVE_LEADERS = 16
_MOST_TRIED_PX = 1.5e8
"""[pixels] Of modulators and pictures, predicted for all beams with wavefronts. Evidence: the cost: up to a minute of
a core."""
_CLEAR = 0.9
"""[1] Correlation above which no other start is tried. Evidence: drawn benches: wrong valleys stayed below 0.75, a beam
in a wrong place with the right wavefront at 0.86."""
_SCANS = len(_STROKES) + 1
_KICKS = 8
_STAGES = _SCANS + _LEADERS + 1 + _KICKS
_LEAST_STEP = 0.002  # of the correlation
LEAST_LOSS = 0.01
"""[1] Of the held-out correlation without a part, below which the part isn't named. Evidence: the prototype: a trefoil
and unmodulated light that weren't there gave 0.001, the least true part 0.011."""
LEAST_SIGMAS = 5.0
"""[σ] Loss of the correlation's mean over held-out blocks below which the part isn't named. Evidence: the prototype:
1.7 σ and less of parts that weren't there."""


@dataclass(frozen=True)
class FoundLight:
    """What a search by speckle found.

    values: of the effects, {id: {parameter: value}}. before, after: correlation of the held-out speckle at the nominal
    bench and with the values. losses: of each part of the light, by how much this correlation is lower without it, and
    by how many standard deviations; parts that aren't in `values` too. explained: what a near field's beam explains of
    the brightness that even light leaves; None of a Fourier bench, where speckle tells the beam. was_ended: whether the
    search was ended before its parts were judged. is_of_parts: whether it was sought in parts of pictures. earlier:
    values of the effects that an earlier search by derivatives has named.
    """

    values: dict[str, dict[str, float]]
    before: float
    after: float
    losses: dict[str, tuple[float, float]]
    explained: float | None = None
    was_ended: bool = False
    is_of_parts: bool = False
    earlier: dict[str, dict[str, float]] = dataclasses.field(default_factory=dict)


def with_or_without_unmodulated(values: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
    """Values of effects, {id: {parameter: value}}, with unmodulated light if it isn't there and without it if it is.

    Most of it goes into the zero order, where no speckle tells it, and a stroke imitates the rest: brightness decides.
    """
    others = {name: own for name, own in values.items() if name != "undiffracted"}
    return others if len(others) < len(values) else {**others, "undiffracted": {"share": 0.0, "quadrature": 0.0}}


def find_light(
    pictures: Pictures,
    part: Pictures,
    progress: ProgressCallback,
    beam: NearBeam | None = None,
    earlier: Mapping[str, Mapping[str, float]] = NO_VALUES,
    threads: int = 1,
    seed: int = 0,
) -> FoundLight:
    """The light that makes the speckle of pictures stand, as values of effects. seed: of the random kicks.

    part: a smaller window of the pictures, in which the light is sought before it is refined and judged. beam: of near
    fields, as brightness tells it. earlier: values of causes that another search has found. threads: in which
    independent ascents run; the light is the same for any number. progress: may raise `SearchEnded`: then the best
    light so far counts, with all of its parts; before there is one, the exception is passed on.
    """
    told, steps = "light on the modulator, by speckle", _STAGES + len(PARTS)
    before, shape = SpeckleSearch(pictures).held_out(None), NO_SHAPE if beam is None else beam.numbers(part)
    task = _Task(part, shape, lambda number: progress(number, steps, told), threads)
    found, was_ended = _sought(task, earlier, np.random.default_rng(seed))
    point, losses = found.point, dict[str, tuple[float, float]]()
    search = SpeckleSearch(pictures.scaled(found.lengths), found.circle, shape)
    if not was_ended:
        point = _polished(search, point)
        if beam is not None and shape:
            beam = NearBeam.beside(point, beam.pictures.scaled(found.lengths), found.circle)
            search.shape = beam.numbers(pictures)
            point = search.ascend(point | dict(search.shape), 12, rate=0.5)[1]
        try:
            point, losses = without_superfluous(search, point, lambda n: task.progress(_STAGES + n), threads)
        except SearchEnded:
            was_ended = True
    dropped = [part for part, loss in losses.items() if not _is_needed(loss)]
    dropped += [name for name in ("shape", "stray light") if _is_absent(name, search.shape)]
    values = search.effect_values(point, dropped)
    captures, lengths = pictures.captures, found.lengths
    if captures.is_fourier:
        values["camera_alignment"]["magnification"] = lengths.far - 1
    elif lengths.far != 1:
        values["distance"] = {"distance_error": (lengths.far - 1) * float(captures.distance_m[0])}
    if captures.gap_m and lengths.gap != 1:
        values["gap"] = {"gap_error": (lengths.gap - 1) * captures.gap_m}
    explained = None if beam is None else beam.explained
    after, is_of_parts = search.held_out(point), bool(pictures.parts)
    causes = {name: dict(own) for name, own in earlier.items()}
    return FoundLight(values, before, after, losses, explained, was_ended, is_of_parts, causes)


@dataclass(frozen=True)
class _Leader:
    """A point from which a search goes on, its score, the circle of its terms, and the bench's lengths."""

    score: float
    point: Point
    circle: Circle
    lengths: Lengths


@dataclass(frozen=True)
class _Task:
    """What a search has. part: the window in which light is sought. shape: numbers of a beam that stay. progress: is
    told the stage; may raise `SearchEnded`. threads: in which independent ascents run."""

    part: Pictures
    shape: Mapping[str, float]
    progress: Callable[[int], None]
    threads: int = 1

    def search(self, circle: Circle = MIDDLE, lengths: Lengths = NOMINAL_LENGTHS) -> SpeckleSearch:
        """The search with a circle of the wavefront's terms, on a bench of other lengths."""
        return SpeckleSearch(self.part.scaled(lengths), circle, self.shape)

    def side_by_side(self, work: Callable[[_Item], _Result], items: Sequence[_Item]) -> Iterator[_Result]:
        """The results of pieces of work that don't depend on each other, in their order, each as soon as it's there."""
        return _side_by_side(self.threads, work, items)


def _side_by_side(threads: int, work: Callable[[_Item], _Result], items: Sequence[_Item]) -> Iterator[_Result]:
    """As `_Task.side_by_side`. Whoever stops asking waits for the pieces that run."""
    if threads < 2:
        yield from map(work, items)
        return
    pool = ThreadPoolExecutor(threads)
    try:
        yield from pool.map(work, items)
    finally:
        pool.shutdown(cancel_futures=True)


def _ways(task: _Task, earlier: Mapping[str, Mapping[str, float]]) -> list[Callable[[_Task], _Leader]]:
    """The starts of a search, the most promising first: causes that were found before, retrieved light, and of near
    fields the place of the second modulator (before retrieved light where brightness tells the beam)."""
    is_fourier = task.part.captures.is_fourier
    ways: list[Callable[[_Task], _Leader]] = [_from_retrieved] if is_fourier else [_from_retrieved, _from_places]
    ways = ways[1:] if task.part.parts else ways  # splines over the whole modulator tell little of parts
    ways = ways[::-1] if task.shape else ways
    return [partial(_from_earlier, earlier), *ways] if earlier else ways


def _sought(task: _Task, earlier: Mapping[str, Mapping[str, float]], rng: np.random.Generator) -> tuple[_Leader, bool]:
    """The best light of a window, and whether the search was ended: of several ways to start, from simple beams, and
    after kicks."""
    part, shape, progress = task.part, task.shape, task.progress
    first, *others = _ways(task, earlier)
    best = first(task)
    try:
        for other in others:
            if best.score <= _CLEAR:
                best = max(best, other(task), key=lambda one: one.score)
        if best.score <= _CLEAR:
            progress(_SCANS + _LEADERS)
            best = max(best, _from_simple_beams(task), key=lambda one: one.score)
        if best.score <= _CLEAR and not shape and _may_try_waves(part):
            best = max(best, _from_beams_with_waves(task), key=lambda one: one.score)
        search = task.search(best.circle, best.lengths)
        for number in range(_KICKS):
            progress(_SCANS + _LEADERS + 1 + number)
            if number in (0, _KICKS - 1):
                of_lengths = partial(_score_of, task, best.circle, best.point)
                lengths = _climbed(part, of_lengths, best.lengths, is_fine=True)
                search = task.search(best.circle, lengths)
                best = dataclasses.replace(best, lengths=lengths, score=search.score(best.point))
            if best.score > _CLEAR:
                continue
            kicked = _kicked(best.point, number, rng) | dict(shape)
            score, point = search.ascend(search.moved_to_peak(kicked)[1], 14)
            if score > best.score + _LEAST_STEP:
                best = dataclasses.replace(best, score=score, point=point)
    except SearchEnded:
        return best, True
    return best, False


def _polished(search: SpeckleSearch, point: Point) -> Point:
    """The point after ascents in small steps, as long as they gain."""
    score = search.score(point)
    for _ in range(3):
        polished = search.ascend(point, 20, rate=0.5)
        gained, (score, point) = polished[0] - score, max(polished, (score, point), key=lambda one: one[0])
        if gained < 2 * _LEAST_STEP:
            break
    return point


def _from_earlier(earlier: Mapping[str, Mapping[str, float]], task: _Task) -> _Leader:
    """The best ascent from the light of causes that were found before, which lacks a wavefront for instance."""
    task.progress(0)
    captures = task.part.captures
    changes = {name: earlier.get(name, {}) for name in ("distance", "gap", "camera_alignment")}
    far = 1 + changes["distance"].get("distance_error", 0.0) / float(captures.distance_m[0])
    far = 1 + changes["camera_alignment"].get("magnification", 0.0) if captures.is_fourier else far
    gap = 1 + changes["gap"].get("gap_error", 0.0) / captures.gap_m if captures.gap_m else 1.0
    lengths = Lengths(far, gap)
    circle = circle_of(task.search().point_of(earlier))
    search = task.search(circle, lengths)
    point = search.point_of(earlier)
    start = max(point, search.moved_to_peak(point)[1], key=search.score)
    return _Leader(*search.ascend(start, 40), circle, lengths)


def _from_places(task: _Task) -> _Leader:
    """The best ascent from light without a wavefront, of a near field, whose speckle is at its place then already: from
    the stroke and the place of the second modulator with which speckle stands best, with the lengths in between."""
    part, shape = task.part, task.shape
    task.progress(0)
    search, point, lengths = task.search(), NOMINAL | dict(shape), NOMINAL_LENGTHS
    strokes = [{"stroke": stroke} for stroke in _STROKES]
    places = [dict(zip(SECOND, (y, x), strict=True)) for y in _PLACES_PX for x in _PLACES_PX]
    for changes in (strokes, *([places, strokes] if part.captures.gap_m is not None else [])):
        point = max((point | change for change in changes), key=search.score)
    wavefront = {f"z{noll}" for noll in TERMS}
    for number in range(2):
        task.progress(1 + number)
        point = search.ascend(point, 14, fixed=wavefront)[1]
        lengths = _climbed(part, partial(_score_of, task, MIDDLE, point), lengths, is_fine=number > 0)
        search = task.search(lengths=lengths)
    task.progress(3)
    circle = Circle(math.exp(-point["log_size"]), point["centre_y"], point["centre_x"]) if shape else MIDDLE
    return _Leader(*task.search(circle, lengths).ascend(point, 30), circle, lengths)


def _from_retrieved(task: _Task) -> _Leader:
    """The best of the beams that resemble retrieved lights, after an ascent. The focal length, or the distance of near
    fields, is that at which the speckle of retrieved light stands best; the strokes are those with which it stands best
    there."""
    part, starts = task.part, list[Retrieved]()
    retrieval = LightRetrieval(part.data)
    for number, stroke in enumerate(_STROKES):
        task.progress(number)
        starts.append(retrieval.start(stroke))
    starts.sort(key=lambda one: -one.correlation)
    task.progress(len(_STROKES))
    stroke = starts[0].stroke

    def stands(one: Lengths) -> float:
        return LightRetrieval(part.scaled(one).data).start(stroke).correlation

    lengths = _climbed(part, stands, NOMINAL_LENGTHS)
    if lengths != NOMINAL_LENGTHS:
        retrieval = LightRetrieval(part.scaled(lengths).data)
        starts = [retrieval.start(one.stroke) for one in starts[:_LEADERS]]
    leaders: list[_Leader] = []

    def follow(steps: int, start: Retrieved) -> _Leader:
        own = retrieval.for_thread()
        retrieved = own.ascend(start, steps)
        beam = own.nearest_beam(retrieved, TERMS)
        circle = Circle(beam.radius, *beam.centre)
        search = task.search(circle, lengths)
        return _Leader(*search.ascend(search.near(beam, retrieved.stroke), 30), circle, lengths)

    task.progress(_SCANS)
    for number, leader in enumerate(task.side_by_side(partial(follow, 30), starts[:_LEADERS])):
        task.progress(_SCANS + number)
        leaders.append(leader)
        if leader.score > _CLEAR:
            return leader
    if lengths != NOMINAL_LENGTHS:
        starts = [retrieval.start(stroke) for stroke in _STROKES]
    longer = task.side_by_side(lambda start: retrieval.for_thread().ascend(start, 30), starts)
    best = sorted(longer, key=lambda one: -one.held_out)[:_LEADERS]
    for leader in task.side_by_side(partial(follow, _LONG), best):
        leaders.append(leader)
        if leader.score > _CLEAR:
            break
    return max(leaders, key=lambda one: one.score)


def _from_simple_beams(task: _Task) -> _Leader:
    """The best ascent from beams with at most one term of a wavefront, of several sizes and strokes: it finds light of
    some radians behind patterns whose far field is drawn in thin lines, where a retrieval sees lines rather than
    speckle. Beams in the middle and those all over the modulator are followed apart: of many places some score high by
    chance, and would crowd out the right one."""
    search = task.search()
    if task.shape:
        return _from_simple_ones(task, search, [NearestBeam(1.0, 2.0, (0.0, 0.0), {}, 1.0)])
    beams = _start_beams(task.part, _START_SIZES)
    apart = [beam for beam in beams if not any(beam.centre)], [beam for beam in beams if any(beam.centre)]
    return max((_from_simple_ones(task, search, some) for some in apart if some), key=lambda one: one.score)


def _from_simple_ones(task: _Task, search: SpeckleSearch, beams: Sequence[NearestBeam]) -> _Leader:
    """The best ascent from some beams."""

    def moved(points: list[Point]) -> list[tuple[float, Point]]:
        return list(task.side_by_side(lambda point: search.for_thread().moved_to_peak(point), points))

    starts = moved([search.near(beam, stroke) for beam in beams for stroke in _START_STROKES])
    best_start = max(starts, key=lambda found: found[0])[1]
    starts += moved([best_start | {f"z{noll}": radians} for noll in (4, 5, 6, 7, 8, 11) for radians in (-1.0, 1.0)])
    points = [point for _, point in _spread(sorted(starts, key=lambda found: -found[0]))]
    ascents = task.side_by_side(lambda point: search.for_thread().ascend(point, 12), points)
    rough = sorted(ascents, key=lambda found: -found[0])

    def finer(point: Point) -> _Leader:
        circle = circle_of(point)
        return _Leader(*task.search(circle).ascend(rebased(point, MIDDLE, circle), 30), circle, NOMINAL_LENGTHS)

    return max(task.side_by_side(finer, [point for _, point in rough[:2]]), key=lambda one: one.score)


def _from_beams_with_waves(task: _Task) -> _Leader:
    """The best ascent from beams at all places with one of several wavefronts: of defocus and coma, the terms that are
    largest where a lens isn't at its place. Ascents from even phases end in other valleys beyond a radian r.m.s."""

    def starts_of(beam: NearestBeam) -> list[_Leader]:
        circle, starts = Circle(beam.radius, *beam.centre), []
        search = task.search(circle)
        for stroke, radians in itertools.product(_WAVE_STROKES, _WAVES):
            point = search.moved_to_peak(search.near(beam, stroke) | dict(zip(_WAVE_TERMS, radians, strict=True)))[1]
            starts.append(_Leader(search.score(point), point, circle, NOMINAL_LENGTHS))
        return starts

    def ascended(steps: int, start: _Leader) -> _Leader:
        score, point = task.search(start.circle).ascend(start.point, steps)
        return dataclasses.replace(start, score=score, point=point)

    starts = list[_Leader]()
    for some in task.side_by_side(starts_of, _start_beams(task.part, _WAVE_SIZES)):
        task.progress(_SCANS + _LEADERS)
        starts += some
    starts.sort(key=lambda one: -one.score)
    rough = task.side_by_side(partial(ascended, 14), starts[:_WAVE_LEADERS])
    return ascended(40, max(rough, key=lambda one: one.score))


def _may_try_waves(part: Pictures) -> bool:
    """Whether pictures and modulators are small enough to try every wavefront at every place."""
    pixels = part.data.light.size + part.captures.levels.size
    tried = len(_start_beams(part, _WAVE_SIZES)) * len(_WAVE_STROKES) * len(_WAVES)
    return tried * pixels <= _MOST_TRIED_PX


def _start_beams(part: Pictures, sizes: Collection[float]) -> list[NearestBeam]:
    """Gaussian beams of some sizes at places a radius apart over the modulator."""
    sides = [n / max(part.whole_shape) for n in part.whole_shape]
    beams = []
    for radius in (1 / size for size in sizes):
        counts = [round(max(half - radius / 2, 0.0) / radius) for half in sides]
        places = [np.arange(-count, count + 1) * radius for count in counts]
        beams += [NearestBeam(radius, 2.0, (float(y), float(x)), {}, 1.0) for y, x in itertools.product(*places)]
    return beams


def _spread(starts: list[tuple[float, Point]]) -> list[tuple[float, Point]]:
    """The two best starts, and the best of each third of the sizes and of the larger stroke, each once."""
    chosen = starts[:2]
    sizes = [math.log(size) for size in _START_SIZES]
    for low, high in ((-9.0, sizes[1] + 0.01), (sizes[1] + 0.01, sizes[3] - 0.01), (sizes[3] - 0.01, 9.0)):
        chosen += [found for found in starts if low < found[1]["log_size"] <= high][:1]
    chosen += [found for found in starts if found[1]["stroke"] > _START_STROKES[0]][:1]
    return [found for number, found in enumerate(chosen) if found not in chosen[:number]]


def without_superfluous(
    search: SpeckleSearch, point: Point, progress: Callable[[int], None], threads: int = 1
) -> tuple[Point, dict[str, tuple[float, float]]]:
    """The point without parts that held-out speckle doesn't need, and the loss without each part: of the correlation
    after a refit of all others, and in standard deviations of its mean over blocks."""
    whole, losses = search.standing(point), dict[str, tuple[float, float]]()
    parts = [part for part in PARTS if search.is_free(part)]

    def lost(part: str) -> tuple[float, float]:
        absent, own = PARTS[part], search.for_thread()
        return whole.loss(own.standing(own.ascend(point | absent, 12, rate=0.5, fixed=absent)[1]))

    progress(0)
    for number, loss in enumerate(_side_by_side(threads, lost, parts)):
        progress(number)
        losses[parts[number]] = loss
    for part in sorted(losses, key=lambda name: losses[name][0]):
        if _is_needed(losses[part]):
            continue
        dropped = [name for name, loss in losses.items() if not _is_needed(loss)]
        absent = {name: value for one in dropped for name, value in PARTS[one].items()}
        fewer = search.ascend(point | absent, 20, rate=0.5, fixed=absent)[1]
        together = whole.loss(search.standing(fewer))
        if len(dropped) == 1 or not _is_needed(together):
            return fewer, losses
        needed = max(dropped, key=lambda name: losses[name][0])  # several stood for each other
        losses[needed] = together
    return point, losses


def _is_absent(part: str, shape: Mapping[str, float]) -> bool:
    """Whether the numbers that stay say that there is no such part."""
    return all(shape.get(name) == value for name, value in PARTS[part].items())


def _is_needed(loss: tuple[float, float]) -> bool:
    return loss[0] > LEAST_LOSS and loss[1] > LEAST_SIGMAS


def _score_of(task: _Task, circle: Circle, point: Point, lengths: Lengths) -> float:
    return task.search(circle, lengths).score(point)


def _climbed(part: Pictures, score: Callable[[Lengths], float], lengths: Lengths, *, is_fine: bool = False) -> Lengths:
    """The lengths up to which a score rises, in steps of one after the other."""
    most = {"far": (_MOST_SCALE, _SCALE_STEPS) if part.captures.is_fourier else (_MOST_FARTHER, _FARTHER_STEPS)}
    if part.captures.gap_m is not None:
        most["gap"] = (_MOST_WIDER, _WIDER_STEPS)
    best = score(lengths)
    for name, (limit, steps) in most.items():
        for change in (steps[is_fine], -steps[is_fine]):
            while True:
                factor = getattr(lengths, name) + change
                other = dataclasses.replace(lengths, **{name: factor})
                if abs(factor - 1) >= limit or (found := score(other)) <= best:
                    break
                best, lengths = found, other
    return lengths


def _kicked(point: Point, number: int, rng: np.random.Generator) -> Point:
    """The point after a jump of its size, of its stroke, or of all terms."""
    if number < 2:
        return point | {"log_size": point["log_size"] + (0.35, -0.35)[number]}
    if number < 4:
        return point | {"stroke": point["stroke"] * (0.55, 1.8)[number - 2]}
    if number < 5:  # a beam of usual size in the middle, beside the same wavefront
        return point | {"log_size": 0.3, "edge": 2.0, "centre_y": 0.0, "centre_x": 0.0}
    terms = {f"z{noll}": point[f"z{noll}"] * rng.uniform(0.2, 1.2) + 0.4 * rng.normal() for noll in WAVEFRONT_TERMS}
    return point | terms | {"stroke": point["stroke"] * math.exp(0.25 * rng.normal())}
