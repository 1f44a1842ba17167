"""Any device, in a Python file of one's own, which is run.

    [lasers]
    device = "python"
    file = "my_lasers.py"           # beside rig.toml
    class = "MyLasers"
    arguments = { address = 7 }     # of the class; modulators take `settle` too, in place of the class's settle_s

The class has the methods and attributes of the device's protocol in `rig.devices`; its exceptions are reported
as failures of the device. It needs nothing of holoview.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, MutableMapping
from pathlib import Path
from types import ModuleType
from typing import Any

from holoview.bench.rig.description import DeviceSpec, RigDescription
from holoview.bench.rig.devices import Counts, DeviceError, Levels, call_device
from holoview.bench.rig.kinds.checks import (
    option_place,
    parse_options,
    require_counts,
    require_device,
    require_levels,
    require_shape,
    table,
    text,
)
from holoview.light.model.fields import Number
from holoview.util.errors import UserError, suggest_matches
from holoview.util.packages import run_python_file

_OPTIONS = {"file": text, "class": text, "arguments": table}
_SLM_OPTIONS = {**_OPTIONS, "settle": Number(low=0.0, high=1000.0).parse}
_MEMBERS = {
    "slm": ("shape", "settle_s", "show", "close"),
    "camera": ("shape", "exposures_s", "set_exposure", "take", "close"),
    "lasers": ("wavelengths_m", "switch_on", "switch_off", "close"),
    "stage": ("range_m", "move_to", "close"),
}


def open_python(rig: RigDescription, spec: DeviceSpec, modules: MutableMapping[Path, ModuleType]) -> Any:
    """Opens a device. modules: files of this rig that have been run, so that each runs once.

    Raises UserError for wrong options and a file or class that fails, DeviceError for a device that doesn't open.
    """
    types = _SLM_OPTIONS if spec.name in rig.modulator_names else _OPTIONS
    options = parse_options(rig, spec, types, required=("file", "class"))
    where = option_place(rig, spec)
    file = (rig.path.parent / options["file"]).resolve()
    if file not in modules:
        modules[file] = _run(file, f"{where}.file")
    name, known = options["class"], vars(modules[file])
    if not isinstance(known.get(name), type):
        classes = [key for key, value in known.items() if isinstance(value, type)]
        raise UserError(f"{where}.class", f'{file.name} has no class "{name}"', remedy=suggest_matches(name, classes))
    remedy = f"see {file.name}"
    device = call_device(spec.name, "open", remedy, lambda: known[name](**options.get("arguments", {})))
    for member in require_device(rig, spec, _MEMBERS):
        if not hasattr(device, member):
            raise UserError(
                f"{where}.class", f"{name} has no `{member}`", expected="what holoview.bench.rig.devices lists"
            )
    wrapped = require_device(rig, spec, _WRAPPERS)(rig, spec.name, device, remedy)
    if "settle" in options:
        wrapped.settle_s = options["settle"]
    return wrapped


class _Guarded:
    """A device whose exceptions become DeviceErrors that name it."""

    def __init__(self, rig: RigDescription, name: str, device: Any, remedy: str) -> None:
        self._rig, self._name, self._device, self._remedy = rig, name, device, remedy

    def _call(self, action: str, call: Callable[[], Any]) -> Any:
        return call_device(self._name, action, self._remedy, call)

    def _number(self, action: str, call: Callable[[], Any]) -> float:
        found = self._call(action, call)
        try:
            return float(found)
        except (TypeError, ValueError) as error:
            raise DeviceError(self._name, f"returned {found!r}", expected="a number", remedy=self._remedy) from error

    def close(self) -> None:
        """Closes the device."""
        self._call("close", self._device.close)


class _Modulator(_Guarded):
    def __init__(self, rig: RigDescription, name: str, device: Any, remedy: str) -> None:
        super().__init__(rig, name, device, remedy)
        self.shape = rig.slm_shapes[rig.modulator_names.index(name)]
        require_shape(name, device.shape, self.shape)
        self.settle_s = float(device.settle_s)

    def show(self, levels: Levels) -> None:
        """Sends grey levels (y, x)."""
        require_levels(self._name, levels, self._rig)
        self._call("take the pattern", lambda: self._device.show(levels))


class _Camera(_Guarded):
    def __init__(self, rig: RigDescription, name: str, device: Any, remedy: str) -> None:
        super().__init__(rig, name, device, remedy)
        require_shape(name, device.shape, rig.camera_shape)
        low, high = device.exposures_s
        self.shape, self.exposures_s = rig.camera_shape, (float(low), float(high))

    def set_exposure(self, exposure_s: float) -> float:
        """Sets the exposure time; returns the exposure that the camera took."""
        return self._number("set its exposure", lambda: self._device.set_exposure(exposure_s))

    def take(self) -> Counts:
        """Raw counts (y, x) of one picture."""
        return require_counts(self._call("send a picture", self._device.take), self._rig)


class _Lasers(_Guarded):
    def __init__(self, rig: RigDescription, name: str, device: Any, remedy: str) -> None:
        super().__init__(rig, name, device, remedy)
        found = tuple(float(λ) for λ in device.wavelengths_m)
        if found != rig.wavelengths_m:
            listed, wanted = (", ".join(f"{λ * 1e9:g} nm" for λ in both) for both in (found, rig.wavelengths_m))
            raise DeviceError(name, f"has {listed}", expected=f"{wanted}, as rig.toml lists", remedy=remedy)
        self.wavelengths_m = rig.wavelengths_m

    def switch_on(self, wavelength_m: float, power: float) -> None:
        """Switches one laser on."""
        self._call("switch on", lambda: self._device.switch_on(wavelength_m, power))

    def switch_off(self) -> None:
        """Switches all lasers off."""
        self._call("switch off", self._device.switch_off)


class _Stage(_Guarded):
    def __init__(self, rig: RigDescription, name: str, device: Any, remedy: str) -> None:
        super().__init__(rig, name, device, remedy)
        low, high = device.range_m
        self.range_m = (float(low), float(high))

    def move_to(self, distance_m: float) -> float:
        """Moves there; returns the position that the stage reports."""
        return self._number("move", lambda: self._device.move_to(distance_m))


_WRAPPERS = {"slm": _Modulator, "camera": _Camera, "lasers": _Lasers, "stage": _Stage}


def _run(file: Path, where: str) -> ModuleType:
    """Runs a file, which is said on stderr."""
    print(f"running {file} for its devices", file=sys.stderr)
    try:
        return run_python_file(file, f"holoview_rig_{file.stem}", lambda module: module)
    except UserError as error:
        raise error.inside(f"{where}: ") from error
