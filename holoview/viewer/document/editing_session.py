"""The editing session: a document with undo, background jobs and messages, for a window or a notebook.

One thread owns a session. Worker threads deliver results with `call_on_owner`; these take effect when the owner calls
`poll`. The function `wake` tells the owner, from any thread, that there is something to poll.

A user's choices for the next optimisation (`OptimisationChoices`) are saved with the session, but are no step of its
history.
"""

from __future__ import annotations

import time
import traceback
from collections import deque
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.metrics.likeness import NO_OTHERS, OtherPlanes
from holoview.holograms.optimise.eyes import OptimisedEyes
from holoview.holograms.optimise.settings import FIELD_LOSS, FIELD_LOSS_DOC, INITIAL_PATTERNS, LOSS_SPACES, Settings
from holoview.holograms.view import random_drive
from holoview.light.model import preset
from holoview.light.model.fields import Choice, Word, described_field, field_for, same_field, validate
from holoview.light.model.system import System
from holoview.util.errors import UserError, suggest_matches
from holoview.util.text import printable
from holoview.viewer.document.document import (
    Document,
    History,
    HistoryStep,
    LookHistory,
    Looks,
    is_look_alone,
    is_same_document,
    middle_plane,
)
from holoview.viewer.document.jobs import JobManager
from holoview.viewer.document.sweeper import Sweeper
from holoview.viewer.document.target_builder import TargetBuilder, TargetSpec
from holoview.viewer.render.scene import Drive, Scene
from holoview.viewer.render.view_settings import NOW, TARGET, ComparisonSide, ViewSettings

_KEPT_BY_UNDO = ("zoom", "centre")
"""Fields of the view settings that undo and redo leave unchanged."""


