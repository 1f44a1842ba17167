"""The next capture: of many proposals the one that promises most information in a second, improved by gradient.

Proposal             a capture that could be taken: patterns of several classes, planes, wavelengths, powers, exposures
CaptureChooser       chooses among proposals
expected_…           how well a capture tells hypotheses apart, before it is taken
BenchTime            how long a capture takes on the bench, learned from those that were taken
ProposalPrediction   what hypotheses predict of proposed captures, in σ of the noise that the leader predicts
improve_pattern      a proposal's patterns, improved by gradient

A hypothesis i predicts the picture u_i, in σ of its noise. Its parameters, as uncertain as the captures so far leave
them, spread it along the rows of B_i, each by one standard deviation. If i is true and its rival j is fitted again, to
first order, with the present knowledge of j's parameters as a prior,

    E[Δχ²_ij] = (u_i − u_j)ᵀ M_j (u_i − u_j) + tr(B_i M_j B_iᵀ),   M_j = (I + B_jᵀ B_j)⁻¹

which is the criterion of T-optimal designs (Atkinson & Fedorov, Biometrika 62, 57 (1975)) with its rival linearised.
The gain of a capture is unknown, so that all pictures are projected onto the directions that no gain can imitate.

A larger Δχ² between two hypotheses tells no more than which of them is true. So proposals are compared by information,

    I = −Σ_i p_i ln Σ_j p_j exp(−Δχ²_ij / 8)   in nats

with Bhattacharyya's distances of Gaussians of equal variance, a lower bound of the mutual information between cause
and capture (Kolchinsky & Tracey, Entropy 19, 361 (2017)). It is never negative, nor more than the entropy of p.

The gradient raises the separation Σ (m₁ − a m₂)²/σ² of leader and rival, with the gain a that suits best and the
rival's values refitted to first order to the pattern of each step. The refitted values minimise the separation: its
derivative by the rival's values vanishes, so that its gradient by the pattern is the same as with the values held. The
pattern of largest E[Δχ²] is kept.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.patterns import BLUR_SIGMAS_PX
from holoview.bench.captures.prepared_captures import BORDER_PX
from holoview.bench.captures.records.trials import central_slices
from holoview.bench.diagnose.likelihood import PredictorProtocol, Values
from holoview.bench.experiment.hypotheses import Belief, Hypothesis, searched_part
from holoview.bench.rig.camera_pictures import BRIGHT_QUANTILE
from holoview.bench.rig.capture_plan import CaptureRequest, default_plan
from holoview.bench.rig.description import RigDescription
from holoview.bench.rig.devices import Devices, Levels, SafetyLimits
from holoview.light.model.effects.effect import Effect, Parameter
from holoview.light.model.effects.effect import Values as ParameterValues
from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.util.errors import UserError

T = TypeVar("T")

START_COUNT = 2

_START_SIGMAS_PX = (0.0, 3.0)  # rough patterns show small errors, smooth patterns survive large errors
_PERIODS_PX = (4, 6, 8, 12, 16)
_LOW_POWER = 0.5  # of the highest: a power law needs two
_POWERS = (_LOW_POWER, 1.0, 1.0, 1.0)
_BRIGHTNESSES = (0.1, *[1.0] * 7)  # light of the room and the camera's response show in a tenth of the exposure


@dataclass(frozen=True)
class Proposal:
    """A capture that could be taken.

    levels: (modulator, y, x). words: a description of its patterns. brightness: its exposure over an exposure that uses
    the camera's range. exposure_s: None where it has to be searched.
    """

    wavelength_m: float
    distance_m: float
    power: float
    levels: Levels
    words: str
    brightness: float = 1.0
    exposure_s: float | None = None

    @property
    def request(self) -> CaptureRequest:
        """The request for a measurement; its patterns are `levels`."""
        return CaptureRequest(self.wavelength_m, self.distance_m, self.power, 0.0, (0, 0), self.exposure_s)

    @property
    def place(self) -> str:
        """Wavelength, plane, patterns, and an unusual power or exposure, in words."""
        dim = ", a tenth of the exposure" if self.brightness < 1 else ""
        return f"{self.wavelength_m * 1e9:.0f} nm at {self.distance_m * 1e3:.3g} mm, {self.words}{dim}"


def starting_proposals(rig: RigDescription, seed: int) -> list[Proposal]:
    """The captures to begin with. They differ in wavelength, plane and power, so that every effect shows that the rig
    can show: a rough pattern at the shortest wavelength in the last plane, where light spreads most, and a smooth one
    at the longest wavelength in the first plane."""
    rng = np.random.default_rng((seed, 0))
    planes, lasers = planes_of(rig), rig.wavelengths_m
    places = ((min(lasers), planes[-1], 1.0), (max(lasers), planes[0], _LOW_POWER))
    return [
        Proposal(λ, z, power * rig.limits.power, rig.random_levels(rng, sigma), _blur_words(rig, sigma))
        for (λ, z, power), sigma in zip(places, _START_SIGMAS_PX, strict=True)
    ]


def draw_proposals(rig: RigDescription, rng: np.random.Generator, count: int) -> list[Proposal]:
    """Random ones; every pair of wavelength and plane, every class of patterns, every power and brightness comes about
    as often as it should."""
    low, high = rig.limits.stage_m
    planes = [*planes_of(rig)]
    if len(planes) > 1:
        planes.append(float(rng.uniform(low, high)))
    places = _cycled(rng, list(itertools.product(rig.wavelengths_m, planes)), count)
    classes = _cycled(rng, _classes(rig), count)
    powers, brightnesses = _cycled(rng, _POWERS, count), _cycled(rng, _BRIGHTNESSES, count)
    drawn = []
    for (λ, z), pattern, power, brightness in zip(places, classes, powers, brightnesses, strict=True):
        levels, words = pattern(rng)
        drawn.append(Proposal(λ, z, power * rig.limits.power, levels, words, brightness))
    return drawn


def planes_of(rig: RigDescription) -> list[float]:
    """The planes of the default plan, nearest first."""
    return sorted({request.distance_m for request in default_plan(rig).requests})


def _cycled(rng: np.random.Generator, values: Sequence[T], count: int) -> list[T]:
    """`count` of the values in random order, each about as often."""
    order: list[int] = []
    while len(order) < count:
        order += rng.permutation(len(values)).tolist()
    return [values[k] for k in order[:count]]


PatternClass = Callable[[np.random.Generator], tuple[Levels, str]]


def _classes(rig: RigDescription) -> list[PatternClass]:
    """Blurred noise of every width on all modulators, one modulator flat, gratings."""
    numbers = range(len(rig.bench.slms))
    classes: list[PatternClass] = [_blur_class(rig, sigma) for sigma in BLUR_SIGMAS_PX]
    classes += [_grating_class(rig, number) for number in numbers]
    if len(numbers) > 1:
        classes += [_one_flat_class(rig, number, sigma) for number in numbers for sigma in (0.0, 3.0)]
    return classes


def _blur_class(rig: RigDescription, sigma_px: float) -> PatternClass:
    return lambda rng: (rig.random_levels(rng, sigma_px), _blur_words(rig, sigma_px))


def _one_flat_class(rig: RigDescription, flat: int, sigma_px: float) -> PatternClass:
    def draw(rng: np.random.Generator) -> tuple[Levels, str]:
        levels, (rows, columns) = rig.random_levels(rng, sigma_px), rig.slm_shapes[flat]
        levels[flat, :rows, :columns] = rig.bench.slms[flat].num_levels // 2
        return levels, f"{_noise(sigma_px)} on {_others(rig, flat)}, {rig.slm_words[flat]} flat"

    return draw


def _grating_class(rig: RigDescription, number: int) -> PatternClass:
    def draw(rng: np.random.Generator) -> tuple[Levels, str]:
        levels, (rows, columns) = rig.random_levels(rng, 3.0), rig.slm_shapes[number]
        period, angle = int(rng.choice(_PERIODS_PX)), float(rng.uniform(0, np.pi))
        y, x = np.indices((rows, columns))
        wave = 0.5 + 0.5 * np.sin(2 * np.pi * (x * np.cos(angle) + y * np.sin(angle)) / period)
        levels[number, :rows, :columns] = rig.bench.slms[number].levels_of(wave)
        beside = f", {_noise(3.0)} on {_others(rig, number)}" if len(levels) > 1 else ""
        return levels, f"grating of {period} px on {rig.slm_words[number]}{beside}"

    return draw


def _others(rig: RigDescription, number: int) -> str:
    """The modulators in words but for one."""
    return " and ".join(words for k, words in enumerate(rig.slm_words) if k != number)


def _blur_words(rig: RigDescription, sigma_px: float) -> str:
    return f"{_noise(sigma_px)} on {' and '.join(rig.slm_words)}"


def _noise(sigma_px: float) -> str:
    return f"noise blurred by {sigma_px:g} px" if sigma_px else "white pattern"


# --- the choice ---


MIN_INFORMATION = 1e-3
"""nats; a capture that promises less tells nothing."""

_MAX_HYPOTHESES = 6
Floats = NDArray[np.float64]
Images = NDArray[np.float64]
Tensor = torch.Tensor
_GUESSED_SPEED = 5e-3  # m/s of a stage, until it has moved
_GUESSED_READOUT_S = 0.05
_FULL = 0.7  # of the camera's range that the brightest pixels are to reach
_DIGITS = 2  # of an exposure time
_STEPS = 6
_STEP = 0.06  # of the stroke, r.m.s.


@dataclass(frozen=True)
class NextCapture:
    """The next capture, and why.

    information: expected, nats. seconds: expected on the bench. delta_chi2: expected between the leader and the rival
    that it is taken for. reason: in words.
    """

    proposal: Proposal
    reason: str
    information: float = 0.0
    seconds: float = 0.0
    delta_chi2: float = 0.0

    @property
    def rate(self) -> float:
        """Nats a second."""
        return self.information / max(self.seconds, 1e-9)

    @property
    def promises_something(self) -> bool:
        """Whether it is expected to tell anything."""
        return self.information >= MIN_INFORMATION


class CaptureChooser:
    """Chooses among proposals. taken: the captures so far, whole. time: of captures. here_m: where the stage is."""

    def __init__(self, belief: Belief, taken: Captures, limits: SafetyLimits, time: BenchTime, here_m: float) -> None:
        self._belief, self._taken, self._limits, self._time, self._here_m = belief, taken, limits, time, here_m
        self._hypotheses = [belief.leader, *belief.rivals[: _MAX_HYPOTHESES - 1]]
        weights = np.exp([h.log_weight - belief.hypotheses[0].log_weight for h in self._hypotheses])
        self._p = weights / weights.sum()

    def choose(self, proposals: Sequence[Proposal]) -> NextCapture:
        """The best of the proposals, with its patterns improved by gradient where that helps."""
        best, rival = self._best_of(proposals)
        if not best.promises_something or rival is None:
            return best
        levels = improve_pattern(self._belief, self._taken, best.proposal, rival, self._limits)
        words = f"{best.proposal.words}, improved by gradient"
        better, _ = self._best_of([replace(best.proposal, levels=levels, words=words)])
        return better if better.rate >= best.rate and better.delta_chi2 > best.delta_chi2 else best

    def sharpest(self, proposals: Sequence[Proposal]) -> Proposal:
        """The proposal that narrows the values of the hypotheses most per second, where nothing separates them."""
        prediction, rates = ProposalPrediction(self._belief, self._taken, proposals, self._limits), []
        for k, responses in enumerate(prediction.responses(self._hypotheses)):
            seconds = self._expected_seconds(prediction, k)
            rates.append(float(np.mean([value_information(response) for response in responses])) / seconds)
        return prediction.proposals[int(np.argmax(rates))]

    def _expected_seconds(self, prediction: ProposalPrediction, number: int) -> float:
        move_m = prediction.proposals[number].distance_m - self._here_m
        return self._time.expect(move_m, float(prediction.captures.exposure_s[number]))

    def _best_of(self, proposals: Sequence[Proposal]) -> tuple[NextCapture, Hypothesis | None]:
        """The proposal of most information per second, and the rival that it separates."""
        prediction = ProposalPrediction(self._belief, self._taken, proposals, self._limits)
        found = []
        for k, responses in enumerate(prediction.responses(self._hypotheses)):
            found.append(self._judge(prediction.proposals[k], responses, self._expected_seconds(prediction, k)))
        return max(found, key=lambda one: (one[0].rate, one[0].delta_chi2 / one[0].seconds))

    def _judge(
        self, proposal: Proposal, responses: Sequence[Response], seconds: float
    ) -> tuple[NextCapture, Hypothesis | None]:
        """A proposal as a choice, and the rival for which it would be taken."""
        deltas = pairwise_delta_chi2(responses)
        information = expected_information(self._p, deltas)
        if len(self._hypotheses) < 2:
            return NextCapture(proposal, "", information, seconds), None
        number = 1 + int(np.argmax(self._p[1:] * -np.expm1(-deltas[0, 1:] / 8.0)))
        delta, rival = float(deltas[0, number]), self._hypotheses[number]
        reason = f"{_purpose(self._hypotheses[0], rival)} (expected Δχ² {delta:.3g} in {seconds:.2g} s)"
        return NextCapture(proposal, reason, information, seconds, delta), rival


def _purpose(leader: Hypothesis, rival: Hypothesis) -> str:
    """The purpose of a capture in words."""
    if not rival.is_open:
        return f"separates {leader.name} from {rival.name}"
    beside = f" beside {leader.name}" if leader.causes else ""
    return f"shows whether there is {rival.causes[-1]}{beside}"


@dataclass(frozen=True)
class Response:
    """The prediction of one capture by a hypothesis, in σ: picture (pixel,), spreads (parameter, pixel)."""

    picture: Floats
    spreads: Floats

    def without(self, gain: Floats) -> Response:
        """The part that isn't along the direction `gain` (pixel,)."""
        unit = gain / max(float(np.linalg.norm(gain)), 1e-300)
        picture = self.picture - unit * (unit @ self.picture)
        return Response(picture, self.spreads - np.outer(self.spreads @ unit, unit))


