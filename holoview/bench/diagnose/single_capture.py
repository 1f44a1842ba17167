"""Captures of one picture: blocks of its pixels are held out and judge the explanation of the other pixels.

The picture is given twice, once with the pixels to fit and once with the held-out pixels. Blocks are several speckles
wide, and a margin of two speckles separates them from the fitted pixels, so that no speckle is on both sides. Where
light fills little of a picture, blocks are held out that hold a fair share of it: dark pixels agree with any bench.

Pixels of one picture are weaker evidence than other captures, in two ways. Errors of the model extend over a speckle,
so that further pixels of a speckle say nothing new and Δχ² counts for 1/A, with A pixels in a speckle. And no other
pattern refutes a cause that imitates the true cause for this pattern. An explanation therefore needs A times as much
Δχ² (25·A), and has to reach the noise floor up to jitter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Prediction
from holoview.bench.captures.prepared_captures import PreparedCaptures
from holoview.bench.captures.records.trials import speckle_px
from holoview.bench.diagnose.capture_split import CaptureSplit
from holoview.bench.diagnose.config import SearchConfig
from holoview.bench.diagnose.likelihood import PredictorProtocol, Values
from holoview.bench.diagnose.search_context import NeighbourVariances, PerThreadPredictor, SearchContext

_BLOCK_WIDTHS = 6.0
"""[speckles] Side of a block. Evidence: a block holds more than 30 speckles, and the margins don't eat it up."""
_MARGIN_WIDTHS = 2.0
"""[speckles] Distance between pixels that are fitted and pixels that are held out. Evidence: derivation: the picture's
autocorrelation is below a hundredth there."""
_MIN_BLOCKS = 3
"""[blocks] Smallest number of blocks along each side of the picture; narrower blocks are used if needed. Evidence:
derivation: with three, one is held out in the middle."""
ONE_PICTURE_MAX_EXCESS = 0.02
"""[χ²/n] An explanation of one picture is complete up to this excess. Evidence: as `JITTER_EXCESS`: captures of other
patterns, which would refute a cause that only imitates this picture, are missing, so that only the excess of a
laboratory's jitter is allowed."""

_LEAST_FAIR = 0.3
"""[1] Of the light's evidence in pixels that are held out, and in those that are fitted, over what is fair for their
number: where the usual blocks have less, the fairest ones are taken. Evidence: a drawn bench with a wavefront of 2.5
rad was `consistent`: 7 % of what is fair was held out."""

Flags = NDArray[np.bool_]
_FAR_FIELD_WIDTHS = 2  # a beam that fills half of the modulator


class OnePicturePredictor:
    """Predicts the one picture, whichever of its two parts is asked for.

    create: makes a predictor of the captures that the keyword names. options: its other keywords.
    """

    def __init__(self, create: Callable[..., PredictorProtocol], captures: Captures, **options: Any) -> None:
        self._predict = create(captures=captures, **options)

    @property
    def fields_requested(self) -> int:
        """How many fields calls have asked for."""
        return self._predict.fields_requested

    def __call__(self, indices: NDArray[np.intp], values: Values, *, grad: bool = False) -> Prediction:
        return self._predict(np.zeros_like(indices), values, grad=grad)


ONE_PICTURE_NOTE = (
    "The verdict rests on one picture: blocks of its pixels were held out. Captures of other patterns are stronger "
    "evidence."
)


def with_one_picture(context: SearchContext, capture: int) -> SearchContext:
    """The context of captures of which only one counts, whose picture is given twice: with the pixels that are fitted,
    and with those that are held out."""
    captures = context.data.captures.subset([capture])
    one = PreparedCaptures(captures, context.data.light[[capture]], context.data.usable[[capture]])
    width_px = speckle_width_px(one)
    held_out, fitted = fair_blocks(one, width_px)
    usable = np.concatenate([one.usable & fitted, one.usable & held_out])
    data = PreparedCaptures(captures.subset([0, 0]), np.repeat(one.light, 2, axis=0), usable)
    first, second = (np.array([k], dtype=np.intp) for k in (0, 1))
    return replace(
        context,
        data=data,
        split=CaptureSplit(first, first, first, second),
        predictor=PerThreadPredictor(partial(OnePicturePredictor, context.predictor.create, captures=captures)),
        variances=NeighbourVariances(data),
        config=config_for_one_picture(context.config, width_px),
        left_out=(),
    )


