"""Lasers that go off when the program that had opened them is gone without having switched them off.

A program that is killed, or that crashes in a vendor's driver, can't do it any more. So a second process waits for the
end of a pipe from the first, which the system closes whatever ends that (`guard_process`).
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from holoview.rig.devices import LasersDevice

ALL_OFF = "off"
"""What the guard is told when it has nothing to do."""

_END_S = 30.0


class GuardedLasers:
    """Lasers, and the process that switches them off if this one can't. rig_path: where they are described."""

    def __init__(self, lasers: LasersDevice, rig_path: Path) -> None:
        self._lasers, self._is_off = lasers, True
        command = [sys.executable, "-m", "holoview.rig.guard_process", str(rig_path)]
        self._guard = subprocess.Popen(command, stdin=subprocess.PIPE, text=True, start_new_session=True)

    @property
    def wavelengths_m(self) -> tuple[float, ...]:
        """Of the lasers."""
        return self._lasers.wavelengths_m

    def switch_on(self, wavelength_m: float, power: float) -> None:
        """As of the lasers."""
        self._is_off = False
        self._lasers.switch_on(wavelength_m, power)

    def switch_off(self) -> None:
        """As of the lasers."""
        self._lasers.switch_off()
        self._is_off = True

    def close(self) -> None:
        """Closes the lasers; if they couldn't be switched off, the guard tries."""
        try:
            self._lasers.close()
        finally:
            self._dismiss()

    def _dismiss(self) -> None:
        """Ends the guard, which has nothing to do if the lasers are off; twice is once."""
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
