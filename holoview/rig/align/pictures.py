"""Takes pictures for an alignment: what each modulator shows in, light per second out."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from holoview.captures.orientations import undone
from holoview.rig.description import RigDescription
from holoview.rig.devices import Devices, Levels
from holoview.rig.measure.exposure_search import take_exposed
from holoview.util.progress import ProgressCallback

_FIRST_EXPOSURE_S = 1e-2
_BRIGHT_PIXELS = 3  # may saturate: hot ones


class AlignmentCancelled(Exception):
    """Whoever started the alignment has asked it to end."""


class PictureTaker:
    """Shows patterns and takes pictures with one laser. camera_turn: pictures are turned back by it.

    total: number of pictures in all, for the progress.
    """

    def __init__(
        self,
        rig: RigDescription,
        devices: Devices,
        total: int,
        progress: ProgressCallback,
        is_asked_to_end: Callable[[], bool],
    ) -> None:
        self._rig, self._devices, self._total = rig, devices, total
        self._progress, self._is_asked_to_end = progress, is_asked_to_end
        self._done, self._exposure_s = 0, _FIRST_EXPOSURE_S
        self.camera_turn = "none"

    def light(self, wavelength_m: float) -> None:
        """Switches a laser on, at the highest power that is allowed, or its nominal one if that is less."""
        self._devices.lasers.switch_on(wavelength_m, min(self._rig.limits.power, 1.0))

    def move_to(self, stage_m: float) -> float:
        """Moves the stage; returns the setting that it reports."""
        return self._devices.stage.move_to(stage_m)

    def report(self, note: str) -> None:
        """Says what happens. Raises AlignmentCancelled if asked to end."""
        if self._is_asked_to_end():
            raise AlignmentCancelled
        self._progress(self._done, self._total, note)

    def take(self, levels: Sequence[Levels], note: str) -> NDArray[np.float64]:
        """The picture (y, x) of these patterns, one of each modulator, in counts per second above the black level.

        Raises AlignmentCancelled if asked to end.
        """
        self.report(note)
        for modulator, own in zip(self._devices.modulators, levels, strict=True):
            modulator.show(own)
        self._devices.clock.wait(max(modulator.settle_s for modulator in self._devices.modulators))
        camera, facts = self._devices.camera, self._rig.bench.camera
        quantile = 1 - _BRIGHT_PIXELS / (camera.shape[0] * camera.shape[1])
        counts, self._exposure_s = take_exposed(camera, facts, self._exposure_s, quantile)
        self._done += 1
        return undone((counts - facts.black_level) / self._exposure_s, self.camera_turn)
