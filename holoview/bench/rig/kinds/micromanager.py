"""Camera, lasers and stage of Micro-Manager, by their labels in its configuration file.

    [camera]
    device = "micromanager"
    config = "scope.cfg"                # beside rig.toml; devices of one file share it
    adapters = "/opt/micro-manager"     # folder of its drivers; default: where pymmcore-plus finds them
    label = "Camera"
    timeout = 5.0                       # s, beyond the exposure
    [lasers]
    device = "micromanager"
    config = "scope.cfg"
    labels = ["Laser450", "Laser520"]   # a shutter for each wavelength, ascending
    power_property = "Power"            # default: only relative power 1 can be set
    full_power = 20.0                   # the property's value at relative power 1; default 1
    [stage]
    device = "micromanager"
    config = "scope.cfg"
    label = "Z"
    zero = "0.1 mm"                     # and reversed, tolerance: see `AXIS_OPTIONS`

Micro-Manager counts in ms and µm. Its calls are those of the class CMMCore.
"""

from __future__ import annotations

from collections.abc import Callable, MutableMapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from holoview.bench.rig.description import DeviceSpec, RigDescription
from holoview.bench.rig.devices import Counts, DeviceError, call_device
from holoview.bench.rig.kinds.checks import (
    AXIS_OPTIONS,
    Parse,
    StageAxis,
    option_place,
    parse_options,
    require_bits,
    require_counts,
    require_device,
    require_shape,
    text,
    texts,
)
from holoview.light.model.fields import Number
from holoview.util.errors import UserError, suggest_matches
from holoview.util.packages import import_optional

_COMMON: dict[str, Parse] = {"config": text, "adapters": text, "timeout": Number(low=0.0, high=1e4).parse}
_CAMERA: dict[str, Parse] = {**_COMMON, "label": text}
_LASERS: dict[str, Parse] = {
    **_COMMON,
    "labels": texts,
    "power_property": text,
    "full_power": Number(low=0.0, high=1e9).parse,
}
_STAGE: dict[str, Parse] = {**_COMMON, "label": text, **AXIS_OPTIONS}
_REMEDY = "see that it is on and connected, and that the configuration works in Micro-Manager itself"
_OFF_REMEDY = "make sure by hand that all lasers are off"
_TIMEOUT_S = 5.0


@dataclass
class SharedCore:
    """A loaded configuration. users: how many devices use it; with the last one it is unloaded."""

    core: Any
    users: int = field(default=0)

    def release(self) -> None:
        """One device is closed."""
        self.users -= 1
        if self.users == 0:
            self.core.reset()


def open_micromanager(rig: RigDescription, spec: DeviceSpec, cores: MutableMapping[Path, SharedCore]) -> Any:
    """Opens a camera, lasers or a stage. cores: the configurations of this rig that are loaded.

    Raises UserError for wrong options, DeviceError for a configuration that can't be loaded, and for labels that it
    doesn't have.
    """
    types, device_class = require_device(
        rig,
        spec,
        {"camera": (_CAMERA, MicroManagerCamera), "lasers": (_LASERS, Lasers), "stage": (_STAGE, MicroManagerStage)},
    )
    options = parse_options(rig, spec, types, required=("config", "labels" if spec.name == "lasers" else "label"))
    if spec.name == "lasers" and len(options["labels"]) != len(rig.wavelengths_m):
        where, found = f"{option_place(rig, spec)}.labels", f"{len(options['labels'])} labels"
        raise UserError(where, found, expected=f"{len(rig.wavelengths_m)}, one for each wavelength")
    file = (rig.path.parent / options["config"]).resolve()
    if file not in cores:
        cores[file] = SharedCore(_load(file, spec, options))
    shared = cores[file]
    shared.users += 1
    try:
        for label in options.get("labels", [options.get("label")]):
            if label not in (known := shared.core.getLoadedDevices()):
                raise DeviceError(spec.name, f'"{label}" isn\'t in {file.name}', remedy=suggest_matches(label, known))
        return device_class(rig, options, shared)
    except BaseException:
        if shared.users == 1:
            del cores[file]  # unloaded now
        with suppress(Exception):  # the first error says more
            shared.release()
        raise


class _Device:
    def __init__(self, rig: RigDescription, options: dict[str, Any], shared: SharedCore) -> None:
        self._rig, self._options, self._shared, self._core = rig, options, shared, shared.core
        self._timeout_s = float(options.get("timeout", _TIMEOUT_S))

    def _call(self, name: str, action: str, call: Callable[[], Any], remedy: str = _REMEDY) -> Any:
        return call_device(name, action, remedy, call)