def expected_delta_chi2(truth: Response, rival: Response) -> float:
    """By how much χ² of the rival, fitted again, will exceed that of the truth, in the mean."""
    d, b = truth.picture - rival.picture, rival.spreads
    rows = np.vstack([d[None], truth.spreads])
    along = rows @ b.T
    normal = np.eye(len(b)) + b @ b.T
    explained = np.einsum("rp,pr->r", along, np.linalg.solve(normal, along.T)) if len(b) else np.zeros(len(rows))
    return float(np.maximum(np.einsum("rn,rn->r", rows, rows) - explained, 0.0).sum())


def pairwise_delta_chi2(responses: Sequence[Response]) -> Floats:
    """Δχ² (hypothesis, hypothesis) by which a capture separates each pair, whichever of the two is true."""
    count = len(responses)
    directed = np.zeros((count, count))
    for i, truth in enumerate(responses):
        for j, rival in enumerate(responses):
            if i != j:
                directed[i, j] = expected_delta_chi2(truth, rival)
    return np.minimum(directed, directed.T)


def expected_information(probabilities: Floats, delta_chi2: Floats) -> float:
    """I in nats. probabilities: (hypothesis,), of sum 1. delta_chi2: (hypothesis, hypothesis), zero on the diagonal."""
    mixture = np.exp(-delta_chi2 / 8.0) @ probabilities
    known = probabilities > 0
    return max(0.0, float(-(probabilities[known] @ np.log(mixture[known]))))


