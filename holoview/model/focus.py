"""Where the eye of a system is focused: its planes at its reference wavelength, and their shift at the others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from holoview.model.system import PLANE_DISTANCES, System
from holoview.util import units
from holoview.util.errors import UserError


def focused_planes(system: System) -> NDArray[np.float64]:
    """Distances (plane,) of the focal planes, or of those on which the system's eye is focused.

    Raises UserError for an accommodation before the modulator or beyond 1 m.
    """
    eye = system.eye
    if eye is None or eye.accommodation_dpt is None:
        return system.planes_m
    planes_m = eye.plane_m(eye.accommodation_dpt, system.planes_m)
    _check_focus(system, planes_m, np.zeros(1), system.wavelengths_m[:1])
    return planes_m


def focus_shift(
    system: System, planes_m: NDArray[np.float64], wavelengths_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """How much further the eye of a system is focused at each wavelength, m; 0 without an eye."""
    if system.eye is None:
        return np.zeros(len(wavelengths_m))
    shift_m = system.eye.focus_shift_m(wavelengths_m)
    _check_focus(system, planes_m, shift_m, wavelengths_m)
    return shift_m


def _check_focus(
    system: System, planes_m: NDArray[np.float64], shift_m: NDArray[np.float64], wavelengths_m: NDArray[np.float64]
) -> None:
    """Raises UserError if an eye is focused before the last modulator or too far behind it at any wavelength."""
    assert system.eye is not None
    distances_m = planes_m[:, None] + shift_m[None, :]
    low, high = PLANE_DISTANCES.item.low, PLANE_DISTANCES.item.high
    outside = np.argwhere((distances_m < low) | (distances_m > high))
    if len(outside) == 0:
        return
    plane, wavelength = outside[0]
    ends = system.eye.dioptres(np.array([low - min(shift_m.min(), 0), high - max(shift_m.max(), 0)]), system.planes_m)
    raise UserError(
        "eye",
        f"focused at {float(system.eye.dioptres(planes_m[plane], system.planes_m)):.3g} D it sees the plane at "
        f"{units.format_rounded(float(distances_m[plane, wavelength]), 'mm')} at "
        f"{units.format_rounded(float(wavelengths_m[wavelength]), 'nm')}",
        expected=f"planes from the last modulator to {units.format_rounded(high, 'm')} behind it: "
        f"accommodations from {ends[0]:.3g} D to {ends[1]:.3g} D",
        remedy="change eye.accommodation, eye.infinity or eye.eyepiece",
    )
