"""Modulators and cameras of slmsuite, of any of its classes or a subclass of one's own.

    [slm1]
    device = "slmsuite"
    class = "slmsuite.hardware.slms.holoeye.Holoeye"
    arguments = { preselect = "index:0", wav_um = 0.633 }   # of the class
    settle = 0.1                # s; default: the class's settle_time_s
    cells = "p67"               # memory cells of a phase light modulator on a class that only shows pictures
    [camera]
    device = "slmsuite"
    class = "slmsuite.hardware.cameras.thorlabs.ThorCam"
    arguments = { serial = "12345" }
    timeout = 5.0               # s beyond the exposure
    flush = true                # drop pictures that wait in the camera's buffer

slmsuite's `set_phase` sends arrays of the class's own unsigned type as they are: no sign is flipped, nothing wrapped
and no correction added (slmsuite 0.5.0, slms/slm.py). Its class for TI's phase light modulators turns levels into
memory cells itself; `cells` is for a class that shows plain pictures, and uses the tables of `io.pictures`.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from holoview.bench.rig.description import DeviceSpec, RigDescription
from holoview.bench.rig.devices import Counts, Levels, call_device
from holoview.bench.rig.kinds.checks import (
    Parse,
    find_class,
    open_or_close,
    option_place,
    parse_options,
    require_bits,
    require_counts,
    require_device,
    require_levels,
    require_shape,
    table,
    text,
)
from holoview.holograms.files.pictures import CELL_MAPS, memory_cells
from holoview.light.model.fields import Choice, Number, Truth
from holoview.util.errors import UserError
from holoview.util.packages import import_optional

_REMEDY = "see that it is on and connected, and that no other program uses it"
_COMMON: dict[str, Parse] = {"class": text, "arguments": table}
_SLM: dict[str, Parse] = {
    **_COMMON,
    "settle": Number(low=0.0, high=1000.0).parse,
    "cells": Choice(tuple(CELL_MAPS)).parse,
}
_CAMERA: dict[str, Parse] = {**_COMMON, "timeout": Number(low=0.0, high=1e4).parse, "flush": Truth().parse}
_TIMEOUT_S = 5.0


def open_slmsuite(rig: RigDescription, spec: DeviceSpec) -> Any:
    """Opens a modulator or the camera. Raises UserError for wrong options, DeviceError if it doesn't fit rig.toml."""
    return require_device(rig, spec, {"slm": _open_modulator, "camera": _open_camera})(rig, spec)


class SlmsuiteModulator:
    """A modulator of slmsuite, which is sent raw levels.

    slm: an instance of slmsuite's SLM. cells: the device whose memory cells it is sent, a key of `CELL_MAPS`.
    """

    def __init__(self, rig: RigDescription, name: str, slm: Any, settle_s: float | None, cells: str | None) -> None:
        self._rig, self._name, self._slm, self._cells = rig, name, slm, cells
        number = rig.modulator_names.index(name)
        self.shape, self.settle_s = rig.slm_shapes[number], float(slm.settle_time_s if settle_s is None else settle_s)
        num_levels, factor = rig.bench.slms[number].num_levels, 1
        if cells is not None:
            factor, own = 2, len(CELL_MAPS[cells].level_codes)
            if num_levels != own:
                raise UserError(f"{rig.path}: {name}.num_levels", f"{num_levels}", expected=f"{own}, as {cells} has")
        else:
            require_bits(name, int(slm.bitdepth), (num_levels - 1).bit_length())
        require_shape(name, slm.shape, (factor * self.shape[0], factor * self.shape[1]))

    def show(self, levels: Levels) -> None:
        """Sends grey levels (y, x)."""
        require_levels(self._name, levels, self._rig)
        sent = levels.astype(self._slm.dtype)
        if self._cells is not None:
            sent = memory_cells(levels, self._cells).astype(self._slm.dtype)
            sent *= 2 ** int(self._slm.bitdepth) - 1  # a cell is black or white
        action = "take the pattern"
        call_device(self._name, action, _REMEDY, lambda: self._slm.set_phase(np.ascontiguousarray(sent), settle=False))

    def close(self) -> None:
        """Closes the device."""
        call_device(self._name, "close", _REMEDY, self._slm.close)


class SlmsuiteCamera:
    """A camera of slmsuite: single raw pictures.

    camera: an instance of slmsuite's Camera. flush: whether pictures that wait in its buffer are dropped first.
    """

    def __init__(self, rig: RigDescription, camera: Any, timeout_s: float, flush: bool) -> None:
        self._rig, self._camera, self._timeout_s, self._flush = rig, camera, timeout_s, flush
        require_shape("camera", camera.shape, rig.camera_shape)
        require_bits("camera", int(camera.bitdepth), rig.bench.camera.bit_depth)
        self.shape = rig.camera_shape
        bounds = camera.exposure_bounds_s
        self.exposures_s = rig.limits.exposures_s if bounds is None else (float(bounds[0]), float(bounds[1]))

    def set_exposure(self, exposure_s: float) -> float:
        """Sets the exposure time; returns the exposure that the camera took."""
        return float(call_device("camera", "set its exposure", _REMEDY, lambda: self._camera.set_exposure(exposure_s)))

    def take(self) -> Counts:
        """Raw counts (y, x) of one picture."""
        return require_counts(call_device("camera", "send a picture", _REMEDY, self._picture), self._rig)

    def close(self) -> None:
        """Closes the device."""
        call_device("camera", "close", _REMEDY, self._camera.close)

    def _picture(self) -> Any:
        if self._flush:
            self._camera.flush(timeout_s=self._timeout_s)
        return self._camera.get_image(timeout_s=self._timeout_s, hdr=False, averaging=False)


def _open_modulator(rig: RigDescription, spec: DeviceSpec) -> SlmsuiteModulator:
    options = parse_options(rig, spec, _SLM, required=("class",))
    slm = _instance(rig, spec, options, "set_phase")
    return open_or_close(
        slm, lambda: SlmsuiteModulator(rig, spec.name, slm, options.get("settle"), options.get("cells"))
    )


def _open_camera(rig: RigDescription, spec: DeviceSpec) -> SlmsuiteCamera:
    options = parse_options(rig, spec, _CAMERA, required=("class",))
    camera = _instance(rig, spec, options, "get_image")
    timeout_s, flush = options.get("timeout", _TIMEOUT_S), options.get("flush", True)
    return open_or_close(camera, lambda: SlmsuiteCamera(rig, camera, timeout_s, flush))


def _instance(rig: RigDescription, spec: DeviceSpec, options: dict[str, Any], method: str) -> Any:
    """The device of slmsuite, which is open when it is made. method: required of its class."""
    where = f"{option_place(rig, spec)}.class"
    import_optional("slmsuite", f'{spec.name}: device = "slmsuite"').configure_logging("WARNING", stream=sys.stderr)
    device_class = find_class(options["class"], where)
    if not hasattr(device_class, method):
        kind = "a modulator" if method == "set_phase" else "a camera"
        raise UserError(where, f'"{options["class"]}" has no `{method}`', expected=f"{kind} of slmsuite")
    arguments = options.get("arguments", {})
    return call_device(spec.name, "open", _REMEDY, lambda: device_class(**arguments))
