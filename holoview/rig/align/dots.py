"""Dots in pictures, and by how much they are seen beside the places that rays predict.

Neighbouring dots, orders of the pixels and stops move the centroid of a dot by some tenths of a pixel. The same
pattern, simulated by the model of captures on the bench as it was found, moves its dots by the same (`dot_bias`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from holoview.captures.dataset import Captures
from holoview.captures.orientations import turned
from holoview.captures.predictor import Predictor
from holoview.rig.align.geometry import NAMES, BenchFacts, Dots, predicted_px, rotation_matrix
from holoview.rig.align.probes import Probes
from holoview.rig.description import RigDescription

Image = NDArray[np.float64]
_SIGMA_OF_WIDTH = 0.4  # of the Gaussian that is most like the core of a diffraction-limited dot
_ROUNDS = 4
_MAD = 1.4826  # standard deviation over median absolute deviation, of normal noise


@dataclass(frozen=True)
class FoundDots:
    """position_px: (dot, 2), NaN where there is none. contrast: height over the noise of the background."""

    position_px: NDArray[np.float64]
    contrast: NDArray[np.float64]


def brightest_dot(change: Image, width_px: float) -> tuple[NDArray[np.float64], float]:
    """Place (y, x) of the brightest dot in a picture less one without it, and its height over the noise."""
    smooth = gaussian_filter(change, max(_SIGMA_OF_WIDTH * width_px, 0.5))
    peak = np.array(np.unravel_index(int(smooth.argmax()), smooth.shape), dtype=np.float64)
    above = smooth - np.median(smooth)
    noise = _MAD * float(np.median(np.abs(above)))
    return peak, float(above.max() / max(noise, 1e-30))


def find_dots(picture: Image, expected_px: NDArray[np.float64], width_px: float, reach_px: float) -> FoundDots:
    """Dots near expected places (dot, 2), each by its centroid, weighted by a Gaussian of the dot's size.

    width_px: of a dot. reach_px: how far a dot may be from where it is expected. One that reaches the edge of the
    picture or of its reach isn't found.
    """
    sigma = max(_SIGMA_OF_WIDTH * width_px, 0.7)
    smooth = gaussian_filter(picture, sigma)
    median = float(np.median(picture))
    noise = _MAD * float(np.median(np.abs(smooth - median))) + 1e-30
    found = [_find_dot(picture, smooth, place, sigma, reach_px) for place in expected_px]
    heights = [smooth[tuple(np.rint(p).astype(int))] - median if np.isfinite(p).all() else 0.0 for p in found]
    return FoundDots(np.array(found).reshape(-1, 2), np.array(heights) / noise)


def _find_dot(
    picture: Image, smooth: Image, place: NDArray[np.float64], sigma: float, reach_px: float
) -> NDArray[np.float64]:
    """The place (y, x) of one dot, NaN if there is none."""
    nothing, shape = np.full(2, np.nan), np.array(picture.shape)
    margin = 3 * sigma
    low = np.maximum(np.ceil(place - reach_px), 0).astype(int)
    high = np.minimum(np.floor(place + reach_px), shape - 1).astype(int)
    if (high - low < 2).any():
        return nothing
    window = smooth[low[0] : high[0] + 1, low[1] : high[1] + 1]
    place = np.array(np.unravel_index(int(window.argmax()), window.shape), dtype=np.float64) + low
    if (place <= low).any() or (place >= high).any():
        return nothing
    for _ in range(_ROUNDS):
        if (place < margin).any() or (place > shape - 1 - margin).any():
            return nothing
        place = _centroid(picture, place, sigma, margin)
    return place


def _centroid(picture: Image, place: NDArray[np.float64], sigma: float, margin: float) -> NDArray[np.float64]:
    """One step of the weighted centroid.

    Of a Gaussian dot of the weight's own size the step goes half of the way, so that it is doubled.
    """
    low, high = (np.rint(place + side * margin).astype(int) for side in (-1, 1))
    part = picture[low[0] : high[0] + 1, low[1] : high[1] + 1]
    y, x = (np.arange(a, b + 1) - p for a, b, p in zip(low, high, place, strict=True))
    edge = np.concatenate([part[0], part[-1], part[:, 0], part[:, -1]])
    weight = np.exp(-(y[:, None] ** 2 + x[None, :] ** 2) / (2 * sigma**2)) * np.maximum(part - np.median(edge), 0.0)
    total = float(weight.sum())
    if total <= 0:
        return np.full(2, np.nan)
    step = np.array([(weight.sum(axis=1) * y).sum(), (weight.sum(axis=0) * x).sum()]) / total
    return np.asarray(place + 2 * np.clip(step, -sigma, sigma))


Floats = NDArray[np.float64]


@dataclass(frozen=True)
class DotPicture:
    """A pattern of modulator `slm` (0 or 1) that was shown, and its dots as they were seen.

    stage_m: the stage's setting. position_px: (dot, 2), NaN where there is none. width_px, reach_px: as of `find_dots`.
    """

    slm: int
    stage_m: float
    probes: Probes
    position_px: Floats
    width_px: float
    reach_px: float

    def dots(self, bias_px: Floats | None = None) -> Dots:
        """What a fit needs. bias_px: (dot, 2), by how much the dots are seen beside where rays say."""
        seen = self.position_px if bias_px is None else self.position_px - bias_px
        return Dots(self.slm, self.stage_m, self.probes.centre_m, self.probes.frequency, seen)


def dot_bias(
    rig: RigDescription, facts: BenchFacts, values: Floats, picture_shape: tuple[int, int], shot: DotPicture
) -> Floats:
    """Places of a shot's dots in its simulated picture less where rays say (dot, 2), px; NaN where none is found.

    values: of `geometry.NAMES`. picture_shape: of the picture turned back. The simulated camera isn't rotated, because
    a model of captures interpolates there; the result is.
    """
    straight = values.copy()
    straight[NAMES.index("rotation")] = 0.0
    capture, effects = simulated_capture(rig, facts, straight, picture_shape, shot)
    picture = Predictor(capture)([0], effects).signal[0].double().numpy()
    rays = predicted_px(straight, facts, shot.slm, shot.stage_m, shot.probes.centre_m, shot.probes.frequency)
    found: FoundDots = find_dots(picture, rays, shot.width_px, shot.reach_px)
    return np.asarray((found.position_px - rays) @ rotation_matrix(values[NAMES.index("rotation")]).T)


def simulated_capture(
    rig: RigDescription, facts: BenchFacts, values: Floats, picture_shape: tuple[int, int], shot: DotPicture
) -> tuple[Captures, dict[str, dict[str, float]]]:
    """One capture without a picture, on the bench with the measured pitch; and its effects."""
    v = dict(zip(NAMES, values, strict=True))
    levels = [np.zeros_like(shot.probes.levels) for _ in rig.bench.slms]
    levels[shot.slm] = turned(shot.probes.levels, facts.slm2_turn if shot.slm else "none")
    z = v["offset"] + (1 + v["scale"]) * shot.stage_m
    fields: dict[str, Any] = rig.bench.as_fields()
    fields["camera"] = replace(rig.bench.camera, pitch_m=float(np.exp(v["log_pitch"])))
    capture = Captures(
        levels=np.stack(levels)[None],
        images=np.zeros((1, *picture_shape), np.uint16),
        wavelength_m=np.array([facts.wavelength_m]),
        distance_m=np.array([z]),
        power=np.ones(1),
        exposure_s=np.ones(1),
        lasers_m=rig.wavelengths_m,
        **fields,
    )
    return capture, geometry_effects(rig, v, [(n - 1) / 2 for n in picture_shape])


def geometry_effects(
    rig: RigDescription, v: dict[str, float], middle_px: Sequence[float]
) -> dict[str, dict[str, float]]:
    """The effects of a geometry whose pitch and distances are the nominal ones. middle_px: (y, x) of the picture."""
    pitch = float(np.exp(v["log_pitch"]))
    effects = {
        "camera_alignment": {
            "shift_y": (v["centre_y"] - middle_px[0]) * pitch,
            "shift_x": (v["centre_x"] - middle_px[1]) * pitch,
            "rotation": v["rotation"],
        },
        "stage": {"walk_y": v["walk_y"], "walk_x": v["walk_x"]},
    }
    if len(rig.bench.slms) == 2:
        names = {
            "shift_y": "shift2_y",
            "shift_x": "shift2_x",
            "rotation": "rotation2",
            "magnification": "magnification2",
        }
        effects["slm_alignment"] = {name: v[own] for name, own in names.items()}
        effects["gap"] = {"gap_error": v["gap"] - (rig.bench.gap_m or 0.0)}
    return effects
