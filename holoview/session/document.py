"""The document: a bench, the patterns on it, what they should show, and how they are looked at. Frozen."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.model.system import System
from holoview.session.target_spec import TargetSpec
from holoview.session.view_settings import Region, ViewSettings
from holoview.util.errors import UserError

Drive = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Document:
    """What is edited and undone as a whole.

    drive (frame, modulator, y, x) float32 in 0…1, read-only. wanted: the target's recipe. origin: where the patterns
    come from, in words. path: the file that they came from or went to. Raises UserError when the drive doesn't fit.
    """

    system: System
    drive: Drive
    view_settings: ViewSettings
    target_spec: TargetSpec | None = None
    origin: str = ""
    path: Path | None = None

    def __post_init__(self) -> None:
        if self.drive.shape != self.system.drive_shape:
            raise UserError(
                "patterns", f"shape {self.drive.shape}", expected=f"{self.system.drive_shape} (frame, modulator, y, x)"
            )
        object.__setattr__(self, "drive", as_readonly_drive(self.drive))
        frames, modulators = self.system.drive_shape[:2]
        count = len(self.system.wavelengths_m)
        object.__setattr__(
            self, "view_settings", self.view_settings.clamped_to(count, self.image_shape, frames, modulators)
        )

    @property
    def image_shape(self) -> tuple[int, int]:
        """Rows and columns of the simulated image."""
        upsample = self.system.sampling.upsample
        rows, columns = self.system.modulators[0].shape
        return rows * upsample, columns * upsample

    @property
    def measured_region(self) -> Region:
        """Where speckle is measured: the region that was drawn, else the central half."""
        rows, columns = self.image_shape
        return self.view_settings.region or (columns // 4, rows // 4, columns // 2, rows // 2)

    @property
    def lit_system(self) -> System:
        """The bench with the lasers switched off that are muted or aren't the solo one."""
        look, count = self.view_settings, len(self.system.wavelengths_m)
        if look.solo is None and not look.muted:
            return self.system
        on = np.array([i == look.solo if look.solo is not None else i not in look.muted for i in range(count)])
        amplitudes = self.system.amplitudes * on
        if not np.any(amplitudes > 0):
            raise UserError("lasers", "none is left on", remedy="solo or unmute one that has power")
        return self.system.edit({"amplitudes": amplitudes})

    def with_changes(self, changes: dict[str, Any]) -> Document:
        """A copy with some fields changed; patterns that no longer fit a changed bench are made to fit.

        Raises UserError when the result is impossible.
        """
        system = changes.get("system", self.system)
        if "drive" not in changes and system.drive_shape != self.drive.shape:
            drive, note = fit_drive(self.drive, system.drive_shape)
            changes = {**changes, "drive": drive}
            changes.setdefault("origin", f"{self.origin}; {note}" if self.origin else note)
        state = replace(self, **changes)
        _ = state.lit_system
        return state


def is_same_document(one: Document, other: Document) -> bool:
    """Whether two states are equal; patterns and targets are compared by identity, which is what edits share."""
    if one.drive is not other.drive or one.target_spec is not other.target_spec:
        return False
    return all(
        getattr(one, field.name) == getattr(other, field.name)
        for field in dataclasses.fields(one)
        if field.name not in ("drive", "target_spec")
    )


def as_readonly_drive(drive: NDArray[np.floating]) -> Drive:
    """A read-only float32 drive; itself where it is one already."""
    if drive.dtype == np.float32 and not drive.flags.writeable:
        return drive
    copy = np.array(drive, dtype=np.float32)
    copy.setflags(write=False)
    return copy


def fit_drive(drive: Drive, shape: tuple[int, int, int, int], seed: int = 0) -> tuple[Drive, str]:
    """Patterns for a bench of another shape, and in words what was done.

    Frames are repeated or dropped, a second modulator's pattern dropped or begun at random; patterns of another pixel
    count can't be kept, since phase isn't a picture that may be scaled: they begin at random.
    """
    frames, modulators = shape[:2]
    if drive.shape[2:] != shape[2:]:
        return _random(shape, seed), "random patterns of the new size"
    notes = []
    if drive.shape[0] != frames:
        fewer = f"{frames} of {drive.shape[0]} frames"
        notes.append(fewer if frames < drive.shape[0] else f"repeated to {frames} frames")
        drive = drive[np.arange(frames) % drive.shape[0]]
    if drive.shape[1] < modulators:
        notes.append("a random second modulator")
        drive = np.concatenate([drive, _random((frames, 1, *shape[2:]), seed)], axis=1)
    elif drive.shape[1] > modulators:
        notes.append("the first modulator's patterns")
        drive = drive[:, :modulators]
    return np.ascontiguousarray(drive), ", ".join(notes)


def _random(shape: tuple[int, int, int, int], seed: int) -> Drive:
    return np.random.default_rng(seed).random(shape, dtype=np.float32)
