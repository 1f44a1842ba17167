"""Modulators, cameras, lasers and stages of any maker: the methods that every device has.

Every kind of device is a class with these methods. All quantities are in SI units; patterns are raw grey levels, never
phases.

protocols           ModulatorDevice, CameraDevice, LasersDevice, StageDevice, BenchClock
Devices             the open devices of a rig, which are closed with the lasers off first
Wrapped             a device in the place of another, which it uses: base of limits, checks and safeguards
call_device         turns the exceptions of a vendor's library into a DeviceError
limit_devices       lasers, camera and stage that can't leave the safety limits of a rig, whatever a plan asks for
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Any, Generic, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.processes import Interrupted, Interruption, handled_signals

Levels = NDArray[np.unsignedinteger]
Counts = NDArray[np.uint16]


class DeviceError(UserError):
    """A device that doesn't answer, or answers wrongly. `where` names the device, the remedy says what to do."""


class DeviceGone(DeviceError):
    """A device that is gone: another request would fail as well."""


class ModulatorDevice(Protocol):
    """Shows patterns. shape: rows and columns. settle_s: from sending a pattern until it is shown."""

    @property
    def shape(self) -> tuple[int, int]: ...
    @property
    def settle_s(self) -> float: ...
    def show(self, levels: Levels) -> None:
        """Sends grey levels (y, x) and doesn't wait until they have settled."""

    def close(self) -> None: ...


class CameraDevice(Protocol):
    """Takes pictures. shape: rows and columns of a raw picture. exposures_s: shortest and longest exposure."""

    @property
    def shape(self) -> tuple[int, int]: ...
    @property
    def exposures_s(self) -> tuple[float, float]: ...
    def set_exposure(self, exposure_s: float) -> float:
        """Sets the exposure time; returns the exposure that the camera took."""

    def take(self) -> Counts:
        """Raw counts (y, x) of one picture that was exposed after the call.

        Raises DeviceError if none comes, and DeviceGone if none can come any more.
        """

    def close(self) -> None: ...


class LasersDevice(Protocol):
    """Lasers of several wavelengths, one on at a time. wavelengths_m: ascending."""

    @property
    def wavelengths_m(self) -> tuple[float, ...]: ...
    def switch_on(self, wavelength_m: float, power: float) -> None:
        """Switches one laser on, at a power relative to its nominal one, and all others off."""

    def switch_off(self) -> None:
        """Switches all lasers off. Must work at any time, twice too."""

    def close(self) -> None: ...


class StageDevice(Protocol):
    """Moves the camera along the axis. range_m: nearest and farthest distance from the last modulator."""

    @property
    def range_m(self) -> tuple[float, float]: ...
    def move_to(self, distance_m: float) -> float:
        """Moves there and waits until it has arrived; returns the position that the stage reports."""

    def close(self) -> None: ...


class BenchClock(Protocol):
    """Time on the bench, which a virtual bench simulates."""

    def now(self) -> float:
        """Seconds since some beginning."""

    def wait(self, seconds: float) -> None:
        """Returns after so many seconds on the bench."""


@dataclass(frozen=True)
class Devices:
    """The open devices of a rig. As a context manager it switches the lasers off and closes all at the end.

    The lasers are switched off first, whatever ends the block: the end, an error, Ctrl-C or another signal.
    """

    modulators: tuple[ModulatorDevice, ...]
    camera: CameraDevice
    lasers: LasersDevice
    stage: StageDevice
    clock: BenchClock

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    @property
    def settle_s(self) -> float:
        """Seconds until the slower modulator shows its pattern."""
        return max(modulator.settle_s for modulator in self.modulators)

    def show(self, levels: Sequence[Levels] | Levels) -> None:
        """Sends each modulator its grey levels (y, x), and doesn't wait until they have settled.

        A modulator with fewer pixels than others gets the first rows and columns.
        """
        for modulator, own in zip(self.modulators, levels, strict=True):
            rows, columns = modulator.shape
            modulator.show(own[:rows, :columns])

    def close(self) -> None:
        """Switches the lasers off and closes all devices, each even if another one fails; the first failure counts."""
        with ExitStack() as stack:
            parts: tuple[Any, ...] = (*self.modulators, self.camera, self.stage, self.lasers)
            for device in parts:
                stack.callback(device.close)
            stack.callback(self._switch_lasers_off)  # last in, first out

    def _switch_lasers_off(self) -> None:
        """Switches the lasers off. A signal that comes meanwhile ends the program afterwards; a second one at once."""
        asked = Interruption()

        def handle(number: int) -> None:
            if asked():
                raise Interrupted(number)
            asked.ask(number)

        with handled_signals(handle):
            self.lasers.switch_off()
        if asked():
            raise Interrupted(asked.signal)


Kind = TypeVar("Kind")


@dataclass(eq=False)
class Wrapped(Generic[Kind]):
    """A device in the place of another of its kind, `device`; subclasses change some of its methods."""

    device: Kind

    def __getattr__(self, name: str) -> Any:
        """The method or property of the device, unless it is changed here."""
        return getattr(self.device, name)


def call_device(name: str, action: str, remedy: str, call: Callable[[], Any]) -> Any:
    """The value that `call` returns; any exception of a device's library becomes a DeviceError.

    name: the device in rig.toml, such as "camera". action: the request, as in "didn't …".
    """
    try:
        return call()
    except UserError:
        raise
    except Exception as error:  # each vendor's library raises exceptions of its own
        found = str(error).strip().rstrip(".") or type(error).__name__
        raise DeviceError(name, f"didn't {action}: {found}", remedy=remedy) from error


# --- safety limits ----------------------------------------------------------------------------------------------------


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
class _LimitedCamera(Wrapped[CameraDevice]):
    limits: SafetyLimits

    @property
    def exposures_s(self) -> tuple[float, float]:
        low, high = self.device.exposures_s
        return max(low, self.limits.exposures_s[0]), min(high, self.limits.exposures_s[1])

    def set_exposure(self, exposure_s: float) -> float:
        self.limits.require_exposure(exposure_s)
        return self.device.set_exposure(exposure_s)


@dataclass(eq=False)
class _LimitedLasers(Wrapped[LasersDevice]):
    limits: SafetyLimits

    def switch_on(self, wavelength_m: float, power: float) -> None:
        self.limits.require_power(power)
        self.device.switch_on(wavelength_m, power)


@dataclass(eq=False)
class _LimitedStage(Wrapped[StageDevice]):
    limits: SafetyLimits

    @property
    def range_m(self) -> tuple[float, float]:
        low, high = self.device.range_m
        return max(low, self.limits.stage_m[0]), min(high, self.limits.stage_m[1])

    def move_to(self, distance_m: float) -> float:
        self.limits.require_distance(distance_m)
        return self.device.move_to(distance_m)
