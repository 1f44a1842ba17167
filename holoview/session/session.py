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

from holoview.errors import UserError
from holoview.session.changes import KINDS, Change, Listeners, kinds_between
from holoview.session.history import History, Step
from holoview.session.inbox import Inbox
from holoview.session.jobs import Jobs
from holoview.session.look import NOW, Look, Side
from holoview.session.messages import Messages
from holoview.session.scene import Scene, scene_of
from holoview.session.state import Drive, State, is_same
from holoview.session.wanted import Targets, Wanted
from holoview.system import System
from holoview.view import random_drive

_STAYS = ("zoom", "centre")
"""Fields of the look that undo leaves alone."""


class Session:
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
        wanted: Wanted | None = None,
        look: Look | None = None,
        origin: str = "",
        wake: Callable[[], None] = lambda: None,
    ) -> None:
        patterns = random_drive(system, seed) if drive is None else drive
        origin = origin or ("random patterns" if drive is None else "patterns given")
        look = look or Look(plane_m=middle_plane(system))
        state = State(system, np.asarray(patterns, dtype=np.float32), look, wanted, origin)
        self._begin(History(Step("Start", state, time())), {}, wake)

    @classmethod
    def restored(
        cls, history: History, snapshots: Mapping[str, State], wake: Callable[[], None] = lambda: None
    ) -> Session:
        """A session as it was saved."""
        session = cls.__new__(cls)
        session._begin(history, snapshots, wake)
        return session

    def _begin(self, history: History, snapshots: Mapping[str, State], wake: Callable[[], None]) -> None:
        self.wake, self.version = wake, 0
        self._history, self._snapshots = history, dict(snapshots)
        self._inbox, self._listeners = Inbox(), Listeners()
        self._preview: tuple[State, State] | None = None
        self.messages = Messages(lambda: self._tell("messages"))
        self.jobs = Jobs(self.deliver, self._wake, self.messages.post_error)
        self.targets = Targets(self.deliver, lambda: self._tell("target"), self.messages.post_error)

    # --- the document -----------------------------------------------------------------------------------------------

    @property
    def state(self) -> State:
        """The document as it was last edited."""
        return self._history.present

    @property
    def system(self) -> System:
        """The bench."""
        return self.state.system

    @property
    def drive(self) -> Drive:
        """The patterns."""
        return self.state.drive

    @property
    def look(self) -> Look:
        """The way it is looked at."""
        return self.state.look

    @property
    def wanted(self) -> Wanted | None:
        """The target's recipe."""
        return self.state.wanted

    @property
    def shown(self) -> State:
        """What is to be drawn: the document, lasers soloed and muted, with what a running optimisation has found."""
        state = self.state
        if self._preview is not None:
            begun, preview = self._preview
            if state.system == begun.system and state.drive is begun.drive:
                state = replace(state, system=preview.system, drive=preview.drive)
        lit = state.lit_system
        return state if lit is state.system else replace(state, system=lit)

    @property
    def found(self) -> State | None:
        """What a running optimisation has found so far."""
        return None if self._preview is None else self._preview[1]

    def preview(self, begun: State | None, found: State | None = None) -> None:
        """Shows `found` in place of `begun` for as long as the document is still that; None ends it."""
        self._preview = None if begun is None or found is None else (begun, found)
        self._tell("drive", "system")

    def edit(self, label: str, *, merge: Hashable = None, undoable: bool = True, **changes: Any) -> None:
        """Changes `system`, `drive`, `look`, `wanted`, `origin` or `path` of the document, in one step of undo.

        Edits with the same `merge` that follow each other within a second are one step. Raises UserError when the
        result is impossible; then nothing has changed. An edit that changes nothing is no step.
        """
        before = self.state
        after = before.edited(changes)
        if is_same(before, after):
            return
        if undoable:
            self._history.add(label, after, merge)
        else:
            self._history.amend(after)
        self._tell(*kinds_between(before, after), "history")

    def change(self, label: str, changes: Mapping[str, Any], merge: Hashable = None) -> None:
        """Edits keys of the bench as `System.edit` does, e.g. {"gap": 3e-3, "relay2.iris_na": 0.02}."""
        self.edit(label, system=self.system.edit(changes), merge=merge)

    def look_at(self, label: str, *, merge: Hashable = None, undoable: bool = True, **fields: Any) -> None:
        """Changes fields of the look, e.g. look_at("Exposure", merge="exposure", exposure_stops=1.0)."""
        self.edit(label, look=self.look.with_(**fields), merge=merge, undoable=undoable)

    def settle(self) -> None:
        """The hand has let go: the next edit is a step of its own, whatever its merge key."""
        self._history.settle()

    # --- undo -------------------------------------------------------------------------------------------------------

    @property
    def history(self) -> tuple[Step, ...]:
        """All steps, undone ones included."""
        return tuple(self._history.steps)

    @property
    def position(self) -> int:
        """Index of the present step."""
        return self._history.position

    @property
    def can_undo(self) -> bool:
        """Whether there is something to undo."""
        return self.position > 0

    @property
    def can_redo(self) -> bool:
        """Whether there is something to redo."""
        return self.position < len(self._history.steps) - 1

    def undo(self) -> str | None:
        """Takes back the last edit and returns its label, or None when there is none."""
        if not self.can_undo:
            return None
        label = self._history.steps[self.position].label
        self.go_to(self.position - 1)
        return label

    def redo(self) -> str | None:
        """Makes the edit again that was last undone and returns its label, or None when there is none."""
        if not self.can_redo:
            return None
        self.go_to(self.position + 1)
        return self._history.steps[self.position].label

    def go_to(self, position: int) -> None:
        """Makes a step of the history the present; zoom stays."""
        before = self.state
        self._history.go_to(position)
        stays = {key: getattr(before.look, key) for key in _STAYS}
        self._history.amend(replace(self.state, look=self.look.with_(**stays)))
        self._tell(*kinds_between(before, self.state), "history")

    def adopt(self, history: History, snapshots: Mapping[str, State]) -> None:
        """Becomes a session that was saved; listeners stay, jobs are cancelled."""
        self.jobs.cancel_all()
        self._preview, self._history, self._snapshots = None, history, dict(snapshots)
        self._tell(*KINDS)

    # --- sides of a comparison --------------------------------------------------------------------------------------

    @property
    def snapshots(self) -> Mapping[str, State]:
        """Pinned states by name, oldest first."""
        return dict(self._snapshots)

    def pin(self, name: str = "", state: State | None = None) -> str:
        """Keeps a state (the present when None) to compare with, and returns its name; the same name replaces."""
        name = name or next(f"Snapshot {n}" for n in range(1, 10_000) if f"Snapshot {n}" not in self._snapshots)
        self._snapshots[name] = state or self.state
        self._tell("snapshots")
        return name

    def unpin(self, name: str) -> None:
        """Forgets a snapshot; a comparison with it becomes one with the present."""
        if self._snapshots.pop(name, None) is not None:
            self._replace_side(Side("snapshot", name), NOW)

    def rename(self, name: str, to: str) -> None:
        """Gives a snapshot another name, by which every step knows it. Raises UserError when that is taken or empty."""
        if not to or to in self._snapshots:
            raise UserError("snapshot", f'"{to}"', expected="a name that isn't taken")
        self._snapshots = {to if key == name else key: state for key, state in self._snapshots.items()}
        self._replace_side(Side("snapshot", name), Side("snapshot", to))

    def _replace_side(self, old: Side, new: Side) -> None:
        """Looks at another side in the place of one in all steps, as snapshots come and go without undo."""
        self._history.amend_all(lambda state: replace(state, look=state.look.with_side(old, new)))
        self._tell("look", "history", "snapshots")

    def scene(self, side: Side) -> Scene | None:
        """What to render for a side: see `scene_of`."""
        return scene_of(side, self.shown, self._snapshots)

    def target_at(self, plane_m: float | None = None) -> NDArray[np.float32] | None:
        """The target (y, x, 3) at a plane (that of the look), linear sRGB; None: none, or it is being built."""
        return self.targets.at(self.state, self.look.plane_m if plane_m is None else plane_m)

    # --- threads and listeners --------------------------------------------------------------------------------------

    def deliver(self, call: Callable[[], None]) -> None:
        """From any thread: has the owner make a call at its next poll."""
        self._inbox.put(call)
        self._wake()

    def poll(self) -> None:
        """Makes the calls that workers delivered. One that fails becomes a message; the rest are still made."""
        for call in self._inbox.taken():
            with self.guard():
                call()
            self._tell("jobs")

    def wait(self, timeout_s: float = 60.0) -> bool:
        """Polls until no job runs and no target is being built; whether that was so in time. For notebooks, tests."""
        until = monotonic() + timeout_s
        while monotonic() < until:
            self.poll()
            busy = [job for job in self.jobs.active if job.status == "running"]
            if not busy and not self.targets.is_building and self._inbox.is_empty:
                return True
            sleep(0.01)
        return False

    @contextmanager
    def guard(self, where: str = "") -> Iterator[None]:
        """An exception inside becomes a message: nothing is lost and the front end goes on."""
        try:
            yield
        except Exception as error:  # told to the user, whatever it is
            self.messages.post_error(error, where)

    def listen(self, listener: Callable[[Change], None]) -> Callable[[], None]:
        """Calls `listener` on the owner's thread after every change; the returned function ends it."""
        return self._listeners.add(listener)

    def close(self) -> None:
        """Ends jobs and threads."""
        self.jobs.close()
        self.targets.close()

    def _wake(self) -> None:
        self.wake()

    def _tell(self, *kinds: str) -> None:
        if kinds:
            self.version += 1
        self._listeners.tell(*kinds)


def middle_plane(system: System) -> float:
    """The focal plane that is looked at first."""
    return float(np.sort(system.planes_m)[len(system.planes_m) // 2])