def value_information(response: Response) -> float:
    """Expected information on the values of a hypothesis, ½ ln |I + B Bᵀ| in nats: the D-optimal design's criterion."""
    spreads = response.spreads
    return 0.5 * float(np.linalg.slogdet(np.eye(len(spreads)) + spreads @ spreads.T)[1])


@dataclass
class BenchTime:
    """Seconds of a capture: move + settle + exposure + readout.

    settle_s: of the modulators. The stage's speed (m/s) and the time added to each exposure follow from the clock.
    """

    settle_s: float
    moved_m: float = 0.0
    moving_s: float = 0.0
    _readouts: tuple[float, ...] = ()

    @classmethod
    def of(cls, devices: Devices) -> BenchTime:
        """Of these devices, before any capture."""
        return cls(max(modulator.settle_s for modulator in devices.modulators))

    @property
    def readout_s(self) -> float:
        """Seconds of a capture beside moving, settling and exposure; the median of the captures so far."""
        ordered = sorted(self._readouts)
        return ordered[len(ordered) // 2] if ordered else _GUESSED_READOUT_S

    @property
    def speed(self) -> float:
        """Of the stage, m/s."""
        return self.moved_m / self.moving_s if self.moving_s > 0 and self.moved_m > 0 else _GUESSED_SPEED

    def expect(self, move_m: float, exposure_s: float) -> float:
        """Seconds of a capture for which the stage moves so far."""
        return abs(move_m) / self.speed + self.settle_s + exposure_s + self.readout_s

    def note(self, move_m: float, exposure_s: float, seconds: float) -> None:
        """Learns from a capture that took so many seconds."""
        still = self.settle_s + exposure_s + self.readout_s
        if abs(move_m) > 0:
            self.moved_m += abs(move_m)
            self.moving_s += max(seconds - still, 1e-6)
        else:
            self._readouts = (*self._readouts, max(seconds - self.settle_s - exposure_s, 0.0))


class ProposalPrediction:
    """Predicts proposals under the hypotheses of a belief.

    taken: the captures so far, whole. Each proposal gets the exposure that its brightness asks for, by the light that
    the captures so far showed at its wavelength; at a wavelength that none has, it has to be searched.
    """

    def __init__(
        self, belief: Belief, taken: Captures, proposals: Sequence[Proposal], limits: SafetyLimits, **options: Any
    ) -> None:
        self._belief, self._gains = belief, _gains(belief)
        self.captures = searched_part(_as_captures(taken, proposals), belief.context.config)
        self._all = np.arange(len(proposals))
        self._predictor: PredictorProtocol = belief.context.predictor.counted(captures=self.captures, **options)
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
        """The prediction of each proposal by each hypothesis, with free gain: [proposal][hypothesis]."""
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
        """The proposals with exposures, which the predicted captures get as well."""
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


def _as_captures(taken: Captures, proposals: Sequence[Proposal]) -> Captures:
    """The proposals as captures, with exposures of 1 s and pictures of zeros, each taken after the last capture."""
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


class ShownPatterns(Effect):
    """Patterns that gradients reach, in place of those that a capture's record says.

    patterns: (modulator, y, x), smaller ones in the first rows and columns. elements: of a chain, the names of the
    elements that show them, in order.
    """

    id = "shown_patterns"
    cause = "Patterns are held by a tensor."
    finding = "Patterns are held by a tensor."
    parameters = (Parameter("on", "1: the patterns are shown."),)
    acts_on = ("modulator 1", "modulator 2")
    order = -100
    listed = False

    def __init__(self, patterns: Tensor, elements: Sequence[str] = ()) -> None:
        self.patterns, self.elements, self.on_all_elements = patterns, elements, bool(elements)  # type: ignore[misc]

    def stroke_response(self, share: Tensor, context: ModulatorContext, v: ParameterValues) -> Tensor:
        number = self.elements.index(context.element) if self.elements else context.number
        return self.patterns[number, : share.shape[0], : share.shape[1]].to(share.dtype)


def improve_pattern(
    belief: Belief, taken: Captures, proposal: Proposal, rival: Hypothesis, limits: SafetyLimits
) -> Levels:
    """Levels (modulator, y, x) that separate the leader from the rival better, or those of the proposal."""
    levels = best = proposal.levels
    best_delta, drive = -1.0, None
    for _ in range(_STEPS + 1):
        prediction = ProposalPrediction(belief, taken, [replace(proposal, levels=levels)], limits)
        ((leading, other),) = prediction.responses([belief.leader, rival])
        delta = expected_delta_chi2(leading, other)
        if delta > best_delta:
            best, best_delta = levels, delta
        drive = torch.from_numpy(prediction.captures.drive(0)) if drive is None else drive
        slope = _separation_slope(prediction, belief, _refitted(leading, other, rival), drive)
        rms = slope.square().mean().sqrt()
        if not rms.item() > 0:
            break
        drive = (drive + _STEP / rms * slope).clamp(0.0, 1.0)
        levels = _as_levels(drive.numpy(), proposal.levels, taken)
    return best


def _separation_slope(prediction: ProposalPrediction, belief: Belief, rival: Values, drive: Tensor) -> Tensor:
    """∂/∂drive of Σ (m₁ − a m₂)²/σ², leader and rival with the best gain a; (modulator, y, x)."""
    drive = drive.clone().requires_grad_(True)
    captures = prediction.captures
    shown = ShownPatterns(drive, () if captures.chain is None else captures.slm_names)
    predictor = belief.context.predictor.counted(captures=captures, extra_effects=[shown], cache_mb=1)
    weight = torch.from_numpy(prediction.weight[0]) * float(prediction.scale[0, 0, 0])
    index, on = np.array([0]), {ShownPatterns.id: {"on": 1.0}}
    m, n = (
        weight * without_border(predictor(index, {**values, **on}, grad=True).signal[0].double())  # type: ignore[arg-type]
        for values in (belief.leader.values, rival)
    )
    gain = (m * n).sum() / (n * n).sum().clamp_min(1e-300)
    (slope,) = torch.autograd.grad((m - gain * n).square().sum(), drive)
    return slope


def _refitted(leading: Response, other: Response, rival: Hypothesis) -> Values:
    """Values of the rival, fitted to first order to the leader's prediction; an open one's at one standard deviation.

    leading, other: the proposal as leader and rival predict it. Of an open rival the direction that it shows best.
    """
    spreads = other.spreads
    if not len(rival.free):
        return rival.values
    if rival.is_open:
        along = np.linalg.eigh(spreads @ spreads.T)[1][:, -1]
    else:
        normal = np.eye(len(spreads)) + spreads @ spreads.T
        along = np.linalg.solve(normal, spreads @ (leading.picture - other.picture))
    x = rival.free.pack(rival.values) + rival.root @ along
    bounds = rival.free.bounds()
    return rival.free.unpack(bounds.clip(x), rival.values)


def _as_levels(drive: NDArray[np.float64], levels: Levels, taken: Captures) -> Levels:
    """Levels of a drive. A drive of the modulators' middle replaces the middle of the proposal's levels."""
    result = levels.copy()
    rows, columns = central_slices(levels.shape[1:], (drive.shape[1], drive.shape[2]))
    for own, pattern, slm in zip(result, drive, taken.slms, strict=True):
        own[rows, columns] = slm.levels_of(pattern)
    return result
