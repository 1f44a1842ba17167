"""The inputs of a frame in numpy, for systems without levels, aberrations, apodisation and effects.

Importing torch takes a second, for which the first picture of the viewer doesn't wait.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.model.plan import Plan
from holoview.util.errors import UserError


@dataclass(frozen=True)
class PlainFrameInputs:
    """What a frame is computed from; the numpy counterpart of `FrameInputs`.

    drive: (frame, modulator, y, x) in 0…1 of the stroke.
    pupils: pupils[relay][wavelength], all None.
    sampled_transmissions: None.
    """

    drive: NDArray[np.floating]
    pupils: tuple[tuple[None, ...], ...]
    sampled_transmissions: None = None

    def stroke_fractions(self, frame: int, modulator: int, stroke_m: float) -> NDArray[np.float32]:
        """Optical paths of a modulator's pixels (y, x), float32 in units of the stroke: the drive itself."""
        return np.ascontiguousarray(self.drive[frame, modulator], dtype=np.float32)

    def is_sampled(self, modulator: int) -> bool:
        """False: transmissions are exp(2πi·opd/λ) of pixels."""
        return False

    def transmission(self, frame: int, modulator: int, wavelength: int) -> None:
        """None: transmissions are exp(2πi·opd/λ) of pixels."""
        return


def plain_frame_inputs(plan: Plan, drive: NDArray[np.floating]) -> PlainFrameInputs | None:
    """The inputs of a plan's frames for a drive (frame, modulator, y, x), or None where `make_frame_inputs` is needed.

    Raises UserError as `make_frame_inputs` does.
    """
    relays = (plan.nominal.relay1, plan.nominal.relay2)
    has_levels = any(modulator.levels is not None for modulator in plan.system.modulators)
    has_pupils = any(relay.aberration_m or relay.apodisation_na is not None for relay in relays)
    has_pupils |= plan.nominal.eye is not None and plan.nominal.eye.has_pupil_function
    if has_levels or has_pupils or plan.nominal.effects or plan.moments != (1.0,):
        return None
    check_drive_dtype(drive)
    low, high = (float(drive.min()), float(drive.max())) if drive.size else (0.0, 0.0)
    check_drive_range(plan, drive.shape, low, high)
    return PlainFrameInputs(drive, ((None,) * len(plan.system.wavelengths_m),) * len(relays))


def check_drive_dtype(drive: NDArray[np.generic]) -> None:
    """Raises UserError unless a drive consists of real numbers."""
    if drive.dtype.kind not in "fiub":
        raise UserError("drive", f"values of type {drive.dtype}", expected="real numbers, 0 to 1 of the stroke")


def check_drive_range(plan: Plan, shape: tuple[int, ...], low: float, high: float) -> None:
    """Raises UserError unless a drive of this shape, with values from `low` to `high`, fits the system."""
    expected = plan.nominal.drive_shape
    if shape != expected:
        raise UserError("drive", f"an array of shape {shape}", expected=f"(frame, modulator, y, x) = {expected}")
    if not (low >= 0.0 and high <= 1.0):
        raise UserError(
            "drive", f"values from {low:g} to {high:g}", expected="0 to 1, a fraction of the modulator's stroke"
        )