def fair_blocks(data: PreparedCaptures, speckle_px: float) -> tuple[Flags, Flags]:
    """The pixels (y, x) of one picture that are held out, and those that are fitted: the usual blocks, or those with
    which both parts have more of the light's evidence, Σ(I/σ)²."""
    light = np.maximum(data.light[0], 0.0).astype(np.float64)
    evidence = np.where(data.usable[0], light**2 / data.camera.noise_variance(light), 0.0)
    total = max(float(evidence.sum()), 1e-30)
    choices = [held_out_blocks(data.captures.shape, speckle_px, first) for first in ((1, 1), (0, 1), (1, 0), (0, 0))]

    def fairness(parts: tuple[Flags, Flags]) -> float:
        return min(float(evidence[part].sum()) / total / max(float(part.mean()), 1e-30) for part in parts)

    return choices[0] if fairness(choices[0]) >= _LEAST_FAIR else max(choices, key=fairness)


def held_out_blocks(shape: tuple[int, int], speckle_px: float, first: tuple[int, int] = (1, 1)) -> tuple[Flags, Flags]:
    """The pixels that are held out, every other block along rows and columns, and those that are fitted, (y, x).

    first: number (y, x) of the first block that is held out, 0 or 1.
    """
    side = max(1, min(round(_BLOCK_WIDTHS * speckle_px), min(shape) // _MIN_BLOCKS))
    margin = max(1, min(round(_MARGIN_WIDTHS * speckle_px), side // 3))
    y, x = (np.arange(n) // side % 2 == parity for n, parity in zip(shape, first, strict=True))
    held_out = y[:, None] & x[None, :]
    near = maximum_filter(held_out, size=2 * margin + 1, mode="constant")  # a row at a time, however wide the margin
    return held_out, ~near


def speckle_width_px(data: PreparedCaptures) -> float:
    """Full width at half maximum of the picture's autocorrelation, the larger one of rows and columns, at least 1.

    On a Fourier bench at most twice the width for a modulator that is lit evenly: the autocorrelation of smooth
    patterns shows the far field's envelope, but speckles are no wider than the aperture lets them be.
    """
    width = _autocorrelation_width_px(data)
    if not data.captures.is_fourier:
        return width
    return min(width, _FAR_FIELD_WIDTHS * max(speckle_px(data.captures)))


def _autocorrelation_width_px(data: PreparedCaptures) -> float:
    light = np.where(data.usable[0], data.light[0], 0.0).astype(np.float64)
    light = np.where(data.usable[0], light - light[data.usable[0]].mean(), 0.0)
    spectrum = np.abs(np.fft.rfft2(light, s=[2 * n for n in light.shape])) ** 2
    correlation = np.fft.irfft2(spectrum, s=[2 * n for n in light.shape])
    lines = (correlation[: light.shape[0], 0], correlation[0, : light.shape[1]])
    return float(max(_full_width(line / max(line[0], 1e-30)) for line in lines))


def config_for_one_picture(config: SearchConfig, speckle_px: float) -> SearchConfig:
    """The settings with a stricter verdict: Δχ² for each speckle, not each pixel, and the noise floor."""
    verdict = replace(
        config.verdict,
        min_delta_chi2=config.verdict.min_delta_chi2 * max(speckle_px, 1.0) ** 2,
        explained_excess=min(config.verdict.explained_excess, ONE_PICTURE_MAX_EXCESS),
    )
    return replace(config, verdict=verdict)


def _full_width(line: NDArray[np.float64]) -> float:
    """Twice the lag at which a line from its peak of 1 falls to a half, by linear interpolation; at least 1."""
    below = np.flatnonzero(line < 0.5)
    if not len(below):
        return float(2 * len(line))
    after = int(below[0])
    lag = after - (0.5 - line[after]) / max(line[after - 1] - line[after], 1e-30)
    return max(1.0, 2.0 * float(lag))
