"""Which captures are fitted and which are held out.

Smooth patterns stay linear for longer: an error decorrelates the speckle of rough patterns before that of smooth ones.
So a search begins with the smoothest captures and goes on, coarse to fine, to rougher ones; judgement is passed on
captures that no fit has seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures

Indices = NDArray[np.intp]

_MOST_COARSE, _MOST_FINE, _MOST_ROUGH, _MOST_HELD_OUT = 6, 12, 18, 16  # so that the cost doesn't grow with the session


@dataclass(frozen=True)
class CaptureSplit:
    """coarse: the smoothest of each wavelength. fine: these and rougher ones. rough: these and the roughest that are
    left. held_out: disjoint from all."""

    coarse: Indices
    fine: Indices
    rough: Indices
    held_out: Indices


def split_captures(captures: Captures, roughness: NDArray[np.float64]) -> CaptureSplit:
    """The captures to search, fit and judge on; in each, wavelengths take turns and then planes.

    Half of the captures of a wavelength at most are held out; with one capture a wavelength some wavelengths are.
    """
    groups = _by_wavelength(captures, roughness)
    if len(captures) < 2 * len(groups):
        return _split_scarce(groups)
    coarse = [group[0] for group in groups]
    rest = [group[1:] for group in groups]
    held_out = [k for group in rest for k in _pick_held_out(group, captures, min(2, max(1, len(group) - 1)))]
    left = [[k for k in group if k not in held_out] for group in rest]
    fine = coarse + [group[len(group) // 2] for group in left if group]
    rough_too = fine + [group[-1] for group in left if len(group) > 1]
    return CaptureSplit(
        _evenly_spaced(coarse, _MOST_COARSE),
        _evenly_spaced(fine, _MOST_FINE),
        _evenly_spaced(rough_too, _MOST_ROUGH),
        _evenly_spaced(held_out, _MOST_HELD_OUT),
    )


def _by_wavelength(captures: Captures, rough: NDArray[np.float64]) -> list[list[int]]:
    """Indices of each wavelength's captures, smoothest first; groups start at different planes in turn."""
    groups = []
    planes = np.unique(captures.distance_m)
    for turn, wavelength in enumerate(captures.wavelengths_m):
        group = [int(k) for k in np.argsort(rough, kind="stable") if captures.wavelength_m[k] == wavelength]
        first = next((k for k in group if captures.distance_m[k] == planes[turn % len(planes)]), group[0])
        groups.append([first, *(k for k in group if k != first)])
    return groups


def _pick_held_out(group: list[int], captures: Captures, count: int) -> list[int]:
    """`count` of a group: one from the smoother and one from the rougher half, of different planes where there are."""
    if count < 2:
        return [group[len(group) // 2]] if group else []
    first = group[len(group) // 4]
    others = [k for k in group[len(group) // 2 :] if k != first]
    other_plane = [k for k in others if captures.distance_m[k] != captures.distance_m[first]]
    choice = other_plane or others
    return [first, choice[len(choice) // 2]]


def _split_scarce(groups: list[list[int]]) -> CaptureSplit:
    """So few captures that wavelengths must be held out whole: every third one, at least one."""
    everything = [k for group in groups for k in group]
    held_out = everything[1::3] or everything[-1:]
    fitted = [k for k in everything if k not in held_out] or everything
    fine = _evenly_spaced(fitted, _MOST_FINE)
    return CaptureSplit(_evenly_spaced(fitted, _MOST_COARSE), fine, fine, _evenly_spaced(held_out, _MOST_HELD_OUT))


def _evenly_spaced(indices: list[int], most: int) -> Indices:
    """At most so many, evenly spread over the list."""
    chosen = np.asarray(indices, dtype=np.intp)
    if len(chosen) <= most:
        return chosen
    return chosen[np.unique(np.linspace(0, len(chosen) - 1, most).round().astype(int))]


def spread_over_wavelengths(captures: Captures, indices: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """At most so many of some captures, of wavelengths as different as can be."""
    order = indices[np.argsort(captures.wavelength_m[indices], kind="stable")]
    return order[np.unique(np.linspace(0, len(order) - 1, count).round().astype(int))]
