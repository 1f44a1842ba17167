"""Where the eye of a system is focused: its planes at its reference wavelength, and their shift at the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from holoview.model.eye import VERGENCE, Eye
from holoview.model.system import System
from holoview.util import units
from holoview.util.errors import UserError


def focused_planes(system: System) -> NDArray[np.float64]:
    """Distances (plane,) of the focal planes, or of those on which the system's eye is focused.

    Raises UserError for an accommodation out of the range of planes.
    """
    eye = system.eye
    if eye is None or eye.accommodation_dpt is None:
        return system.planes_m
    planes_m = eye.plane_m(eye.accommodation_dpt, system.planes_m)
    _check_focus(system, planes_m, np.zeros(1), system.wavelengths_m[:1])
    return planes_m


def eyes_at(system: System, planes: int, places_m: Sequence[tuple[float, float]]) -> tuple[Eye, ...]:
    """The eye that sees each plane from each of some places (y, x), (place · plane,); from its own place without any.

    Empty without an eye. Raises UserError for places without an eye.
    """
    if system.eye is None and not places_m:
        return ()
    eye = required_eye(system, "pupil places")
    eyes = [eye.moved_to(place) for place in places_m] or [eye]
    return tuple(eye for eye in eyes for _ in range(planes))


def required_eye(system: System, where: str) -> Eye:
    """The eye of a system for what needs one. Raises UserError, at `where`, if there is none."""
    if system.eye is None:
        raise UserError(where, "without an eye", expected="a bench with an eye", remedy="switch it on: --set eye={}")
    return system.eye


def with_pupil_at(system: System, place_m: tuple[float, float]) -> System:
    """A system whose eye has its pupil at a place (y, x) of the eyebox. Raises UserError without an eye."""
    return system.with_(eye=required_eye(system, "pupil places").moved_to(place_m))


def plane_label(system: System, plane_m: float, digits: int | None = None) -> str:
    """A plane in words: "10 mm", with an eye "10 mm (0.625 D)".

    digits: significant digits of the millimetres; None for all.
    """
    text = units.format_exact(plane_m, "mm") if digits is None else units.format_rounded(plane_m, "mm", digits)
    if system.eye is None:
        return text
    return f"{text} ({float(system.eye.dioptres(plane_m, system.planes_m)) + 0.0:.3g} D)"


def parse_plane(system: System, text: str, where: str) -> float:
    """The distance (m) of a plane from text: "10 mm", or with an eye "0.5 D".

    Raises UserError for text of another kind, for dioptres without an eye, for a plane before the last modulator, and
    for one too far from a field.
    """
    if not text.rstrip().endswith("D"):
        plane_m = units.parse(text, where)
    elif system.eye is None:
        raise UserError(
            where, f"{text} without an eye", expected='a distance such as "10 mm"', remedy="switch it on: --set eye={}"
        )
    else:
        plane_m = float(system.eye.plane_m(units.parse(text, where, "vergence"), system.planes_m))
    if system.is_field:
        system.plane_type.parse([plane_m], where)
    elif plane_m < 0:
        raise UserError(
            where, f"{text} lies before the last modulator", expected="0 mm or more behind it, where its light goes"
        )
    return plane_m


def parse_planes(system: System, planes: Sequence[float | str] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Distances of a system's planes in metres, from numbers or text.

    Raises UserError for an empty list or a wrong distance.
    """
    read = system.plane_type.parse(planes, "planes")
    if read is None or len(read) == 0:
        raise UserError("planes", "an empty list", expected="at least one distance")
    return read


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
    low, high = system.plane_type.item.low, system.plane_type.item.high
    outside = np.argwhere((distances_m < low) | (distances_m > high))
    if len(outside) == 0:
        return
    plane, wavelength = outside[0]
    ends = system.eye.dioptres(np.array([low - min(shift_m.min(), 0), high - max(shift_m.max(), 0)]), system.planes_m)
    ends = np.clip(ends, VERGENCE.low, VERGENCE.high)
    raise UserError(
        "eye",
        f"focused at {float(system.eye.dioptres(planes_m[plane], system.planes_m)):.3g} D it sees the plane at "
        f"{units.format_rounded(float(distances_m[plane, wavelength]), 'mm')} at "
        f"{units.format_rounded(float(wavelengths_m[wavelength]), 'nm')}",
        expected=f"planes from the last modulator to {units.format_rounded(high, 'm')} behind it: "
        f"accommodations from {ends[0]:.3g} D to {ends[1]:.3g} D",
        remedy="change eye.accommodation, eye.infinity or eye.eyepiece",
    )
