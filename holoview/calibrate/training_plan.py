"""The plan of a calibration, made before the training begins: settings, captures, maps.

CalibrationSettings, LEARNING_RATES    epochs, batch, rate; the learning rate of each tensor
split_captures                         the captures that are trained on, and those that only judge
map_layout_for                         the maps that the captures can determine, and their resolution
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.model.bench_parts import Relay
from holoview.model.effects.learned_maps import MapLayout, RowsColumns
from holoview.util.errors import UserError

LEARNING_RATES: Mapping[str, float] = {
    "lut_steps": 0.03,
    "fringing_px2": 0.01,
    "source_log_amplitude": 0.02,
    "source_opd_m": 5e-9,
    "warp_m": 0.25e-6,
    "zernike1_m": 5e-9,
    "zernike2_m": 5e-9,
    "pupil1_log_amplitude": 0.02,
    "pupil2_log_amplitude": 0.02,
}
"""First step of Adam for each tensor, in the tensor's unit; `CalibrationSettings.rate` multiplies all of them."""

ADAM_BETAS = (0.9, 0.95)

ADAM_FLOOR = 0.1
"""Lower bound of Adam's denominator as a share of its r.m.s. over a tensor (`rms_floor`).

Elements that the captures hardly determine, whose gradients are mostly noise, then move less than the others.
"""

_MIN_EPOCHS, _MIN_STEPS = 40, 300  # of a calibration without --epochs


def default_epochs(captures: int, batch: int) -> int:
    """Epochs for a number of training captures: at least 300 steps and at least 40 epochs."""
    return max(_MIN_EPOCHS, math.ceil(_MIN_STEPS / math.ceil(captures / batch)))


@dataclass(frozen=True)
class CalibrationSettings:
    """How to train. The field names are keys of checkpoints and appear in error messages.

    epochs: number of passes over the training captures.
    batch: captures per step.
    rate: factor on all LEARNING_RATES.
    seed: of the order of the captures and of the choice of validation captures.
    share: of the captures that is held out for validation, see `split_captures`.
    """

    epochs: int = 40
    batch: int = 4
    rate: float = 1.0
    seed: int = 0
    share: float = 0.2

    def __post_init__(self) -> None:
        for name, low, high in (("epochs", 1, 100_000), ("batch", 1, 10_000)):
            value = getattr(self, name)
            if not low <= value <= high:
                raise UserError(name, str(value), expected=f"{low} to {high}")
        if not 0 < self.rate <= 100:
            raise UserError("rate", f"{self.rate:g}", expected="above 0, at most 100")


Indices = NDArray[np.intp]


# --- captures that are trained on, and captures that only judge ---


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


# --- maps that the captures can determine ---


_SOURCE_PIXELS_PER_NODE = 8
_MAX_ANCHORS = 4
_PUPIL_NODES = 17
_WARP_NODES = (4, 5)
_NOLL_1 = tuple(range(4, 16))  # without tilts: a tilt in relay 1 shifts the field on modulator 2, as the warp does
_NOLL_2 = tuple(range(2, 16))  # with tilts, which shift the camera's image; a piston changes no intensity


def map_layout_for(
    captures: Captures, train: NDArray[np.intp], pixels_per_node: int = _SOURCE_PIXELS_PER_NODE
) -> MapLayout:
    """The layout of the maps that captures of the indices `train` (n,) can determine.

    pixels_per_node: modulator pixels per node and axis of the source's maps.
    """
    wavelengths = np.unique(captures.wavelength_m[train])
    has_two_slms, has_camera_relay = len(captures.slms) == 2, not captures.is_fourier
    return MapLayout(
        modulators=len(captures.slms),
        reference_m=float(wavelengths.mean()),
        anchors_m=_anchors(wavelengths),
        source_nodes=_source_node_counts(captures, pixels_per_node),
        warp_nodes=_WARP_NODES if has_two_slms else (0, 0),
        noll1=_NOLL_1 if has_two_slms else (),
        noll2=_NOLL_2 if has_camera_relay else (),
        degree=0 if len(wavelengths) < 2 else 1 if len(wavelengths) < 4 else 2,
        pupil_nodes=(_PUPIL_NODES, _PUPIL_NODES) if has_camera_relay else (0, 0),
        sine1=_pupil_radius_na(captures, captures.relay1),
        sine2=_pupil_radius_na(captures, captures.relay2),
    )


def _anchors(wavelengths: NDArray[np.float64]) -> tuple[float, ...]:
    """Wavelengths at which the source's maps are stored, evenly spaced; between them they are interpolated."""
    count = min(len(wavelengths), _MAX_ANCHORS)
    return tuple(float(λ) for λ in np.linspace(wavelengths[0], wavelengths[-1], count))


def _source_node_counts(captures: Captures, pixels_per_node: int) -> RowsColumns:
    rows, columns = (max(3, math.ceil(n / pixels_per_node) + 1) for n in captures.levels.shape[2:])
    return rows, columns


def _pupil_radius_na(captures: Captures, relay: Relay) -> float:
    """Radius of a relay's pupil in direction sines, of all wavelengths the largest.

    Without an iris or a square stop that of the circle around all simulated directions.
    """
    pitch_m = captures.slms[0].pitch_m
    if relay.has_aperture:
        return max(relay.pupil_radius_sine(float(λ), pitch_m) for λ in captures.wavelengths_m)
    sample_m = pitch_m / captures.upsample
    return min(1.0, math.sqrt(2) * float(captures.wavelength_m.max()) / (2 * sample_m))
