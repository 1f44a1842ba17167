"""Edits of the eye of a session, and what the panel of the eye draws of it. Lengths are metres, places (y, x)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from holoview.document.editing_session import EditingSession
from holoview.model.eye import Eye
from holoview.model.system import System
from holoview.util.errors import UserError

Place = tuple[float, float]

PUPIL_RANGE_M = (0.5e-3, 8e-3)
"""Diameters that the wheel reaches."""


def toggle_eye(session: EditingSession) -> None:
    """Puts an eye behind an eyepiece, or takes it away."""
    session.change("Eye", {"eye": {} if session.system.eye is None else None})


def toggle_chromatic(session: EditingSession) -> None:
    """Switches the chromatic aberration of the eye; with none, an eye is put in place. Raises UserError as edits do."""
    eye = session.system.eye
    session.change("Chromatic aberration", {"eye.chromatic": eye is None or not eye.chromatic})


def move_pupil(session: EditingSession, place_m: Place) -> None:
    """Moves the pupil to a place in the eyebox or near it; successive moves are one step of undo."""
    half = 1.5 * eyebox_half_m(session.system)
    y, x = (float(f"{min(max(p, -half), half):.4g}") for p in place_m)
    session.change("Pupil", {"eye.pupil_y": y, "eye.pupil_x": x}, merge_key="pupil")


def resize_pupil(session: EditingSession, factor: float) -> None:
    """Multiplies the diameter of the pupil, which stays within `PUPIL_RANGE_M`."""
    low, high = PUPIL_RANGE_M
    diameter = min(max(pupil_diameter_m(session.system) * factor, low), high)
    session.change("Pupil", {"eye.pupil": float(f"{diameter:.3g}")}, merge_key="pupil size")


def eye_of(system: System) -> Eye:
    """The eye of a system. Raises UserError where there is none."""
    if system.eye is None:
        raise UserError("eye", "there is none", remedy="switch it on in the panel Eye")
    return system.eye


def pupil_diameter_m(system: System) -> float:
    """Diameter of the pupil of a system's eye."""
    return eye_of(system).pupil_diameter_m(system.field_m)


def eyebox_half_m(system: System, wavelength_m: float | None = None) -> float:
    """Half the side of the eyebox of the first order in the plane of the pupil, at a wavelength or the longest one."""
    λ = float(system.wavelengths_m.max()) if wavelength_m is None else wavelength_m
    return eye_of(system).eyepiece_m * λ / (2 * system.modulators[0].pitch_m)


def seen_planes_m(system: System, plane_m: float, wavelengths_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The plane on which an eye is focused at each wavelength, (wavelength,), that is at `plane_m` at its reference."""
    return plane_m + eye_of(system).focus_shift_m(wavelengths_m)


def dioptres_of(system: System, plane_m: float) -> float:
    """The vergence at which a plane appears to the eye of a system."""
    return float(eye_of(system).dioptres(plane_m, system.planes_m))


def dioptres_text(system: System, plane_m: float) -> str:
    """That vergence with its unit; planes that differ by rounding alone read alike."""
    return f"{round(round(dioptres_of(system, plane_m), 9), 2) + 0.0:.2f} D"


def plane_of(system: System, dioptres: float) -> float:
    """The plane that appears at a vergence."""
    return float(eye_of(system).plane_m(dioptres, system.planes_m))
