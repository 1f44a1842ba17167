"""What hypotheses predict of proposed captures, in σ of the noise that the leader predicts."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.captures.prepared_captures import BORDER_PX
from holoview.diagnose.likelihood import PredictorProtocol, Values
from holoview.experiment.next_capture.hypotheses import Belief, Hypothesis
from holoview.experiment.next_capture.loop_context import searched_part
from holoview.experiment.next_capture.proposals import Proposal
from holoview.experiment.next_capture.separation import Response
from holoview.rig.limits import SafetyLimits
from holoview.rig.measure.exposure_search import BRIGHT_QUANTILE
from holoview.util.errors import UserError

Images = NDArray[np.float64]

_FULL = 0.7  # of the camera's range that the brightest pixels are to reach
_DIGITS = 2  # of an exposure time


class ProposalPrediction:
    """Predicts proposals under the hypotheses of a belief.

    taken: the captures so far, whole. Each proposal gets the exposure that its brightness asks for, by the light that
    the captures so far showed at its wavelength; at a wavelength that none has, it has to be searched.
    """

    def __init__(
        self, belief: Belief, taken: Captures, proposals: Sequence[Proposal], limits: SafetyLimits, **options: Any
    ) -> None:
        self._belief, self._gains = belief, _gains(belief)
        self.captures = searched_part(_as_session(taken, proposals), belief.context.config)
        self._all = np.arange(len(proposals))
        self._predictor: PredictorProtocol = belief.context.predictor.create(captures=self.captures, **options)
        self.proposals = self._with_exposures(proposals, limits)
        signal, dark = self.light(self._predictor, belief.leader.values)
        self.scale = np.array([self._gain(p.wavelength_m) for p in self.proposals])[:, None, None]
        self._signal = signal * self.scale
        camera, prnu = self.captures.camera, belief.context.prnu
        expected = self._signal + dark
        variance = camera.noise_variance(expected) + np.square(prnu * expected)
        usable = expected < camera.saturation - camera.black_level
        self.weight = usable / np.sqrt(variance * belief.temperature)

    def responses(self, hypotheses: Sequence[Hypothesis]) -> list[list[Response]]:
        """What each hypothesis predicts of each proposal, whose gain is free: [proposal][hypothesis]."""
        found: list[list[Response]] = [[] for _ in self.proposals]
        gains = (self._signal * self.weight).reshape(len(self.proposals), -1)
        for hypothesis in hypotheses:
            pictures, spreads = self._pictures_and_spreads(hypothesis)
            for k, gain in enumerate(gains):
                found[k].append(Response(pictures[k], spreads[k]).without(gain))
        return found

    def light(self, predictor: PredictorProtocol, values: Values) -> tuple[Images, Images]:
        """Signals of all proposals (proposal, y, x) without borders, and counts that don't depend on the lasers."""
        prediction = predictor(self._all, values)
        dark = prediction.counts_without_lasers(self.captures.camera.black_level)
        signal = np.asarray(prediction.signal, dtype=np.float64)
        return without_border(signal), without_border(np.broadcast_to(dark, signal.shape).astype(np.float64))

    def _pictures_and_spreads(self, hypothesis: Hypothesis) -> tuple[Images, Images]:
        """Pictures (proposal, pixel) in σ, and (proposal, parameter, pixel) their change by one standard deviation."""
        free, values = hypothesis.free, hypothesis.values
        base = self._picture(values)
        x, bounds = free.pack(values), free.bounds()
        slopes = np.zeros((len(free), *base.shape))
        for axis in range(len(free)):
            step, stepped = bounds.step_at(x, axis), x.copy()
            stepped[axis] += step
            try:
                slopes[axis] = (self._picture(free.unpack(stepped, values)) - base) / step
            except UserError:
                continue  # a bench that can't be: no capture shows it
        return base, np.einsum("pc,pkn->kcn", hypothesis.root, slopes)

    def _picture(self, values: Values) -> Images:
        """Pictures (proposal, pixel) in σ, each with the gain that is nearest to the leader's picture."""
        signal, dark = self.light(self._predictor, values)
        model, w = signal * self.weight, self._signal * self.weight
        power = np.maximum(np.einsum("kyx,kyx->k", model, model), 1e-300)
        gain = np.einsum("kyx,kyx->k", w, model) / power
        return (gain[:, None, None] * model + dark * self.weight).reshape(len(signal), -1)

    def _gain(self, wavelength_m: float) -> float:
        return self._gains.get(wavelength_m, float(np.median(list(self._gains.values()))))

    def _with_exposures(self, proposals: Sequence[Proposal], limits: SafetyLimits) -> list[Proposal]:
        """The proposals with exposures, which the session that predicts them gets as well."""
        signal, _ = self.light(self._predictor, self._belief.leader.values)
        camera, found = self.captures.camera, []
        exposures = self.captures.exposure_s
        for k, proposal in enumerate(proposals):
            bright = float(np.quantile(signal[k], BRIGHT_QUANTILE)) * self._gain(proposal.wavelength_m)
            wanted = proposal.brightness * _FULL * (camera.saturation - camera.black_level) / max(bright, 1e-300)
            exposures[k] = float(np.clip(float(f"{wanted:.{_DIGITS}g}"), *limits.exposures_s))
            is_known = proposal.wavelength_m in self._gains
            found.append(dataclasses.replace(proposal, exposure_s=float(exposures[k]) if is_known else None))
        return found


def without_border(images: Images) -> Images:
    """Without the borders, which no comparison uses."""
    y, x = (min(BORDER_PX, n // 4) for n in images.shape[-2:])
    return images[..., y : images.shape[-2] - y, x : images.shape[-1] - x]


def _gains(belief: Belief) -> dict[float, float]:
    """Counts per unit of signal at each wavelength that captures have, the median of its captures."""
    gain = belief.comparison.fit_gains(belief.leader.values).gain
    wavelengths = belief.context.data.captures.wavelength_m[belief.comparison.indices]
    return {float(λ): float(np.median(gain[wavelengths == λ])) for λ in np.unique(wavelengths)}


def _as_session(taken: Captures, proposals: Sequence[Proposal]) -> Captures:
    """A session of the proposals, with exposures of 1 s and pictures of zeros, each taken after the last capture."""
    count = len(proposals)
    return dataclasses.replace(
        taken,
        levels=np.stack([p.levels for p in proposals]),
        images=np.zeros((count, *taken.shape), np.uint16),
        wavelength_m=np.array([p.wavelength_m for p in proposals]),
        distance_m=np.array([p.distance_m for p in proposals]),
        power=np.array([p.power for p in proposals]),
        exposure_s=np.ones(count),
        levels_before=np.broadcast_to(taken.levels[-1], (count, *taken.levels.shape[1:])),
        levels_first=taken.levels[0],
    )
