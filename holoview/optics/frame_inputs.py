"""The inputs of a frame: optical paths, sampled transmissions and pupils, computed in torch for both executors.

Levels, aberrations and effects are applied here, so that executors know nothing of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.model.eye import Eye
from holoview.model.plan import Plan
from holoview.optics.plain_inputs import check_drive_dtype, check_drive_range
from holoview.optics.propagate import eye_pupil, nominal_pupil
from holoview.optics.slm import optical_path
from holoview.optics.torch_effects import SampledTransmissions, effects_pupil
from holoview.util.errors import UserError


@dataclass(frozen=True)
class FrameInputs:
    """What a frame is computed from.

    opd_m: (frame, modulator, y, x) float64 optical path of each modulator pixel, m; without effects on modulators.
    pupils: pupils[relay][wavelength], (P_y, P_x) complex128, or None without aberration and apodisation.
    sampled_transmissions: of modulators whose transmission isn't exp(2πi·opd/λ) of their pixels; None if there is none.
    """

    opd_m: torch.Tensor
    pupils: tuple[tuple[torch.Tensor | None, ...], ...]
    sampled_transmissions: SampledTransmissions | None = None

    def stroke_fractions(self, frame: int, modulator: int, stroke_m: float) -> NDArray[np.float32]:
        """Optical paths of a modulator's pixels (y, x), float32 in units of the stroke, which keeps a drive exact."""
        return np.ascontiguousarray((self.opd_m[frame, modulator] / stroke_m).float().cpu().numpy())

    def is_sampled(self, modulator: int) -> bool:
        """Whether the transmission of a modulator isn't exp(2πi·opd/λ) of its pixels."""
        return self.sampled_transmissions is not None and self.sampled_transmissions.is_sampled(modulator)

    def transmission(self, frame: int, modulator: int, wavelength: int) -> torch.Tensor | None:
        """The transmission (y, x) complex128 of a modulator's samples; None if it is exp(2πi·opd/λ) of its pixels."""
        if self.sampled_transmissions is None:
            return None
        return self.sampled_transmissions.sampled_transmission(frame, modulator, wavelength)


def make_frame_inputs(plan: Plan, drive: torch.Tensor | NDArray[np.floating]) -> FrameInputs:
    """The inputs of a plan's frames for a drive (frame, modulator, y, x) in 0…1 of the stroke.

    Raises UserError when the drive has another shape than `plan.nominal.drive_shape`, or values outside 0…1.
    """
    patterns = drive if isinstance(drive, torch.Tensor) else _as_tensor(drive)
    check_drive(plan, patterns)
    patterns = patterns.double()
    pupils = tuple(tuple(pupil_with_effects(plan, r, i) for i in range(len(plan.system.wavelengths_m))) for r in (0, 1))
    transmissions = SampledTransmissions(plan, patterns) if plan.nominal.effects else None
    sampled = transmissions if transmissions is not None and transmissions.is_any_sampled else None
    return FrameInputs(exposure_optical_paths(plan, patterns), pupils, sampled)


def pupil_with_effects(plan: Plan, relay: int, wavelength: int, eye: Eye | None = None) -> torch.Tensor | None:
    """The pupil (P_y, P_x) complex128 of a relay with its effects, behind relay 2 also that of the eye.

    None where light is only stopped. eye: that of the plan when None.
    """
    pupil = pupil_without_effects(plan, relay, wavelength, eye)
    return _product(pupil, effects_pupil(plan, relay, wavelength)) if plan.nominal.effects else pupil


def pupil_without_effects(plan: Plan, relay: int, wavelength: int, eye: Eye | None = None) -> torch.Tensor | None:
    """The same without effects."""
    pupil = nominal_pupil(plan, relay, wavelength, torch.complex128, torch.device("cpu"))
    return _product(pupil, eye_pupil(plan, wavelength, eye or plan.nominal.eye)) if relay == 1 else pupil


def _product(first: torch.Tensor | None, second: torch.Tensor | None) -> torch.Tensor | None:
    """The product of two pupils, of which None passes everything."""
    if first is None or second is None:
        return second if first is None else first
    return first * second


def exposure_optical_paths(plan: Plan, drive: torch.Tensor) -> torch.Tensor:
    """Optical paths (frame, modulator, y, x) of a drive in m, for all frames of `plan.system`.

    They have the strokes of `plan.system` and the factors `plan.moments`, but no effects on modulators.
    """
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
    """Raises UserError unless the drive is real, has the system's shape and lies in 0…1."""
    if drive.is_complex():
        raise UserError("drive", "complex numbers", expected="real numbers, 0 to 1 of the modulator's stroke")
    low, high = (float(x) for x in torch.aminmax(drive.detach())) if drive.numel() else (0.0, 0.0)
    check_drive_range(plan, tuple(drive.shape), low, high)
