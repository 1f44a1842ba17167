"""Checks that all kinds of devices share: a device's keys in rig.toml, the values it returns, a stage's coordinate.

parse_options, find_class                      keys of a device's table, and the class that a key names
require_shape, _bits, _counts, _levels         sizes and values, compared with rig.toml before anything is measured
StageAxis                                      a stage's own coordinate, and the camera's distance
"""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from holoview.bench.rig.description import DeviceSpec, RigDescription
from holoview.bench.rig.devices import Counts, DeviceError, Levels
from holoview.light.model.fields import Choice, Number, Truth
from holoview.util import units
from holoview.util.errors import UserError, suggest_matches
from holoview.util.tables import check_keys

Parse = Callable[[Any, str], Any]
"""Checks a value that stands in the place of the second argument; `FieldType.parse` is one."""


def option_place(rig: RigDescription, spec: DeviceSpec) -> str:
    """The name of a device's table, for errors."""
    return f"{rig.path}: {spec.name}"


def parse_options(
    rig: RigDescription, spec: DeviceSpec, types: Mapping[str, Parse], required: Iterable[str] = ()
) -> dict[str, Any]:
    """The checked values of a device's options. Raises UserError for unknown, missing and wrong keys."""
    where = option_place(rig, spec)
    noun = f'option of device = "{spec.kind}"'
    check_keys(spec.options, types, f"{where}.", required=required, expected=f"an {noun}", noun=noun)
    return {key: types[key](value, f"{where}.{key}") for key, value in spec.options.items()}


def require_device(rig: RigDescription, spec: DeviceSpec, offered: Mapping[str, Any]) -> Any:
    """The driver that is offered for a device. offered: drivers by table of rig.toml. Raises UserError for none."""
    name = "slm" if spec.name in ("slm1", "slm2") else spec.name
    if name not in offered:
        where, expected = f"{option_place(rig, spec)}.device", ", ".join(offered)
        raise UserError(where, f'"{spec.kind}" has no {name}', expected=f"this kind for: {expected}")
    return offered[name]


def text(value: Any, where: str) -> str:
    """A text."""
    return Choice().parse(value, where)


def texts(value: Any, where: str) -> tuple[str, ...]:
    """One text, or several in a list."""
    if isinstance(value, list):
        return tuple(text(item, f"{where}[{number}]") for number, item in enumerate(value))
    return (text(value, where),)


def table(value: Any, where: str) -> dict[str, Any]:
    """A table of arguments."""
    if not isinstance(value, Mapping):
        raise UserError(where, f"{value!r}", expected="a table such as { serial = 3 }")
    return dict(value)


def find_class(path: str, where: str) -> Any:
    """The class of a dotted path. Raises UserError where a module or the class is missing or can't be loaded.

    Warnings of libraries while they are imported, mostly of other makers' missing hardware, aren't shown.
    """
    module_name, _, name = path.rpartition(".")
    if not module_name:
        raise UserError(where, f'"{path}"', expected="the dotted path of a class")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            module = importlib.import_module(module_name)
        except Exception as error:  # the module's own code runs
            found = f'"{module_name}" can\'t be imported: {type(error).__name__}: {error}'
            raise UserError(where, found, expected="the dotted path of a class") from error
    if not callable(found_class := getattr(module, name, None)):
        known = [key for key, value in vars(module).items() if isinstance(value, type)]
        raise UserError(where, f'"{module_name}" has no class "{name}"', remedy=suggest_matches(name, known))
    return found_class


def open_or_close(line: Any, wrap: Callable[[], Any]) -> Any:
    """The device that `wrap` makes of an open line or driver, which is closed if that fails in whatever way."""
    try:
        return wrap()
    except BaseException:
        with suppress(Exception):  # the first error says more
            line.close()
        raise


def require_shape(name: str, found: Any, expected: tuple[int, int]) -> None:
    """Raises DeviceError unless a device has so many rows and columns. name: its table in rig.toml."""
    if tuple(found) != expected:
        rows, columns = found
        remedy = f"correct {name}.shape in rig.toml, or the device's own settings"
        raise DeviceError(
            name, f"has {rows} × {columns} pixels", expected=f"{expected[0]} × {expected[1]}", remedy=remedy
        )


def require_bits(name: str, found: int, expected: int) -> None:
    """Raises DeviceError unless a device has so many bits."""
    if found != expected:
        remedy = f"correct [{name}] in rig.toml, or the device's own settings"
        raise DeviceError(name, f"has {found} bits", expected=f"{expected}", remedy=remedy)


def require_counts(picture: Any, rig: RigDescription) -> Counts:
    """A camera's picture as raw counts (y, x). Raises DeviceError for another type, shape or range."""
    picture, highest = np.asarray(picture), rig.bench.camera.saturation
    if picture.dtype.kind not in "iu":
        remedy = "let the camera return raw counts, without averaging and without high dynamic range"
        raise DeviceError("camera", f"sent values of {picture.dtype.name}", expected="whole numbers", remedy=remedy)
    if picture.shape != rig.camera_shape:
        remedy = "correct camera.shape in rig.toml, or the camera's window, binning and rotation"
        raise DeviceError(
            "camera",
            f"sent a picture of {' × '.join(map(str, picture.shape))}",
            expected=" × ".join(map(str, rig.camera_shape)),
            remedy=remedy,
        )
    if picture.min() < 0 or picture.max() > highest:
        remedy = "correct camera.bit_depth in rig.toml, or the camera's pixel format"
        found = f"sent counts from {picture.min()} to {picture.max()}"
        raise DeviceError("camera", found, expected=f"0 … {highest}", remedy=remedy)
    return picture.astype(np.uint16)


def require_levels(name: str, levels: Levels, rig: RigDescription) -> None:
    """Raises DeviceError for levels (y, x) that a modulator doesn't have."""
    number = rig.modulator_names.index(name)
    count = rig.bench.slms[number].num_levels
    require_shape(name, levels.shape, rig.slm_shapes[number])
    if int(levels.max()) >= count:
        raise DeviceError(name, f"was to show level {int(levels.max())}", expected=f"0 … {count - 1}")


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
        """The stage's position at this distance."""
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
