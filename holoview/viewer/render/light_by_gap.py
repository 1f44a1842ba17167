"""How the light behind the last modulator and its stops changes with the gap, computed beside a viewer at rest.

A quick frame has no orders of diffraction that stops could take away; how many they take depends on the gap, most near
the one for which patterns were found. The brightness of a full frame follows the power behind the stops (Parseval):

    X(gap) = X(last full frame) · Σ_λ p_λ·P_λ(gap)·x_λ / Σ_λ p_λ·P_λ(gap of that frame)·x_λ

p are the powers of the lasers, x their X (or Y, Z) at unit power, and P is interpolated between a few gaps by monotonic
cubics. The gaps nearest to the present one come first, and are used as soon as they are there. That the share of the
light that leaves the picture on its way changes with the gap too is left out.
"""

from __future__ import annotations

import bisect
import math
import threading
from collections.abc import Callable
from contextlib import suppress
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
_GAPS = (0.0, 0.2, 0.35, *np.geomspace(0.5, 2.0, 17).tolist(), 2.8, 4.0)  # as multiples of the first scene's
_MOST_SAMPLES = 2**23  # of a padded grid: some 0.2 s for each laser and gap on a core, and 400 MB


class _Table:
    """Of a drive and a bench but for its gap: the powers (laser,) behind the last element by the gap, at unit power.

    gaps_m: where they are computed, in rising order. found: those that are there; None of a gap that the bench can't
    have.
    """

    def __init__(self, drive: Any, bench: System, around_m: float) -> None:
        self.drive, self.bench = drive, bench
        self.gaps_m: list[float] = (around_m * np.array(_GAPS)).tolist()
        self.found: dict[float, list[float] | None] = {}
        self._powers_at: Callable[[float], NDArray[np.float64]] | None = None

    def missing_m(self, near_m: float) -> list[float]:
        """The gaps that aren't there yet, by their ratio to another one."""
        left = [gap_m for gap_m in self.gaps_m if gap_m not in self.found]
        return sorted(left, key=lambda gap_m: abs(math.log(gap_m / near_m)) if gap_m else math.inf)

    def add(self, gap_m: float, powers: list[float] | None) -> None:
        """Adds the powers of a gap."""
        from scipy.interpolate import PchipInterpolator  # slow start

        found = self.found | {gap_m: powers}
        known = {gap_m: powers for gap_m, powers in sorted(found.items()) if powers is not None}
        if len(known) > 1:
            self._powers_at = PchipInterpolator(list(known), np.array(list(known.values())))
        self.found = found  # last: what `holds` tells is there

    def holds(self, gap_m: float) -> bool:
        """Whether the powers are known on either side of a gap."""
        above = bisect.bisect_left(self.gaps_m, gap_m)
        beside = self.gaps_m[max(above - 1, 0) : above + 1]
        return above < len(self.gaps_m) and all(self.found.get(other_m) is not None for other_m in beside)

    def powers(self, gap_m: float) -> NDArray[np.float64]:
        """The powers (laser,) at a gap that it holds."""
        assert self._powers_at is not None
        return self._powers_at(gap_m)


class LightByGap:
    """A table of the light by the gap, filled on a thread: `prepare` after each full frame, `ratio` while it moves.

    is_held: while it is true nothing is computed, so that jobs have the processor; what was asked for last follows.
    """

    def __init__(self) -> None:
        self._table: _Table | None = None
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
        """Begins the table of a scene on a thread, or goes on; not without a gap, nor for a huge grid."""
        self.stop()
        system, self._wanted = scene.system, scene
        if self._is_held or system.is_chain or not system.gap_m:
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
        gap_m = scene.system.gap_m
        return self._is_of(scene) and self._table is not None and gap_m is not None and self._table.holds(gap_m)

    def _is_of(self, scene: Scene) -> bool:
        """Whether the table is of the drive and the bench of a scene."""
        table = self._table
        return table is not None and table.drive is scene.drive and table.bench == _apart_from_gap(scene.system)

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
        gap_m, table = scene.system.gap_m, self._table
        assert gap_m is not None
        if table is None or not self._is_of(scene) or gap_m > table.gaps_m[-1]:
            table = self._table = _Table(scene.drive, _apart_from_gap(scene.system), gap_m)
        for other_m in table.missing_m(gap_m):
            powers = None
            with suppress(UserError):  # a gap that this bench can't have
                powers = _powers(table.bench.with_(gap=other_m), scene.drive, stop)
            if stop.is_set():
                return
            table.add(other_m, powers)


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
