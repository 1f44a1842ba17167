"""A stage's own coordinate, and the distance of the camera that it stands for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from holoview.model.fields import Number, Truth
from holoview.rig.devices import DeviceError
from holoview.rig.kinds.options import Parse
from holoview.util import units

AXIS_OPTIONS: Mapping[str, Parse] = {
    "zero": Number("mm", low=-10.0, high=10.0).parse,
    "reversed": Truth().parse,
    "tolerance": Number("um", low=0.0, high=0.1).parse,
}
"""zero: the stage's position at distance 0 (default 0). reversed: whether it counts against the distance.
tolerance: how far from the target it may stop (default 10 µm)."""


@dataclass(frozen=True)
class StageAxis:
    """position = zero + distance, or zero − distance. All in m."""

    zero_m: float = 0.0
    sign: int = 1
    tolerance_m: float = 1e-5

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> StageAxis:
        """The axis of parsed options."""
        sign = -1 if options.get("reversed", False) else 1
        return cls(options.get("zero", 0.0), sign, options.get("tolerance", cls.tolerance_m))

    def position_m(self, distance_m: float) -> float:
        """Where the stage is at this distance."""
        return self.zero_m + self.sign * distance_m

    def distance_m(self, position_m: float) -> float:
        """The distance at this position of the stage."""
        return self.sign * (position_m - self.zero_m)

    def require_arrived(self, found_m: float, wanted_m: float) -> None:
        """Raises DeviceError for a stage that stopped at another distance than was wanted."""
        if abs(found_m - wanted_m) > self.tolerance_m:
            found, wanted = (f"{units.format_rounded(z, 'mm')}" for z in (found_m, wanted_m))
            remedy = "see whether something is in its way, or raise stage.tolerance in rig.toml"
            raise DeviceError("stage", f"stopped at {found}", expected=wanted, remedy=remedy)
