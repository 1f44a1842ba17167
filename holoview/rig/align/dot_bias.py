"""By how much dots are seen beside where rays say, computed by the model of captures at the geometry found so far.

Neighbouring dots, orders of the pixels and stops move the centroid of a dot by some tenths of a pixel. The same
pattern, simulated on the bench as it was found, moves them by the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.captures.orientations import turned
from holoview.captures.predictor import Predictor
from holoview.rig.align.dots import FoundDots, find_dots
from holoview.rig.align.geometry import NAMES, BenchFacts, Dots, predicted_px, rotation_matrix
from holoview.rig.align.probes import Probes
from holoview.rig.description import RigDescription

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Shot:
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
    rig: RigDescription, facts: BenchFacts, values: Floats, picture_shape: tuple[int, int], shot: Shot
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
    rig: RigDescription, facts: BenchFacts, values: Floats, picture_shape: tuple[int, int], shot: Shot
) -> tuple[Captures, dict[str, dict[str, float]]]:
    """A session of one capture without a picture, on the bench with the measured pitch; and its effects."""
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
