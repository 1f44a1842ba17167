"""Opens the devices that a rig's description names.

A kind of device is a function from the rig and the device's table to the device; `KINDS` lists them. Lasers go off also
when the program that opened them is killed, or crashes in a vendor's driver: a second process (`guard_process`) waits
for the end of a pipe from the first one, which the operating system closes, and then switches them off.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

from holoview.bench.rig.description import DeviceSpec, RigDescription
from holoview.bench.rig.devices import BenchClock, Devices, LasersDevice, Wrapped, limit_devices
from holoview.bench.rig.kinds.manual import open_manual
from holoview.bench.rig.kinds.micromanager import SharedCore, open_micromanager
from holoview.bench.rig.kinds.python_file import open_python
from holoview.bench.rig.kinds.serial_line import open_serial
from holoview.bench.rig.kinds.slmsuite_kind import open_slmsuite
from holoview.bench.rig.registration import register_devices
from holoview.bench.rig.virtual.client import (
    VirtualBenchProcess,
    VirtualCamera,
    VirtualClock,
    VirtualLasers,
    VirtualModulator,
    VirtualStage,
)
from holoview.util.errors import UserError, suggest_matches


@dataclass
class OpeningRig:
    """Libraries and processes that the devices of one rig share while they are opened.

    bench: the process of the virtual bench. modules: Python files that have been run. cores: configurations of
    Micro-Manager that are loaded.
    """

    rig: RigDescription
    stack: ExitStack
    bench: VirtualBenchProcess | None = field(default=None)
    modules: dict[Path, ModuleType] = field(default_factory=dict)
    cores: dict[Path, SharedCore] = field(default_factory=dict)

    def virtual_bench(self) -> VirtualBenchProcess:
        """The process of the virtual bench, which the first of its devices starts."""
        if self.bench is None:
            self.bench = VirtualBenchProcess(self.rig.path)
            self.stack.callback(self.bench.close)
        return self.bench


Opener = Callable[[OpeningRig, DeviceSpec], Any]
_NEED_NO_GUARD = ("virtual", "manual")  # the virtual bench has an interlock; a person has eyes
_END_S = 30.0  # for the guard to end

ALL_OFF = "off"
"""The line by which the guard learns that all lasers are off."""


class SystemClock:
    """The clock of a bench of real devices."""

    def now(self) -> float:
        return time.monotonic()

    def wait(self, seconds: float) -> None:
        time.sleep(max(seconds, 0.0))


def open_rig(rig: RigDescription) -> Devices:
    """Opens all devices of a rig, within its safety limits and registered; use it in a `with` statement.

    Raises UserError for a kind that is unknown or that the table can't have, and DeviceError for a device that doesn't
    answer; devices that were open by then are closed.
    """
    openers = {name: _opener(rig, spec) for name, spec in rig.devices.items()}  # before anything is opened
    with ExitStack() as stack:
        opening = OpeningRig(rig.as_described, stack)
        opened: dict[str, Any] = {}
        for name, spec in rig.devices.items():
            opened[name] = openers[name](opening, spec)
            if name == "lasers" and spec.kind not in _NEED_NO_GUARD:
                opened[name] = GuardedLasers(opened[name], rig.path)
            stack.callback(opened[name].close)
        clock: BenchClock = SystemClock() if opening.bench is None else VirtualClock(opening.bench)
        modulators = tuple(opened[name] for name in rig.modulator_names)
        devices = Devices(modulators, opened["camera"], opened["lasers"], opened["stage"], clock)
        stack.pop_all()  # they stay open
    return limit_devices(
        devices if rig.registration is None else register_devices(devices, rig.registration, rig.dotted[-1]), rig.limits
    )


def open_lasers(rig: RigDescription) -> LasersDevice:
    """Opens the lasers of a rig alone, to switch them off. Raises as `open_rig` does."""
    spec = rig.devices["lasers"]
    with ExitStack() as stack:
        lasers: LasersDevice = _opener(rig, spec)(OpeningRig(rig, stack), spec)
        stack.pop_all()  # they stay open
    return lasers


def _open_virtual(opening: OpeningRig, spec: DeviceSpec) -> Any:
    bench, rig = opening.virtual_bench(), opening.rig
    if spec.name in rig.modulator_names:
        number = rig.modulator_names.index(spec.name)
        return VirtualModulator(bench, rig, number, float(spec.options.get("settle", 0.0)))
    return {"camera": VirtualCamera, "lasers": VirtualLasers, "stage": VirtualStage}[spec.name](bench, rig)


KINDS: Mapping[str, Opener] = {
    "virtual": _open_virtual,
    "slmsuite": lambda opening, spec: open_slmsuite(opening.rig, spec),
    "manual": lambda opening, spec: open_manual(opening.rig, spec),
    "serial": lambda opening, spec: open_serial(opening.rig, spec),
    "micromanager": lambda opening, spec: open_micromanager(opening.rig, spec, opening.cores),
    "python": lambda opening, spec: open_python(opening.rig, spec, opening.modules),
}
"""How devices are opened, by the word `device` of their tables in rig.toml."""


def _opener(rig: RigDescription, spec: DeviceSpec) -> Opener:
    if spec.kind not in KINDS:
        where = f"{rig.path}: {spec.name}.device"
        raise UserError(where, f'"{spec.kind}"', remedy=suggest_matches(spec.kind, KINDS))
    return KINDS[spec.kind]


class GuardedLasers(Wrapped[LasersDevice]):
    """Lasers, and the process that switches them off if this one can't. rig_path: where they are described."""

    def __init__(self, lasers: LasersDevice, rig_path: Path) -> None:
        super().__init__(lasers)
        self._is_off = True
        command = [sys.executable, "-m", "holoview.bench.rig.guard_process", str(rig_path)]
        self._guard = subprocess.Popen(command, stdin=subprocess.PIPE, text=True, start_new_session=True)

    def switch_on(self, wavelength_m: float, power: float) -> None:
        self._is_off = False
        self.device.switch_on(wavelength_m, power)

    def switch_off(self) -> None:
        self.device.switch_off()
        self._is_off = True

    def close(self) -> None:
        """Closes the lasers; if they couldn't be switched off, the guard tries."""
        try:
            self.device.close()
        finally:
            self._dismiss()

    def _dismiss(self) -> None:
        """Ends the guard, which has nothing to do once the lasers are off; a second call does nothing."""
        stdin = self._guard.stdin
        if stdin is None or stdin.closed:
            return
        try:
            if self._is_off:
                stdin.write(ALL_OFF)
            stdin.close()
        except OSError:  # it is gone, as at the end of a terminal's session
            pass
        self._guard.wait(_END_S)
