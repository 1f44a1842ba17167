"""Which parts of a session have changed, and the listeners that are notified."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from holoview.document.document import Document

CHANGE_KINDS = ("system", "drive", "look", "target", "jobs", "messages", "snapshots", "history", "choices")


@dataclass(frozen=True)
class Change:
    """A change of a session; `kinds` are those of CHANGE_KINDS that may have changed."""

    kinds: frozenset[str]


class Listeners:
    """Functions that are called after each change, on the thread that makes it."""

    def __init__(self) -> None:
        self._all: list[Callable[[Change], None]] = []

    def add(self, listener: Callable[[Change], None]) -> Callable[[], None]:
        """Calls `listener` after each change; the returned function removes it."""
        self._all.append(listener)
        return lambda: self._all.remove(listener)

    def notify(self, *kinds: str) -> None:
        """Calls all listeners with a change of these kinds."""
        for listener in list(self._all):
            listener(Change(frozenset(kinds)))


def changed_kinds(before: Document, after: Document) -> list[str]:
    """The kinds of CHANGE_KINDS in which two documents differ; a changed system also changes the target's geometry."""
    kinds = []
    if before.system != after.system:
        kinds += ["system", "target"]
    if before.drive is not after.drive or before.origin != after.origin or before.path != after.path:
        kinds.append("drive")
    if before.target_spec is not after.target_spec:
        kinds.append("target")
    if before.view_settings != after.view_settings:
        kinds.append("look")
    return kinds
