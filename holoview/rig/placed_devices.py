"""Devices as if they were mounted as the bench's model has them: all turned as modulator 1, the camera on the axis."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from holoview.captures.orientations import undone
from holoview.rig.devices import CameraDevice, Counts, Devices, Levels, ModulatorDevice, StageDevice
from holoview.rig.placement import Placement


def place_devices(devices: Devices, placement: Placement) -> Devices:
    """The same devices: levels are turned on their way out, pictures turned back and cropped, distances measured."""
    turns = ("none", placement.slm2_turn or "none")
    modulators = tuple(_PlacedModulator(own, turn) for own, turn in zip(devices.modulators, turns, strict=False))
    return replace(
        devices,
        modulators=modulators,
        camera=_PlacedCamera(devices.camera, placement),
        stage=_PlacedStage(devices.stage, placement),
    )


@dataclass(frozen=True)
class _PlacedModulator:
    device: ModulatorDevice
    turn: str

    @property
    def shape(self) -> tuple[int, int]:
        return self.device.shape

    @property
    def settle_s(self) -> float:
        return self.device.settle_s

    def show(self, levels: Levels) -> None:
        self.device.show(np.ascontiguousarray(undone(levels, self.turn)))

    def close(self) -> None:
        self.device.close()


@dataclass(frozen=True)
class _PlacedCamera:
    device: CameraDevice
    placement: Placement

    @property
    def shape(self) -> tuple[int, int]:
        return self.placement.shape

    @property
    def exposures_s(self) -> tuple[float, float]:
        return self.device.exposures_s

    def set_exposure(self, exposure_s: float) -> float:
        return self.device.set_exposure(exposure_s)

    def take(self) -> Counts:
        (row, column), (rows, columns) = self.placement.first, self.placement.shape
        picture = undone(self.device.take(), self.placement.camera_turn)
        return np.ascontiguousarray(picture[row : row + rows, column : column + columns])

    def close(self) -> None:
        self.device.close()


@dataclass(frozen=True)
class _PlacedStage:
    device: StageDevice
    placement: Placement

    @property
    def range_m(self) -> tuple[float, float]:
        low, high = self.device.range_m
        return self.placement.distance_m(low), self.placement.distance_m(high)

    def move_to(self, distance_m: float) -> float:
        setting = float(np.clip(self.placement.setting_m(distance_m), *self.device.range_m))  # undoes rounding
        return self.placement.distance_m(self.device.move_to(setting))

    def close(self) -> None:
        self.device.close()
