"""Tells pictures that a camera can't have taken: of another shape or range, repeated, or torn.

Noise makes two pictures of the same scene differ. Whole counts of two pixels with normal noise of standard deviation σ
are equal with a probability of at most 1/(2√π·σ); the product over the pixels that are equal to those of the picture
before says how improbable it is that they were taken anew.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Camera
from holoview.rig.devices import CameraDevice, Counts, DeviceError, DeviceGone
from holoview.util.progress import TextCallback

ATTEMPTS = 4
"""How often a picture is tried in all, before the camera counts as out of order."""

_IMPROBABLE = math.log(1e-12)
_DARK_SIGMAS = 6.0  # of dark noise below the black level: no pixel has 0 counts by chance
_REMEDY = "check its cable, trigger and time-out; the same command goes on"


class PictureCheck:
    """Compares each picture with the one before. shape: rows and columns of a raw picture."""

    def __init__(self, facts: Camera, shape: tuple[int, int]) -> None:
        self._facts, self._shape = facts, shape
        self._before: Counts | None = None

    def fault(self, picture: Counts) -> str | None:
        """What is wrong with a picture, in words; None if nothing is. It is then the one before."""
        facts = self._facts
        if picture.shape != self._shape:
            return f"a picture of {' × '.join(map(str, picture.shape))} pixels, not {' × '.join(map(str, self._shape))}"
        if picture.dtype.kind != "u":
            return f"counts of type {picture.dtype}, not unsigned whole numbers"
        if int(picture.max()) > facts.saturation:
            return f"{int(picture.max())} counts, more than {facts.bit_depth} bits"
        before, self._before = self._before, picture.copy()
        if self._is_empty(picture[-1]) and not self._is_empty(picture[0]):
            return "a picture whose lower part is empty"
        if before is None:
            return None
        improbable = self._improbable_rows(picture, before)
        if improbable.all():
            return "the picture before, again"
        if improbable[0] or improbable[-1]:
            return "a picture with a part of the one before"
        return None

    def _is_empty(self, row: Counts) -> bool:
        """Whether there are no counts at all where there should be the black level's."""
        return bool((row == 0).all()) and self._facts.black_level > _DARK_SIGMAS * self._facts.dark_noise

    def _improbable_rows(self, picture: Counts, before: Counts) -> NDArray[np.bool_]:
        """Rows (y,) of blocks at the edges, or of the whole, that can't equal those of the picture before by chance."""
        equal = (picture == before).all(axis=1)
        found = np.zeros(len(equal), np.bool_)
        if not (equal[0] or equal[-1]):
            return found
        first = len(equal) if equal.all() else int(np.argmin(equal))
        last = len(equal) if equal.all() else int(np.argmin(equal[::-1]))
        chance = np.where(equal, self._log_chance(picture), 0.0)
        found[:first] = chance[:first].sum() < _IMPROBABLE
        found[len(equal) - last :] = chance[len(equal) - last :].sum() < _IMPROBABLE
        return found

    def _log_chance(self, picture: Counts) -> NDArray[np.float64]:
        """Logarithm of the probability (y,) that a row taken anew is equal. Saturated pixels are so for certain."""
        facts = self._facts
        signal = picture.astype(np.float64) - facts.black_level
        deviation = np.sqrt(np.maximum(facts.noise_variance(signal) - 1 / 12, 1e-12))  # without quantisation
        chance = np.minimum(1.0, 1 / (2 * math.sqrt(math.pi) * deviation))
        chance[(picture == 0) | (picture >= facts.saturation)] = 1.0
        return np.log(chance).sum(axis=1)


class CheckedCamera:
    """A camera whose pictures are checked, and taken again where one is wrong or doesn't come.

    tell: called with what happened.
    """

    def __init__(self, camera: CameraDevice, facts: Camera, tell: TextCallback) -> None:
        self._camera, self._tell = camera, tell
        self._check = PictureCheck(facts, camera.shape)
        self.shape, self.exposures_s = camera.shape, camera.exposures_s

    def set_exposure(self, exposure_s: float) -> float:
        """As of the camera."""
        return self._camera.set_exposure(exposure_s)

    def take(self) -> Counts:
        """A picture with which nothing is wrong. Raises DeviceError after ATTEMPTS, and DeviceGone at once."""
        for attempt in range(1, ATTEMPTS + 1):
            try:
                picture = self._camera.take()
                fault = self._check.fault(picture)
                if fault is None:
                    return picture
            except DeviceGone:
                raise
            except DeviceError as error:
                fault = error.found
            if attempt < ATTEMPTS:
                self._tell(f"camera: {fault}; taken again")
        raise DeviceError("camera", f"{fault}, {ATTEMPTS} times in a row", remedy=_REMEDY)

    def close(self) -> None:
        """Leaves the camera to who opened it."""
