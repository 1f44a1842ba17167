"""How the light behind the last modulator and its stops changes with the gap, computed beside a viewer at rest.

A quick frame has no orders of diffraction that stops could take away; how many they take depends on the gap, most near
the one for which patterns were found. The brightness of a full frame follows the power behind the stops (Parseval):

    X(gap) = X(last full frame) · Σ_λ p_λ·P_λ(gap)·x_λ / Σ_λ p_λ·P_λ(gap of that frame)·x_λ

p are the powers of the lasers, x their X (or Y, Z) at unit power, and P is interpolated between a few gaps by monotonic
cubics. That the share of the light that leaves the picture on its way changes with the gap too is left out.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.colour import observer_weights
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.viewer.render.scene import Scene

IDLE_BEFORE_TABLE_S = 2.0
"""The time at rest after which the table is computed, so that no edit waits for a processor."""
_GAPS = (0.0, 0.2, 0.35, *np.geomspace(0.5, 2.0, 17).tolist(), 2.8, 4.0)  # as multiples of the scene's
_MOST_SAMPLES = 2**23  # of a padded grid: some 0.2 s for each laser and gap on a core, and 400 MB


@dataclass(frozen=True, eq=False)
class _Table:
    """Of a drive and a bench but for its gap: the powers (laser,) behind the last element by the gap, at unit power."""

    drive: Any
    bench: System
    longest_m: float
    powers: Callable[[float], NDArray[np.float64]]


class LightByGap:
    """A table of the light by the gap, filled on a thread: `prepare` after each full frame, `ratio` while it moves.

    is_held: while it is true nothing is computed, so that jobs have the processor; what was asked for last follows.
    """

    def __init__(self) -> None:
        self._table: _Table | None = None
        self._begun: tuple[Any, System, dict[float, list[float]]] | None = None  # of a drive and a bench, by the gap
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._wanted: Scene | None = None
        self._is_held = False

    @property
    def is_held(self) -> bool:
        return self._is_held

    @is_held.setter
    def is_held(self, is_held: bool) -> None:
        if is_held == self._is_held:
            return
        self._is_held = is_held
        if is_held:
            self._stop.set()
        elif self._wanted is not None:
            self.prepare(self._wanted)

    def prepare(self, scene: Scene) -> None:
        """Begins the table of a scene on a thread, unless it is there; not without a gap, nor for a huge grid."""
        self.stop()
        system, self._wanted = scene.system, scene
        if self._is_held or system.is_chain or not system.gap_m or self._holds(scene):
            return
        if math.prod(make_plan(system).grid.padded) <= _MOST_SAMPLES:
            self._stop = threading.Event()
            arguments = scene, self._stop
            self._thread = threading.Thread(
                target=self._fill, args=arguments, name="holoview: light by gap", daemon=True
            )
            self._thread.start()

    def ratio(self, before: Scene, now: Scene) -> NDArray[np.float64] | None:
        """(X, Y, Z) of a scene by those of another, from which its gap alone differs; None where unknown."""
        if now.drive is not before.drive or now.plane_m != before.plane_m or not now.system.gap_m:
            return None
        if now.system.with_(gap=before.system.gap_m) != before.system or not (self._holds(now) and self._holds(before)):
            return None
        old, new = self._xyz(before), self._xyz(now)
        return None if not old.all() else new / old

    def stop(self) -> None:
        """Ends the thread's work, at the latest behind the laser that it computes now."""
        self._wanted = None
        self._stop.set()

    def close(self) -> None:
        """Ends the thread, which must not be in PyTorch when the program ends."""
        self.stop()
        self.wait()

    def wait(self) -> None:
        """Waits until the thread has ended: the table that was begun is there, or was stopped."""
        if self._thread is not None:
            self._thread.join()

    def _holds(self, scene: Scene) -> bool:
        table, gap_m = self._table, scene.system.gap_m
        if table is None or not gap_m or table.drive is not scene.drive:
            return False
        return bool(gap_m <= table.longest_m) and table.bench == _apart_from_gap(scene.system)

    def _xyz(self, scene: Scene) -> NDArray[np.float64]:
        table, system = self._table, scene.system
        assert table is not None and system.gap_m is not None
        return (
            table.powers(system.gap_m)
            * system.amplitudes.sum(axis=0)
            @ observer_weights(system.observer, system.wavelengths_m)
        )

    def _fill(self, scene: Scene, stop: threading.Event) -> None:
        if stop.wait(IDLE_BEFORE_TABLE_S):
            return
        bench, gap_m = _apart_from_gap(scene.system), scene.system.gap_m
        assert gap_m is not None
        if self._begun is None or self._begun[0] is not scene.drive or self._begun[1] != bench:
            self._begun = scene.drive, bench, {}
        found = self._begun[2]
        for gap in (gap_m * np.array(_GAPS)).tolist():
            with suppress(UserError):  # a gap that this bench can't have
                powers = found[gap] if gap in found else _powers(bench.with_(gap=gap), scene.drive, stop)
                if stop.is_set():
                    return
                found[gap] = powers
        if len(found) > 1:
            from scipy.interpolate import PchipInterpolator  # slow start

            gaps_m = sorted(found)
            powers_at = PchipInterpolator(gaps_m, np.array([found[gap] for gap in gaps_m]))
            self._table = _Table(scene.drive, bench, gaps_m[-1], powers_at)


def _apart_from_gap(system: System) -> System:
    """A bench with one gap whatever its own, and with each laser at unit power."""
    powers = system.amplitudes.sum(axis=0)
    return system.with_(gap="1 mm", amplitudes=system.amplitudes / np.where(powers > 0, powers, 1.0))


def _powers(system: System, drive: Any, stop: threading.Event) -> list[float]:
    """(laser,): power behind the last element; one laser at a time, of which those behind a stop are left out."""
    from holoview.light.engine.light_behind import power_behind  # slow start: importing torch takes a second

    powers = []
    for laser in range(len(system.wavelengths_m)):
        alone = np.zeros_like(system.amplitudes)
        alone[:, laser] = system.amplitudes[:, laser]
        is_left_out = stop.is_set() or not alone.any()
        plan = make_plan(system.with_(amplitudes=alone)) if not is_left_out else None
        powers.append(0.0 if plan is None else float(power_behind(plan, drive).sum()))
    return powers
