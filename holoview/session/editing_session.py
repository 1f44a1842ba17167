"""The one place where a bench, its patterns and the way they are looked at are edited, from a window or a notebook.

Every edit has a label and can be undone. One thread owns the session; workers hand it what they have through `poll`,
and `wake` tells the owner, from any thread, that there is something to poll.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from time import monotonic, sleep, time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.model.system import System
from holoview.session.call_queue import CallQueue
from holoview.session.changes import CHANGE_KINDS, Change, Listeners, changed_kinds
from holoview.session.document import Document, Drive, is_same_document
from holoview.session.history import History, HistoryStep
from holoview.session.jobs import JobManager
from holoview.session.messages import MessageLog
from holoview.session.scene import Scene, resolve_scene
from holoview.session.target_builder import TargetBuilder
from holoview.session.target_spec import TargetSpec
from holoview.session.view_settings import NOW, ComparisonSide, ViewSettings
from holoview.util.errors import UserError
from holoview.view import random_drive

_KEPT_BY_UNDO = ("zoom", "centre")
"""Fields of the look that undo leaves alone."""


class EditingSession:
    """A document with undo, background jobs, snapshots to compare with, and messages to the user.

    drive (frame, modulator, y, x) in 0…1; random patterns of `seed` when None. `wake` is called from any thread.
    Raises UserError when the drive or the look doesn't fit the system.
    """

    def __init__(
        self,
        system: System,
        drive: NDArray[np.floating] | None = None,
        *,
        seed: int = 0,
        target_spec: TargetSpec | None = None,
        view_settings: ViewSettings | None = None,
        origin: str = "",
        wake: Callable[[], None] = lambda: None,
    ) -> None:
        patterns = random_drive(system, seed) if drive is None else drive
        origin = origin or ("random patterns" if drive is None else "patterns given")
        view_settings = view_settings or ViewSettings(plane_m=middle_plane(system))
        state = Document(system, np.asarray(patterns, dtype=np.float32), view_settings, target_spec, origin)
        self._set_up(History(HistoryStep("Start", state, time())), {}, wake)

    @classmethod
    def from_history(
        cls, history: History, snapshots: Mapping[str, Document], wake: Callable[[], None] = lambda: None
    ) -> EditingSession:
        """A session as it was saved."""
        session = cls.__new__(cls)
        session._set_up(history, snapshots, wake)
        return session

    def _set_up(self, history: History, snapshots: Mapping[str, Document], wake: Callable[[], None]) -> None:
        self.wake, self.version = wake, 0
        self._history, self._snapshots = history, dict(snapshots)
        self._inbox, self._listeners = CallQueue(), Listeners()
        self._preview: tuple[Document, Document] | None = None
        self.messages = MessageLog(lambda: self._notify("messages"))
        self.jobs = JobManager(self.call_on_owner, self._wake, self.messages.post_error)
        self.target_builder = TargetBuilder(
            self.call_on_owner, lambda: self._notify("target"), self.messages.post_error
        )

    # --- the document -----------------------------------------------------------------------------------------------

    @property
    def document(self) -> Document:
        """The document as it was last edited."""
        return self._history.present

    @property
    def system(self) -> System:
        """The bench."""
        return self.document.system

    @property
    def drive(self) -> Drive:
        """The patterns."""
        return self.document.drive

    @property
    def view_settings(self) -> ViewSettings:
        """The way it is looked at."""
        return self.document.view_settings

    @property
    def target_spec(self) -> TargetSpec | None:
        """The target's recipe."""
        return self.document.target_spec

    @property
    def displayed_document(self) -> Document:
        """What is to be drawn: the document, lasers soloed and muted, with what a running optimisation has found."""
        state = self.document
        if self._preview is not None:
            begun, preview = self._preview
            if state.system == begun.system and state.drive is begun.drive:
                state = replace(state, system=preview.system, drive=preview.drive)
        lit = state.lit_system
        return state if lit is state.system else replace(state, system=lit)

    @property
    def preview_document(self) -> Document | None:
        """What a running optimisation has found so far."""
        return None if self._preview is None else self._preview[1]

    def set_preview(self, begun: Document | None, found: Document | None = None) -> None:
        """Shows `found` in place of `begun` for as long as the document is still that; None ends it."""
        self._preview = None if begun is None or found is None else (begun, found)
        self._notify("drive", "system")

    def edit(self, label: str, *, merge_key: Hashable = None, undoable: bool = True, **changes: Any) -> None:
        """Changes `system`, `drive`, `look`, `wanted`, `origin` or `path` of the document, in one step of undo.

        Edits with the same `merge` that follow each other within a second are one step. Raises UserError when the
        result is impossible; then nothing has changed. An edit that changes nothing is no step.
        """
        before = self.document
        after = before.with_changes(changes)
        if is_same_document(before, after):
            return
        if undoable:
            self._history.add(label, after, merge_key)
        else:
            self._history.amend(after)
        self._notify(*changed_kinds(before, after), "history")

    def change(self, label: str, changes: Mapping[str, Any], merge_key: Hashable = None) -> None:
        """Edits keys of the bench as `System.edit` does, e.g. {"gap": 3e-3, "relay2.iris_na": 0.02}."""
        self.edit(label, system=self.system.edit(changes), merge_key=merge_key)

    def edit_view(self, label: str, *, merge_key: Hashable = None, undoable: bool = True, **fields: Any) -> None:
        """Changes fields of the look, e.g. edit_view("Exposure", merge_key="exposure", exposure_stops=1.0)."""
        self.edit(label, view_settings=self.view_settings.with_(**fields), merge_key=merge_key, undoable=undoable)

    def end_gesture(self) -> None:
        """The hand has let go: the next edit is a step of its own, whatever its merge key."""
        self._history.end_gesture()

    # --- undo -------------------------------------------------------------------------------------------------------

    @property
    def history(self) -> tuple[HistoryStep, ...]:
        """All steps, undone ones included."""
        return tuple(self._history.steps)

    @property
    def history_position(self) -> int:
        """Index of the present step."""
        return self._history.position

    @property
    def can_undo(self) -> bool:
        """Whether there is something to undo."""
        return self.history_position > 0

    @property
    def can_redo(self) -> bool:
        """Whether there is something to redo."""
        return self.history_position < len(self._history.steps) - 1

    def undo(self) -> str | None:
        """Takes back the last edit and returns its label, or None when there is none."""
        if not self.can_undo:
            return None
        label = self._history.steps[self.history_position].label
        self.go_to_step(self.history_position - 1)
        return label

    def redo(self) -> str | None:
        """Makes the edit again that was last undone and returns its label, or None when there is none."""
        if not self.can_redo:
            return None
        self.go_to_step(self.history_position + 1)
        return self._history.steps[self.history_position].label

    def go_to_step(self, position: int) -> None:
        """Makes a step of the history the present; zoom stays."""
        before = self.document
        self._history.go_to(position)
        stays = {key: getattr(before.view_settings, key) for key in _KEPT_BY_UNDO}
        self._history.amend(replace(self.document, view_settings=self.view_settings.with_(**stays)))
        self._notify(*changed_kinds(before, self.document), "history")

    def load_history(self, history: History, snapshots: Mapping[str, Document]) -> None:
        """Becomes a session that was saved; listeners stay, jobs are cancelled."""
        self.jobs.cancel_all()
        self._preview, self._history, self._snapshots = None, history, dict(snapshots)
        self._notify(*CHANGE_KINDS)

    # --- sides of a comparison --------------------------------------------------------------------------------------

    @property
    def snapshots(self) -> Mapping[str, Document]:
        """Pinned states by name, oldest first."""
        return dict(self._snapshots)

    def pin(self, name: str = "", state: Document | None = None) -> str:
        """Keeps a state (the present when None) to compare with, and returns its name; the same name replaces."""
        name = name or next(f"Snapshot {n}" for n in range(1, 10_000) if f"Snapshot {n}" not in self._snapshots)
        self._snapshots[name] = state or self.document
        self._notify("snapshots")
        return name

    def unpin(self, name: str) -> None:
        """Forgets a snapshot; a comparison with it becomes one with the present."""
        if self._snapshots.pop(name, None) is not None:
            self._replace_side(ComparisonSide("snapshot", name), NOW)

    def rename_snapshot(self, name: str, to: str) -> None:
        """Gives a snapshot another name, by which every step knows it. Raises UserError when that is taken or empty."""
        if not to or to in self._snapshots:
            raise UserError("snapshot", f'"{to}"', expected="a name that isn't taken")
        self._snapshots = {to if key == name else key: state for key, state in self._snapshots.items()}
        self._replace_side(ComparisonSide("snapshot", name), ComparisonSide("snapshot", to))

    def _replace_side(self, old: ComparisonSide, new: ComparisonSide) -> None:
        """Looks at another side in the place of one in all steps, as snapshots come and go without undo."""
        self._history.amend_all(
            lambda state: replace(state, view_settings=state.view_settings.with_side_replaced(old, new))
        )
        self._notify("look", "history", "snapshots")

    def scene_for(self, side: ComparisonSide) -> Scene | None:
        """What to render for a side: see `scene_of`."""
        return resolve_scene(side, self.displayed_document, self._snapshots)

    def target_at(self, plane_m: float | None = None) -> NDArray[np.float32] | None:
        """The target (y, x, 3) at a plane (that of the look), linear sRGB; None: none, or it is being built."""
        return self.target_builder.get(self.document, self.view_settings.plane_m if plane_m is None else plane_m)

    # --- threads and listeners --------------------------------------------------------------------------------------

    def call_on_owner(self, call: Callable[[], None]) -> None:
        """From any thread: has the owner make a call at its next poll."""
        self._inbox.put(call)
        self._wake()

    def poll(self) -> None:
        """Makes the calls that workers delivered. One that fails becomes a message; the rest are still made."""
        for call in self._inbox.drain():
            with self.report_errors():
                call()
            self._notify("jobs")

    def wait_until_idle(self, timeout_s: float = 60.0) -> bool:
        """Polls until no job runs and no target is being built; whether that was so in time. For notebooks, tests."""
        until = monotonic() + timeout_s
        while monotonic() < until:
            self.poll()
            busy = [job for job in self.jobs.active if job.status == "running"]
            if not busy and not self.target_builder.is_building and self._inbox.is_empty:
                return True
            sleep(0.01)
        return False

    @contextmanager
    def report_errors(self, where: str = "") -> Iterator[None]:
        """An exception inside becomes a message: nothing is lost and the front end goes on."""
        try:
            yield
        except Exception as error:  # told to the user, whatever it is
            self.messages.post_error(error, where)

    def add_listener(self, listener: Callable[[Change], None]) -> Callable[[], None]:
        """Calls `listener` on the owner's thread after every change; the returned function ends it."""
        return self._listeners.add(listener)

    def close(self) -> None:
        """Ends jobs and threads."""
        self.jobs.close()
        self.target_builder.close()

    def _wake(self) -> None:
        self.wake()

    def _notify(self, *kinds: str) -> None:
        if kinds:
            self.version += 1
        self._listeners.notify(*kinds)


def middle_plane(system: System) -> float:
    """The focal plane that is looked at first."""
    return float(np.sort(system.planes_m)[len(system.planes_m) // 2])
