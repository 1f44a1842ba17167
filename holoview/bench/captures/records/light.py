"""How much light each capture holds, beside how much the model predicts for its patterns and settings.

Patterns, stops, the lens and the camera's size decide how much light reaches the camera: of a rough pattern a Fourier
bench may collect a hundredth of what it collects of a smooth one. So the light of a capture is never compared with that
of other captures, but its *gain* is: the light seen over the light predicted. Gains of one wavelength are equal if the
records and the bench are right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from holoview.bench.captures.dataset import Captures, Floats
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.prepared_captures import prepare_captures
from holoview.light.model.effects.registry import EffectValues

_CACHE_MB = 64


@dataclass(frozen=True)
class CaptureLight:
    """Mean light of the usable pixels of each capture, (capture,).

    seen: counts above black. predicted: of the lasers, in the unit of `Prediction.signal`. pixels: how many are usable.
    """

    seen: Floats
    predicted: Floats
    pixels: Floats

    @property
    def gain(self) -> Floats:
        """Counts per predicted unit, (capture,); NaN where no light is predicted, or none is seen."""
        lit = (self.seen > 0) & (self.predicted > 0)
        return np.divide(self.seen, self.predicted, where=lit, out=np.full(len(self.seen), np.nan))


def measure_light(captures: Captures, effects: EffectValues) -> CaptureLight:
    """The light of all captures. effects: of the nominal bench, {id: {parameter: value}}."""
    data, predictor = prepare_captures(captures), Predictor(captures, cache_mb=_CACHE_MB)
    seen, predicted, pixels = (np.zeros(len(captures)) for _ in range(3))
    for k, usable in enumerate(data.usable):
        prediction = predictor([k], effects)
        light = data.light[k] - prediction.counts_without_lasers(captures.camera.black_level)
        pixels[k] = float(usable.sum())
        seen[k] = float(np.where(usable, light, 0.0).sum(dtype=np.float64)) / max(pixels[k], 1.0)
        predicted[k] = float(prediction.signal[0].numpy()[usable].sum(dtype=np.float64)) / max(pixels[k], 1.0)
    return CaptureLight(seen, predicted, pixels)
