"""A scene: all that an image is rendered from. Each side of a comparison has one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from holoview.document.document import Document, Drive
from holoview.document.view_settings import ComparisonSide
from holoview.model import preset
from holoview.model.system import System
from holoview.view import random_drive


@dataclass(frozen=True, eq=False)
class Scene:
    """A system, the drive of its modulators (frame, modulator, y, x), and the focal plane in metres."""

    system: System
    drive: Drive
    plane_m: float

    def is_same(self, other: Scene | None) -> bool:
        """Whether the image is the same; drives are compared by identity, since edits share unchanged arrays."""
        return (
            other is not None
            and self.drive is other.drive
            and self.plane_m == other.plane_m
            and self.system == other.system
        )


def resolve_scene(side: ComparisonSide, displayed: Document, snapshots: Mapping[str, Document]) -> Scene | None:
    """The scene of a side at the focal plane of `displayed`, the document that the side "now" shows.

    None for the target, which isn't rendered, and for a snapshot that has been deleted. A preset gets the pixel count
    and the sampling of the displayed system, so that both images have the same size, and random patterns.
    """
    plane_m = displayed.view_settings.plane_m
    if side.kind == "now":
        return Scene(displayed.system, displayed.drive, plane_m)
    if side.kind == "achromatic":
        eye = displayed.system.eye
        system = displayed.system if eye is None else displayed.system.with_(eye=replace(eye, chromatic=False))
        return Scene(system, displayed.drive, plane_m)
    if side.kind == "snapshot":
        pinned = snapshots.get(side.name)
        return None if pinned is None else Scene(pinned.lit_system, pinned.drive, plane_m)
    if side.kind == "preset":
        sampling = {"shape": displayed.system.modulators[0].shape, "upsample": displayed.system.sampling.upsample}
        system = preset.load(side.name).edit(sampling)
        return Scene(system, random_drive(system), plane_m)
    return None
