"""Who chooses the next capture of a loop: the information that it promises, chance, or a plan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from holoview.captures.dataset import Captures
from holoview.experiment.next_capture.bench_time import BenchTime
from holoview.experiment.next_capture.capture_choice import CaptureChooser, Choice
from holoview.experiment.next_capture.hypotheses import Belief
from holoview.experiment.next_capture.proposals import START_COUNT, Proposal, draw_proposals, starting_proposals
from holoview.rig.description import RigDescription
from holoview.rig.measure.capture_plan import default_plan

_PROPOSALS = 20
_SPREAD = "no capture on offer promises to separate what is left; more of all kinds to be judged by"


@dataclass(frozen=True)
class LoopState:
    """What a planner knows. taken: the captures so far, None before the first. count: how many.

    belief: what they say; None while there are too few. here_m: where the stage is. time: of captures on this bench.
    """

    taken: Captures | None
    count: int
    belief: Belief | None
    here_m: float
    time: BenchTime


class Planner(Protocol):
    """Chooses the next capture."""

    def next(self, state: LoopState) -> Choice | None:
        """The next capture; None where there is no further one."""


class InformedPlanner:
    """A few captures to begin with, then those that promise most information per second."""

    def __init__(self, rig: RigDescription, seed: int = 0) -> None:
        self._rig, self._rng = rig, np.random.default_rng((seed, 1))
        self._start = starting_proposals(rig, seed)

    def next(self, state: LoopState) -> Choice | None:
        """One of the captures to begin with, or the best of random proposals."""
        if state.count < START_COUNT:
            return Choice(self._start[state.count], f"one of {START_COUNT} to begin with")
        proposals = draw_proposals(self._rig, self._rng, _PROPOSALS)
        if state.belief is None or state.taken is None:
            return Choice(proposals[0], _SPREAD)
        chooser = CaptureChooser(state.belief, state.taken, self._rig.limits, state.time, state.here_m)
        choice = chooser.choose(proposals)
        return choice if choice.promises_something else Choice(self._rarest(proposals, state.taken), _SPREAD)

    def _rarest(self, proposals: list[Proposal], taken: Captures) -> Proposal:
        """The proposal whose wavelength, then whose plane, has been taken least often."""
        bright = [p for p in proposals if p.brightness == 1.0]

        def times(proposal: Proposal) -> tuple[int, int]:
            of_wavelength = int((taken.wavelength_m == proposal.wavelength_m).sum())
            return of_wavelength, int((taken.distance_m == proposal.distance_m).sum())

        return min(bright or proposals, key=times)


class RandomPlanner:
    """Captures drawn as the proposals are, whatever is known."""

    def __init__(self, rig: RigDescription, seed: int = 0) -> None:
        self._rig, self._rng = rig, np.random.default_rng((seed, 2))

    def next(self, state: LoopState) -> Choice | None:
        """A random one."""
        return Choice(draw_proposals(self._rig, self._rng, 1)[0], "drawn by chance")


class FixedPlanner:
    """The default plan of `holoview measure`, in its order."""

    def __init__(self, rig: RigDescription) -> None:
        self._rig, self._requests = rig, default_plan(rig).requests

    def next(self, state: LoopState) -> Choice | None:
        """The next one of the plan; None at its end."""
        if state.count >= len(self._requests):
            return None
        request = self._requests[state.count]
        words = f"noise blurred by {request.sigma_px:g} px"
        levels = request.levels(self._rig)
        proposal = Proposal(request.wavelength_m, request.distance_m, request.power, levels, words)
        return Choice(proposal, "next of the plan")
