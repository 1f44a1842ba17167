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
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Prediction, Predictor
from holoview.bench.captures.prepared_captures import PreparedCaptures
from holoview.bench.captures.speckle_measure import SpeckleMeasure
from holoview.bench.captures.speckle_retrieval import LightRetrieval, NearestBeam, Retrieved, beam_of_brightness
from holoview.bench.diagnose.crop import compact_prediction
from holoview.bench.diagnose.extended_model import PredictorWithKnownEffects
from holoview.bench.diagnose.parts import PartsPredictor
from holoview.bench.diagnose.search_context import SearchEnded
from holoview.light.effects.beam import WAVEFRONT_TERMS
from holoview.light.model.effects.effect import Effect, Parameter, Values
from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.light.model.effects.registry import get_effect
from holoview.light.numerics.resample import affine_warp
from holoview.light.numerics.sampling import positions
from holoview.light.numerics.speckle_match import match_speckle
from holoview.light.numerics.surfaces import zernike
from holoview.util.progress import ProgressCallback

Tensor = torch.Tensor
Point = dict[str, float]

_TERMS = tuple(range(2, 12))  # Noll: tilts, defocus, astigmatism, coma, trefoil, spherical
_STEPS: dict[str, float] = {
    "log_size": 0.04,
    "edge": 0.15,
    "centre_y": 0.03,
    "centre_x": 0.03,
    "stroke": 0.03,
    "share": 0.03,
    "quadrature": 0.03,
    "stray": 0.02,
    "second_y": 0.05,
    "second_x": 0.05,
    **{f"z{noll}": 0.12 for noll in _TERMS},
}
"""Adam's unit of each number: ln size, exponent, places in half sides, shares, stray over mean light, pixels of the
second modulator's shift, radians r.m.s. of wavefront."""
_BOUNDS = {"log_size": (-1.5, 2.5), "edge": (0.8, 6.0), "stroke": (0.15, 2.2), "stray": (0.0, 1.0)}
_SECOND = {"second_y": 0.0, "second_x": 0.0}  # where the second modulator should be
_EVEN = {"log_size": _BOUNDS["log_size"][0], "edge": 2.0, "centre_y": 0.0, "centre_x": 0.0}
"""Light that falls by 0.3 % of its amplitude from the middle to the corners: even."""
NOMINAL: Point = dict.fromkeys(_STEPS, 0.0) | _EVEN | {"stroke": 1.0}
"""Even light without a wavefront, and the assumed stroke."""
PARTS: dict[str, dict[str, float]] = {
    "shape": _EVEN,
    "defocus": {"z4": 0.0},
    "astigmatism": {"z5": 0.0, "z6": 0.0},
    "coma": {"z7": 0.0, "z8": 0.0},
    "trefoil": {"z9": 0.0, "z10": 0.0},
    "spherical aberration": {"z11": 0.0},
    "stroke": {"stroke": 1.0},
    "unmodulated light": {"share": 0.0, "quadrature": 0.0},
    "stray light": {"stray": 0.0},
    "shift of the second modulator": _SECOND,
}
"""Parts of the light that may be superfluous, with the numbers that stand for their absence."""
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
_CLEAR = 0.85
"""[1] Correlation above which no other start is tried. Evidence: drawn benches: wrong valleys stayed below 0.75."""
_SCANS = len(_STROKES) + 1
_REACH_PX, _AROUND_PX = 25, 80
_KICKS = 7
_STAGES = _SCANS + _LEADERS + 1 + _KICKS
_LEAST_STEP = 0.002  # of the correlation
LEAST_LOSS = 0.01
"""[1] Of the held-out correlation without a part, below which the part isn't named. Evidence: the prototype: a trefoil
and unmodulated light that weren't there gave 0.001, the least true part 0.011."""
LEAST_SIGMAS = 5.0
"""[σ] Loss of the correlation's mean over held-out blocks below which the part isn't named. Evidence: the prototype:
1.7 σ and less of parts that weren't there."""


_CELL_PX = 16  # at least, of cells of a near field whose brightness tells the beam
_MOST_CELLS = 48  # along the shorter side
_LEAST_WALK_OFFS = 2.0
"""[1] Radii of beams over the way that the first order's edge walks off, below which brightness doesn't tell the beam.
Evidence: a reason: such a beam's brightness is spread by as much as it is wide."""
_LEAST_STRAY = 1.4
"""[1] What a beam alone leaves of the brightness in held-out cells, over what it leaves beside stray light, above which
there is stray light. Evidence: drawn benches: with stray light 1.5 and more, without 1.25 and less."""
_LEAST_EXPLAINED = 0.2
"""[1] Of what even light leaves of the brightness in held-out cells, below which there is no beam. Evidence: drawn
benches: beams of 0.3 to 1 of the modulator explained 0.70 and more."""


