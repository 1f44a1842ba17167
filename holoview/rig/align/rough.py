"""Orientation and rough place of a modulator on the camera, from single dots, without knowing either before."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.captures.orientations import nearest_orientation, orientation_matrix
from holoview.rig.align.dots import brightest_dot
from holoview.rig.align.probes import Optics, Probes, flat_levels, grating, single_lens
from holoview.rig.devices import DeviceError, Levels

_PLACES = ((-0.28, -0.25), (-0.22, 0.27), (0.27, -0.2), (0.23, 0.28), (0.05, -0.03))  # shares of height and width
_FOURIER_REACH = 0.25  # share of the camera's width within which dots are put
_LEAST_CONTRAST = 8.0  # over the noise; 4.5 is the highest of 10⁵ independent pixels of pure noise
_LARGEST_MISFIT = 0.15  # of the dots' extent, from a mirrored, turned and scaled copy of what was shown
SINGLE_DOTS = len(_PLACES) + 1
"""Pictures that it takes."""

Floats = NDArray[np.float64]
TakePicture = Callable[[Levels, str], Floats]


@dataclass(frozen=True)
class RoughPlace:
    """turn: of what is displayed on the picture. pitch_m: of the camera, seen from the modulator. centre_px: (y, x)."""

    turn: str
    pitch_m: float
    centre_px: Floats


def find_roughly(
    optics: Optics, number: int, distance_m: float, camera_width_m: float, take: TakePicture
) -> RoughPlace:
    """Shows dots one by one on one modulator. take: the picture of its pattern, the other modulator being flat.

    number: 1 or 2, for messages. distance_m: from it to the camera, nominally. camera_width_m: of the shorter side.
    Raises DeviceError where the dots aren't seen, or not where any place of the camera could have them.
    """
    dark = take(flat_levels(optics), f"modulator {number} flat")
    probes = _single_dots(optics, distance_m, camera_width_m)
    width_px = probes[0].width_m / (camera_width_m / min(dark.shape))
    found = [brightest_dot(take(p.levels, f"dot on modulator {number}") - dark, width_px) for p in probes]
    seen = [k for k, (_, contrast) in enumerate(found) if contrast >= _LEAST_CONTRAST]
    if len(seen) < len(probes) - 1:
        raise DeviceError(
            "camera",
            f"sees {len(seen)} of the {len(probes)} dots that modulator {number} showed",
            remedy="look whether the laser's light reaches the camera, whether the camera sees the whole modulator, "
            f"and whether slm{number}, [lasers] and [geometry] of rig.toml are as on the bench",
        )
    shown = np.concatenate([_nominal_point(p, optics) for p in probes])[seen]
    return _place(shown, np.array([found[k][0] for k in seen]), number)


def _single_dots(optics: Optics, distance_m: float, camera_width_m: float) -> list[Probes]:
    if optics.focal_length_m is None:
        extent = np.array(optics.shape) * optics.slm.pitch_m
        return [single_lens(optics, (y * extent[0], x * extent[1]), distance_m) for y, x in _PLACES]
    reach = fourier_carrier(optics, camera_width_m) / max(abs(share) for place in _PLACES[:-1] for share in place)
    places = [*_PLACES[:-1], (0.0, 0.25)]
    return [grating(optics, (y * reach, x * reach)) for y, x in places]


def fourier_carrier(optics: Optics, camera_width_m: float) -> float:
    """Spatial frequency (1/m) whose dot lies well on the camera of a Fourier bench."""
    assert optics.focal_length_m is not None
    on_camera = _FOURIER_REACH * camera_width_m / (optics.wavelength_m * optics.focal_length_m)
    return min(optics.carrier, on_camera)


def _nominal_point(probes: Probes, optics: Optics) -> Floats:
    """Where the dots of a probe without a carrier, or on a Fourier bench, lie nominally (dot, 2), m."""
    if optics.focal_length_m is None:
        return probes.centre_m
    return optics.focal_length_m * optics.wavelength_m * probes.frequency


def _place(shown_m: Floats, seen_px: Floats, number: int) -> RoughPlace:
    """Turn, scale and shift from what was shown (dot, 2) to what was seen, without the worst dot if that helps."""
    best: tuple[float, Floats] | None = None
    for left_out in [None, *range(len(shown_m))] if len(shown_m) > 4 else [None]:
        kept = [k for k in range(len(shown_m)) if k != left_out]
        design = np.column_stack([shown_m[kept], np.ones(len(kept))])
        solution, *_ = np.linalg.lstsq(design, seen_px[kept], rcond=None)
        misfit = float(np.abs(design @ solution - seen_px[kept]).max())
        if best is None or misfit < 0.3 * best[0]:
            best = (misfit, np.asarray(solution, dtype=np.float64))
    assert best is not None
    misfit, solution = best
    matrix = solution[:2].T
    turn, extent = nearest_orientation(matrix), float(np.ptp(seen_px, axis=0).max())
    scale = float((orientation_matrix(turn) * matrix).sum()) / 2
    skew = float(np.abs(matrix - scale * orientation_matrix(turn)).max())
    if scale <= 0 or misfit > _LARGEST_MISFIT * extent or skew > 2 * _LARGEST_MISFIT * scale:
        raise DeviceError(
            "camera",
            f"sees the dots of modulator {number} where no mirrored, turned or shifted picture of them has them",
            remedy="look for reflections and for other light, and whether the camera sees the whole modulator",
        )
    return RoughPlace(turn, 1 / scale, solution[2])


def rectified_centre(centre_px: Floats, raw_shape: Sequence[int], camera_turn: str) -> Floats:
    """A place (y, x) on the raw picture as one on the picture turned back."""
    middle = (np.array(raw_shape) - 1) / 2
    turned_back = orientation_matrix(camera_turn).T @ (centre_px - middle)
    shape = np.abs(orientation_matrix(camera_turn).T) @ np.array(raw_shape)
    return np.asarray(turned_back + (shape - 1) / 2)
