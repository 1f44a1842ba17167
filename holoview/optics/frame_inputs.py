"""Slots: the small, well-defined inputs of a frame. The heavy part of an executor knows nothing else.

Everything that only shapes a slot (modulator response, aberrations) exists once, here in torch, for both executors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.model.plan import Plan
from holoview.optics.plain_inputs import PlainFrameInputs, check_drive_dtype, check_drive_range
from holoview.optics.pupil import nominal_pupil
from holoview.optics.sampled_effects import SampledTransmissions, effects_pupil
from holoview.optics.slm import optical_path
from holoview.util.errors import UserError


@dataclass(frozen=True)
class FrameInputs:
    """opd_m (frame, modulator, y, x) float64: optical path of each modulator pixel, m; what was sent, where `light` is.

    pupils[relay][wavelength]: (P_y, P_x) complex128 or None where the relay neither apodises nor aberrates.
    light: transmissions of modulators that aren't exp(2πi·opd/λ) of their pixels alone; None where all are.
    """

    opd_m: torch.Tensor
    pupils: tuple[tuple[torch.Tensor | None, ...], ...]
    sampled_transmissions: TransmissionSource | None = None

    def stroke_fractions(self, frame: int, modulator: int, stroke_m: float) -> NDArray[np.float32]:
        """Optical paths of a modulator's pixels (y, x) in strokes, so that a float32 drive stays exact."""
        return np.ascontiguousarray((self.opd_m[frame, modulator] / stroke_m).float().cpu().numpy())

    def is_sampled(self, modulator: int) -> bool:
        """Whether a modulator's transmission isn't exp(2πi·opd/λ) of its pixels."""
        return self.sampled_transmissions is not None and self.sampled_transmissions.is_sampled(modulator)

    def transmission(self, frame: int, modulator: int, wavelength: int) -> torch.Tensor | None:
        """Complex128 transmission of a modulator's samples (y, x), or None: exp(2πi·opd/λ) of its pixels."""
        return (
            None
            if self.sampled_transmissions is None
            else self.sampled_transmissions.sampled_transmission(frame, modulator, wavelength)
        )


AnyFrameInputs = FrameInputs | PlainFrameInputs
"""What the shaders take."""


class TransmissionSource(Protocol):
    """What makes dense transmissions of modulators."""

    def is_sampled(self, modulator: int) -> bool:
        """Whether that modulator's is."""

    def sampled_transmission(self, frame: int, modulator: int, wavelength: int) -> torch.Tensor | None:
        """Complex128 transmission of a modulator's samples (y, x); None where its pixels' optical paths say it all."""


def make_frame_inputs(plan: Plan, drive: torch.Tensor | NDArray[np.floating]) -> FrameInputs:
    """The slots of a plan for a drive (frame, modulator, y, x) in 0…1 of the stroke.

    Raises UserError when the drive's shape doesn't fit the system, or when it leaves 0…1.
    """
    patterns = drive if isinstance(drive, torch.Tensor) else _as_tensor(drive)
    check_drive(plan, patterns)
    patterns = patterns.double()
    pupils = tuple(tuple(pupil_with_effects(plan, r, i) for i in range(len(plan.system.wavelengths_m))) for r in (0, 1))
    return FrameInputs(exposure_optical_paths(plan, patterns), pupils, _lights(plan, patterns))


def pupil_with_effects(plan: Plan, relay: int, wavelength: int) -> torch.Tensor | None:
    """(P_y, P_x) complex128 pupil of a relay with its effects; None where it neither apodises nor aberrates."""
    own = nominal_pupil(plan, relay, wavelength, torch.complex128, torch.device("cpu"))
    if not plan.nominal.effects:
        return own
    added = effects_pupil(plan, relay, wavelength)
    if own is None or added is None:
        return added if own is None else own
    return own * added


def _lights(plan: Plan, drive: torch.Tensor) -> TransmissionSource | None:
    if not plan.nominal.effects:
        return None
    light = SampledTransmissions(plan, drive)
    return light if light.is_any_sampled else None


def exposure_optical_paths(plan: Plan, drive: torch.Tensor) -> torch.Tensor:
    """Optical path (frame, modulator, y, x) of a drive at each moment, nominal but for the strokes, m."""
    modulators = plan.system.modulators
    paths = torch.stack([optical_path(drive[:, i], modulator) for i, modulator in enumerate(modulators)], dim=1)
    if plan.moments == (1.0,):
        return paths
    factors = torch.tensor(plan.moments, dtype=paths.dtype, device=paths.device)
    return (paths[:, None] * factors[:, None, None, None]).flatten(0, 1)


def _as_tensor(drive: NDArray[np.floating]) -> torch.Tensor:
    values = np.asarray(drive)
    check_drive_dtype(values)
    return torch.from_numpy(np.array(values, order="C"))


def check_drive(plan: Plan, drive: torch.Tensor) -> None:
    """UserError unless the drive has the system's shape and lies in 0…1."""
    if drive.is_complex():
        raise UserError("drive", "complex numbers", expected="real numbers, 0 to 1 of the modulator's stroke")
    low, high = (float(x) for x in torch.aminmax(drive.detach())) if drive.numel() else (0.0, 0.0)
    check_drive_range(plan, tuple(drive.shape), low, high)
