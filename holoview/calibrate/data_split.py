"""Splits captures into those that are trained on and those that only judge: unseen captures, planes and wavelengths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.util.errors import UserError

Indices = NDArray[np.intp]

_MIN_CAPTURES = 4
_MIN_PLANES_TO_HOLD_OUT_ONE = 3
_MIN_WAVELENGTHS_TO_HOLD_OUT_ONE = 4


@dataclass(frozen=True)
class DataSplit:
    """Indices of captures, each (n,) and ascending; the four sets are disjoint.

    train: captures whose images the maps are fitted to.
    validation: captures of the same wavelengths and planes; they choose the epoch whose maps are kept.
    unseen_planes: all captures of one plane that `train` lacks; empty with fewer than three planes.
    unseen_wavelengths: all captures of one wavelength that `train` lacks; empty with fewer than four wavelengths.
    """

    train: Indices
    validation: Indices
    unseen_planes: Indices
    unseen_wavelengths: Indices

    def groups(self) -> dict[str, Indices]:
        """The sets that aren't empty, by the names under which their scores are written."""
        groups = {
            "train": self.train,
            "captures": self.validation,
            "planes": self.unseen_planes,
            "wavelengths": self.unseen_wavelengths,
        }
        return {name: indices for name, indices in groups.items() if len(indices)}


def split_captures(captures: Captures, held_out_share: float = 0.2, seed: int = 0) -> DataSplit:
    """Splits captures at random, with the same share of every wavelength and plane in the validation set.

    The middle one of three or more planes and the middle one of four or more wavelengths are held out whole: maps
    that hold between the planes and wavelengths of the training predict them, too.

    held_out_share: validation captures as a share of those that aren't held out whole, between 0 and 0.8.
    seed: of the random choice.

    Raises UserError for fewer than four captures or a share outside its range.
    """
    if not 0 < held_out_share < 0.8:
        raise UserError("held-out share", f"{held_out_share:g}", expected="between 0 and 0.8")
    if len(captures) < _MIN_CAPTURES:
        found = f"{len(captures)} capture{'s' if len(captures) > 1 else ''}"
        raise UserError(
            "captures", found, expected=f"at least {_MIN_CAPTURES}: some to learn from and some to judge by"
        )
    of_wavelength = _middle_value_mask(captures.wavelength_m, _MIN_WAVELENGTHS_TO_HOLD_OUT_ONE)
    of_plane = _middle_value_mask(captures.distance_m, _MIN_PLANES_TO_HOLD_OUT_ONE) & ~of_wavelength
    rest = np.flatnonzero(~of_wavelength & ~of_plane)
    validation = _stratified_sample(captures, rest, held_out_share, np.random.default_rng(seed))
    train = np.setdiff1d(rest, validation)
    return DataSplit(train, validation, np.flatnonzero(of_plane), np.flatnonzero(of_wavelength))


def _middle_value_mask(values: NDArray[np.float64], min_distinct: int) -> NDArray[np.bool_]:
    """Mask of the captures at the middle one of the distinct values; nowhere true if these are fewer than a minimum."""
    distinct = np.unique(values)
    if len(distinct) < min_distinct:
        return np.zeros(len(values), dtype=bool)
    return values == distinct[len(distinct) // 2]


def _stratified_sample(captures: Captures, indices: Indices, share: float, rng: np.random.Generator) -> Indices:
    """A share (at least one) of some captures, which takes the same share of each wavelength and plane."""
    keys = np.stack([captures.wavelength_m[indices], captures.distance_m[indices]], axis=1)
    groups = [indices[(keys == key).all(axis=1)] for key in np.unique(keys, axis=0)]
    shuffled = [rng.permutation(group) for group in groups]
    ranked = [
        (rank / len(group), number, int(k)) for number, group in enumerate(shuffled) for rank, k in enumerate(group)
    ]
    count = max(1, round(share * len(indices)))
    return np.sort(np.array([k for _, _, k in sorted(ranked)[:count]], dtype=np.intp))
