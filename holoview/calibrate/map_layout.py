"""Chooses which maps the captures can determine, and at which resolution.

With one modulator there are no warp and no maps of relay 1; a Fourier bench has neither maps of relay 2 nor pupil
amplitudes. The degree of the Zernike coefficients' polynomial in the wavelength follows the number of wavelengths.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.model.bench_parts import Relay
from holoview.model.effects.learned_maps import MapLayout, RowsColumns

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
