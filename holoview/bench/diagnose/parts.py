"""Five small parts of large pictures, the middle and the four corners, predicted one by one and compared as one.

The middle hardly shows effects that grow towards the edges, such as a beam that falls off, and a whole field takes
thirty times as long as five parts. Each part has as much of the modulators around it as the middle that causes are
searched in. A picture of parts has them one below the other, and one gain, so that light that is lost at the corners
isn't lost in their gains. Whole pictures judge what was fitted to parts. Beneath a beam that lights less than the
modulators, the middle and the corners are those of its light.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.patterns import pattern_roughness
from holoview.bench.captures.predictor import Prediction
from holoview.bench.captures.prepared_captures import BORDER_PX, PreparedCaptures
from holoview.bench.captures.records.trials import cut_out
from holoview.bench.diagnose.capture_split import split_captures
from holoview.bench.diagnose.crop import compact_prediction, pixel_ratio, through_windows
from holoview.bench.diagnose.likelihood import PredictorProtocol, Values
from holoview.bench.diagnose.search_context import (
    NeighbourVariances,
    Pace,
    PerThreadPredictor,
    SearchContext,
    field_samples,
)
from holoview.light.model.effects.effect import FileParameter
from holoview.light.model.effects.registry import get_effect

_CACHE_MB = 64  # of each part's predictor
_TIME_SHARE = 0.85
"""[1] Of the time of a search, after which parts are given up with their best result. Evidence: a reason: whole
pictures have to judge it."""
_LIT_RADII = 0.6
"""[1] Of a beam's radius, from its centre to that of a corner along each axis. Evidence: derivation: corners lie
where a Gaussian beam has a quarter of its peak."""


class PartsPredictor:
    """Predicts all parts of a picture, one below the other. create: makes the predictor of each part."""

    def __init__(self, create: Sequence[Callable[..., PredictorProtocol]], **options: Any) -> None:
        self._parts = [one(**({"cache_mb": _CACHE_MB} | options)) for one in create]

    @property
    def fields_requested(self) -> int:
        """How many fields of all parts together calls have asked for."""
        return self._parts[0].fields_requested

    def __call__(self, indices: NDArray[np.intp], values: Values, *, grad: bool = False) -> Prediction:
        """As `Predictor`; the rows of a signal are those of all parts."""
        found = [part(indices, values, grad=grad) for part in self._parts]
        ambient = [one.ambient for one in found if one.ambient is not None]
        together = torch.cat(ambient, dim=1) if ambient else None
        return Prediction(torch.cat([one.signal for one in found], dim=1), found[0].black_level, together)


@dataclasses.dataclass(frozen=True)
class Parts:
    """Parts of pictures. captures: of each part. data: of all, one below the other, in the order of `captures`.
    windows: rows and columns of each in the whole pictures."""

    captures: tuple[Captures, ...]
    data: PreparedCaptures
    windows: tuple[tuple[slice, slice], ...]


def cut_parts(data: PreparedCaptures, like: Captures, beam: Mapping[str, float] | None = None) -> Parts | None:
    """Five parts of near-field pictures; None where none fit.

    like: whose size each part has. beam: values of the effect `beam`, whose middle and corners are taken; those of the
    pictures where None.
    """
    captures = data.captures
    offsets = _offsets(captures, like, beam or {})
    if offsets is None:
        return None
    shape = (like.levels.shape[2], like.levels.shape[3])
    cut = [cut_out(captures, shape, like.shape, offset) for offset in offsets]
    parts, windows = tuple(one for one, _ in cut), tuple(window for _, window in cut)
    light, usable = through_windows(windows, data.light), through_windows(windows, data.usable)
    names = ("levels", "images") if parts[0].usable is None else ("levels", "images", "usable")
    below: dict[str, Any] = {name: np.concatenate([getattr(p, name) for p in parts], axis=-2) for name in names}
    together = dataclasses.replace(parts[0], **below, levels_before=None, levels_first=None)  # of no place
    return Parts(parts, PreparedCaptures(together, light, usable), windows)


def parts_of_context(
    whole: SearchContext,
    like: Captures,
    known: Values,
    beam: Mapping[str, float] | None = None,
    *,
    min_saving: float | None = None,
) -> SearchContext | None:
    """The context of a search in parts; None where it would save little, and on a Fourier bench.

    like, beam: as of `cut_parts`. known: effects that the nominal model has; None is returned too where one is read
    from a file, whose maps are of whole modulators. min_saving: in place of `RegionConfig.min_saving`.
    """
    captures = whole.data.captures
    has_maps = any(isinstance(p, FileParameter) for name in known for p in get_effect(name).parameters)
    parts = None if captures.is_fourier or has_maps else cut_parts(whole.data, like, beam)
    least = whole.config.region.min_saving if min_saving is None else min_saving
    if parts is None or pixel_ratio(captures, parts.data.captures) < least:
        return None
    creators = [partial(whole.predictor.create, **compact_prediction(part)) for part in parts.captures]
    together = parts.data.captures
    budget = whole.config.budget.fields_for(field_samples(together, whole.sampling))
    return dataclasses.replace(
        whole,
        data=parts.data,
        system=parts.captures[0].nominal_system(),
        field_budget=budget if math.isfinite(whole.field_budget) else math.inf,
        split=split_captures(together, pattern_roughness(captures), whole.left_out),
        predictor=PerThreadPredictor(partial(PartsPredictor, creators)),
        variances=NeighbourVariances(parts.data),
        end=whole.end.after_share(_TIME_SHARE),
        pace=Pace(),
        windows=parts.windows,
    )


def _offsets(captures: Captures, like: Captures, beam: Mapping[str, float]) -> list[tuple[int, int]] | None:
    """How far (y, x) each part's centre is from the pictures', modulator pixels; None where no part fits.

    As far out as the modulators around a part, the usable pixels of the picture and the beam's light allow, but not
    over the middle part.
    """
    scale, places = captures.slms[0].pitch_m / captures.camera.pitch_m, list[list[int]]()
    whole = captures.levels.shape[2:]
    half_px, size = max(whole) / 2, beam.get("size", 0.0)
    for axis, name in enumerate(("centre_y", "centre_x")):
        around = (whole[axis] - like.levels.shape[2 + axis]) // 2
        seen = (captures.shape[axis] - like.shape[axis]) / 2 - BORDER_PX
        most = math.floor(min(around, seen / scale))
        if most < 1:
            return None
        lit = math.ceil(max(_LIT_RADII * half_px / size, like.shape[axis] / scale)) if size else most
        reach = min(lit, most)
        centre = round(float(np.clip(beam.get(name, 0.0) * half_px, reach - most, most - reach)))
        places.append([centre - reach, centre, centre + reach])
    (top, middle, bottom), (left, centre, right) = places
    return [(middle, centre), *((y, x) for y in (top, bottom) for x in (left, right))]
