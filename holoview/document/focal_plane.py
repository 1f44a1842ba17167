"""Moving the focal plane of a session: by steps, to the planes of the system, or to any distance in its range."""

from __future__ import annotations

import numpy as np

from holoview.document.editing_session import EditingSession
from holoview.model.system import System
from holoview.util.errors import UserError

SAME_PLANE_M = 1e-9
"""Planes that are closer to each other than this are the same."""
_STEP_FRACTION = 0.02  # of the range, for one step


def focus_range_m(system: System) -> tuple[float, float]:
    """The distances in metres that can be focused at: the system's planes with a margin of half their range.

    An eye sees other wavelengths in other planes, none of which lies before the modulator.
    """
    low, high = float(system.planes_m.min()), float(system.planes_m.max())
    margin = 0.5 * (high - low) or 0.2 * high
    least = 0.0 if system.eye is None else -float(min(system.eye.focus_shift_m(system.wavelengths_m).min(), 0.0))
    return max(low - margin, least), high + margin


def focus_at(session: EditingSession, plane_m: float) -> None:
    """Moves the focal plane to a distance, clipped to `focus_range_m`; successive moves are one step of undo."""
    low, high = focus_range_m(session.system)
    plane_m = float(f"{min(max(plane_m, low), high):.7g}")
    session.edit_view("Focal plane", merge_key=("plane_m",), plane_m=plane_m)


def focus_on(session: EditingSession, row: int, column: int) -> None:
    """Moves the focal plane to what the target shows at a sample of the image.

    Raises UserError without a target, and for a focal stack, whose pictures don't tell what is where.
    """
    if session.target_spec is None:
        raise UserError("focus", "there is no target", expected="a picture with a depth map", remedy="open one")
    focus_at(session, session.target_spec.depth_at(session.system, row, column))


def step_focus(session: EditingSession, steps: float) -> None:
    """Moves the focal plane by steps of 2 % of the range; positive is nearer to the viewer, at larger z."""
    low, high = focus_range_m(session.system)
    focus_at(session, session.view_settings.plane_m + steps * _STEP_FRACTION * (high - low))


def focus_at_next_plane(session: EditingSession, direction: int) -> None:
    """Moves to the next of the system's planes: nearer to the viewer for a positive direction, else farther."""
    planes, here = np.sort(session.system.planes_m), session.view_settings.plane_m
    ahead = planes[planes > here + SAME_PLANE_M] if direction > 0 else planes[planes < here - SAME_PLANE_M][::-1]
    if len(ahead):
        focus_at(session, float(ahead[0]))
