"""The shipped example: a hologram of the still life with its target, which a new session shows.

The hologram is for the preset `EXAMPLE_PRESET` as it is. Every other bench gets random patterns with the same target.
What the first picture of a viewer needs and no more is imported here.
"""

from __future__ import annotations

from typing import Any

from holoview.holograms.hologram import load_hologram
from holoview.light.model import preset
from holoview.light.model.system import System
from holoview.util.files import data_dir
from holoview.viewer.document.document import middle_plane
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.target_builder import TargetSpec, example_target
from holoview.viewer.render.view_settings import SPECKLE_EXPOSURE_STOPS, ViewSettings

EXAMPLE_PRESET = "holochrome-8"
_ORIGIN = "shipped hologram of the still life"


def new_session(system: System, *, is_random: bool = False) -> EditingSession:
    """A new session of a bench, which shows the example.

    is_random: shows random patterns instead, without a target. Raises UserError when a shipped file can't be read.
    """
    view = ViewSettings(plane_m=middle_plane(system), exposure_stops=SPECKLE_EXPOSURE_STOPS)
    if is_random:
        return EditingSession(system, view_settings=view)
    if not is_example_bench(system):
        target_spec = example_target()
        session = EditingSession(system, target_spec=target_spec, view_settings=view)
        session.messages.post(random_patterns_hint(target_spec))
        return session
    fields = _example_fields()
    view = ViewSettings(plane_m=middle_plane(fields["system"]))
    return EditingSession(**fields, view_settings=view)


def show_example(session: EditingSession) -> None:
    """Shows the example in a session, as one step of undo. Raises UserError when a shipped file can't be read."""
    fields = _example_fields()
    view = session.view_settings.with_(plane_m=middle_plane(fields["system"]), exposure_stops=0.0)
    session.edit("Open the still life", **fields, view_settings=view, path=None)
    session.mark_saved()


def shows_example(session: EditingSession) -> bool:
    """Whether a session shows the example as it was shipped, apart from view settings."""
    return has_example_target(session) and session.document.origin == _ORIGIN


def has_example_target(session: EditingSession) -> bool:
    """Whether the target of a session is that of the example."""
    return session.target_spec is not None and session.target_spec.is_example


def is_example_bench(system: System | None) -> bool:
    """Whether the shipped hologram is for this bench."""
    return system == preset.load(EXAMPLE_PRESET)


def random_patterns_hint(target_spec: TargetSpec) -> str:
    """A hint for a user who sees the speckle of random patterns."""
    return f"Random patterns show speckle. Ctrl+Enter finds patterns that show the target, {target_spec.title}."


def _example_fields() -> dict[str, Any]:
    """The fields of a document that shows the example."""
    hologram = load_hologram(data_dir("assets") / "still-life.safetensors")
    return {
        "system": hologram.system,
        "drive": hologram.drive,
        "target_spec": example_target(),
        "origin": _ORIGIN,
    }
