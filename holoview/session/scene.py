"""What has to be rendered for a side of a comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from holoview.model import preset
from holoview.model.system import System
from holoview.session.document import Document, Drive
from holoview.session.view_settings import ComparisonSide
from holoview.view import random_drive


@dataclass(frozen=True, eq=False)
class Scene:
    """A bench and its patterns."""

    system: System
    drive: Drive


def resolve_scene(side: ComparisonSide, shown: Document, snapshots: Mapping[str, Document]) -> Scene | None:
    """What to render for a side; None for the target, which isn't rendered, and for a snapshot that is gone.

    shown: the state that is drawn for "now". Another preset is taken at this bench's pixel count, with random
    patterns, so that images lie over each other.
    """
    if side.kind == "now":
        return Scene(shown.system, shown.drive)
    if side.kind == "snapshot":
        pinned = snapshots.get(side.name)
        return None if pinned is None else Scene(pinned.lit_system, pinned.drive)
    if side.kind == "preset":
        sampling = {"shape": shown.system.modulators[0].shape, "upsample": shown.system.sampling.upsample}
        system = preset.load(side.name).edit(sampling)
        return Scene(system, random_drive(system))
    return None
