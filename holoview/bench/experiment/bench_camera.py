"""Shows patterns on a rig and takes pictures of them: exposures, dark level, saturated pixels.

Lasers keep one power in all pictures; the optimiser's amplitudes weight the pictures when they are summed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Captures
from holoview.bench.rig.camera_pictures import range_share, take_dark_frame
from holoview.bench.rig.capture_plan import CaptureRequest
from holoview.bench.rig.description import RigDescription
from holoview.bench.rig.devices import CameraDevice, Counts, Devices, Levels, Wrapped
from holoview.bench.rig.measurement import Measurement
from holoview.util.progress import TextCallback

_TOO_BRIGHT, _TOO_DARK = 0.95, 0.2  # of the camera's range, beyond which an exposure is searched anew
_DARK_PICTURES = 4  # whose mean is the dark level of an exposure
_NO_SEED = (0, 0)


@dataclass(frozen=True)
class PictureRequest:
    """One picture: the frame whose patterns are shown, the laser that is on, and the focal plane."""

    frame: int
    wavelength_m: float
    distance_m: float


@dataclass(frozen=True)
class TakenPicture:
    """A picture that a camera took.

    light (y, x): counts above the dark level, per second of unit power. saturated (y, x): pixels of which only a lower
    bound is known. capture: the capture with its record.
    """

    light: NDArray[np.float64]
    saturated: NDArray[np.bool_]
    capture: Captures


class PictureSource(Protocol):
    """A source of pictures, real or in a test; `exposures_s` may be set to those of an earlier run."""

    exposures_s: dict[float, float]

    @property
    def pictures(self) -> int:
        """How many pictures have been taken, with those of searches and of the dark."""

    @property
    def bench_s(self) -> float:
        """Seconds of bench time since the first one."""

    def record(self, levels: NDArray[np.uint16], shots: Sequence[PictureRequest]) -> list[TakenPicture]:
        """The pictures of these shots, in their order. levels: grey levels (frame, modulator, y, x)."""

    def rest(self) -> None:
        """Switches the lasers off while nothing is recorded."""


@dataclass(eq=False)
class _CountingCamera(Wrapped[CameraDevice]):
    """A camera that counts its pictures."""

    taken: int = 0

    def take(self) -> Counts:
        self.taken += 1
        return self.device.take()


@dataclass
class BenchCamera:
    """Takes pictures on open devices, which the caller closes.

    exposures_s: of each wavelength; searched for the first picture, and anew when a picture is too bright or all
    pictures of a hologram are much too dark. tell: called with news for a user, as of `Measurement`.
    """

    rig: RigDescription
    devices: Devices
    exposures_s: dict[float, float] = field(default_factory=dict)
    tell: TextCallback = lambda _: None
    _distance_m: float | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self._camera = _CountingCamera(self.devices.camera)
        devices = dataclasses.replace(self.devices, camera=self._camera)
        self._measurement = Measurement(self.rig, devices, self.tell)
        self._dark: dict[float, NDArray[np.float32]] = {}
        self._began_s = devices.clock.now()

    @property
    def pictures(self) -> int:
        return self._camera.taken

    @property
    def bench_s(self) -> float:
        return self.devices.clock.now() - self._began_s

    def record(self, levels: NDArray[np.uint16], shots: Sequence[PictureRequest]) -> list[TakenPicture]:
        """See `PictureSource`. Raises DeviceError, and UserError for settings that the safety limits don't allow."""
        narrow = [levels[frame].astype(self._levels_type) for frame in range(len(levels))]
        taken = {k: self._capture(narrow[shots[k].frame], shots[k]) for k in self._order(shots)}
        for λ in {shot.wavelength_m for shot in shots}:
            own = [taken[k].images[0] for k, shot in enumerate(shots) if shot.wavelength_m == λ]
            if max(range_share(image, self.rig.bench.camera) for image in own) < _TOO_DARK:
                del self.exposures_s[λ]  # searched for the next picture
        return [self._picture(taken[k]) for k in range(len(shots))]

    def rest(self) -> None:
        self.devices.lasers.switch_off()

    @property
    def _levels_type(self) -> type[np.unsignedinteger]:
        return np.uint8 if max(slm.num_levels for slm in self.rig.bench.slms) <= 256 else np.uint16

    def _order(self, shots: Sequence[PictureRequest]) -> list[int]:
        """Plane by plane, since the stage is slowest; the nearest to where it is first."""
        distances = sorted({shot.distance_m for shot in shots})
        here = distances[0] if self._distance_m is None else self._distance_m
        if abs(here - distances[-1]) < abs(here - distances[0]):
            distances.reverse()
        self._distance_m = distances[-1]
        return sorted(range(len(shots)), key=lambda k: (distances.index(shots[k].distance_m), shots[k].frame))

    def _capture(self, levels: Levels, shot: PictureRequest) -> Captures:
        """A capture with the exposure of its wavelength, searched where that is too long."""
        exposure_s = self.exposures_s.get(shot.wavelength_m)
        power = self.rig.limits.power
        request = CaptureRequest(shot.wavelength_m, shot.distance_m, power, 0.0, _NO_SEED, exposure_s)
        capture = self._measurement.take(request, levels)
        share = range_share(capture.images[0], self.rig.bench.camera)
        if exposure_s is not None and share > _TOO_BRIGHT:
            capture = self._measurement.take(dataclasses.replace(request, exposure_s=None), levels)
        self.exposures_s[shot.wavelength_m] = float(capture.exposure_s[0])
        return capture

    def _picture(self, capture: Captures) -> TakenPicture:
        counts, exposure_s = capture.images[0], float(capture.exposure_s[0])
        light = (counts - self._dark_level(exposure_s)) / (exposure_s * float(capture.power[0]))
        return TakenPicture(light, counts >= self.rig.bench.camera.saturation, capture)

    def _dark_level(self, exposure_s: float) -> NDArray[np.float32]:
        """Counts (y, x) without lasers at an exposure."""
        if exposure_s not in self._dark:
            self.devices.lasers.switch_off()
            self._dark[exposure_s] = take_dark_frame(self._camera, exposure_s, _DARK_PICTURES).mean
        return self._dark[exposure_s]
