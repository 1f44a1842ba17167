"""The light on the modulator that a search by speckle varies, and how well the speckle of predictions stands with it.

A point has the numbers of a beam, of a wavefront over it, of the stroke, of unmodulated and of stray light. The
correlation of local contrasts (`numerics.speckle_match`) has derivatives by all of them.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Callable, Collection, Mapping
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
from holoview.bench.captures.speckle_retrieval import NearestBeam, beam_of_brightness
from holoview.bench.diagnose.crop import compact_prediction
from holoview.bench.diagnose.extended_model import PredictorWithKnownEffects
from holoview.bench.diagnose.parts import PartsPredictor
from holoview.light.effects.beam import WAVEFRONT_TERMS
from holoview.light.model.effects.effect import Effect, Parameter, Values
from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.light.model.effects.registry import get_effect
from holoview.light.numerics.resample import affine_warp
from holoview.light.numerics.sampling import positions
from holoview.light.numerics.speckle_match import match_speckle
from holoview.light.numerics.surfaces import zernike

Tensor = torch.Tensor
Point = dict[str, float]

TERMS = tuple(range(2, 12))
"""Noll's indices of a wavefront's terms: tilts, defocus, astigmatism, coma, trefoil, spherical aberration."""
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
    **{f"z{noll}": 0.12 for noll in TERMS},
}
"""Adam's unit of each number: ln size, exponent, places in half sides, shares, stray over mean light, pixels of the
second modulator's shift, radians r.m.s. of wavefront."""
_BOUNDS = {"log_size": (-1.5, 2.5), "edge": (0.8, 6.0), "stroke": (0.15, 2.2), "stray": (0.0, 1.0)} | dict.fromkeys(
    ("centre_y", "centre_x"), (-1.0, 1.0)
)
SECOND = {"second_y": 0.0, "second_x": 0.0}
"""Where the second modulator should be."""
EVEN = {"log_size": _BOUNDS["log_size"][0], "edge": 2.0, "centre_y": 0.0, "centre_x": 0.0}
"""Light that falls by 0.3 % of its amplitude from the middle to the corners: even."""
NOMINAL: Point = dict.fromkeys(_STEPS, 0.0) | EVEN | {"stroke": 1.0}
"""Even light without a wavefront, and the assumed stroke."""
PARTS: dict[str, dict[str, float]] = {
    "shape": EVEN,
    "defocus": {"z4": 0.0},
    "astigmatism": {"z5": 0.0, "z6": 0.0},
    "coma": {"z7": 0.0, "z8": 0.0},
    "trefoil": {"z9": 0.0, "z10": 0.0},
    "spherical aberration": {"z11": 0.0},
    "stroke": {"stroke": 1.0},
    "unmodulated light": {"share": 0.0, "quadrature": 0.0},
    "stray light": {"stray": 0.0},
    "shift of the second modulator": SECOND,
}
"""Parts of the light that may be superfluous, with the numbers that stand for their absence."""
_LEAST_WAVE = 1e-3
"""[rad] R.m.s. of a term of the wavefront, below which it isn't stated. Evidence: a reason: no picture shows it."""
_REACH_PX, _AROUND_PX = 25, 80
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


MIDDLE = Circle(0.5)
"""As large as the modulator's longer side, in its middle."""
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


