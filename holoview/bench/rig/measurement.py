"""Takes the missing captures of a plan; after any interruption, the same call goes on."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from holoview.bench.captures.dataset import Captures
from holoview.bench.rig.camera_pictures import (
    DARK_PICTURES,
    CheckedCamera,
    SettlingTime,
    dark_exposures,
    dark_notes,
    exposure_note,
    measure_settling,
    take_dark_frame,
    take_exposed,
)
from holoview.bench.rig.capture_folder import CaptureStore
from holoview.bench.rig.capture_plan import CapturePlan, CaptureRequest
from holoview.bench.rig.description import RigDescription
from holoview.bench.rig.devices import Counts, Devices, Levels
from holoview.util.progress import ProgressCallback, TextCallback
from holoview.util.units import format_duration

_FIRST_EXPOSURE_S = 1e-2
_FIRST_DARK_PICTURES = 4


class Measurement:
    """Takes captures one after the other. devices: open devices, which the caller closes.

    tell: called with news for a user, such as a picture that was taken again. notes: all of this news.
    """

    def __init__(self, rig: RigDescription, devices: Devices, tell: TextCallback = lambda _: None) -> None:
        self._rig, self._devices, self._tell = rig, devices, tell
        self._camera = CheckedCamera(devices.camera, rig.bench.camera, self._note)
        self._energy: dict[float, float] = {}  # power × exposure that suited each laser last
        self._distance_m: float | None = None
        self._settling: dict[str, SettlingTime] = {}
        self._told_of_dark: set[str] = set()
        self.notes: list[str] = []

    def run(
        self,
        plan: CapturePlan,
        store: CaptureStore,
        progress: ProgressCallback,
        is_asked_to_end: Callable[[], bool] = lambda: False,
    ) -> bool:
        """Takes the missing captures; returns whether all are there. Each is on the disk before the next begins.

        Before the captures, dark frames and settling are measured; dark frames at the exposures used follow them.
        """
        self.notes = list(store.record.notes)
        missing = store.missing
        if missing:
            self._prepare(plan.requests[missing[0]], store)
        begin_s = self._devices.clock.now()
        for done, number in enumerate(missing):
            if is_asked_to_end():
                return False
            request = plan.requests[number]
            left = self._format_left(begin_s, done, len(missing))
            where = f"{request.wavelength_m * 1e9:.0f} nm, {request.distance_m * 1e3:.3g} mm"
            progress(done, len(missing), f"{where}{left}")
            store.add(number, self.take(request, request.levels(self._rig)))
            self._keep(store)
        self._take_dark_frames(store, _missing_dark(store), DARK_PICTURES)
        progress(len(missing), len(missing), "")
        return True

    def take(self, request: CaptureRequest, levels: Levels) -> Captures:
        """One capture of these patterns (modulator, y, x)."""
        self._light_up(request, levels)
        image, exposure_s = self._picture(request)
        self._energy[request.wavelength_m] = request.power * exposure_s
        return self._rig.capture(
            levels,
            image,
            wavelength_m=request.wavelength_m,
            distance_m=request.distance_m,
            power=request.power,
            exposure_s=exposure_s,
        )

    def _light_up(self, request: CaptureRequest, levels: Levels) -> None:
        """Moves the camera, switches the laser on, shows the patterns, and waits until they have settled."""
        devices = self._devices
        if request.distance_m != self._distance_m:
            devices.stage.move_to(request.distance_m)
            self._distance_m = request.distance_m
        devices.lasers.switch_on(request.wavelength_m, request.power)
        devices.show(levels)
        devices.clock.wait(self._settle_s())

    def _settle_s(self) -> float:
        """The longest time that a modulator needs: the measured time, if there is one."""
        pairs = zip(self._rig.modulator_names, self._devices.modulators, strict=True)
        waits = {name: modulator.settle_s for name, modulator in pairs}
        return max((waits | {name: found.wait_s for name, found in self._settling.items()}).values())

    def _picture(self, request: CaptureRequest) -> tuple[Counts, float]:
        """The picture and its exposure time (s), which is searched unless the plan states it."""
        facts = self._rig.bench.camera
        if request.exposure_s is not None:
            exposure_s = self._camera.set_exposure(request.exposure_s)
            return self._camera.take(), exposure_s
        energy = self._energy.get(request.wavelength_m, request.power * _FIRST_EXPOSURE_S)
        picture, exposure_s = take_exposed(self._camera, facts, energy / max(request.power, 1e-12))
        note = exposure_note(picture, facts)
        if note:
            self._note(f"{request.wavelength_m * 1e9:.0f} nm: {note} at {exposure_s:.3g} s, where exposures end")
        return picture, exposure_s

    def _prepare(self, request: CaptureRequest, store: CaptureStore) -> None:
        """Takes the first dark frame and measures how modulators settle, unless these are known."""
        if not store.record.dark:
            self._take_dark_frames(store, [self._allowed(_FIRST_EXPOSURE_S)], _FIRST_DARK_PICTURES)
        self._settling = dict(store.record.settling)
        wanted = [name for name, spec in self._rig.devices.items() if spec.measures_settling]
        for name in wanted:
            if name not in self._settling:
                self._measure_settling(name, request)
                store.keep(dataclasses.replace(store.record, settling=self._settling, notes=tuple(self.notes)))

    def _measure_settling(self, name: str, request: CaptureRequest) -> None:
        """Measures how one modulator settles, in the light of a capture."""
        number, rig, devices = self._rig.modulator_names.index(name), self._rig, self._devices
        levels = request.levels(rig)
        self._light_up(request, levels)
        rows, columns = rig.slm_shapes[number]
        own, num_levels = levels[number, :rows, :columns], rig.bench.slms[number].num_levels
        facts, modulator = rig.bench.camera, devices.modulators[number]
        found = measure_settling(modulator, self._camera, facts, devices.clock, own, num_levels)
        self._settling[name] = found
        if found.constant_s == 0:
            self._note(f"{name}: settled in its first picture")
            return
        constant, deviation = found.constant_s * 1e3, found.deviation_s * 1e3
        wait = format_duration(found.wait_s)
        self._note(f"{name}: settles with a time constant of {constant:.3g} ± {deviation:.2g} ms; waits for {wait}")

    def _take_dark_frames(self, store: CaptureStore, exposures_s: list[float], pictures: int) -> None:
        """Adds dark frames to the record of the bench."""
        self._devices.lasers.switch_off()
        for exposure_s in exposures_s:
            frame = take_dark_frame(self._camera, self._allowed(exposure_s), pictures)
            store.keep(dataclasses.replace(store.record, dark=(*store.record.dark, frame)))
        for kind, note in dark_notes(store.record.dark, self._rig.bench.camera).items():
            if kind not in self._told_of_dark:
                self._told_of_dark.add(kind)
                self._note(note)
        self._keep(store)

    def _allowed(self, exposure_s: float) -> float:
        return float(np.clip(exposure_s, *self._camera.exposures_s))

    def _keep(self, store: CaptureStore) -> None:
        """Writes the notes that aren't on the disk yet."""
        if tuple(self.notes) != store.record.notes:
            store.keep(dataclasses.replace(store.record, notes=tuple(self.notes)))

    def _note(self, text: str) -> None:
        """Tells a note once, and keeps it."""
        if text not in self.notes:
            self.notes.append(text)
            self._tell(text)

    def _format_left(self, begin_s: float, done: int, count: int) -> str:
        """The bench's time that is left, from the captures so far."""
        if not done:
            return ""
        spent_s = self._devices.clock.now() - begin_s
        return f", {format_duration(spent_s / done * (count - done))} left"


def is_complete(store: CaptureStore) -> bool:
    """Whether all captures of a plan are there, with their dark frames."""
    return not store.missing and not _missing_dark(store)


def _missing_dark(store: CaptureStore) -> list[float]:
    """Exposure times (s) for which dark frames are missing."""
    there = [frame.exposure_s for frame in store.record.dark if frame.pictures >= DARK_PICTURES]
    return dark_exposures(store.exposures_s, there)
