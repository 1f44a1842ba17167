"""The document that a session edits: system, modulator patterns, target and view settings. Immutable."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.load_field import Recorded
from holoview.light.model.drives import chain_drives, complex_names, drive_fits
from holoview.light.model.elements import ComplexModulator, Element, PhaseModulator
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.viewer.document.target_builder import TargetSpec
from holoview.viewer.render.scene import Drive, ElementPatterns, Scene, image_shape
from holoview.viewer.render.view_settings import SPECKLE_EXPOSURE_STOPS, NamedRegion, Region, ViewSettings


@dataclass(frozen=True, eq=False)
class Parked:
    """An element of a bench that is switched off, and what it takes to switch it on again.

    name: of the element. elements: those that were taken away with it, itself among them; empty of a modulator, which
    shows nothing in place of `drive`, its patterns; of a space itself with its stops. behind: the name of the element
    before them, "" for the source. shift_m: how much farther the planes are meanwhile.
    """

    name: str
    elements: tuple[Element, ...] = ()
    behind: str = ""
    shift_m: float = 0.0
    drive: Drive | None = None


@dataclass(frozen=True, eq=False)
class Document:
    """The data that are edited and undone as a whole.

    drive: patterns (frame, modulator, y, x) in 0…1, float32, read-only; of a field its values
    (frame, wavelength, y, x), complex64; of a chain a mapping of patterns (frame, y, x) by the names of its elements.
    origin: where the patterns come from, in words. path: the hologram file that they were read from or written to.
    recorded: the recording that the field is cut out of; any other drive takes it away. parked: elements that are
    switched off; other patterns take away those that a modulator is to show again, another bench all of them.

    View settings that refer to lasers, frames, modulators or samples that don't exist, or to a plane before the
    modulator, are adjusted. Raises UserError when the drive doesn't have the shape that the system needs.
    """

    system: System
    drive: Drive
    view_settings: ViewSettings
    target_spec: TargetSpec | None = None
    origin: str = ""
    path: Path | None = None
    recorded: Recorded | None = None
    parked: tuple[Parked, ...] = ()

    def __post_init__(self) -> None:
        if self.system.is_chain:
            object.__setattr__(self, "drive", _chain_drive(self.system, self.drive))
        elif (
            isinstance(self.drive, Mapping)
            or self.drive.shape != self.system.drive_shape
            or np.iscomplexobj(self.drive) != self.system.is_field
        ):
            raise UserError(
                "patterns",
                f"shape {np.shape(self.drive)}",
                expected=f"{self.system.drive_shape} (frame, modulator, y, x)",
            )
        else:
            object.__setattr__(self, "drive", as_readonly_drive(self.drive))
        patterns = 1 if self.system.is_field else len(self.system.drive_shapes)
        view = self.view_settings.clamped_to(
            len(self.system.wavelengths_m), self.image_shape, self.system.frames, patterns
        )
        if view.plane_m < self.system.plane_type.item.low:
            view = view.with_(plane_m=middle_plane(self.system))
        object.__setattr__(self, "view_settings", view)

    @property
    def title(self) -> str:
        """The name of its file, else of its target's picture, else of its bench."""
        target = "" if self.target_spec is None else self.target_spec.title
        return self.path.name if self.path is not None else target or self.system.name or "hologram"

    @property
    def scene(self) -> Scene:
        """The scene from which the image is rendered."""
        return Scene(self.system, self.drive, self.view_settings.plane_m)

    @property
    def image_shape(self) -> tuple[int, int]:
        """Rows and columns of the simulated image."""
        return image_shape(self.system)

    @property
    def measured_region(self) -> Region:
        """Where speckle is measured: the region of the view settings, else the central half in each direction."""
        rows, columns = self.image_shape
        return self.view_settings.region or (columns // 4, rows // 4, columns // 2, rows // 2)

    @property
    def measured_regions(self) -> tuple[NamedRegion, ...]:
        """The regions that were drawn, by their names; without any the measured one."""
        return self.view_settings.regions or (NamedRegion("centre", self.measured_region),)

    @property
    def sample_pitch_m(self) -> float:
        """Distance in metres between samples of the simulated image."""
        return self.system.way.sample_m

    @property
    def lit_system(self) -> System:
        """The system with the amplitudes of lasers that are muted, or aren't the solo one, set to 0.

        Where one frame is shown alone, so are those of the others, and its light is as many times brighter as there are
        frames. Raises UserError when no laser is left on.
        """
        view, (frames, count) = self.view_settings, self.system.amplitudes.shape
        is_one_frame = view.is_one_frame and frames > 1
        if view.solo is None and not view.muted and not is_one_frame:
            return self.system
        amplitudes = self.system.amplitudes * np.array([view.shows_laser(i) for i in range(count)])
        if is_one_frame:
            amplitudes = amplitudes * (np.arange(frames)[:, None] == view.frame) * frames
        if not np.any(amplitudes > 0):
            raise UserError("lasers", "none is left on", remedy="solo or unmute one that has power")
        return self.system.edit({"amplitudes": amplitudes})

    @property
    def view_settings_for_picture(self) -> ViewSettings:
        """The view settings, without the low exposure that new random patterns get."""
        view = self.view_settings
        is_low = "random patterns" in self.origin and view.exposure_stops == SPECKLE_EXPOSURE_STOPS
        return view.with_(exposure_stops=0.0) if is_low else view

    def with_changes(self, changes: dict[str, Any]) -> Document:
        """A copy with some fields changed; patterns are adapted to a changed system by `fit_drive`.

        Raises UserError when the result is impossible.
        """
        system = changes.get("system", self.system)
        if "drive" not in changes and not _fits(system, self.drive):
            drive, note = fit_patterns(self.system, self.drive, system)
            changes = {**changes, "drive": drive}
            changes.setdefault("origin", "; ".join(part for part in (self.origin, note) if part))
        if "drive" in changes:
            is_same_bench = system.elements == self.system.elements
            kept = tuple(parked for parked in self.parked if is_same_bench and parked.drive is None)
            changes = {"recorded": None, "parked": kept, **changes}
        document = replace(self, **changes)
        _ = document.lit_system
        return document


def middle_plane(system: System) -> float:
    """The median focal plane in metres, which a new session displays."""
    return float(np.sort(system.planes_m)[len(system.planes_m) // 2])


def is_same_document(one: Document, other: Document) -> bool:
    """Whether two documents are equal. Drives and targets are compared by identity, as edits share unchanged arrays."""
    if one.drive is not other.drive or one.target_spec is not other.target_spec:
        return False
    return all(
        getattr(one, field.name) == getattr(other, field.name)
        for field in dataclasses.fields(one)
        if field.name not in ("drive", "target_spec")
    )


def as_readonly_drive(drive: Drive) -> Drive:
    """A read-only copy of a drive in single precision; the drive itself if it is both already."""
    if isinstance(drive, ElementPatterns):
        return drive
    if isinstance(drive, Mapping):
        return ElementPatterns({name: as_readonly_drive(patterns) for name, patterns in drive.items()})
    dtype = np.complex64 if np.iscomplexobj(drive) else np.float32
    if drive.dtype == dtype and not drive.flags.writeable:
        return drive
    copy: Drive = np.array(drive, dtype=dtype)
    copy.setflags(write=False)
    return copy


def drive_arrays(drive: Drive) -> tuple[NDArray[Any], ...]:
    """The arrays of a drive: itself, or those of a chain's elements."""
    return tuple(drive.values()) if isinstance(drive, Mapping) else (drive,)


def _chain_drive(system: System, drive: Drive) -> Drive:
    """The patterns of a chain by name. Raises UserError for such that don't fit."""
    return drive if _fits(system, drive) else as_readonly_drive(chain_drives(system, drive))


def _fits(system: System, drive: Drive) -> bool:
    """Whether a document's drive, whose values were checked, has the shapes that a system needs."""
    return drive_fits(system, drive) and (isinstance(drive, ElementPatterns) or not system.is_chain)


def fit_patterns(before: System, drive: Drive, system: System) -> tuple[Drive, str]:
    """Adapts the patterns of one system to another; returns them and a description of the change.

    Between benches of the short form as `fit_drive`. To and from other chains, elements keep the patterns of their
    name; a new element passes all light, and one of another pixel count gets random patterns.
    """
    if not (before.is_chain or system.is_chain):
        return fit_drive(drive, system.drive_shape)
    if before.is_field or system.is_field:
        raise UserError("field", "as an element of a chain", expected="modulators", remedy="open a preset to begin")
    known = dict(drive) if before.is_chain else dict(zip(before.drive_shapes, np.swapaxes(drive, 0, 1), strict=True))
    of_complex, fitted, notes = complex_names(system), dict[str, NDArray[Any]](), list[str]()
    for name, shape in system.drive_shapes.items():
        old = known.get(name)
        if old is None or np.iscomplexobj(old) != (name in of_complex):
            fitted[name] = neutral_patterns(system, name)
            notes.append(f"{name} passes all light")
        elif old.shape[1:] != shape[1:]:
            turns = np.random.default_rng(0).random(shape, dtype=np.float32)
            fitted[name] = np.exp(2j * np.pi * turns).astype(np.complex64) if name in of_complex else turns
            notes.append(f"random patterns of {name}")
        else:
            fitted[name] = old if len(old) == shape[0] else old[np.arange(shape[0]) % len(old)]
    together: Drive = fitted if system.is_chain else np.stack(list(fitted.values()), axis=1)
    return as_readonly_drive(together), ", ".join(notes)


def neutral_patterns(system: System, name: str) -> NDArray[Any]:
    """Patterns (frame, y, x) of an element that leave all light as it is: no path, or a transmission of 1."""
    element = system.elements[system.part(name)]
    dtype = np.complex64 if isinstance(element, ComplexModulator) else np.float32
    return np.full(system.drive_shapes[name], 0.0 if isinstance(element, PhaseModulator) else 1.0, dtype)


def fit_drive(drive: Drive, shape: tuple[int, int, int, int]) -> tuple[Drive, str]:
    """Adapts patterns to `shape` (frame, modulator, y, x); returns them and a description of the change.

    Frames are repeated or dropped; a second modulator gets a random pattern or is dropped. For another pixel count all
    patterns become random, because phase patterns can't be resampled like pictures. Raises UserError for a field, whose
    samples and wavelengths are given.
    """
    frames, modulators = shape[:2]
    if np.iscomplexobj(drive):
        raise UserError(
            "field",
            f"{len(drive)} frames, {drive.shape[1]} wavelengths, {drive.shape[3]} x {drive.shape[2]} samples",
            expected="a bench with as many",
            remedy="open a preset to begin with modulators",
        )
    if drive.shape[2:] != shape[2:]:
        return _random(shape), "random patterns of the new size"
    notes = []
    if drive.shape[0] != frames:
        fewer = f"{frames} of {drive.shape[0]} frames"
        notes.append(fewer if frames < drive.shape[0] else f"repeated to {frames} frames")
        drive = drive[np.arange(frames) % drive.shape[0]]
    if drive.shape[1] < modulators:
        notes.append("a random second modulator")
        drive = np.concatenate([drive, _random((frames, 1, *shape[2:]))], axis=1)
    elif drive.shape[1] > modulators:
        notes.append("the first modulator's patterns")
        drive = drive[:, :modulators]
    return np.ascontiguousarray(drive), ", ".join(notes)


def _random(shape: tuple[int, int, int, int]) -> Drive:
    return np.random.default_rng(0).random(shape, dtype=np.float32)


# --- Undo and redo as a list of documents, each with the label of the edit that led to it ---


MAX_STEPS = 300
MAX_BYTES = 1 << 30
MERGE_WITHIN_S = 1.0
"""Edits with the same merge key become one step if they follow each other within this time, or in one hold."""


class Gesture:
    """A merge key whose edits become one step however slowly they follow, as frames of a film that plays may."""


class Timing:
    """Tells whether a change belongs to the one before it: both have a key in common, and follow each other soon."""

    def __init__(self, clock: Callable[[], float] = time.time) -> None:
        self.now = clock
        self._held_since = math.inf

    def hold(self, is_held: bool) -> None:
        """States whether a button or a key is held: the changes of one hold belong together, however slow they are."""
        if not is_held:
            self._held_since = math.inf
        elif self._held_since == math.inf:
            self._held_since = self.now()

    def joins(self, key: Hashable, last: HistoryStep | LookStep) -> bool:
        """Whether a change with a key, made now, belongs to the last one."""
        is_in_time = self.now() - last.when <= MERGE_WITHIN_S or last.when >= self._held_since
        return key is not None and key == last.merge_key and (is_in_time or isinstance(key, Gesture))


@dataclass(frozen=True, eq=False)
class HistoryStep:
    """A document, the label of the edit that led to it, and when it was made, as `time.time`.

    sets_look: whether the edit chose another look too, as opening a file does: then undo takes it back with the rest.
    """

    label: str
    document: Document
    when: float
    merge_key: Hashable = None
    sets_look: bool = True


class History:
    """The steps up to the present one and those that were undone.

    The oldest steps are dropped beyond MAX_STEPS steps or MAX_BYTES of patterns.
    """

    def __init__(self, first: HistoryStep, clock: Callable[[], float] = time.time) -> None:
        self.steps: list[HistoryStep] = [first]
        self.position = 0
        self._timing = Timing(clock)

    @classmethod
    def from_steps(cls, steps: list[HistoryStep], position: int) -> History:
        """A history of saved steps; `position` is the index of the present one."""
        history = cls(steps[0])
        history.steps, history.position = list(steps), position
        history.end_gesture()
        return history

    @property
    def present(self) -> Document:
        """The document at the present step."""
        return self.steps[self.position].document

    def add(self, label: str, document: Document, merge_key: Hashable = None) -> None:
        """Adds a step, or merges it into the present one; undone steps are dropped."""
        last = self.steps[self.position]
        merges = self._timing.joins(merge_key, last) and self.position > 0
        sets_look = not is_same_look(document, last.document) or (merges and last.sets_look)
        del self.steps[self.position + (0 if merges else 1) :]
        self.steps.append(HistoryStep(label, document, self._timing.now(), merge_key, sets_look))
        self.position = len(self.steps) - 1
        self._drop_oldest()

    def amend(self, document: Document) -> None:
        """Replaces the document of the present step, for changes that aren't undone separately."""
        self.steps[self.position] = replace(self.steps[self.position], document=document)

    def amend_all(self, change: Callable[[Document], Document]) -> None:
        """Applies a change to the documents of all steps, undone steps included."""
        self.steps = [replace(step, document=change(step.document)) for step in self.steps]

    def hold(self, is_held: bool) -> None:
        """States whether a button or a key is held: the edits of one hold merge, however slowly they follow."""
        self._timing.hold(is_held)

    def end_gesture(self) -> None:
        """Ends a drag: the next edit is a separate step."""
        self.steps[self.position] = replace(self.steps[self.position], merge_key=None)

    def go_to(self, position: int) -> bool:
        """Makes the step of that index the present one; returns whether an edit between the two chose a look.

        Raises IndexError when there is none.
        """
        if not 0 <= position < len(self.steps):
            raise IndexError(f"step {position} of {len(self.steps)}")
        self.end_gesture()
        between = self.steps[min(position, self.position) + 1 : max(position, self.position) + 1]
        self.position = position
        return any(step.sets_look for step in between)

    def _drop_oldest(self) -> None:
        while len(self.steps) > 1 and (len(self.steps) > MAX_STEPS or self._bytes() > MAX_BYTES):
            if self.position == 0:
                self.steps.pop()
            else:
                self.steps.pop(0)
                self.position -= 1

    def _bytes(self) -> int:
        arrays = (array for step in self.steps for array in drive_arrays(step.document.drive))
        return sum({id(array): array.nbytes for array in arrays}.values())


# --- looks: they are no edits, and have a history of their own ---


def is_same_look(one: Document, other: Document) -> bool:
    """Whether two documents are seen alike; a recorded path of the pupil is work, and part of no look."""
    return replace(one.view_settings, pupil_path=None) == replace(other.view_settings, pupil_path=None)


def is_look_alone(before: Document, after: Document) -> bool:
    """Whether an edit changes nothing but the look."""
    path = before.view_settings.pupil_path
    same = replace(after, view_settings=before.view_settings)
    return after.view_settings.pupil_path == path and is_same_document(before, same)


@dataclass(frozen=True, eq=False)
class LookStep:
    """A look that was left, the label of the change that left it, and when that was, as `time.time`."""

    label: str
    look: ViewSettings
    when: float
    merge_key: Hashable = None


Looks = tuple[tuple[LookStep, ...], tuple[LookStep, ...]]
"""The looks before the present one, and those that were gone back from; the last of each is the nearest."""


class LookHistory:
    """The looks before the present one, and those that were gone back from; the last of each list is the nearest."""

    def __init__(self, looks: Looks = ((), ()), clock: Callable[[], float] = time.time) -> None:
        self.before, self.after = (list(some) for some in looks)
        self._timing = Timing(clock)

    def add(self, label: str, left: ViewSettings, merge_key: Hashable = None) -> None:
        """The look `left` was changed. Looks that were gone back from are forgotten."""
        self.after.clear()
        now = self._timing.now()
        if self.before and self._timing.joins(merge_key, self.before[-1]):
            self.before[-1] = replace(self.before[-1], label=label, when=now)
        else:
            self.before = [*self.before[1 - MAX_STEPS :], LookStep(label, left, now, merge_key)]

    def go(self, present: ViewSettings, *, back: bool) -> LookStep | None:
        """The step that is gone back or forward to; None where there is none. present: the look that is left."""
        source, other = (self.before, self.after) if back else (self.after, self.before)
        if not source:
            return None
        step = source.pop()
        other.append(LookStep(step.label, present, self._timing.now()))
        return step

    def hold(self, is_held: bool) -> None:
        """As `History.hold`."""
        self._timing.hold(is_held)

    def end_gesture(self) -> None:
        """Ends a drag: the next change is a separate step."""
        if self.before:
            self.before[-1] = replace(self.before[-1], merge_key=None)

    def amend_all(self, change: Callable[[ViewSettings], ViewSettings]) -> None:
        """Applies a change to all looks."""
        self.before = [replace(step, look=change(step.look)) for step in self.before]
        self.after = [replace(step, look=change(step.look)) for step in self.after]

    def without_comparison(self, present: ViewSettings) -> ViewSettings:
        """The present look without its comparison: all that the change which began it chose is as it was before.

        A field that was changed since stays. Where nothing tells how the comparison began, it is switched off.
        """
        looks = [*(step.look for step in self.before), present]
        for left, chosen in reversed(list(pairwise(looks))):
            if left.compare == "off" and chosen.compare != "off":
                fields = [field.name for field in dataclasses.fields(left)]
                changed = [name for name in fields if getattr(left, name) != getattr(chosen, name)]
                kept = [name for name in changed if getattr(present, name) != getattr(chosen, name)]
                undone = {name: getattr(left, name) for name in changed if name not in (*kept, "zoom", "centre")}
                return present.with_(**{**undone, "compare": "off"})
        return present.with_(compare="off")
