"""The stage misses its position: planes of the captures aren't where they should be, each by an error of its own."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

from holoview.model.effects.effect import DataProperties, Effect, Needs, StartKind
from holoview.model.effects.parameter import ListParameter, Values
from holoview.model.system import System
from holoview.util.errors import UserError
from holoview.util.units import format_rounded

_SAME_M = 1e-7  # planes that are nearer to each other show the same
_START_M = 0.3e-3


class PlaneErrors(Effect):
    """Plane z_j → z_j + error_j, for each nominal distance z_j that is listed; other planes are right.

    The errors are those of a stage that stops beside its target, or of a wrong entry in the list of positions. One
    that all planes share is that of `distance`, and one that grows with z that of `stage`, which take fewer numbers.
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
        self._check(v)
        return distance_m + sum(e for z, e in zip(v["distances"], v["errors"], strict=True) if _is_same(z, distance_m))

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        pairs = zip(v["distances"], v["errors"], strict=False)
        texts = [
            f"{format_rounded(abs(e), 'mm', 3)} {'beyond' if e >= 0 else 'short of'} {format_rounded(z, 'mm')}"
            for z, e in sorted(pairs)
        ]
        return {"missed": " and ".join([", ".join(texts[:-1]), texts[-1]] if len(texts) > 1 else texts)}

    def _check(self, v: Values) -> None:
        """Raises UserError unless each distance has an error."""
        if len(v["distances"]) != len(v["errors"]):
            found = f"{len(v['distances'])} distances and {len(v['errors'])} errors"
            raise UserError(f"effects.{self.id}", found, expected="an error for each distance")


def _is_same(first_m: float, second_m: float) -> bool:
    return abs(first_m - second_m) < _SAME_M
