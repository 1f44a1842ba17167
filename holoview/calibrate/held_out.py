"""Which captures are learned from, and which only judge: other captures, other planes, other wavelengths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.captures.session import Captures
from holoview.errors import UserError

Indices = NDArray[np.intp]

_FEWEST = 4
_PLANES_FOR_ONE, _WAVELENGTHS_FOR_ONE = 3, 4  # from so many on, an inner one is held out whole


@dataclass(frozen=True)
class HeldOut:
    """Indices of captures. train: learned from. captures: of known wavelengths and planes. planes, wavelengths: of
    such that no training capture has.
    """

    train: Indices
    captures: Indices
    planes: Indices
    wavelengths: Indices

    def groups(self) -> dict[str, Indices]:
        """What is scored, by name; empty groups left out."""
        all_of = {"train": self.train, "captures": self.captures, "planes": self.planes}
        all_of["wavelengths"] = self.wavelengths
        return {name: indices for name, indices in all_of.items() if len(indices)}


def hold_out(captures: Captures, share: float = 0.2, seed: int = 0) -> HeldOut:
    """A split: `share` of the captures of every wavelength and plane, an inner plane of three or more, an inner
    wavelength of four or more.

    Raises UserError where too few captures are left to learn from.
    """
    if not 0 < share < 0.8:
        raise UserError("held-out share", f"{share:g}", expected="between 0 and 0.8")
    if len(captures) < _FEWEST:
        found = f"{len(captures)} capture{'s' if len(captures) > 1 else ''}"
        raise UserError("captures", found, expected=f"at least {_FEWEST}: some to learn from and some to judge by")
    of_wavelength = _of_inner(captures.wavelength_m, _WAVELENGTHS_FOR_ONE)
    of_plane = _of_inner(captures.distance_m, _PLANES_FOR_ONE) & ~of_wavelength
    rest = np.flatnonzero(~of_wavelength & ~of_plane)
    chosen = _spread(captures, rest, share, np.random.default_rng(seed))
    train = np.setdiff1d(rest, chosen)
    return HeldOut(train, chosen, np.flatnonzero(of_plane), np.flatnonzero(of_wavelength))


def _of_inner(values: NDArray[np.float64], least: int) -> NDArray[np.bool_]:
    different = np.unique(values)
    if len(different) < least:
        return np.zeros(len(values), dtype=bool)
    return values == different[len(different) // 2]


def _spread(captures: Captures, among: Indices, share: float, rng: np.random.Generator) -> Indices:
    """`share` of the captures of each wavelength and plane, in a random order that visits all groups alike."""
    keys = np.stack([captures.wavelength_m[among], captures.distance_m[among]], axis=1)
    groups = [among[(keys == key).all(axis=1)] for key in np.unique(keys, axis=0)]
    shuffled = [rng.permutation(group) for group in groups]
    count = max(1, round(share * len(among)))
    turns = [
        (place / len(group), number, int(k)) for number, group in enumerate(shuffled) for place, k in enumerate(group)
    ]
    return np.sort(np.array([k for _, _, k in sorted(turns)[:count]], dtype=np.intp))