class MicroManagerCamera(_Device):
    """A camera of Micro-Manager; Micro-Manager opens no shutter for it."""

    def __init__(self, rig: RigDescription, options: dict[str, Any], shared: SharedCore) -> None:
        super().__init__(rig, options, shared)
        self._label, self.shape, self.exposures_s = options["label"], rig.camera_shape, rig.limits.exposures_s
        self._call("camera", "become the current camera", self._select)
        require_shape("camera", (self._core.getImageHeight(), self._core.getImageWidth()), rig.camera_shape)
        require_bits("camera", int(self._core.getImageBitDepth()), rig.bench.camera.bit_depth)

    def set_exposure(self, exposure_s: float) -> float:
        """Sets the exposure time; returns the exposure that the camera took."""

        def set_and_read() -> float:
            self._core.setExposure(self._label, exposure_s * 1e3)
            return float(self._core.getExposure(self._label)) * 1e-3

        return float(self._call("camera", "set its exposure", set_and_read))

    def take(self) -> Counts:
        """Raw counts (y, x) of one picture."""

        def snap() -> Any:
            self._core.setTimeoutMs(round(1e3 * self._timeout_s + self._core.getExposure(self._label)))
            self._core.snapImage()
            return self._core.getImage()

        return require_counts(self._call("camera", "send a picture", snap), self._rig)

    def close(self) -> None:
        """Unloads the configuration with its last device."""
        self._call("camera", "close", self._shared.release)

    def _select(self) -> None:
        self._core.setCameraDevice(self._label)
        self._core.setAutoShutter(False)


class Lasers(_Device):
    """A shutter of Micro-Manager for each wavelength; all are closed when it is opened."""

    def __init__(self, rig: RigDescription, options: dict[str, Any], shared: SharedCore) -> None:
        super().__init__(rig, options, shared)
        self.wavelengths_m, self._labels = rig.wavelengths_m, options["labels"]
        self._property, self._full = options.get("power_property"), options.get("full_power", 1.0)
        self.switch_off()

    def switch_on(self, wavelength_m: float, power: float) -> None:
        """Closes all shutters, sets the power and opens one."""
        if self._property is None and power != 1.0:
            remedy = "state power_property in [lasers], or power = [1.0] in the plan"
            raise UserError("power", f"{power:g}", expected="1, since these lasers can't be set", remedy=remedy)
        self.switch_off()
        label = self._labels[self.wavelengths_m.index(wavelength_m)]

        def switch() -> None:
            if self._property is not None:
                self._core.setProperty(label, self._property, power * self._full)
            self._core.setShutterOpen(label, True)
            self._wait(label)

        self._call("lasers", f"open the shutter {label}", switch)

    def switch_off(self) -> None:
        """Closes all shutters, each even if another one fails."""
        failures: list[DeviceError] = []
        for label in self._labels:
            try:
                self._call("lasers", f"close the shutter {label}", partial(self._shut, label), _OFF_REMEDY)
            except DeviceError as error:
                failures.append(error)
        if failures:
            raise failures[0]

    def close(self) -> None:
        """Closes the shutters; unloads the configuration with its last device."""
        try:
            self.switch_off()
        finally:
            self._shared.release()

    def _shut(self, label: str) -> None:
        self._core.setShutterOpen(label, False)
        self._wait(label)

    def _wait(self, label: str) -> None:
        self._core.setTimeoutMs(round(1e3 * self._timeout_s))
        self._core.waitForDevice(label)


class MicroManagerStage(_Device):
    """A focus drive of Micro-Manager."""

    def __init__(self, rig: RigDescription, options: dict[str, Any], shared: SharedCore) -> None:
        super().__init__(rig, options, shared)
        self._label, self._axis, self.range_m = options["label"], StageAxis.of(options), rig.stage_m

    def move_to(self, distance_m: float) -> float:
        """Moves there and waits; returns where it stopped."""

        def move() -> float:
            self._core.setTimeoutMs(round(1e3 * self._timeout_s))
            self._core.setPosition(self._label, self._axis.position_m(distance_m) * 1e6)
            self._core.waitForDevice(self._label)
            return self._axis.distance_m(float(self._core.getPosition(self._label)) * 1e-6)

        found_m = float(self._call("stage", "move", move))
        self._axis.require_arrived(found_m, distance_m)
        return found_m

    def close(self) -> None:
        """Unloads the configuration with its last device."""
        self._call("stage", "close", self._shared.release)


def _load(file: Path, spec: DeviceSpec, options: dict[str, Any]) -> Any:
    """A core with the configuration of a file."""
    library = import_optional("pymmcore_plus", f'{spec.name}: device = "micromanager"')
    if not file.is_file():
        raise UserError(str(file), "no such file", expected="a configuration of Micro-Manager")
    core = library.CMMCorePlus()

    def load() -> None:
        if "adapters" in options:
            core.setDeviceAdapterSearchPaths([options["adapters"]])
        core.loadSystemConfiguration(str(file))

    remedy = "see that Micro-Manager itself loads this file, and that `adapters` names the folder of its drivers"
    try:
        call_device(spec.name, f"load {file.name}", remedy, load)
    except BaseException:
        with suppress(Exception):  # gives back the ports of the devices that were loaded before one failed
            core.reset()
        raise
    return core