class EditingSession:
    """A document with undo, snapshots to compare with, background jobs, and messages to the user.

    drive: patterns (frame, modulator, y, x) in 0…1, of a chain by the names of its elements; random patterns of `seed`
    when None. wake: may be called on any thread. `version` rises with each change. save_problem: why the session isn't
    saved at present, or "". fits_exposure: whether who computes the next picture is to fit the exposure to it, as of a
    field that was opened. sweeper: what measures the points of a sweep; None where the program that opened the viewer
    gave none.

    Raises UserError when the drive doesn't fit the system.
    """

    def __init__(
        self,
        system: System,
        drive: Drive | None = None,
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
        patterns = patterns if system.is_chain else np.asarray(patterns, dtype=np.float32)
        document = Document(system, patterns, view_settings, target_spec, origin)
        self._set_up(History(HistoryStep("Start", document, time.time())), {}, wake)

    @classmethod
    def from_history(
        cls,
        history: History,
        snapshots: Mapping[str, Document],
        looks: Looks = ((), ()),
        wake: Callable[[], None] = lambda: None,
    ) -> EditingSession:
        """A session with an undo history, snapshots and looks that were saved."""
        session = cls.__new__(cls)
        session._set_up(history, snapshots, wake)
        session._looks = LookHistory(looks)
        return session

    def _set_up(self, history: History, snapshots: Mapping[str, Document], wake: Callable[[], None]) -> None:
        self.wake, self.version, self.save_problem, self.fits_exposure = wake, 0, "", False
        self.sweeper: Sweeper | None = None
        self._history, self._looks, self._snapshots = history, LookHistory(), dict(snapshots)
        self._saved = history.present if len(history.steps) == 1 else None
        self._choices = OptimisationChoices()
        self._presets: dict[Hashable, Scene] = {}
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
        """The document at the present step of the history."""
        return self._history.present

    @property
    def system(self) -> System:
        """The document's system."""
        return self.document.system

    @property
    def drive(self) -> Drive:
        """The document's patterns (frame, modulator, y, x)."""
        return self.document.drive

    @property
    def view_settings(self) -> ViewSettings:
        """The document's view settings."""
        return self.document.view_settings

    @property
    def target_spec(self) -> TargetSpec | None:
        """The document's target specification."""
        return self.document.target_spec

    def mark_saved(self) -> None:
        """States that patterns and bench are in a file as they are now."""
        self._saved = self.document

    @property
    def has_unsaved_work(self) -> bool:
        """Whether patterns or bench are others than in the file, or than at the start where there is none."""
        kept, now = self._saved, self.document
        return kept is None or kept.drive is not now.drive or kept.system != now.system

    @property
    def displayed_document(self) -> Document:
        """The document as it is displayed: solo and mute applied, with the preview of a running optimisation.

        Raises UserError when no laser is left on.
        """
        document = self.previewed_document
        lit = document.lit_system
        return document if lit is document.system else replace(document, system=lit)

    @property
    def previewed_document(self) -> Document:
        """The document with the preview of a running optimisation.

        The preview replaces the patterns only while the system and the patterns are those it was started from.
        """
        document = self.document
        if self._preview is None:
            return document
        start, preview = self._preview
        if document.system != start.system or document.drive is not start.drive:
            return document
        return replace(document, system=preview.system, drive=preview.drive, origin=preview.origin)

    @property
    def preview_document(self) -> Document | None:
        """The best result so far of a running optimisation."""
        return None if self._preview is None else self._preview[1]

    def set_preview(self, start: Document | None, preview: Document | None = None) -> None:
        """Displays `preview` in place of `start` while the document still has the patterns of `start`; None ends it."""
        self._preview = None if start is None or preview is None else (start, preview)
        self._notify("drive", "system")

    def edit(self, label: str, *, merge_key: Hashable = None, undoable: bool = True, **changes: Any) -> None:
        """Changes fields of the document (`system`, `drive`, `view_settings`, `target_spec`, …) in one step of undo.

        An edit of the look alone is no step of undo, and forgets nothing that was undone: looks have steps of their
        own (`look_back`). Edits with the same `merge_key` that follow each other within a second, or in one hold,
        become one step. An edit that is not `undoable` changes the present step. An edit without effect adds no step.
        Raises UserError when the result is impossible; then nothing has changed.
        """
        before = self.document
        after = before.with_changes(changes)
        if is_same_document(before, after):
            return
        if undoable and not is_look_alone(before, after):
            self._history.add(label, after, merge_key)
        else:
            if undoable:
                self._looks.add(label, before.view_settings, merge_key)
            self._history.amend(after)
        self._notify(*changed_kinds(before, after), "history")

    def change(self, label: str, changes: Mapping[str, Any], merge_key: Hashable = None) -> None:
        """Changes keys of the system as `System.edit` does, e.g. {"gap": 3e-3, "relay2.iris_na": 0.02}."""
        self.edit(label, system=self.system.edit(changes), merge_key=merge_key)

    def edit_view(self, label: str, *, merge_key: Hashable = None, undoable: bool = True, **fields: Any) -> None:
        """Changes fields of the view settings, e.g. `edit_view("Exposure", exposure_stops=1.0)`."""
        self.edit(label, view_settings=self.view_settings.with_(**fields), merge_key=merge_key, undoable=undoable)

    def hold(self, is_held: bool) -> None:
        """States whether a button or a key is held: the edits of one hold merge by their keys at any time."""
        self._history.hold(is_held)
        self._looks.hold(is_held)

    def end_gesture(self) -> None:
        """Ends a drag: the next edit is a separate step of undo, even with the same merge key."""
        self._history.end_gesture()
        self._looks.end_gesture()

    @property
    def optimisation_choices(self) -> OptimisationChoices:
        """The choices for the next optimisation; undo leaves them as they are."""
        return self._choices

    def choose_optimisation(self, choices: OptimisationChoices) -> None:
        """Chooses for the next optimisation."""
        if choices != self._choices:
            self._choices = choices
            self._notify("choices")

    # --- undo -------------------------------------------------------------------------------------------------------

    @property
    def history(self) -> tuple[HistoryStep, ...]:
        """All steps, including those that were undone."""
        return tuple(self._history.steps)

    @property
    def history_position(self) -> int:
        """Index of the present step in `history`."""
        return self._history.position

    @property
    def can_undo(self) -> bool:
        """Whether an edit can be undone."""
        return self.history_position > 0

    @property
    def can_redo(self) -> bool:
        """Whether an edit can be redone."""
        return self.history_position < len(self._history.steps) - 1

    def undo(self) -> str | None:
        """Undoes the last edit and returns its label; None when there is none."""
        if not self.can_undo:
            return None
        label = self._history.steps[self.history_position].label
        self.go_to_step(self.history_position - 1)
        return label

    def redo(self) -> str | None:
        """Redoes the edit that was undone last and returns its label; None when there is none."""
        if not self.can_redo:
            return None
        self.go_to_step(self.history_position + 1)
        return self._history.steps[self.history_position].label

    def go_to_step(self, position: int) -> None:
        """Makes the step of that index the present one.

        The look stays as it is, unless one of the edits between chose another, as opening a file does; then zoom and
        position of the view stay.
        """
        before = self.document
        chose_look = self._history.go_to(position)
        own = self.view_settings
        look = before.view_settings.with_(pupil_path=own.pupil_path)
        if chose_look:
            look = own.with_(**{key: getattr(look, key) for key in _KEPT_BY_UNDO})
        try:
            self._history.amend(self.document.with_changes({"view_settings": look}))
        except UserError:  # with these lasers muted none would be left on
            self._history.amend(self.document.with_changes({"view_settings": look.with_(solo=None, muted=frozenset())}))
        self._notify(*changed_kinds(before, self.document), "history")

    # --- looks ------------------------------------------------------------------------------------------------------

    @property
    def looks(self) -> Looks:
        """The looks before the present one, and those that were gone back from."""
        return tuple(self._looks.before), tuple(self._looks.after)

    @property
    def can_look_back(self) -> bool:
        """Whether there was another look before."""
        return bool(self._looks.before)

    @property
    def can_look_forward(self) -> bool:
        """Whether a look was gone back from."""
        return bool(self._looks.after)

    def look_back(self) -> str | None:
        """Brings the look before the present one back; returns the label of the change; None when there is none."""
        return self._go_to_look(back=True)

    def look_forward(self) -> str | None:
        """Brings the look back that `look_back` left; returns the label of the change, None when there is none."""
        return self._go_to_look(back=False)

    def end_comparison(self) -> None:
        """Ends a comparison. All that the change which began it chose (page, exposure, sides) is as it was before."""
        look = self._looks.without_comparison(self.view_settings)
        self.edit("No comparison", view_settings=look)

    def _go_to_look(self, *, back: bool) -> str | None:
        before = self.document
        step = self._looks.go(before.view_settings, back=back)
        if step is None:
            return None
        kept = {key: getattr(before.view_settings, key) for key in (*_KEPT_BY_UNDO, "pupil_path")}
        self._history.amend(before.with_changes({"view_settings": step.look.with_(**kept)}))
        self._notify(*changed_kinds(before, self.document))
        return step.label

    def load_history(self, history: History, snapshots: Mapping[str, Document], looks: Looks = ((), ())) -> None:
        """Replaces the history, snapshots and looks by those of a saved session; jobs are cancelled, listeners stay."""
        self.jobs.cancel_all()
        self._preview, self._history, self._snapshots = None, history, dict(snapshots)
        self._looks = LookHistory(looks)
        self._notify(*CHANGE_KINDS)

    # --- sides of a comparison --------------------------------------------------------------------------------------

    @property
    def snapshots(self) -> Mapping[str, Document]:
        """Pinned documents by name, oldest first."""
        return dict(self._snapshots)

    def pin(self, name: str = "", document: Document | None = None) -> str:
        """Stores a document (the present one when None) as a snapshot and returns its name; an equal name replaces."""
        name = name or next(f"Snapshot {n}" for n in range(1, 10_000) if f"Snapshot {n}" not in self._snapshots)
        self._snapshots[name] = document or self.document
        self._notify("snapshots")
        return name

    def pin_beside(self, name: str, document: Document) -> str:
        """Stores a document as a snapshot under a name that can be shown and no other has, and returns it."""
        shown = printable(name)
        names = (shown, *(f"{shown} ({n})" for n in range(2, 10_000)))
        return self.pin(next(free for free in names if free not in self._snapshots), document)

    def edit_snapshot(self, name: str) -> None:
        """Edits a copy of a snapshot from now on, in one step of undo; the present document is kept as a snapshot.

        It isn't kept twice: not if a snapshot shows the same already. Raises UserError for an unknown name.
        """
        if name not in self._snapshots:
            raise UserError("snapshot", f'"{name}"', remedy=suggest_matches(name, self._snapshots))
        chosen, present = self._snapshots[name], self.document
        is_kept = any(of.drive is present.drive and of.system == present.system for of in self._snapshots.values())
        if not is_kept:
            self.pin_beside(present.title, present)
        work = ("system", "drive", "target_spec", "origin", "path", "recorded", "parked")
        self.edit(f"Edit {name}", **{key: getattr(chosen, key) for key in work})
        self.edit_view("Shown", shown=NOW)

    def unpin(self, name: str) -> None:
        """Deletes a snapshot; comparisons with it compare with the present document instead."""
        if self._snapshots.pop(name, None) is not None:
            self._replace_side(ComparisonSide("snapshot", name), NOW)

    def rename_snapshot(self, name: str, to: str) -> None:
        """Renames a snapshot, in all steps of the history too. Raises UserError when the name is taken or empty."""
        if not to or to in self._snapshots:
            raise UserError("snapshot", f'"{to}"', expected="a name that isn't taken")
        self._snapshots = {to if key == name else key: document for key, document in self._snapshots.items()}
        self._replace_side(ComparisonSide("snapshot", name), ComparisonSide("snapshot", to))

    def _replace_side(self, old: ComparisonSide, new: ComparisonSide) -> None:
        """Replaces a side of the comparison in all steps, since deleting a snapshot isn't undone."""
        self._history.amend_all(
            lambda document: replace(document, view_settings=document.view_settings.with_side_replaced(old, new))
        )
        self._looks.amend_all(lambda look: look.with_side_replaced(old, new))
        self._notify("look", "history", "snapshots")

    def scene_for(self, side: ComparisonSide) -> Scene | None:
        """The scene of a side of the comparison at the displayed focal plane.

        None for the target, which isn't rendered, and for a snapshot that has been deleted. A preset gets the pixel
        count and the sampling of the displayed system, so that both images have the same size, and random patterns.
        """
        displayed = self.displayed_document
        system, plane_m = displayed.system, displayed.view_settings.plane_m
        if side.kind == "now":
            return displayed.scene
        if side.kind == "achromatic":
            system = system if system.eye is None else system.with_(eye=replace(system.eye, chromatic=False))
            return Scene(system, displayed.drive, plane_m)
        if side.kind == "snapshot":
            pinned = self._snapshots.get(side.name)
            return None if pinned is None else Scene(pinned.lit_system, pinned.drive, plane_m)
        if side.kind == "preset":
            return replace(self._preset_scene(side.name, system), plane_m=plane_m)
        return None

    def _preset_scene(self, name: str, displayed: System) -> Scene:
        """A preset's scene in the displayed sampling; cached, as other random patterns would restart rendering."""
        way = displayed.way
        upsample = 1 if any(n % way.upsample for n in way.shape) else way.upsample
        sampling = {"shape": tuple(n // upsample for n in way.shape), "upsample": upsample}
        key = (name, *sampling.values())
        if key not in self._presets:
            system = preset.load(name).edit(sampling)
            self._presets[key] = Scene(system, random_drive(system), middle_plane(system))
        return self._presets[key]

    def target_at(self, plane_m: float | None = None) -> NDArray[np.float32] | None:
        """The target (y, x, 3) in linear sRGB at a plane, by default the displayed one; None until it is built."""
        if self.target_spec is None:
            return None
        plane_m = self.view_settings.plane_m if plane_m is None else plane_m
        return self.target_builder.get(self.target_spec, self.system, plane_m)

    def other_targets(self) -> OtherPlanes:
        """The targets (y, x, 3) at planes that aren't displayed, as far as they are built."""
        if self.target_spec is None:
            return NO_OTHERS
        return self.target_builder.others(self.target_spec, self.system, self.view_settings.plane_m)

    def target_for(self, side: ComparisonSide) -> NDArray[np.float32] | None:
        """The target (y, x, 3) of a side of the comparison at the displayed plane; a snapshot has its own.

        None without a target, and until it is built.
        """
        if side.kind != "snapshot":
            return None if side == TARGET else self.target_at()
        pinned = self._snapshots.get(side.name)
        if pinned is None or pinned.target_spec is None:
            return None
        return self.target_builder.get(pinned.target_spec, pinned.system, self.view_settings.plane_m)

    # --- threads and listeners --------------------------------------------------------------------------------------

    def call_on_owner(self, call: Callable[[], None]) -> None:
        """Has the owner make a call at its next `poll`. May be called on any thread."""
        self._inbox.put(call)
        self._wake()

    def poll(self) -> None:
        """Makes the calls that worker threads delivered. An exception becomes a message; the other calls are made."""
        for call in self._inbox.drain():
            with self.report_errors():
                call()
            self._notify("jobs")

    def wait_until_idle(self, timeout_s: float = 60.0) -> bool:
        """Polls until no job runs and no target is being built; returns False after the timeout."""
        until = time.monotonic() + timeout_s
        while time.monotonic() < until:
            self.poll()
            busy = [job for job in self.jobs.active if job.status == "running"]
            if not busy and not self.target_builder.is_building and self._inbox.is_empty:
                return True
            time.sleep(0.01)
        return False

    @contextmanager
    def report_errors(self, where: str = "") -> Iterator[None]:
        """A context in which an exception becomes a message to the user instead of propagating."""
        try:
            yield
        except Exception as error:  # a defect in one edit must not end the program
            self.messages.post_error(error, where)

    def add_listener(self, listener: Callable[[Change], None]) -> Callable[[], None]:
        """Calls `listener` on the owner's thread after each change; the returned function removes it."""
        return self._listeners.add(listener)

    def close(self) -> None:
        """Cancels all jobs and ends the threads."""
        self.jobs.close()
        self.target_builder.close()

    def _wake(self) -> None:
        self.wake()

    def _notify(self, *kinds: str) -> None:
        if kinds:
            self.version += 1
        self._listeners.notify(*kinds)


# --- Which parts of a session have changed, and the listeners that are notified ---


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


# --- A queue of calls from any thread to the thread that owns a session ---


Call = Callable[[], None]


class CallQueue:
    """A thread-safe queue of calls without arguments, in the order of `put`."""

    def __init__(self) -> None:
        self._waiting: SimpleQueue[Call] = SimpleQueue()

    @property
    def is_empty(self) -> bool:
        """Whether no call waits."""
        return self._waiting.empty()

    def put(self, call: Call) -> None:
        """Adds a call. May be called on any thread."""
        self._waiting.put(call)

    def drain(self) -> Iterator[Call]:
        """Takes the waiting calls, and those that are added meanwhile, for the owner to make."""
        while True:
            try:
                yield self._waiting.get_nowait()
            except Empty:
                return


# --- A log of messages to the user, which a front end shows for a while ---


MAX_MESSAGES = 200


@dataclass(frozen=True)
class Message:
    """A line of text, its kind ("info", "warning", "error"), details such as a traceback, and when it was posted."""

    text: str
    kind: str = "info"
    details: str = ""
    when: float = 0.0


class MessageLog:
    """The last MAX_MESSAGES messages. on_change: called after each new message."""

    def __init__(self, on_change: Callable[[], None] = lambda: None) -> None:
        self._messages: deque[Message] = deque(maxlen=MAX_MESSAGES)
        self._on_change = on_change

    @property
    def all(self) -> tuple[Message, ...]:
        """All messages that are stored, oldest first."""
        return tuple(self._messages)

    def recent(self, seconds: float) -> tuple[Message, ...]:
        """Messages of the last seconds, oldest first."""
        since = time.time() - seconds
        return tuple(message for message in self._messages if message.when >= since)

    def post(self, text: str, kind: str = "info", details: str = "") -> None:
        """Adds a message; its text may quote a file."""
        self._messages.append(Message(printable(text), kind, details, time.time()))
        self._on_change()

    def post_error(self, error: BaseException, where: str = "") -> None:
        """Adds an error: a UserError by its text, any other exception with its traceback as details."""
        prefix = f"{where}: " if where else ""
        if isinstance(error, UserError):
            self.post(f"{prefix}{error}", "error")
            return
        details = "".join(traceback.format_exception(error))
        self.post(f"{prefix}{type(error).__name__}: {error}", "error", details)


# --- What a user has chosen for the next optimisation ---


SCHEMES = (
    *("simultaneous", "time-sequential", "multiplexed-3", "holochrome-8", "holochrome-8x3", "holochrome-16"),
    "holochrome-8+multisource-3x3",
)


@dataclass(frozen=True)
class OptimisationChoices:
    """Choices for an optimisation: those of its `Settings` and `OptimisedEyes` that a panel offers, and three more.

    pupils: as text; "" for the eye's own place. Raises UserError for a choice that isn't offered.
    """

    scheme: str = described_field(
        Word(("", *SCHEMES)),
        "How the lasers are driven: which wavelengths, together or in turn, in how many frames; as they are if absent.",
        default="",
    )
    loss: str = described_field(
        Word(("", *LOSS_SPACES, FIELD_LOSS)),
        f"{field_for(Settings, 'loss').metadata['doc']} {FIELD_LOSS}: {FIELD_LOSS_DOC}",
        default="",
    )
    start_patterns: str = described_field(
        Word(("now", *INITIAL_PATTERNS)),
        f"{field_for(Settings, 'begin').metadata['doc']} now: go on from what is shown.",
        default=Settings.begin,
    )
    iterations: int = same_field(Settings, "iterations")
    eyebox: float = same_field(Settings, "eyebox")
    pupils: str = described_field(Choice(), field_for(OptimisedEyes, "pupils").metadata["doc"], default="")
    chromatic: str = same_field(OptimisedEyes, "chromatic")

    def __post_init__(self) -> None:
        validate(self)
        OptimisedEyes.from_text(self.pupils or None, self.chromatic)

    def eyes_for(self, system: System) -> OptimisedEyes:
        """For which eyes a system is optimised; without an eye, none of them is moved and nothing is ignored."""
        return OptimisedEyes() if system.eye is None else OptimisedEyes.from_text(self.pupils or None, self.chromatic)
