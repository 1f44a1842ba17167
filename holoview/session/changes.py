"""What has changed about a session, and who is told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from holoview.session.document import Document

CHANGE_KINDS = ("system", "drive", "look", "target", "jobs", "messages", "snapshots", "history")


@dataclass(frozen=True)
class Change:
    """What listeners are told: which of KINDS may have changed."""

    kinds: frozenset[str]


class Listeners:
    """Those who are told of changes, on the thread that makes them."""

    def __init__(self) -> None:
        self._all: list[Callable[[Change], None]] = []

    def add(self, listener: Callable[[Change], None]) -> Callable[[], None]:
        """Calls `listener` after every change; the returned function ends it."""
        self._all.append(listener)
        return lambda: self._all.remove(listener)

    def notify(self, *kinds: str) -> None:
        """Tells all of them."""
        for listener in list(self._all):
            listener(Change(frozenset(kinds)))


def changed_kinds(before: Document, after: Document) -> list[str]:
    """Which kinds an edit of the document has changed."""
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
