"""Small rigs whose bench runs in this process, and a camera that sees exactly what a model predicts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from holoview.bench.experiment.bench_camera import PictureRequest, TakenPicture
from holoview.bench.experiment.camera_problem import CameraProblem, camera_sampling
from holoview.bench.experiment.rig_bench import on_rig, system_of_rig
from holoview.bench.rig import RigDescription, read_rig
from holoview.bench.rig.devices import Counts, DeviceError, Devices, Levels, limit_devices
from holoview.bench.rig.virtual.server import VirtualBench, read_virtual_settings
from holoview.holograms.optimise.settings import Settings
from holoview.light.model.system import System

SHAPE = (24, 32)
PLANE_M = 2e-3


def rig_text(
    *,
    pixels: tuple[int, int] = (48, 64),
    pitch_um: float = 4.0,
    lasers: str = '["520 nm"]',
    hidden: str = "",
    bits: int = 12,
) -> str:
    """A description of a virtual rig with two modulators."""
    slm = f'device = "virtual"\nshape = {list(SHAPE)}\npitch = "8 um"\nnum_levels = 256\nopd_range = "825 nm"\n'
    return (
        f"[slm1]\n{slm}[slm2]\n{slm}"
        f'[camera]\ndevice = "virtual"\nshape = {list(pixels)}\npitch = "{pitch_um} um"\nbit_depth = {bits}\n'
        "electrons_per_count = 4.0\nread_noise = 3.0\nblack_level = 64\n"
        f'[lasers]\ndevice = "virtual"\nwavelengths = {lasers}\n'
        '[stage]\ndevice = "virtual"\nrange = ["0 mm", "10 mm"]\n'
        "[limits]\npower = 1.0\nexposure = [1e-5, 0.5]\n"
        f'[geometry]\ngap = "1 mm"\niris1_na = 0.03\niris2_na = 0.03\n[virtual]\nseed = 1\n{hidden}'
    )


MakeRig = Callable[..., RigDescription]


@pytest.fixture
def make_rig(tmp_path: Path) -> MakeRig:
    """`make_rig(pitch_um=8.0, …)` writes rig.toml and reads it."""

    def make(**values: object) -> RigDescription:
        (tmp_path / "rig.toml").write_text(rig_text(**values), encoding="utf-8")  # type: ignore[arg-type]
        return read_rig(tmp_path / "rig.toml")

    return make


def system_on(rig: RigDescription, **changes: object) -> System:
    """The rig's own bench with one focal plane."""
    return on_rig(system_of_rig(rig).edit({"planes": [PLANE_M], **changes}), rig)


def target_on(system: System) -> NDArray[np.float32]:
    """A smooth random picture at every plane, (plane, y, x, 3)."""
    rng = np.random.default_rng(7)
    shape = [n * system.sampling.upsample for n in system.modulators[0].shape]
    picture = gaussian_filter(rng.random((len(system.planes_m), *shape, 3)), (0, 5, 5, 0))
    return (0.6 * (picture - picture.min()) / np.ptp(picture)).astype(np.float32)


class ModelCamera:
    """Takes the pictures that a model of the bench predicts, without noise unless `noise` counts per second of it.

    system: of the bench as it is. scale: counts per second for unit intensity. shift_m: of the camera.
    """

    def __init__(
        self,
        system: System,
        rig: RigDescription,
        *,
        scale: float = 5e4,
        shift_m: tuple[float, float] = (0.0, 0.0),
        noise: float = 0.0,
    ) -> None:
        self.exposures_s: dict[float, float] = {}
        self.pictures, self.bench_s, self.rested, self.recorded = 0, 0.0, 0, list[NDArray[np.uint16]]()
        self._system, self._rig, self._scale, self._noise = system, rig, scale, noise
        self._problem = CameraProblem(system, target_on(system), Settings(), rig)
        self._view = camera_sampling(rig, self._problem.model.plan.grid.shape, self._problem.sample_pitch_m, shift_m)

    def record(self, levels: NDArray[np.uint16], shots: Sequence[PictureRequest]) -> list[TakenPicture]:
        self.recorded.append(levels)
        strokes = np.array([m.stroke_m for m in self._system.modulators])[:, None, None]
        seen = []
        for patterns in levels:
            drive = np.stack([m.levels[n] for m, n in zip(self._system.modulators, patterns, strict=True)])
            opd = torch.tensor(np.stack([drive * strokes] * self._system.frames), dtype=torch.float32)
            seen.append(self._view.picture(self._problem.predict(opd)).double().numpy())
        return [self._picture(seen[shot.frame], shot, levels[shot.frame]) for shot in shots]

    def rest(self) -> None:
        self.rested += 1

    def _picture(self, seen: NDArray[np.float64], shot: PictureRequest, levels: NDArray[np.uint16]) -> TakenPicture:
        self.pictures += 1
        plane = int(np.argmin(np.abs(self._system.planes_m - shot.distance_m)))
        wavelengths = self._system.wavelengths_m
        laser = next(
            i for i, (_, λ) in enumerate(self._problem.lasers) if np.isclose(wavelengths[λ], shot.wavelength_m)
        )
        light = self._scale * seen[plane, laser]
        if self._noise:  # the same for the same pattern, whenever it is shown
            rng = np.random.default_rng([int(levels.sum()), laser])
            light = light + self._noise * rng.standard_normal(light.shape)
        capture = self._rig.blank_capture()
        return TakenPicture(light, np.zeros(light.shape, bool), capture)


@dataclass
class BenchHere:
    """A virtual bench in this process as devices. fail_after: pictures after which the camera doesn't answer."""

    rig: RigDescription
    fail_after: int = 10**9
    exposures: list[float] = field(default_factory=list)
    was_off: bool = False

    def __post_init__(self) -> None:
        self.bench = VirtualBench(self.rig, read_virtual_settings(self.rig))
        self.shape, self.settle_s, self.taken = self.rig.camera_shape, 0.0, 0
        self.exposures_s, self.range_m = self.rig.limits.exposures_s, self.rig.stage_m
        self.wavelengths_m = self.rig.wavelengths_m

    def devices(self) -> Devices:
        """All devices, within the rig's safety limits."""
        modulators = tuple(_Modulator(self.bench, n, shape=shape) for n, shape in enumerate(self.rig.slm_shapes))
        return limit_devices(Devices(modulators, self, self, self, self), self.rig.limits)

    def set_exposure(self, exposure_s: float) -> float:
        self.exposures.append(exposure_s)
        return self.bench.expose(exposure_s)

    def take(self) -> Counts:
        self.taken += 1
        if self.taken > self.fail_after:
            raise DeviceError("camera", "sent no picture", remedy="look at its cable")
        return self.bench.take()

    def switch_on(self, wavelength_m: float, power: float) -> None:
        self.bench.switch_on(wavelength_m, power)
        self.was_off = False

    def switch_off(self) -> None:
        self.bench.switch_off()
        self.was_off = True

    def move_to(self, distance_m: float) -> float:
        return self.bench.move_to(distance_m)

    def now(self) -> float:
        return self.bench.time_s

    def wait(self, seconds: float) -> None:
        self.bench.wait(seconds)

    def close(self) -> None:
        pass


@dataclass
class _Modulator:
    bench: VirtualBench
    number: int
    settle_s: float = 0.01
    shape: tuple[int, int] = SHAPE

    def show(self, levels: Levels) -> None:
        self.bench.show(self.number, levels)

    def close(self) -> None:
        pass
