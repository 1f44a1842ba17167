"""Which maps a session can tell about, and how fine they may be."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.effects.learned_maps import MapLayout, Pair

_PIXELS_A_NODE = 8  # of the source's maps
_ANCHORS = 4
_PUPIL_NODES = 17
_WARP_NODES = (4, 5)
_NOLL_1 = tuple(range(4, 16))  # piston is nothing; tilts of relay 1 are a shift of modulator 2: the warp's
_NOLL_2 = tuple(range(2, 16))  # tilts of relay 2 shift the picture


def map_layout_for(captures: Captures, train: NDArray[np.intp], pixels_per_node: int = _PIXELS_A_NODE) -> MapLayout:
    """The maps for a session, of whose captures those of `train` are learned from."""
    wavelengths = np.unique(captures.wavelength_m[train])
    two, near = len(captures.slms) == 2, not captures.is_fourier
    return MapLayout(
        modulators=len(captures.slms),
        reference_m=float(wavelengths.mean()),
        anchors_m=_anchors(wavelengths),
        source_nodes=_source_node_counts(captures, pixels_per_node),
        warp_nodes=_WARP_NODES if two else (0, 0),
        noll1=_NOLL_1 if two else (),
        noll2=_NOLL_2 if near else (),
        degree=0 if len(wavelengths) < 2 else 1 if len(wavelengths) < 4 else 2,
        pupil_nodes=(_PUPIL_NODES, _PUPIL_NODES) if near else (0, 0),
        sine1=_pupil_radius_na(captures, captures.iris1_na),
        sine2=_pupil_radius_na(captures, captures.iris2_na),
    )


def _anchors(wavelengths: NDArray[np.float64]) -> tuple[float, ...]:
    count = min(len(wavelengths), _ANCHORS)
    return tuple(float(λ) for λ in np.linspace(wavelengths[0], wavelengths[-1], count))


def _source_node_counts(captures: Captures, pixels_a_node: int) -> Pair:
    rows, columns = (max(3, math.ceil(n / pixels_a_node) + 1) for n in captures.levels.shape[2:])
    return rows, columns


def _pupil_radius_na(captures: Captures, iris_na: float | None) -> float:
    """Radius of an aperture: the iris, or the circle around all directions that are simulated."""
    if iris_na is not None:
        return iris_na
    sample_m = captures.slms[0].pitch_m / captures.upsample
    return min(1.0, math.sqrt(2) * float(captures.wavelength_m.max()) / (2 * sample_m))