@dataclass(frozen=True)
class Circle:
    """A circle on the modulator over which terms of a wavefront are stated, in half sides of the longer side."""

    radius: float
    centre_y: float = 0.0
    centre_x: float = 0.0


_MIDDLE = Circle(0.5)
NO_SHAPE: Mapping[str, float] = MappingProxyType({})
NO_VALUES: Mapping[str, Mapping[str, float]] = MappingProxyType({})


@dataclass(frozen=True)
class Pictures:
    """Pictures in which light is sought, few enough to be predicted together.

    parts: where the pictures show parts of larger ones, one below the other, the captures of each.
    """

    data: PreparedCaptures
    parts: tuple[Captures, ...] = ()

    @property
    def captures(self) -> Captures:
        """Of all parts together."""
        return self.data.captures

    @property
    def whole_shape(self) -> tuple[int, int]:
        """Rows and columns of the modulators that these are parts of."""
        rows, columns = self.captures.slm_frame or self.captures.levels.shape[2:]
        return rows, columns

    @property
    def half_m(self) -> float:
        """Half the longer side of the modulators, m."""
        return max(self.whole_shape) * self.captures.slms[0].pitch_m / 2

    @property
    def mean_light(self) -> float:
        """Mean of all usable pixels, counts."""
        return float(self.data.light[self.data.usable].mean())

    def predictor(self, light: Effect) -> Callable[..., Prediction]:
        """Predicts the pictures with an effect beside those of the registry."""
        if not self.parts:
            return Predictor(self.captures, [light], cache_mb=1)
        options: dict[str, Any] = {"known_values": {}, "extra_effects": [light]}
        each = [partial(PredictorWithKnownEffects, **compact_prediction(part), **options) for part in self.parts]
        return PartsPredictor(each, cache_mb=1)

    def scaled(self, lengths: Lengths) -> Pictures:
        """The pictures of a bench of other lengths."""
        data = dataclasses.replace(self.data, captures=lengths.scaled(self.captures))
        return Pictures(data, tuple(lengths.scaled(part) for part in self.parts))


@dataclass(frozen=True)
class Lengths:
    """Factors of a bench's lengths. far: of the focal length, or of the distance of near fields. gap: of the gap."""

    far: float = 1.0
    gap: float = 1.0

    def scaled(self, captures: Captures) -> Captures:
        """The captures of a bench of these lengths."""
        changed = dict[str, Any]()
        if captures.focal_length_m is None:
            changed["distance_m"] = captures.distance_m * self.far
        else:
            changed["focal_length_m"] = captures.focal_length_m * self.far
        if captures.gap_m is not None:
            changed["gap_m"] = captures.gap_m * self.gap
        return dataclasses.replace(captures, **changed)