NOMINAL_LENGTHS = Lengths()


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
            edge, (dy, dx) = (1, 1, 1, 1), (p[name] * context.upsample for name in SECOND)
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
            terms = [context.zernike(one, {noll: 1.0}, tuple(centre_m), radius_m) for noll in TERMS]
            self._terms[key] = torch.stack(terms)
        phase = torch.tensordot(torch.stack([p[f"z{noll}"] for noll in TERMS]), self._terms[key], dims=1)
        phase = phase * (self._unit_m / context.wavelength_m)
        return light * torch.polar(torch.ones_like(phase), phase)


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
    def beside(cls, point: Point, pictures: Pictures, circle: Circle = MIDDLE) -> NearBeam:
        """The beam that brings brightness to its places beside a point's other numbers. circle: of the point's terms.
        pictures: whole ones."""
        captures, usable = pictures.captures, pictures.data.usable
        with torch.no_grad():
            even = PointPredictor(pictures, circle)(point | EVEN | {"stray": 0.0}).numpy()
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
            return cls(pictures, EVEN, 0.0)
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

    def __init__(self, pictures: Pictures, circle: Circle = MIDDLE, shape: Mapping[str, float] = NO_SHAPE) -> None:
        self.shape, self._circle = shape, circle
        self._pictures, self._data = pictures, pictures.data
        self._predicted = PointPredictor(pictures, circle)
        self._measure = SpeckleMeasure(pictures.data)
        self._has_second = pictures.captures.levels.shape[1] > 1

    def for_thread(self) -> SpeckleSearch:
        """The same for another thread: what predicts can't be shared."""
        other = copy.copy(self)
        other._predicted = PointPredictor(self._pictures, self._circle)
        return other

    def near(self, beam: NearestBeam, stroke: float) -> Point:
        """The point of a beam with a wavefront."""
        point = dict.fromkeys(_STEPS, 0.0) | {"stroke": stroke}
        point |= {"log_size": -math.log(beam.radius), "edge": beam.edge}
        point |= {"centre_y": beam.centre[0], "centre_x": beam.centre[1]}
        point |= {f"z{noll}": radians for noll, radians in beam.terms.items()}
        point = rebased(point, Circle(beam.radius, *beam.centre), self._circle) if beam.terms else point
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
        fixed = {*fixed, *self.shape, *({} if self._has_second else SECOND)}
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
        return not {*PARTS[part]} <= {*self.shape} and (self._has_second or PARTS[part] is not SECOND)

    def effect_values(self, point: Point, dropped: Collection[str]) -> dict[str, dict[str, float]]:
        """The values of effects that make the light of a point. dropped: parts that it doesn't have, over the circle of
        its terms."""
        captures = self._data.captures
        circle = self._whole_circle()
        values: dict[str, dict[str, float]] = {}
        beam: dict[str, float] = {}
        if "shape" not in dropped:
            circle = min(math.exp(-point["log_size"]), circle)
            beam = {"size": math.exp(point["log_size"]), "edge": point["edge"]}
            beam |= {f"centre_{axis}": point[f"centre_{axis}"] for axis in "yx"}
        own = Circle(circle, point["centre_y"], point["centre_x"])  # in the middle without a shape
        centred = rebased(point, self._circle, own)
        per_radian = float(captures.wavelength_m[0]) / (2 * math.pi)
        names = [f"z{noll}" for noll in WAVEFRONT_TERMS]
        is_dropped = {name for part in dropped for name in PARTS[part]}
        wave = dict[str, float]()
        if not {*names} <= is_dropped:  # coma has defocus and astigmatism about another centre: these aren't left out
            wave = {name: centred[name] * per_radian for name in names if abs(centred[name]) > _LEAST_WAVE}
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
        if self._has_second and not {*SECOND} <= is_dropped:
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
            added = rebased(dict.fromkeys(point, 0.0) | own, circle, self._circle)
            point |= {f"z{noll}": point[f"z{noll}"] + added[f"z{noll}"] for noll in TERMS}
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


def circle_of(point: Point) -> Circle:
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


def rebased(point: Point, before: Circle, after: Circle) -> Point:
    """The same wavefront in terms over another circle, by least squares over it."""
    line = torch.linspace(-1, 1, 41, dtype=torch.float64)
    y, x = torch.meshgrid(line, line, indexing="ij")
    inside = y.square() + x.square() <= 1
    y, x = y[inside] * after.radius + after.centre_y, x[inside] * after.radius + after.centre_x

    def terms(circle: Circle) -> Tensor:
        down, across = (y - circle.centre_y) / circle.radius, (x - circle.centre_x) / circle.radius
        radius, angle = torch.hypot(down, across), torch.atan2(down, across)
        return torch.stack([zernike(noll, radius, angle) for noll in (1, *TERMS)], 1)

    wanted = terms(before)[:, 1:] @ torch.tensor([point[f"z{noll}"] for noll in TERMS], dtype=torch.float64)
    solved = torch.linalg.lstsq(terms(after), wanted[:, None]).solution[1:, 0]
    return point | {f"z{noll}": float(value) for noll, value in zip(TERMS, solved, strict=True)}
