"""Undo and redo: states with the label of the edit that led to each. Edits of one drag are one step."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace

from holoview.session.document import Document

MAX_STEPS = 300
MAX_BYTES = 1 << 30
MERGE_WITHIN_S = 1.0
"""Edits with the same merge key are one step while they follow each other within this time."""


@dataclass(frozen=True, eq=False)
class HistoryStep:
    """A state and the edit that led to it; `when` as `time.time` gives it."""

    label: str
    document: Document
    when: float
    merge_key: Hashable = None


class History:
    """Steps up to the present and those undone, bounded in number and in the memory of their patterns."""

    def __init__(self, first: HistoryStep, clock: Callable[[], float] = time.time) -> None:
        self.steps: list[HistoryStep] = [first]
        self.position = 0
        self._clock = clock

    @classmethod
    def from_steps(cls, steps: list[HistoryStep], position: int, clock: Callable[[], float] = time.time) -> History:
        """A history that was saved."""
        history = cls(steps[0], clock)
        history.steps, history.position = list(steps), position
        history.end_gesture()
        return history

    @property
    def present(self) -> Document:
        """The state that is current."""
        return self.steps[self.position].document

    def add(self, label: str, state: Document, merge_key: Hashable = None) -> None:
        """Makes `state` the present; what was undone is forgotten."""
        now, last = self._clock(), self.steps[self.position]
        follows = merge_key is not None and merge_key == last.merge_key and now - last.when <= MERGE_WITHIN_S
        del self.steps[self.position + 1 :]
        if follows and self.position > 0:
            self.steps[self.position] = HistoryStep(label, state, now, merge_key)
        else:
            self.steps.append(HistoryStep(label, state, now, merge_key))
        self.position = len(self.steps) - 1
        self._forget_oldest()

    def amend(self, state: Document) -> None:
        """Replaces the present without a step, for what isn't worth undoing."""
        self.steps[self.position] = replace(self.steps[self.position], document=state)

    def amend_all(self, change: Callable[[Document], Document]) -> None:
        """Replaces every state, those undone too, without a step."""
        self.steps = [replace(step, document=change(step.document)) for step in self.steps]

    def end_gesture(self) -> None:
        """Ends a drag: the next edit is a step of its own."""
        self.steps[self.position] = replace(self.steps[self.position], merge_key=None)

    def go_to(self, position: int) -> None:
        """Makes the step of that index the present."""
        if not 0 <= position < len(self.steps):
            raise IndexError(f"step {position} of {len(self.steps)}")
        self.end_gesture()
        self.position = position

    def _forget_oldest(self) -> None:
        while len(self.steps) > 1 and (len(self.steps) > MAX_STEPS or self._bytes() > MAX_BYTES):
            if self.position == 0:
                self.steps.pop()
            else:
                self.steps.pop(0)
                self.position -= 1

    def _bytes(self) -> int:
        drives = {id(step.document.drive): step.document.drive.nbytes for step in self.steps}
        return sum(drives.values())
