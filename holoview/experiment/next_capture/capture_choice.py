"""The next capture: of many proposals the one that promises most information in a second, improved by gradient."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from holoview.captures.dataset import Captures
from holoview.experiment.next_capture.bench_time import BenchTime
from holoview.experiment.next_capture.hypotheses import Belief, Hypothesis
from holoview.experiment.next_capture.pattern_ascent import improve_pattern
from holoview.experiment.next_capture.proposal_prediction import ProposalPrediction
from holoview.experiment.next_capture.proposals import Proposal
from holoview.experiment.next_capture.separation import Response, expected_information, pairwise_delta_chi2
from holoview.rig.limits import SafetyLimits

MIN_INFORMATION = 1e-3
"""nats; a capture that promises less tells nothing."""

_MAX_HYPOTHESES = 6


@dataclass(frozen=True)
class Choice:
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

    def choose(self, proposals: Sequence[Proposal]) -> Choice:
        """The best of the proposals, with its patterns improved by gradient where that helps."""
        best, rival = self._best_of(proposals)
        if not best.promises_something or rival is None:
            return best
        levels = improve_pattern(self._belief, self._taken, best.proposal, rival, self._limits)
        words = f"{best.proposal.words}, improved by gradient"
        better, _ = self._best_of([replace(best.proposal, levels=levels, words=words)])
        return better if better.rate >= best.rate and better.delta_chi2 > best.delta_chi2 else best

    def _best_of(self, proposals: Sequence[Proposal]) -> tuple[Choice, Hypothesis | None]:
        """The proposal of most information per second, and the rival that it separates."""
        prediction = ProposalPrediction(self._belief, self._taken, proposals, self._limits)
        found = []
        for k, responses in enumerate(prediction.responses(self._hypotheses)):
            proposal = prediction.proposals[k]
            exposure_s = float(prediction.captures.exposure_s[k])
            seconds = self._time.expect(proposal.distance_m - self._here_m, exposure_s)
            found.append(self._judge(proposal, responses, seconds))
        return max(found, key=lambda one: (one[0].rate, one[0].delta_chi2 / one[0].seconds))

    def _judge(
        self, proposal: Proposal, responses: Sequence[Response], seconds: float
    ) -> tuple[Choice, Hypothesis | None]:
        """A proposal as a choice, and the rival for which it would be taken."""
        deltas = pairwise_delta_chi2(responses)
        information = expected_information(self._p, deltas)
        if len(self._hypotheses) < 2:
            return Choice(proposal, "", information, seconds), None
        number = 1 + int(np.argmax(self._p[1:] * -np.expm1(-deltas[0, 1:] / 8.0)))
        delta, rival = float(deltas[0, number]), self._hypotheses[number]
        reason = f"{_purpose(self._hypotheses[0], rival)} (expected Δχ² {delta:.3g} in {seconds:.2g} s)"
        return Choice(proposal, reason, information, seconds, delta), rival


def _purpose(leader: Hypothesis, rival: Hypothesis) -> str:
    """What a capture is for, in words."""
    if not rival.is_open:
        return f"separates {leader.name} from {rival.name}"
    beside = f" beside {leader.name}" if leader.causes else ""
    return f"shows whether there is {rival.causes[-1]}{beside}"
