"""A proposal's patterns improved by gradient: their separation of two hypotheses rises, step by step.

The separation is Σ (m₁ − a m₂)²/σ² with the rival at its most likely values, refitted to first order to the proposal,
and the gain a that suits best. At the refitted values its derivative by them vanishes, so that the gradient by the
pattern is that of a fixed rival.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.captures.records.central_region import central_slices
from holoview.diagnose.likelihood import PredictorProtocol, Values
from holoview.experiment.next_capture.hypotheses import Belief, Hypothesis
from holoview.experiment.next_capture.proposal_prediction import ProposalPrediction, without_border
from holoview.experiment.next_capture.proposals import Proposal
from holoview.model.effects.effect import Effect
from holoview.model.effects.hook_contexts import ModulatorContext
from holoview.model.effects.parameter import Parameter
from holoview.model.effects.parameter import Values as ParameterValues
from holoview.rig.devices import Levels
from holoview.rig.limits import SafetyLimits

Tensor = torch.Tensor

_STEPS = 6
_STEP = 0.06  # of the stroke, r.m.s.


class ShownPatterns(Effect):
    """Patterns that gradients reach, in place of those that a capture's record says. patterns: (modulator, y, x)."""

    id = "shown_patterns"
    cause = "Patterns are held by a tensor."
    finding = "Patterns are held by a tensor."
    parameters = (Parameter("on", "1: the patterns are shown."),)
    acts_on = ("modulator 1", "modulator 2")
    order = -100
    listed = False

    def __init__(self, patterns: Tensor) -> None:
        self.patterns = patterns

    def stroke_response(self, share: Tensor, context: ModulatorContext, v: ParameterValues) -> Tensor:
        return self.patterns[context.number].to(share.dtype)


def improve_pattern(
    belief: Belief, taken: Captures, proposal: Proposal, rival: Hypothesis, limits: SafetyLimits
) -> Levels:
    """Levels (modulator, y, x) that separate the leader from the rival better, or those of the proposal."""
    prediction = ProposalPrediction(belief, taken, [proposal], limits)
    other = _refitted(prediction, belief.leader, rival)
    drive = torch.from_numpy(prediction.captures.drive(0)).requires_grad_(True)
    shown = ShownPatterns(drive)
    predictor = belief.context.predictor.create(captures=prediction.captures, extra_effects=[shown], cache_mb=1)
    weight = torch.from_numpy(prediction.weight[0])
    best, best_separation = drive.detach().clone(), -1.0
    for _ in range(_STEPS + 1):
        separation = _separation(predictor, belief.leader.values, other, weight, float(prediction.scale[0, 0, 0]))
        if separation.item() > best_separation:
            best, best_separation = drive.detach().clone(), separation.item()
        (slope,) = torch.autograd.grad(separation, drive)
        rms = slope.square().mean().sqrt()
        if not rms.item() > 0:
            break
        with torch.no_grad():
            drive.add_(slope, alpha=_STEP / rms.item()).clamp_(0.0, 1.0)
    return _as_levels(best.numpy(), proposal.levels, taken)


def _separation(predictor: PredictorProtocol, first: Values, second: Values, weight: Tensor, scale: float) -> Tensor:
    """Σ (m₁ − a m₂)²/σ² with the best gain a. scale: counts per unit of signal."""
    index, on = np.array([0]), {ShownPatterns.id: {"on": 1.0}}
    m, n = (
        weight * scale * without_border(predictor(index, {**values, **on}, grad=True).signal[0].double())  # type: ignore[arg-type]
        for values in (first, second)
    )
    gain = (m * n).sum() / (n * n).sum().clamp_min(1e-300)
    return (m - gain * n).square().sum()


def _refitted(prediction: ProposalPrediction, leader: Hypothesis, rival: Hypothesis) -> Values:
    """Values of the rival, fitted to first order to what the leader predicts; an open one's at one standard deviation.

    Of an open rival the direction that the proposal shows best.
    """
    ((first, second),) = prediction.responses([leader, rival])
    spreads = second.spreads
    if not len(rival.free):
        return rival.values
    if rival.is_open:
        along = np.linalg.eigh(spreads @ spreads.T)[1][:, -1]
    else:
        normal = np.eye(len(spreads)) + spreads @ spreads.T
        along = np.linalg.solve(normal, spreads @ (first.picture - second.picture))
    x = rival.free.pack(rival.values) + rival.root @ along
    bounds = rival.free.bounds()
    return rival.free.unpack(bounds.clip(x), rival.values)


def _as_levels(drive: NDArray[np.float64], levels: Levels, taken: Captures) -> Levels:
    """Levels of the patterns, in the middle of those of the proposal where they are its middle."""
    result = levels.copy()
    rows, columns = central_slices(levels.shape[1:], (drive.shape[1], drive.shape[2]))
    for own, pattern, slm in zip(result, drive, taken.slms, strict=True):
        own[rows, columns] = np.rint(pattern * (slm.num_levels - 1))
    return result
