"""Devices of which can be told, at any time and from any thread, which one is being waited for."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, cast

from holoview.rig.devices import BenchClock, CameraDevice, Devices, LasersDevice, ModulatorDevice, StageDevice


class DeviceWatch:
    """What the thread of the devices waits for."""

    def __init__(self) -> None:
        self._waiting: tuple[str, float] | None = None

    @contextmanager
    def waiting_for(self, name: str) -> Iterator[None]:
        """A context within which the thread waits for something, such as "the camera"."""
        self._waiting = (name, time.monotonic())
        try:
            yield
        finally:
            self._waiting = None

    @property
    def waiting(self) -> tuple[str, float] | None:
        """What is being waited for, and for how many seconds; None while nothing is."""
        found = self._waiting
        return None if found is None else (found[0], time.monotonic() - found[1])


def watch_devices(devices: Devices, lasers: LasersDevice, watch: DeviceWatch) -> Devices:
    """The same devices, with `lasers` as lasers, each call of which is seen by `watch`."""
    names = ("the modulator",) if len(devices.modulators) == 1 else ("modulator 1", "modulator 2")
    return Devices(
        tuple(cast(ModulatorDevice, _Watched(m, n, watch)) for m, n in zip(devices.modulators, names, strict=True)),
        cast(CameraDevice, _Watched(devices.camera, "the camera", watch)),
        cast(LasersDevice, _Watched(lasers, "the lasers", watch)),
        cast(StageDevice, _Watched(devices.stage, "the stage", watch)),
        cast(BenchClock, _Watched(devices.clock, "the patterns to settle", watch)),
    )


class _Watched:
    """A device whose attributes are those of another one, with its methods watched."""

    def __init__(self, device: object, name: str, watch: DeviceWatch) -> None:
        self._device, self._name, self._watch = device, name, watch

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._device, name)
        return self._watched(found) if callable(found) else found

    def _watched(self, method: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **keywords: Any) -> Any:
            with self._watch.waiting_for(self._name):
                return method(*arguments, **keywords)

        return call
