"""Undo and redo: states with the label of the edit that led to each. Edits of one drag are one step."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace

from holoview.session.state import State

MOST_STEPS = 300
MOST_BYTES = 1 << 30
MERGE_WITHIN_S = 1.0
"""Edits with the same merge key are one step while they follow each other within this time."""


@dataclass(frozen=True, eq=False)
class Step:
    """A state and the edit that led to it; `when` as `time.time` gives it."""

    label: str
    state: State
    when: float
    merge: Hashable = None


class History:
    """Steps up to the present and those undone, bounded in number and in the memory of their patterns."""

    def __init__(self, first: Step, clock: Callable[[], float] = time.time) -> None:
        self.steps: list[Step] = [first]
        self.position = 0
        self._clock = clock

    @classmethod
    def of(cls, steps: list[Step], position: int, clock: Callable[[], float] = time.time) -> History:
        """A history that was saved."""
        history = cls(steps[0], clock)
        history.steps, history.position = list(steps), position
        history.settle()
        return history

    @property
    def present(self) -> State:
        """The state that is current."""
        return self.steps[self.position].state

    def add(self, label: str, state: State, merge: Hashable = None) -> None:
        """Makes `state` the present; what was undone is forgotten."""
        now, last = self._clock(), self.steps[self.position]
        follows = merge is not None and merge == last.merge and now - last.when <= MERGE_WITHIN_S
        del self.steps[self.position + 1 :]
        if follows and self.position > 0:
            self.steps[self.position] = Step(label, state, now, merge)
        else:
            self.steps.append(Step(label, state, now, merge))
        self.position = len(self.steps) - 1
        self._forget_oldest()

    def amend(self, state: State) -> None:
        """Replaces the present without a step, for what isn't worth undoing."""
        self.steps[self.position] = replace(self.steps[self.position], state=state)

    def amend_all(self, change: Callable[[State], State]) -> None:
        """Replaces every state, those undone too, without a step."""
        self.steps = [replace(step, state=change(step.state)) for step in self.steps]

    def settle(self) -> None:
        """Ends a drag: the next edit is a step of its own."""
        self.steps[self.position] = replace(self.steps[self.position], merge=None)

    def go_to(self, position: int) -> None:
        """Makes the step of that index the present."""
        if not 0 <= position < len(self.steps):
            raise IndexError(f"step {position} of {len(self.steps)}")
        self.settle()
        self.position = position

    def _forget_oldest(self) -> None:
        while len(self.steps) > 1 and (len(self.steps) > MOST_STEPS or self._bytes() > MOST_BYTES):
            if self.position == 0:
                self.steps.pop()
            else:
                self.steps.pop(0)
                self.position -= 1

    def _bytes(self) -> int:
        drives = {id(step.state.drive): step.state.drive.nbytes for step in self.steps}
        return sum(drives.values())
