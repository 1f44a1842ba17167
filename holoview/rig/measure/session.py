"""Takes the captures of a plan that are missing; whatever interrupts it, the same call goes on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from holoview.captures.dataset import Captures
from holoview.rig.description import RigDescription
from holoview.rig.devices import Counts, Devices, Levels
from holoview.rig.measure.capture_plan import CapturePlan, CaptureRequest
from holoview.rig.measure.capture_store import CaptureStore
from holoview.rig.measure.exposure_search import take_exposed
from holoview.util.progress import ProgressCallback

_FIRST_EXPOSURE_S = 1e-2


class MeasurementSession:
    """Takes captures one after the other. devices: open ones, which the caller closes."""

    def __init__(self, rig: RigDescription, devices: Devices) -> None:
        self._rig, self._devices = rig, devices
        self._energy: dict[float, float] = {}  # power × exposure that suited each laser last
        self._distance_m: float | None = None

    def run(
        self,
        plan: CapturePlan,
        store: CaptureStore,
        progress: ProgressCallback,
        is_asked_to_end: Callable[[], bool] = lambda: False,
    ) -> bool:
        """Takes what is missing; returns whether all is there. Each capture is on the disk before the next begins."""
        missing = store.missing
        for done, number in enumerate(missing):
            if is_asked_to_end():
                return False
            request = plan.requests[number]
            progress(done, len(missing), f"{request.wavelength_m * 1e9:.0f} nm, {request.distance_m * 1e3:.3g} mm")
            store.add(number, self.take(request, request.levels(self._rig)))
        progress(len(missing), len(missing), "")
        return True

    def take(self, request: CaptureRequest, levels: Levels) -> Captures:
        """One capture of these patterns (modulator, y, x), a session of one."""
        rig, devices = self._rig, self._devices
        if request.distance_m != self._distance_m:
            devices.stage.move_to(request.distance_m)
            self._distance_m = request.distance_m
        devices.lasers.switch_on(request.wavelength_m, request.power)
        for modulator, own in zip(devices.modulators, levels, strict=True):
            modulator.show(own)
        devices.clock.wait(max(modulator.settle_s for modulator in devices.modulators))
        image, exposure_s = self._picture(request)
        self._energy[request.wavelength_m] = request.power * exposure_s
        return Captures(
            levels=levels[None],
            images=image[None],
            wavelength_m=np.array([request.wavelength_m]),
            distance_m=np.array([request.distance_m]),
            power=np.array([request.power]),
            exposure_s=np.array([exposure_s]),
            **rig.bench.as_fields(),
        )

    def _picture(self, request: CaptureRequest) -> tuple[Counts, float]:
        """The picture and its exposure time (s), which is searched unless the plan states it."""
        camera, facts = self._devices.camera, self._rig.bench.camera
        if request.exposure_s is not None:
            exposure_s = camera.set_exposure(request.exposure_s)
            return camera.take(), exposure_s
        energy = self._energy.get(request.wavelength_m, request.power * _FIRST_EXPOSURE_S)
        return take_exposed(camera, facts, energy / max(request.power, 1e-12))
