"""Which captures are learned from, and which only judge: other captures, other planes, other wavelengths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.util.errors import UserError

Indices = NDArray[np.intp]

_FEWEST = 4
_MIN_PLANES_TO_HOLD_OUT_ONE, _MIN_WAVELENGTHS_TO_HOLD_OUT_ONE = 3, 4  # from so many on, an inner one is held out whole


@dataclass(frozen=True)
class DataSplit:
    """Indices of captures. train: learned from. captures: of known wavelengths and planes. planes, wavelengths: of
    such that no training capture has.
    """

    train: Indices
    validation: Indices
    unseen_planes: Indices
    unseen_wavelengths: Indices

    def groups(self) -> dict[str, Indices]:
        """What is scored, by name; empty groups left out."""
        all_of = {"train": self.train, "captures": self.validation, "planes": self.unseen_planes}
        all_of["wavelengths"] = self.unseen_wavelengths
        return {name: indices for name, indices in all_of.items() if len(indices)}


def split_captures(captures: Captures, held_out_share: float = 0.2, seed: int = 0) -> DataSplit:
    """A split: `share` of the captures of every wavelength and plane, an inner plane of three or more, an inner
    wavelength of four or more.

    Raises UserError where too few captures are left to learn from.
    """
    if not 0 < held_out_share < 0.8:
        raise UserError("held-out share", f"{held_out_share:g}", expected="between 0 and 0.8")
    if len(captures) < _FEWEST:
        found = f"{len(captures)} capture{'s' if len(captures) > 1 else ''}"
        raise UserError("captures", found, expected=f"at least {_FEWEST}: some to learn from and some to judge by")
    of_wavelength = _inner_value_mask(captures.wavelength_m, _MIN_WAVELENGTHS_TO_HOLD_OUT_ONE)
    of_plane = _inner_value_mask(captures.distance_m, _MIN_PLANES_TO_HOLD_OUT_ONE) & ~of_wavelength
    rest = np.flatnonzero(~of_wavelength & ~of_plane)
    chosen = _stratified_sample(captures, rest, held_out_share, np.random.default_rng(seed))
    train = np.setdiff1d(rest, chosen)
    return DataSplit(train, chosen, np.flatnonzero(of_plane), np.flatnonzero(of_wavelength))


def _inner_value_mask(values: NDArray[np.float64], least: int) -> NDArray[np.bool_]:
    different = np.unique(values)
    if len(different) < least:
        return np.zeros(len(values), dtype=bool)
    return values == different[len(different) // 2]


def _stratified_sample(captures: Captures, among: Indices, share: float, rng: np.random.Generator) -> Indices:
    """`share` of the captures of each wavelength and plane, in a random order that visits all groups alike."""
    keys = np.stack([captures.wavelength_m[among], captures.distance_m[among]], axis=1)
    groups = [among[(keys == key).all(axis=1)] for key in np.unique(keys, axis=0)]
    shuffled = [rng.permutation(group) for group in groups]
    count = max(1, round(share * len(among)))
    turns = [
        (place / len(group), number, int(k)) for number, group in enumerate(shuffled) for place, k in enumerate(group)
    ]
    return np.sort(np.array([k for _, _, k in sorted(turns)[:count]], dtype=np.intp))
