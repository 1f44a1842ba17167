"""The stage that moves the camera between planes: its scale and the angle of its rail, and positions that it misses."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, ClassVar

from holoview.light.model.effects.effect import (
    DataProperties,
    Effect,
    ListParameter,
    Needs,
    Parameter,
    StartKind,
    Values,
)
from holoview.light.model.system import System
from holoview.util.units import format_rounded

if TYPE_CHECKING:
    from holoview.light.model.effects.hook_contexts import Pose


_REACH_M, _STEP_M = 0.6e-3, 0.1e-3  # errors of the farthest plane at which a search begins
_GROWTHS = (-0.04, -0.02, -0.01, 0.01, 0.02, 0.04)  # at the farthest plane


class Stage(Effect):
    """Plane z → z·(1 + scale); light that should be at r in its picture is at (1 + growth·z)·r + walk·z, with the true
    z.

    The scale is that of a screw whose pitch is wrong. `walk` is the angle between rail and axis, for small angles, and
    `growth` is what light makes that isn't collimated as the relay should leave it. All three are zero at z = 0, on a
    Fourier bench in the focal plane; an error that all planes share is that of `distance` or `camera_alignment`.
    """

    id = "stage"
    cause = "The stage that moves the camera between planes errs: its scale, or the angle of its rail."
    finding = (
        "The stage moves the camera by {factor} of the distance that was set, at an angle of {walk_y} (y) and {walk_x} "
        "(x) to the axis; the picture grows by {percent} a millimetre."
    )
    parameters = (
        Parameter("scale", "Relative error of all distances.", low=-0.9, high=2.0, prior=0.03),
        Parameter(
            "walk_y", "Angle between rail and axis: shift in y per distance.", "mrad", low=-0.5, high=0.5, prior=1e-3
        ),
        Parameter(
            "walk_x", "Angle between rail and axis: shift in x per distance.", "mrad", low=-0.5, high=0.5, prior=1e-3
        ),
        Parameter("growth", "Relative enlargement per distance.", "1/m", low=-50.0, high=50.0, prior=1.0),
    )
    acts_on = ("camera",)
    needs = Needs(planes=2)
    order = -1

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """Errors of the scale, then of the growth; a diagnosis adds the walk that it measures."""
        farthest = max(float(system.planes_m.max()), 1e-9)
        count = round(_REACH_M / _STEP_M)
        scales = [k * _STEP_M / farthest for k in range(-count, count + 1) if k]
        growths = [growth / farthest for growth in _GROWTHS]
        yield from ({"scale": scale} for scale in scales if -0.9 <= scale <= 2.0)
        yield from ({"growth": growth} for growth in growths if abs(growth) <= 50.0)

    def camera_distance(self, distance_m: float, v: Values) -> float:
        return distance_m * (1 + v["scale"])

    def camera_pose_at(self, pose: Pose, distance_m: float, v: Values) -> Pose:
        return dataclasses.replace(
            pose,
            shift_m=(pose.shift_m[0] + v["walk_y"] * distance_m, pose.shift_m[1] + v["walk_x"] * distance_m),
            magnification=pose.magnification * (1 + v["growth"] * distance_m),
        )

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        return {"factor": f"{1 + v['scale']:.4g}", "percent": f"{0.1 * v['growth']:.3g} %"}


_SAME_M = 1e-7  # planes that are nearer to each other show the same
_START_M = 0.3e-3


class PlaneErrors(Effect):
    """Plane z_j → z_j + error_j, for each nominal distance z_j that is listed; other planes are right.

    The errors are those of a stage that stops beside its target, or of a wrong entry in the list of positions. An error
    that all planes share is the effect `distance`, and an error that grows with z the effect `stage`; both take fewer
    numbers.
    """

    id = "plane_errors"
    cause = "The stage misses its position: single planes aren't at the distance that was set."
    finding = "The stage misses its position: it stops {missed}."
    parameters = (
        ListParameter(
            "distances",
            "Nominal distances of the planes that are off.",
            "mm",
            low=-10.0,
            high=10.0,
            prior=5e-3,
            fixed=True,
        ),
        ListParameter(
            "errors",
            "By how much each of these planes is further from the last modulator.",
            "mm",
            low=-20e-3,
            high=20e-3,
            prior=0.2e-3,
        ),
    )
    start_kinds = (StartKind.PLANES,)
    acts_on = ("camera",)
    needs = Needs(planes=2)
    degenerate_with: ClassVar = ("distance",)
    order = -2  # the stage's own error comes before that of its rail

    def degeneracies(self, properties: DataProperties) -> tuple[str, ...]:
        return self.degenerate_with if self.needs.planes <= properties.planes else ()

    def starting_points(self, system: System) -> Iterable[dict[str, Any]]:
        """Each plane alone; a diagnosis adds the errors that the captures of each plane show."""
        for plane in system.planes_m:
            for error in (-_START_M, _START_M):
                yield {"distances": (float(plane),), "errors": (error,)}

    def camera_distance(self, distance_m: float, v: Values) -> float:
        pairs = zip(v["distances"], v["errors"], strict=True)
        return distance_m + sum(error for z, error in pairs if abs(z - distance_m) < _SAME_M)

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        pairs = zip(v["distances"], v["errors"], strict=False)
        texts = [
            f"{format_rounded(abs(e), 'mm', 3)} {'beyond' if e >= 0 else 'short of'} {format_rounded(z, 'mm')}"
            for z, e in sorted(pairs)
        ]
        return {"missed": " and ".join([", ".join(texts[:-1]), texts[-1]] if len(texts) > 1 else texts)}

    def contradiction(self, v: Values) -> str:
        distances, errors = len(v["distances"]), len(v["errors"])
        return "" if distances == errors else f"has {distances} distances, {errors} errors: as many of each are needed"
