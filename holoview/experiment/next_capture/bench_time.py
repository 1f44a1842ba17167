"""How long a capture takes on the bench, learned from those that were taken."""

from __future__ import annotations

from dataclasses import dataclass

from holoview.rig.devices import Devices

_GUESSED_SPEED = 5e-3  # m/s of a stage, until it has moved
_GUESSED_READOUT_S = 0.05


@dataclass
class BenchTime:
    """Seconds of a capture: move + settle + exposure + readout.

    settle_s: of the modulators. The stage's speed (m/s) and what is added to each exposure follow from the clock.
    """

    settle_s: float
    moved_m: float = 0.0
    moving_s: float = 0.0
    _readouts: tuple[float, ...] = ()

    @classmethod
    def of(cls, devices: Devices) -> BenchTime:
        """Of these devices, before any capture."""
        return cls(max(modulator.settle_s for modulator in devices.modulators))

    @property
    def readout_s(self) -> float:
        """What a capture takes beside moving, settling and its exposure; the median of those taken."""
        ordered = sorted(self._readouts)
        return ordered[len(ordered) // 2] if ordered else _GUESSED_READOUT_S

    @property
    def speed(self) -> float:
        """Of the stage, m/s."""
        return self.moved_m / self.moving_s if self.moving_s > 0 and self.moved_m > 0 else _GUESSED_SPEED

    def expect(self, move_m: float, exposure_s: float) -> float:
        """Seconds of a capture for which the stage moves so far."""
        return abs(move_m) / self.speed + self.settle_s + exposure_s + self.readout_s

    def note(self, move_m: float, exposure_s: float, seconds: float) -> None:
        """Learns from a capture that took so many seconds."""
        still = self.settle_s + exposure_s + self.readout_s
        if abs(move_m) > 0:
            self.moved_m += abs(move_m)
            self.moving_s += max(seconds - still, 1e-6)
        else:
            self._readouts = (*self._readouts, max(seconds - self.settle_s - exposure_s, 0.0))
