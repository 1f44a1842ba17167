"""Lasers, camera and stage that can't leave the safety limits of a rig, whatever a plan asks for."""

from __future__ import annotations

from dataclasses import dataclass, replace

from holoview.rig.devices import Devices, WrappedCamera, WrappedLasers, WrappedStage
from holoview.util import units
from holoview.util.errors import UserError

_REMEDY = "change the plan, or [limits] in rig.toml if the bench allows more"


@dataclass(frozen=True)
class SafetyLimits:
    """power: highest, relative. exposures_s: shortest and longest. stage_m: nearest and farthest distance."""

    power: float
    exposures_s: tuple[float, float]
    stage_m: tuple[float, float]

    def require_power(self, power: float) -> None:
        """Raises UserError for a power that isn't allowed."""
        if not 0 <= power <= self.power:
            raise UserError("power", f"{power:g}", expected=f"0 … {self.power:g}", remedy=_REMEDY)

    def require_exposure(self, exposure_s: float) -> None:
        """Raises UserError for an exposure time (s) that isn't allowed."""
        low, high = self.exposures_s
        if not low <= exposure_s <= high:
            raise UserError("exposure", f"{exposure_s:g} s", expected=f"{low:g} … {high:g} s", remedy=_REMEDY)

    def require_distance(self, distance_m: float) -> None:
        """Raises UserError for a distance (m) to which the stage must not go."""
        low, high = self.stage_m
        if not low <= distance_m <= high:
            near, far, found = (units.format_rounded(z, "mm") for z in (low, high, distance_m))
            raise UserError("stage", found, expected=f"{near} … {far}", remedy=_REMEDY)


def limit_devices(devices: Devices, limits: SafetyLimits) -> Devices:
    """The same devices, which refuse requests beyond the limits before anything is sent to them."""
    return replace(
        devices,
        camera=_LimitedCamera(devices.camera, limits),
        lasers=_LimitedLasers(devices.lasers, limits),
        stage=_LimitedStage(devices.stage, limits),
    )


@dataclass(eq=False)
class _LimitedCamera(WrappedCamera):
    limits: SafetyLimits

    @property
    def exposures_s(self) -> tuple[float, float]:
        low, high = self.device.exposures_s
        return max(low, self.limits.exposures_s[0]), min(high, self.limits.exposures_s[1])

    def set_exposure(self, exposure_s: float) -> float:
        self.limits.require_exposure(exposure_s)
        return self.device.set_exposure(exposure_s)


@dataclass(eq=False)
class _LimitedLasers(WrappedLasers):
    limits: SafetyLimits

    def switch_on(self, wavelength_m: float, power: float) -> None:
        self.limits.require_power(power)
        self.device.switch_on(wavelength_m, power)


@dataclass(eq=False)
class _LimitedStage(WrappedStage):
    limits: SafetyLimits

    @property
    def range_m(self) -> tuple[float, float]:
        low, high = self.device.range_m
        return max(low, self.limits.stage_m[0]), min(high, self.limits.stage_m[1])

    def move_to(self, distance_m: float) -> float:
        self.limits.require_distance(distance_m)
        return self.device.move_to(distance_m)
