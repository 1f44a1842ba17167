"""Which captures are searched, which are fitted, and which are held out.

An error of the model decorrelates the speckle of rough patterns before that of smooth patterns, so that smooth captures
depend on the error almost linearly over a wider range. A search therefore begins with the smoothest captures and adds
rougher ones; candidates are ranked on captures that no fit has used.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Captures

Indices = NDArray[np.intp]

# The cost must not grow with the number of captures; the search study used one capture of each wavelength for
# screening, two for joint fits. Rough captures show small errors.
_MAX_COARSE = 6  # captures that a screening uses
_MAX_FINE = 12  # captures that a joint fit uses
_MAX_ROUGH = 18  # captures that a search along axes uses
_MAX_HELD_OUT = 16  # captures that candidates are ranked on
_HELD_OUT_PER_WAVELENGTH = 2  # if enough are left to fit (search study)
_SCARCE_STRIDE = 3  # with fewer than two captures a wavelength, one of so many is held out
MAX_SET_PIXELS = 8_000_000
"""[px] Of the pictures in one set, but a picture of each wavelength at least. Measured: a fit keeps some ten arrays of
these pixels and one for each parameter, of four bytes a pixel, in every process."""


@dataclass(frozen=True)
class CaptureSplit:
    """Indices of captures, in which wavelengths take turns.

    coarse: the smoothest of each wavelength. fine: these and rougher captures. rough: these and the roughest of each.
    held_out: disjoint from all of them.
    """

    coarse: Indices
    fine: Indices
    rough: Indices
    held_out: Indices

    @property
    def used(self) -> frozenset[int]:
        """All captures that a search looks at."""
        return frozenset(int(k) for part in (self.coarse, self.fine, self.rough, self.held_out) for k in part)


def split_captures(
    captures: Captures,
    roughness: NDArray[np.float64],
    left_out: Collection[int] = (),
    max_pixels: int = MAX_SET_PIXELS,
) -> CaptureSplit:
    """The captures to search, fit and rank on, of every plane if there are enough.

    roughness: of each capture's patterns. left_out: captures that no set contains; at least two others remain. Of each
    wavelength at least one capture is fitted; with fewer than two captures a wavelength, whole wavelengths are held
    out, and with one capture in each plane, whole planes. Of large pictures each set has fewer, so that their pixels
    fit into memory.
    """
    groups = _by_wavelength(captures, roughness, left_out)
    most = max(max_pixels // captures.images[0].size, len(groups))
    sizes = [min(size, most) for size in (_MAX_COARSE, _MAX_FINE, _MAX_ROUGH, _MAX_HELD_OUT)]
    if sum(len(group) for group in groups) < 2 * len(groups):
        return _split_scarce(groups, sizes)
    coarse = [group[0] for group in groups]
    spare = [k for group in groups if len(group) > 2 for k in group[1:]]  # with one to hold out beside it
    coarse += _of_missing_planes(coarse, spare, captures, roughness, sizes[0])
    rest = [[k for k in group if k not in coarse] for group in groups]
    if not any(rest):  # every capture shows a plane of its own
        return _split_scarce(groups, sizes)
    held_out = [
        k
        for group in rest
        for k in _pick_held_out(group, captures, min(_HELD_OUT_PER_WAVELENGTH, max(1, len(group) - 1)))
    ]
    left = [[k for k in group if k not in held_out] for group in rest]
    held_out += _of_missing_planes(held_out, [k for one in left for k in one], captures, roughness, sizes[3])
    left = [[k for k in group if k not in held_out] for group in left]
    fine = coarse + [group[len(group) // 2] for group in left if group]
    rough = fine + [group[-1] for group in left if len(group) > 1]
    return CaptureSplit(*(_at_most(part, n) for part, n in zip((coarse, fine, rough, held_out), sizes, strict=True)))


def _by_wavelength(captures: Captures, roughness: NDArray[np.float64], left_out: Collection[int]) -> list[list[int]]:
    """Indices of each wavelength's captures, smoothest first; groups start at different planes in turn."""
    groups = []
    planes = np.unique(captures.distance_m)
    ordered = [int(k) for k in np.argsort(roughness, kind="stable") if k not in left_out]
    for turn, wavelength in enumerate(np.unique(captures.wavelength_m[ordered])):
        group = [k for k in ordered if captures.wavelength_m[k] == wavelength]
        first = next((k for k in group if captures.distance_m[k] == planes[turn % len(planes)]), group[0])
        groups.append([first, *(k for k in group if k != first)])
    return groups


def _pick_held_out(group: list[int], captures: Captures, count: int) -> list[int]:
    """One or two of a group: one from the smoother and one from the rougher half, of different planes if possible."""
    if count < 2:
        return [group[len(group) // 2]] if group else []
    first = group[len(group) // 4]
    others = [k for k in group[len(group) // 2 :] if k != first]
    other_plane = [k for k in others if captures.distance_m[k] != captures.distance_m[first]]
    choice = other_plane or others
    return [first, choice[len(choice) // 2]]


def _of_missing_planes(
    chosen: list[int], spare: list[int], captures: Captures, roughness: NDArray[np.float64], most: int
) -> list[int]:
    """The smoothest spare capture of each plane that no chosen capture shows, until `most` are chosen."""
    found: list[int] = []
    for plane in np.setdiff1d(captures.distance_m, captures.distance_m[chosen]):
        own = [k for k in spare if captures.distance_m[k] == plane]
        if own and len(chosen) + len(found) < most:
            found.append(min(own, key=lambda k: roughness[k]))
    return found


def _split_scarce(groups: list[list[int]], sizes: list[int]) -> CaptureSplit:
    """The split of few captures, of which whole wavelengths or planes are held out, at least one capture."""
    everything = [k for group in groups for k in group]
    held_out = everything[1::_SCARCE_STRIDE] or everything[-1:]
    fitted = [k for k in everything if k not in held_out] or everything
    fine = _at_most(fitted, sizes[1])
    return CaptureSplit(_at_most(fitted, sizes[0]), fine, fine, _at_most(held_out, sizes[3]))


def _at_most(indices: list[int], count: int) -> Indices:
    """All indices, or `count` that are evenly spaced over the list."""
    chosen = np.asarray(indices, dtype=np.intp)
    return chosen if len(chosen) <= count else _evenly_spaced(chosen, count)


def _evenly_spaced(indices: Indices, count: int) -> Indices:
    return indices[np.unique(np.linspace(0, len(indices) - 1, count).round().astype(int))]


def spread_over_wavelengths(captures: Captures, indices: Indices, count: int) -> Indices:
    """At most `count` of some captures, with wavelengths as different as possible."""
    return _evenly_spaced(indices[np.argsort(captures.wavelength_m[indices], kind="stable")], count)
