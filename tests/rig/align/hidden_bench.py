"""Virtual benches with a placement that is hidden, and what should be found of it; devices without a process."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from holoview.bench.captures.dataset import ORIENTATIONS, nearest_orientation, orientation_matrix, oriented_shape
from holoview.bench.rig import RigDescription, read_rig
from holoview.bench.rig.devices import Counts, Devices, Levels, limit_devices
from holoview.bench.rig.registration import Registration
from holoview.bench.rig.virtual.server import VirtualBench, read_virtual_settings

PITCH_M, GAP_M, FOCAL_LENGTH_M = 8e-6, 1e-3, 0.1


@dataclass(frozen=True)
class Hidden:
    """What is hidden, in SI units, in the bench's own orientation. kind: "two", "one" (modulators) or "fourier".

    faults: effects that an alignment doesn't look for.
    """

    kind: str = "one"
    shape: tuple[int, int] = (48, 64)
    slm1: str = "none"
    slm2: str = "none"
    camera: str = "none"
    shift_m: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0
    magnification: float = 0.0
    slm2_shift_m: tuple[float, float] = (0.0, 0.0)
    slm2_rotation: float = 0.0
    gap_error_m: float = 0.0
    offset_m: float = 0.0
    scale: float = 0.0
    seed: int = 0
    faults: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def camera_pitch_m(self) -> float:
        """Nominal."""
        return 12e-6 if self.kind == "fourier" else PITCH_M / 2

    def write(self, folder: Path) -> RigDescription:
        """Writes rig.toml with its hidden table; returns the description."""
        slm = {
            "device": "virtual",
            "shape": list(self.shape),
            "pitch": "8 um",
            "num_levels": 256,
            "opd_range": "825 nm",
        }
        square = self.kind == "fourier"
        raw = (220, 240) if square else tuple(2 * n + 52 for n in oriented_shape(self.shape, self.slm1))
        tables: dict[str, Any] = {
            "slm1": slm,
            "camera": {
                "device": "virtual",
                "shape": list(oriented_shape((raw[0], raw[1]), self.camera)),
                "pitch": f"{self.camera_pitch_m * 1e6:g} um",
                "bit_depth": 12,
                "electrons_per_count": 4.0,
                "read_noise": 3.0,
                "black_level": 64,
            },
            "lasers": {"device": "virtual", "wavelengths": ["520 nm", "638 nm"]},
            "stage": {"device": "virtual", "range": ["-5 mm", "5 mm"] if square else ["0 mm", "10 mm"]},
            "limits": {"power": 1.0, "exposure": [1e-7, 0.5]},
            "geometry": {},
            "virtual": {"seed": self.seed, "prnu": 0.01, "effects": self._effects(), "placement": self._placement()},
        }
        if square:
            tables["geometry"]["focal_length"] = "100 mm"
        if self.kind == "two":
            tables |= {"slm2": slm, "geometry": {"gap": "1 mm", "iris1_na": 0.03, "iris2_na": 0.03}}
        path = folder / "rig.toml"
        path.write_text(tomli_w.dumps(tables), encoding="utf-8")
        return read_rig(path, is_registered=False)

    def _effects(self) -> dict[str, dict[str, float]]:
        effects: dict[str, dict[str, float]] = {
            "camera_alignment": {
                "shift_y": self.shift_m[0],
                "shift_x": self.shift_m[1],
                "rotation": self.rotation,
                "magnification": self.magnification,
            },
            "distance": {"distance_error": self.offset_m},
            "stage": {"scale": self.scale},
        }
        if self.kind == "two":
            effects["gap"] = {"gap_error": self.gap_error_m}
            effects["slm_alignment"] = {
                "shift_y": self.slm2_shift_m[0],
                "shift_x": self.slm2_shift_m[1],
                "rotation": self.slm2_rotation,
            }
        return effects | {name: dict(values) for name, values in self.faults.items()}

    def _placement(self) -> dict[str, str]:
        return {"slm1": self.slm1, "camera": self.camera} | ({"slm2": self.slm2} if self.kind == "two" else {})

    def expected_turns(self) -> tuple[str, str | None]:
        """Of the camera and of modulator 2, as seen from modulator 1."""
        camera = nearest_orientation(orientation_matrix(self.camera) @ orientation_matrix(self.slm1))
        second = nearest_orientation(orientation_matrix(self.slm1).T @ orientation_matrix(self.slm2))
        return camera, second if self.kind == "two" else None

    def expected_values(self) -> dict[str, float]:
        """As seen from modulator 1; centre_y, centre_x: on the picture turned back, in its pixels from its middle."""
        to_own = orientation_matrix(self.slm1).T
        sign = float(np.linalg.det(to_own))
        centre = to_own @ np.array(self.shift_m) / self.camera_pitch_m
        expected = {
            "pitch": self.camera_pitch_m / (1 + self.magnification),
            "rotation": sign * self.rotation,
            "centre_y": float(centre[0]),
            "centre_x": float(centre[1]),
            "stage_offset": self.offset_m,
            "stage_scale": self.scale,
            "walk_y": 0.0,
            "walk_x": 0.0,
        }
        if self.kind == "two":
            shift = to_own @ np.array(self.slm2_shift_m)
            expected |= {"slm2_shift_y": float(shift[0]), "slm2_shift_x": float(shift[1])}
            expected |= {"slm2_rotation": sign * self.slm2_rotation, "slm2_magnification": 0.0}
            expected["gap_error"] = self.gap_error_m
        return expected


def found_values(registration: Registration) -> dict[str, tuple[float, float]]:
    """Values and uncertainties of a placement, with the centre in pixels in place of what is left of the shift."""
    values = {name: (own.value, own.uncertainty) for name, own in registration.values.items()}
    raw = np.array(oriented_shape(registration.camera_shape, registration.camera_turn))
    for axis, name in enumerate("yx"):
        left, error = values.pop(f"shift_{name}")
        crop = registration.first[axis] + (registration.shape[axis] - 1) / 2 - (raw[axis] - 1) / 2
        values[f"centre_{name}"] = crop + left / registration["pitch"], error / registration["pitch"]
    return values


def draw(kind: str, seed: int, shape: tuple[int, int] = (48, 64)) -> Hidden:
    """A random placement: any turns that the shape allows, and errors of a first day in the laboratory."""
    rng = np.random.default_rng((seed, len(kind)))
    square = shape[0] == shape[1]
    slm1 = str(rng.choice(ORIENTATIONS))
    same = [t for t in ORIENTATIONS if square or oriented_shape(shape, t) == oriented_shape(shape, slm1)]
    size = 30e-6 if kind != "fourier" else 200e-6

    def pair(extent: float) -> tuple[float, float]:
        y, x = rng.uniform(-extent, extent, 2)
        return float(y), float(x)

    return Hidden(
        kind,
        shape,
        slm1=slm1,
        slm2=str(rng.choice(same)),
        camera=str(rng.choice(ORIENTATIONS)),
        shift_m=pair(size),
        rotation=float(rng.uniform(-0.02, 0.02)),
        magnification=float(rng.uniform(-0.03, 0.03)),
        slm2_shift_m=pair(20e-6),
        slm2_rotation=float(rng.uniform(-0.01, 0.01)),
        gap_error_m=float(rng.uniform(-0.2e-3, 0.2e-3)),
        offset_m=float(rng.uniform(-0.3e-3, 0.3e-3)) * (5 if kind == "fourier" else 1),
        scale=float(rng.uniform(-0.03, 0.03)),
        seed=seed,
    )


def devices_of(rig: RigDescription) -> tuple[Devices, VirtualBench]:
    """The devices of a virtual bench in this process, and the bench."""
    bench = VirtualBench(rig, read_virtual_settings(rig))
    modulators = tuple(_Modulator(bench, shape, k) for k, shape in enumerate(rig.slm_shapes))
    devices = Devices(modulators, _Camera(bench, rig), _Lasers(bench, rig), _Stage(bench, rig), _Clock(bench))
    return limit_devices(devices, rig.limits), bench


class _Closed:
    def close(self) -> None: ...


@dataclass
class _Modulator(_Closed):
    bench: VirtualBench
    shape: tuple[int, int]
    number: int
    settle_s: float = 0.0

    def show(self, levels: Levels) -> None:
        self.bench.show(self.number, levels)


@dataclass
class _Camera(_Closed):
    bench: VirtualBench
    rig: RigDescription

    @property
    def shape(self) -> tuple[int, int]:
        return self.rig.camera_shape

    @property
    def exposures_s(self) -> tuple[float, float]:
        return self.rig.limits.exposures_s

    def set_exposure(self, exposure_s: float) -> float:
        return self.bench.expose(exposure_s)

    def take(self) -> Counts:
        return self.bench.take()


@dataclass
class _Lasers(_Closed):
    bench: VirtualBench
    rig: RigDescription

    @property
    def wavelengths_m(self) -> tuple[float, ...]:
        return self.rig.wavelengths_m

    def switch_on(self, wavelength_m: float, power: float) -> None:
        self.bench.switch_on(wavelength_m, power)

    def switch_off(self) -> None:
        self.bench.switch_off()


@dataclass
class _Stage(_Closed):
    bench: VirtualBench
    rig: RigDescription

    @property
    def range_m(self) -> tuple[float, float]:
        return self.rig.stage_m

    def move_to(self, distance_m: float) -> float:
        return self.bench.move_to(distance_m)


@dataclass
class _Clock:
    bench: VirtualBench

    def now(self) -> float:
        return self.bench.time_s

    def wait(self, seconds: float) -> None:
        self.bench.wait(seconds)
