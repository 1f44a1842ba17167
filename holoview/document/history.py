"""Undo and redo as a list of documents, each with the label of the edit that led to it."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace

from holoview.document.document import Document

MAX_STEPS = 300
MAX_BYTES = 1 << 30
MERGE_WITHIN_S = 1.0
"""Edits with the same merge key become one step if they follow each other within this time."""


@dataclass(frozen=True, eq=False)
class HistoryStep:
    """A document, the label of the edit that led to it, and when it was made, as `time.time`."""

    label: str
    document: Document
    when: float
    merge_key: Hashable = None


class History:
    """The steps up to the present one and those that were undone.

    The oldest steps are dropped beyond MAX_STEPS steps or MAX_BYTES of patterns.
    """

    def __init__(self, first: HistoryStep, clock: Callable[[], float] = time.time) -> None:
        self.steps: list[HistoryStep] = [first]
        self.position = 0
        self._clock = clock

    @classmethod
    def from_steps(cls, steps: list[HistoryStep], position: int, clock: Callable[[], float] = time.time) -> History:
        """A history of saved steps; `position` is the index of the present one."""
        history = cls(steps[0], clock)
        history.steps, history.position = list(steps), position
        history.end_gesture()
        return history

    @property
    def present(self) -> Document:
        """The document at the present step."""
        return self.steps[self.position].document

    def add(self, label: str, document: Document, merge_key: Hashable = None) -> None:
        """Adds a step, or merges it into the present one; undone steps are dropped."""
        now, last = self._clock(), self.steps[self.position]
        merges = merge_key is not None and merge_key == last.merge_key and now - last.when <= MERGE_WITHIN_S
        del self.steps[self.position + 1 :]
        if merges and self.position > 0:
            self.steps[self.position] = HistoryStep(label, document, now, merge_key)
        else:
            self.steps.append(HistoryStep(label, document, now, merge_key))
        self.position = len(self.steps) - 1
        self._drop_oldest()

    def amend(self, document: Document) -> None:
        """Replaces the document of the present step, for changes that aren't undone separately."""
        self.steps[self.position] = replace(self.steps[self.position], document=document)

    def amend_all(self, change: Callable[[Document], Document]) -> None:
        """Applies a change to the documents of all steps, including undone ones."""
        self.steps = [replace(step, document=change(step.document)) for step in self.steps]

    def end_gesture(self) -> None:
        """Ends a drag: the next edit is a separate step."""
        self.steps[self.position] = replace(self.steps[self.position], merge_key=None)

    def go_to(self, position: int) -> None:
        """Makes the step of that index the present one. Raises IndexError when there is none."""
        if not 0 <= position < len(self.steps):
            raise IndexError(f"step {position} of {len(self.steps)}")
        self.end_gesture()
        self.position = position

    def _drop_oldest(self) -> None:
        while len(self.steps) > 1 and (len(self.steps) > MAX_STEPS or self._bytes() > MAX_BYTES):
            if self.position == 0:
                self.steps.pop()
            else:
                self.steps.pop(0)
                self.position -= 1

    def _bytes(self) -> int:
        drives = {id(step.document.drive): step.document.drive.nbytes for step in self.steps}
        return sum(drives.values())
