"""Lasers and a stage that a person sets: the device prints the setting, and waits for Enter.

    [lasers]
    device = "manual"
    wavelengths = ["450 nm", "520 nm", "638 nm"]
    [stage]
    device = "manual"
    range = ["0 mm", "20 mm"]

Instructions go to stderr. Where the position of the stage was read more exactly than it was asked for, it can be
typed before Enter, such as "5.02 mm" or "5.02".
"""

from __future__ import annotations

import sys
from typing import Any

from holoview.bench.rig.description import DeviceSpec, RigDescription
from holoview.bench.rig.devices import DeviceError
from holoview.bench.rig.kinds.checks import parse_options, require_device
from holoview.util import units
from holoview.util.errors import UserError

_REMEDY = "run the command in a terminal, and answer there"


def open_manual(rig: RigDescription, spec: DeviceSpec) -> Any:
    """Lasers or a stage. Raises UserError for another device, and for options, which these devices don't have."""
    device_class = require_device(rig, spec, {"lasers": ManualLasers, "stage": ManualStage})
    parse_options(rig, spec, {})
    return device_class(rig)


def ask_person(name: str, instruction: str) -> str:
    """Prints a request, waits for a line and returns it. Raises DeviceError at the end of the input."""
    print(f"{name}: {instruction}, then press Enter", file=sys.stderr, flush=True)
    line = sys.stdin.readline()
    if not line:
        raise DeviceError(name, f"nobody answered: {instruction}", remedy=_REMEDY)
    return line.strip()


class ManualLasers:
    """Lasers that a person switches. The person is asked only for changes."""

    def __init__(self, rig: RigDescription) -> None:
        self.wavelengths_m = rig.wavelengths_m
        self._state: tuple[float, float] | None = None
        self._is_known = False

    def switch_on(self, wavelength_m: float, power: float) -> None:
        """Asks for one laser at a power, relative to its nominal one, and for all others to be off."""
        if self._is_known and self._state == (wavelength_m, power):
            return
        self._is_known = False
        ask_person("lasers", f"switch {wavelength_m * 1e9:g} nm on at {power:g} of its power, and all others off")
        self._state, self._is_known = (wavelength_m, power), True

    def switch_off(self) -> None:
        """Asks for all lasers to be off."""
        if self._is_known and self._state is None:
            return
        self._is_known = False
        ask_person("lasers", "switch all lasers off")
        self._state, self._is_known = None, True

    def close(self) -> None:
        """Asks for lasers that were switched on to be off."""
        if self._state is not None:
            self.switch_off()


class ManualStage:
    """A stage that a person moves."""

    def __init__(self, rig: RigDescription) -> None:
        self.range_m = rig.stage_m
        self._distance_m: float | None = None

    def move_to(self, distance_m: float) -> float:
        """Asks for the camera to be moved; returns the typed distance, or else the distance that was asked for."""
        if self._distance_m == distance_m:
            return distance_m
        self._distance_m = None
        wanted = units.format_rounded(distance_m, "mm")
        answer = ask_person("stage", f"move the camera to {wanted} (and type the position if you read another one)")
        while (found_m := self._parsed(answer, distance_m)) is None:
            low, high = (units.format_rounded(z, "mm") for z in self.range_m)
            answer = ask_person("stage", f'"{answer}" is no position from {low} to {high}: type it in mm')
        self._distance_m = distance_m
        return found_m

    def close(self) -> None:
        """Nothing is open."""

    def _parsed(self, answer: str, distance_m: float) -> float | None:
        """The typed distance, m; None if it isn't one."""
        if not answer:
            return distance_m
        try:
            found_m = units.parse(answer if answer[-1:].isalpha() else f"{answer} mm", "stage", units.quantity_of("mm"))
        except UserError:
            return None
        low, high = self.range_m
        return found_m if low <= found_m <= high else None