class FreeLight(Effect):
    """The light of a beam, its tilt, the modulators' stroke and unmodulated light with tensors in place of numbers."""

    id = "speckle_light"
    cause = "A search by speckle."
    finding = "A search by speckle."
    parameters = (Parameter("on", "Whether it acts."),)
    acts_on = ("source", "modulator 1", "modulator 2")
    listed: ClassVar = False

    def __init__(self, circle: Circle, unit_m: float) -> None:
        """circle: of the wavefront's terms. unit_m: the wavelength of which their radians are."""
        self.point: dict[str, Tensor] = {}
        self.circle, self._unit_m = circle, unit_m
        self._terms: dict[tuple[object, ...], Tensor] = {}

    def stroke_response(self, share: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        return share * self.point["stroke"].to(share.dtype)

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        p = self.point
        leak = torch.complex(p["share"], p["quadrature"]).to(transmission.dtype)
        transmission = (1 - leak.abs()) * transmission + leak
        if context.number:
            edge, (dy, dx) = (1, 1, 1, 1), (p[name] * context.upsample for name in _SECOND)
            rows = (1.0, 0.0, -dy), (0.0, 1.0, -dx)  # a dark edge, since nothing passes beside the modulator
            return affine_warp(torch.nn.functional.pad(context.sampled(transmission), edge), rows)[1:-1, 1:-1]
        half_m = context.half_width()
        even = dict.fromkeys((f"z{noll}" for noll in WAVEFRONT_TERMS), 0.0)
        values = {"size": p["log_size"].exp(), "edge": p["edge"], "ellipse": 0.0, **even}
        values |= {f"centre_{axis}": p[f"centre_{axis}"] for axis in "yx"}
        light = get_effect("beam").transmission(transmission, context, values)  # type: ignore[arg-type]
        one, shape = transmission.real.detach(), tuple(transmission.shape)
        key = shape, context.centre_m  # parts are alike in shape
        if key not in self._terms:
            radius_m, *centre_m = (length * half_m for length in dataclasses.astuple(self.circle))
            terms = [context.zernike(one, {noll: 1.0}, tuple(centre_m), radius_m) for noll in _TERMS]
            self._terms[key] = torch.stack(terms)
        phase = torch.tensordot(torch.stack([p[f"z{noll}"] for noll in _TERMS]), self._terms[key], dims=1)
        phase = phase * (self._unit_m / context.wavelength_m)
        return light * torch.polar(torch.ones_like(phase), phase)


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


@dataclass(frozen=True)
class Standing:
    """Correlation of held-out speckle, and what each block of all bright pixels lacks of 1."""

    held_out: float
    missing: NDArray[np.float64]

    def loss(self, without: Standing) -> tuple[float, float]:
        """By how much held-out speckle stands better than without something, and by how many standard deviations of
        the difference over all blocks: few numbers fit so many pixels that fitted ones tell as much as others."""
        lost = without.missing - self.missing
        spread = float(lost.std(ddof=1)) * math.sqrt(len(lost)) if len(lost) > 1 else math.inf
        return self.held_out - without.held_out, float(lost.sum()) / max(spread, 1e-12)


class PointPredictor:
    """The light (picture, y, x) that pictures would show if a point were true."""

    def __init__(self, pictures: Pictures, circle: Circle) -> None:
        """circle: that of the wavefront's terms."""
        self._light = FreeLight(circle, float(pictures.captures.wavelength_m[0]))
        self._predict = pictures.predictor(self._light)
        self._indices, self._calls = np.arange(len(pictures.captures)), 0

    def __call__(self, point: Mapping[str, Tensor | float] | None) -> Tensor:
        """Of the nominal bench without a point."""
        if point is None:
            return self._predict(self._indices, {}).signal
        point = dict(point)
        stray = point.pop("stray")
        self._light.point = {name: torch.as_tensor(value, dtype=torch.float32) for name, value in point.items()}
        self._calls += 1  # each point is another light, of which nothing is kept
        values = {"speckle_light": {"on": float(self._calls)}}
        light = self._predict(self._indices, values, grad=torch.is_grad_enabled()).signal
        return light + stray * light.mean()


@dataclass(frozen=True)
class NearBeam:
    """What brightness tells of the beam of near fields.

    pictures: whole ones. shape: numbers of a point; those of even light where nothing shows a beam; none where light
    walks off so far that brightness doesn't tell the beam. explained: share of the brightness that even light leaves.
    stray: stray light beside a beam, counts; None where brightness doesn't tell.
    """

    pictures: Pictures
    shape: Mapping[str, float]
    explained: float
    stray: float | None = None

    @classmethod
    def beside(cls, point: Point, pictures: Pictures, circle: Circle = _MIDDLE) -> NearBeam:
        """The beam that brings brightness to its places beside a point's other numbers. circle: of the point's terms.
        pictures: whole ones."""
        captures, usable = pictures.captures, pictures.data.usable
        with torch.no_grad():
            even = PointPredictor(pictures, circle)(point | _EVEN | {"stray": 0.0}).numpy()
        side = max(_CELL_PX, min(captures.shape) // _MOST_CELLS)
        y, x = (_cell_means(positions(n, captures.camera.pitch_m), side) / pictures.half_m for n in captures.shape)
        measured, predicted = (_of_cells(light, usable, side) for light in (pictures.data.light, even))
        told = beam_of_brightness(measured, predicted, y, x)
        beam = told.beam
        farthest_m = float(np.abs(captures.distance_m).max()) + (captures.gap_m or 0.0)
        walk_off = farthest_m * float(captures.wavelength_m.max()) / (2 * captures.slms[0].pitch_m) / pictures.half_m
        if min(beam.radius, 1.0) < _LEAST_WALK_OFFS * walk_off:
            return cls(pictures, NO_SHAPE, 0.0)
        if told.explained < _LEAST_EXPLAINED:
            return cls(pictures, _EVEN, 0.0)
        found = {"log_size": -math.log(beam.radius), "edge": beam.edge}
        found |= {"centre_y": beam.centre[0], "centre_x": beam.centre[1]}
        return cls(pictures, found, told.explained, told.stray if told.without_stray > _LEAST_STRAY else 0.0)

    def numbers(self, pictures: Pictures) -> Mapping[str, float]:
        """The numbers of a point that stay while other pictures of the same bench, perhaps parts, are compared."""
        if self.stray is None:
            return self.shape
        return {**self.shape, "stray": self.stray / max(pictures.mean_light - self.stray, 1e-9)}


class SpeckleSearch:
    """Ascents of the correlation of local contrasts of pictures.

    circle: that of the wavefront's terms. shape: numbers of a beam that stay.
    """

    def __init__(self, pictures: Pictures, circle: Circle = _MIDDLE, shape: Mapping[str, float] = NO_SHAPE) -> None:
        self.shape, self._circle = shape, circle
        self._pictures, self._data = pictures, pictures.data
        self._predicted = PointPredictor(pictures, circle)
        self._measure = SpeckleMeasure(pictures.data)
        self._has_second = pictures.captures.levels.shape[1] > 1

    def near(self, beam: NearestBeam, stroke: float) -> Point:
        """The point of a beam with a wavefront."""
        point = dict.fromkeys(_STEPS, 0.0) | {"stroke": stroke}
        point |= {"log_size": -math.log(beam.radius), "edge": beam.edge}
        point |= {"centre_y": beam.centre[0], "centre_x": beam.centre[1]}
        point |= {f"z{noll}": radians for noll, radians in beam.terms.items()}
        point = _rebased(point, Circle(beam.radius, *beam.centre), self._circle) if beam.terms else point
        return point | dict(self.shape)

    def score(self, point: Point) -> float:
        """Correlation of the speckle on the fitted pixels."""
        with torch.no_grad():
            return float(self._measure.correlation(self._predicted(point), self._measure.fitted))

    def held_out(self, point: Point | None) -> float:
        """Correlation of the speckle on held-out pixels; of the nominal bench without a point."""
        with torch.no_grad():
            return float(self._measure.correlation(self._predicted(point), self._measure.held_out))

    def standing(self, point: Point) -> Standing:
        """How well the speckle of a point stands."""
        with torch.no_grad():
            return Standing(self.held_out(point), self._measure.missing_by_block(self._predicted(point)))

    def moved_to_peak(self, point: Point) -> tuple[float, Point]:
        """The peak of the correlation over shifts of the picture, and the point with the tilts that move it there."""
        with torch.no_grad():
            predicted = self._predicted(point)[0].numpy()
        reach = min(_REACH_PX, min(self._data.captures.shape) // 4)
        found = match_speckle(
            self._data.light[0],
            predicted,
            self._measure.fitted[0].numpy(),
            reach_px=reach,
            around_px=max(_AROUND_PX, reach + 8),
        )
        per_px = self._per_metre(self._circle.radius) * self._data.captures.camera.pitch_m
        moved = {"z3": point["z3"] + found.shift[0] * per_px, "z2": point["z2"] + found.shift[1] * per_px}
        return found.correlation, point | moved

    def ascend(self, point: Point, steps: int, rate: float = 1.0, fixed: Collection[str] = ()) -> tuple[float, Point]:
        """The best point of an ascent by Adam, with its score. fixed: numbers that stay."""
        fixed = {*fixed, *self.shape, *({} if self._has_second else _SECOND)}
        moves = {name: torch.zeros((), requires_grad=True) for name in _STEPS if name not in fixed}
        adam = torch.optim.Adam(moves.values(), lr=rate, betas=(0.8, 0.95))
        best = (-1.0, point)
        for number in range(steps):
            for group in adam.param_groups:
                group["lr"] = rate * (1 - 0.85 * number / steps)
            values = {
                name: _bounded(name, value + _STEPS[name] * moves[name]) if name in moves else torch.tensor(value)
                for name, value in point.items()
            }
            score = self._measure.correlation(self._predicted(values), self._measure.fitted)
            if score.item() > best[0]:
                best = (score.item(), {name: float(value.detach()) for name, value in values.items()})
            adam.zero_grad()
            (-score).backward()  # type: ignore[no-untyped-call]
            adam.step()
        return best

    def is_free(self, part: str) -> bool:
        """Whether a part of the light is varied."""
        return not {*PARTS[part]} <= {*self.shape} and (self._has_second or PARTS[part] is not _SECOND)

    def effect_values(self, point: Point, dropped: Collection[str]) -> dict[str, dict[str, float]]:
        """The values of effects that make the light of a point. dropped: parts that it doesn't have."""
        captures = self._data.captures
        circle = self._whole_circle()
        values: dict[str, dict[str, float]] = {}
        beam: dict[str, float] = {}
        if "shape" not in dropped:
            circle = min(math.exp(-point["log_size"]), circle)
            beam = {"size": math.exp(point["log_size"]), "edge": point["edge"]}
            beam |= {f"centre_{axis}": point[f"centre_{axis}"] for axis in "yx"}
        own = Circle(circle, point["centre_y"], point["centre_x"])  # in the middle without a shape
        centred = _rebased(point, self._circle, own)
        per_radian = float(captures.wavelength_m[0]) / (2 * math.pi)
        names = [f"z{noll}" for noll in WAVEFRONT_TERMS]
        is_dropped = {name for part in dropped for name in PARTS[part]}
        wave = {name: centred[name] * per_radian for name in names if name not in is_dropped}
        if beam:
            values["beam"] = beam | wave
        elif wave:  # over the circle around the modulator, whose own wavefront can't be told from the light's
            values["slm_flatness"] = {f"{name}_1": value for name, value in wave.items()}
        if "stroke" not in dropped:
            values["stroke"] = {"stroke_error": point["stroke"] - 1}
        if "unmodulated light" not in dropped:
            values["undiffracted"] = {"share": point["share"], "quadrature": point["quadrature"]}
        if "stray light" not in dropped:
            black = self._pictures.mean_light * point["stray"] / (1 + point["stray"])
            values["camera_black"] = {"black": black}
        if self._has_second and not {*_SECOND} <= is_dropped:
            pitch_m = captures.slms[1].pitch_m
            values["slm_alignment"] = {f"shift_{axis}": point[f"second_{axis}"] * pitch_m for axis in "yx"}
        to_m = 1 / self._per_metre(circle)
        return values | {"camera_alignment": {"shift_y": centred["z3"] * to_m, "shift_x": centred["z2"] * to_m}}

    def point_of(self, values: Mapping[str, Mapping[str, float]]) -> Point:
        """The point whose light these effects make, as far as a point can: the inverse of `effect_values`. It has no
        tilts. The beam's wavefront and that over the modulator add up."""
        captures, point = self._data.captures, dict(NOMINAL)
        radians = 2 * math.pi / float(captures.wavelength_m[0])
        flat, beam = values.get("slm_flatness", {}), values.get("beam", {})
        waves = [(Circle(self._whole_circle()), {noll: flat.get(f"z{noll}_1", 0.0) for noll in WAVEFRONT_TERMS})]
        if beam.get("size", 0.0) > 0:
            point |= {name: beam[name] for name in ("edge", "centre_y", "centre_x")}
            point["log_size"] = math.log(beam["size"])
            circle = Circle(min(1 / beam["size"], self._whole_circle()), beam["centre_y"], beam["centre_x"])
            waves.append((circle, {noll: beam.get(f"z{noll}", 0.0) for noll in WAVEFRONT_TERMS}))
        for circle, terms in waves:
            own = {f"z{noll}": term * radians for noll, term in terms.items()}
            rebased = _rebased(dict.fromkeys(point, 0.0) | own, circle, self._circle)
            point |= {f"z{noll}": point[f"z{noll}"] + rebased[f"z{noll}"] for noll in _TERMS}
        point["stroke"] += values.get("stroke", {}).get("stroke_error", 0.0)
        point |= {name: values.get("undiffracted", {}).get(name, 0.0) for name in ("share", "quadrature")}
        black = min(values.get("camera_black", {}).get("black", 0.0), self._pictures.mean_light / 2)
        point["stray"] = max(black, 0.0) / (self._pictures.mean_light - black)
        if self._has_second:
            place, pitch_m = values.get("slm_alignment", {}), captures.slms[1].pitch_m
            point |= {f"second_{axis}": place.get(f"shift_{axis}", 0.0) / pitch_m for axis in "yx"}
        point |= {name: min(max(point[name], low), high) for name, (low, high) in _BOUNDS.items()}
        return point | dict(self.shape)

    def _whole_circle(self) -> float:
        """Radius of the circle around the modulator in half sides."""
        shape = self._pictures.whole_shape
        return math.hypot(*shape) / max(shape)

    def _per_metre(self, circle: float) -> float:
        """Radians r.m.s. of a tilt over a circle that move the picture by a metre: a slope s of the path moves light by
        s times the focal length, or the distance."""
        captures = self._data.captures
        distance_m = captures.focal_length_m or float(captures.distance_m[0])
        return 2 * math.pi / float(captures.wavelength_m[0]) / distance_m * circle * self._pictures.half_m / 2


def _circle_of(point: Point) -> Circle:
    """The circle of a point's beam, over which terms of its wavefront tell most."""
    radius = min(max(math.exp(-point["log_size"]), 0.15), 1.25)
    return Circle(radius, point["centre_y"], point["centre_x"])


def _cell_means(values: NDArray[np.float64], side: int) -> NDArray[np.float64]:
    """Means of every `side` numbers; the last ones are left out."""
    return values[: len(values) // side * side].reshape(-1, side).mean(axis=1)


def _of_cells(light: NDArray[np.float32], usable: NDArray[np.bool_], side: int) -> NDArray[np.float64]:
    """Mean light (picture, row, column) of square cells; NaN where fewer than a quarter of the pixels are usable."""
    rows, columns = (n // side for n in light.shape[1:])

    def sums(values: NDArray[np.float64]) -> NDArray[np.float64]:
        cut = values[:, : rows * side, : columns * side]
        return np.asarray(cut.reshape(len(values), rows, side, columns, side).sum(axis=(2, 4)))

    counts = sums(usable.astype(np.float64))
    return np.where(
        counts > side * side / 4, sums((light * usable).astype(np.float64)) / np.maximum(counts, 1.0), np.nan
    )


def _bounded(name: str, value: Tensor) -> Tensor:
    low, high = _BOUNDS.get(name, (-math.inf, math.inf))
    return value.clamp(low, high)


def _rebased(point: Point, before: Circle, after: Circle) -> Point:
    """The same wavefront in terms over another circle, by least squares over it."""
    line = torch.linspace(-1, 1, 41, dtype=torch.float64)
    y, x = torch.meshgrid(line, line, indexing="ij")
    inside = y.square() + x.square() <= 1
    y, x = y[inside] * after.radius + after.centre_y, x[inside] * after.radius + after.centre_x

    def terms(circle: Circle) -> Tensor:
        down, across = (y - circle.centre_y) / circle.radius, (x - circle.centre_x) / circle.radius
        radius, angle = torch.hypot(down, across), torch.atan2(down, across)
        return torch.stack([zernike(noll, radius, angle) for noll in (1, *_TERMS)], 1)

    wanted = terms(before)[:, 1:] @ torch.tensor([point[f"z{noll}"] for noll in _TERMS], dtype=torch.float64)
    solved = torch.linalg.lstsq(terms(after), wanted[:, None]).solution[1:, 0]
    return point | {f"z{noll}": float(value) for noll, value in zip(_TERMS, solved, strict=True)}


def with_or_without_unmodulated(values: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
    """Values of effects, {id: {parameter: value}}, with unmodulated light if it isn't there and without it if it is.

    Most of it goes into the zero order, where no speckle tells it, and a stroke imitates the rest: brightness decides.
    """
    others = {name: own for name, own in values.items() if name != "undiffracted"}
    return others if len(others) < len(values) else {**others, "undiffracted": {"share": 0.0, "quadrature": 0.0}}


# --- the search -------------------------------------------------------------------------------------------------------


def find_light(
    pictures: Pictures,
    part: Pictures,
    progress: ProgressCallback,
    beam: NearBeam | None = None,
    earlier: Mapping[str, Mapping[str, float]] = NO_VALUES,
    seed: int = 0,
) -> FoundLight:
    """The light that makes the speckle of pictures stand, as values of effects. seed: of the random kicks.

    part: a smaller window of the pictures, in which the light is sought before it is refined and judged. beam: of near
    fields, as brightness tells it. earlier: values of causes that another search has found. progress: may raise
    `SearchEnded`: then the best light so far counts, with all of its parts; before there is one, the exception is
    passed on.
    """
    told, steps = "light on the modulator, by speckle", _STAGES + len(PARTS)
    before, shape = SpeckleSearch(pictures).held_out(None), NO_SHAPE if beam is None else beam.numbers(part)
    ways = _ways(part, shape, earlier)
    found, was_ended = _sought(ways, part, shape, lambda n: progress(n, steps, told), np.random.default_rng(seed))
    point, losses = found.point, dict[str, tuple[float, float]]()
    search = SpeckleSearch(pictures.scaled(found.lengths), found.circle, shape)
    if not was_ended:
        point = _polished(search, point)
        if beam is not None and shape:
            beam = NearBeam.beside(point, beam.pictures.scaled(found.lengths), found.circle)
            search.shape = beam.numbers(pictures)
            point = search.ascend(point | dict(search.shape), 12, rate=0.5)[1]
        try:
            point, losses = without_superfluous(search, point, lambda number: progress(_STAGES + number, steps, told))
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
    return FoundLight(values, before, search.held_out(point), losses, explained, was_ended, bool(pictures.parts))


@dataclass(frozen=True)
class _Leader:
    """A point from which a search goes on, its score, the circle of its terms, and the bench's lengths."""

    score: float
    point: Point
    circle: Circle
    lengths: Lengths


_Way = Callable[[Pictures, Mapping[str, float], Callable[[int], None]], _Leader]


def _ways(
    part: Pictures, shape: Mapping[str, float], earlier: Mapping[str, Mapping[str, float]]
) -> tuple[_Way, *tuple[_Way, ...]]:
    """The starts of a search, the most promising first: causes that were found before, retrieved light, and of near
    fields the place of the second modulator (before retrieved light where brightness tells the beam)."""
    ways: list[_Way] = [_from_retrieved] if part.captures.is_fourier else [_from_retrieved, _from_places]
    ways = ways[1:] if part.parts else ways  # splines over the whole modulator tell little of parts
    ways = ways[::-1] if shape else ways
    first, *others = [partial(_from_earlier, earlier), *ways] if earlier else ways
    return first, *others


def _sought(
    ways: tuple[_Way, *tuple[_Way, ...]],
    part: Pictures,
    shape: Mapping[str, float],
    progress: Callable[[int], None],
    rng: np.random.Generator,
) -> tuple[_Leader, bool]:
    """The best light of a window, and whether the search was ended: of several ways to start, from simple beams, and
    after kicks."""
    first, *others = ways
    best = first(part, shape, progress)
    try:
        for other in others:
            if best.score <= _CLEAR:
                best = max(best, other(part, shape, progress), key=lambda one: one.score)
        if best.score <= _CLEAR:
            progress(_SCANS + _LEADERS)
            best = max(best, _from_simple_beams(part, shape), key=lambda one: one.score)
        if best.score <= _CLEAR and not shape and _may_try_waves(part):
            waves = _from_beams_with_waves(part, lambda: progress(_SCANS + _LEADERS))
            best = max(best, waves, key=lambda one: one.score)
        search = SpeckleSearch(part.scaled(best.lengths), best.circle, shape)
        for number in range(_KICKS):
            progress(_SCANS + _LEADERS + 1 + number)
            if number in (0, _KICKS - 1):
                of_lengths = partial(_score_of, part, best.circle, shape, best.point)
                lengths = _climbed(part, of_lengths, best.lengths, is_fine=True)
                search = SpeckleSearch(part.scaled(lengths), best.circle, shape)
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


def _from_earlier(
    earlier: Mapping[str, Mapping[str, float]],
    part: Pictures,
    shape: Mapping[str, float],
    progress: Callable[[int], None],
) -> _Leader:
    """The best ascent from the light of causes that were found before, which lacks a wavefront for instance."""
    progress(0)
    captures = part.captures
    changes = {name: earlier.get(name, {}) for name in ("distance", "gap", "camera_alignment")}
    far = 1 + changes["distance"].get("distance_error", 0.0) / float(captures.distance_m[0])
    far = 1 + changes["camera_alignment"].get("magnification", 0.0) if captures.is_fourier else far
    gap = 1 + changes["gap"].get("gap_error", 0.0) / captures.gap_m if captures.gap_m else 1.0
    lengths = Lengths(far, gap)
    circle = _circle_of(SpeckleSearch(part, shape=shape).point_of(earlier))
    search = SpeckleSearch(part.scaled(lengths), circle, shape)
    point = search.point_of(earlier)
    start = max(point, search.moved_to_peak(point)[1], key=search.score)
    return _Leader(*search.ascend(start, 40), circle, lengths)


def _from_places(part: Pictures, shape: Mapping[str, float], progress: Callable[[int], None]) -> _Leader:
    """The best ascent from light without a wavefront, of a near field, whose speckle is at its place then already: from
    the stroke and the place of the second modulator with which speckle stands best, with the lengths in between."""
    progress(0)
    search, point, lengths = SpeckleSearch(part, shape=shape), NOMINAL | dict(shape), Lengths()
    strokes = [{"stroke": stroke} for stroke in _STROKES]
    places = [dict(zip(_SECOND, (y, x), strict=True)) for y in _PLACES_PX for x in _PLACES_PX]
    for changes in (strokes, *([places, strokes] if part.captures.gap_m is not None else [])):
        point = max((point | change for change in changes), key=search.score)
    wavefront = {f"z{noll}" for noll in _TERMS}
    for number in range(2):
        progress(1 + number)
        point = search.ascend(point, 14, fixed=wavefront)[1]
        lengths = _climbed(part, partial(_score_of, part, _MIDDLE, shape, point), lengths, is_fine=number > 0)
        search = SpeckleSearch(part.scaled(lengths), shape=shape)
    progress(3)
    circle = Circle(math.exp(-point["log_size"]), point["centre_y"], point["centre_x"]) if shape else _MIDDLE
    return _Leader(*SpeckleSearch(part.scaled(lengths), circle, shape).ascend(point, 30), circle, lengths)


def _from_retrieved(part: Pictures, shape: Mapping[str, float], progress: Callable[[int], None]) -> _Leader:
    """The best of the beams that resemble retrieved lights, after an ascent. The focal length, or the distance of near
    fields, is that at which the speckle of retrieved light stands best; the strokes are those with which it stands best
    there. shape: of a beam that is known."""
    retrieval, starts = LightRetrieval(part.data), []
    for number, stroke in enumerate(_STROKES):
        progress(number)
        starts.append(retrieval.start(stroke))
    starts.sort(key=lambda one: -one.correlation)
    progress(len(_STROKES))
    stroke = starts[0].stroke
    lengths = _climbed(part, lambda one: LightRetrieval(part.scaled(one).data).start(stroke).correlation, Lengths())
    if lengths != Lengths():
        retrieval = LightRetrieval(part.scaled(lengths).data)
        starts = [retrieval.start(one.stroke) for one in starts[:_LEADERS]]
    leaders: list[_Leader] = []

    def follow(start: Retrieved, steps: int) -> None:
        retrieved = retrieval.ascend(start, steps)
        beam = retrieval.nearest_beam(retrieved, _TERMS)
        circle = Circle(beam.radius, *beam.centre)
        search = SpeckleSearch(part.scaled(lengths), circle, shape)
        leaders.append(_Leader(*search.ascend(search.near(beam, retrieved.stroke), 30), circle, lengths))

    for number, start in enumerate(starts[:_LEADERS]):
        progress(_SCANS + number)
        follow(start, 30)
        if leaders[-1].score > _CLEAR:
            return leaders[-1]
    if lengths != Lengths():
        starts = [retrieval.start(stroke) for stroke in _STROKES]
    longer = [retrieval.ascend(start, 30) for start in starts]
    for start in sorted(longer, key=lambda one: -one.held_out)[:_LEADERS]:
        follow(start, _LONG)
        if leaders[-1].score > _CLEAR:
            break
    return max(leaders, key=lambda one: one.score)


def _from_simple_beams(part: Pictures, shape: Mapping[str, float]) -> _Leader:
    """The best ascent from beams with at most one term of a wavefront, of several sizes and strokes: it finds light of
    some radians behind patterns whose far field is drawn in thin lines, where a retrieval sees lines rather than
    speckle. Beams in the middle and those all over the modulator are followed apart: of many places some score high by
    chance, and would crowd out the right one."""
    search = SpeckleSearch(part, shape=shape)
    if shape:
        return _from_simple_ones(part, search, [NearestBeam(1.0, 2.0, (0.0, 0.0), {}, 1.0)])
    beams = _start_beams(part, _START_SIZES)
    apart = [beam for beam in beams if not any(beam.centre)], [beam for beam in beams if any(beam.centre)]
    return max((_from_simple_ones(part, search, some) for some in apart if some), key=lambda one: one.score)


def _from_simple_ones(part: Pictures, search: SpeckleSearch, beams: Sequence[NearestBeam]) -> _Leader:
    """The best ascent from some beams."""
    starts = [search.moved_to_peak(search.near(beam, stroke)) for beam in beams for stroke in _START_STROKES]
    best_start = max(starts, key=lambda found: found[0])[1]
    for noll in (4, 5, 6, 7, 8, 11):
        starts += [search.moved_to_peak(best_start | {f"z{noll}": radians}) for radians in (-1.0, 1.0)]
    starts = _spread(sorted(starts, key=lambda found: -found[0]))
    rough = sorted((search.ascend(point, 12) for _, point in starts), key=lambda found: -found[0])
    leaders = []
    for _, point in rough[:2]:
        circle = _circle_of(point)
        finer = SpeckleSearch(part, circle, search.shape).ascend(_rebased(point, _MIDDLE, circle), 30)
        leaders.append(_Leader(*finer, circle, Lengths()))
    return max(leaders, key=lambda one: one.score)


def _from_beams_with_waves(part: Pictures, go_on: Callable[[], None]) -> _Leader:
    """The best ascent from beams at all places with one of several wavefronts: of defocus and coma, the terms that are
    largest where a lens isn't at its place. Ascents from even phases end in other valleys beyond a radian r.m.s.

    go_on: called before each beam; may raise `SearchEnded`.
    """
    starts = []
    for beam in _start_beams(part, _WAVE_SIZES):
        go_on()
        circle = Circle(beam.radius, *beam.centre)
        search = SpeckleSearch(part, circle)
        for stroke, radians in itertools.product(_WAVE_STROKES, _WAVES):
            point = search.moved_to_peak(search.near(beam, stroke) | dict(zip(_WAVE_TERMS, radians, strict=True)))[1]
            starts.append(_Leader(search.score(point), point, circle, Lengths()))
    starts.sort(key=lambda one: -one.score)
    rough = [_ascended(part, start, 14) for start in starts[:_WAVE_LEADERS]]
    return _ascended(part, max(rough, key=lambda one: one.score), 40)


def _ascended(part: Pictures, start: _Leader, steps: int) -> _Leader:
    score, point = SpeckleSearch(part, start.circle).ascend(start.point, steps)
    return dataclasses.replace(start, score=score, point=point)


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
    search: SpeckleSearch, point: Point, progress: Callable[[int], None]
) -> tuple[Point, dict[str, tuple[float, float]]]:
    """The point without parts that held-out speckle doesn't need, and the loss without each part: of the correlation
    after a refit of all others, and in standard deviations of its mean over blocks."""
    whole, losses = search.standing(point), {}
    parts = {part: absent for part, absent in PARTS.items() if search.is_free(part)}
    for number, (part, absent) in enumerate(parts.items()):
        progress(number)
        without = search.ascend(point | absent, 12, rate=0.5, fixed=absent)[1]
        losses[part] = whole.loss(search.standing(without))
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


def _score_of(part: Pictures, circle: Circle, shape: Mapping[str, float], point: Point, lengths: Lengths) -> float:
    return SpeckleSearch(part.scaled(lengths), circle, shape).score(point)


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
    terms = {f"z{noll}": point[f"z{noll}"] * rng.uniform(0.2, 1.2) + 0.4 * rng.normal() for noll in WAVEFRONT_TERMS}
    return point | terms | {"stroke": point["stroke"] * math.exp(0.25 * rng.normal())}
