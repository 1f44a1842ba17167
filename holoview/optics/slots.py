"""Slots: the small, well-defined inputs of a frame. The heavy part of an executor knows nothing else.

Everything that only shapes a slot (modulator response, aberrations) exists once, here in torch, for both executors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.errors import UserError
from holoview.optics.pupil import pupil
from holoview.optics.slm import optical_path
from holoview.plan import Plan


@dataclass(frozen=True)
class Slots:
    """opd_m (frame, modulator, y, x) float64: optical path of each modulator pixel, m.

    pupils[relay][wavelength]: (P_y, P_x) complex128 or None where the relay neither apodises nor aberrates.
    """

    opd_m: torch.Tensor
    pupils: tuple[tuple[torch.Tensor | None, ...], ...]


def make_slots(plan: Plan, drive: torch.Tensor | NDArray[np.floating]) -> Slots:
    """The slots of a plan for a drive (frame, modulator, y, x) in 0…1 of the stroke.

    Raises UserError when the drive's shape doesn't fit the system, or when it leaves 0…1.
    """
    patterns = drive if isinstance(drive, torch.Tensor) else _as_tensor(drive)
    check_drive(plan, patterns)
    patterns = patterns.double()
    modulators = plan.system.modulators
    opd = torch.stack([optical_path(patterns[:, i], modulator) for i, modulator in enumerate(modulators)], dim=1)
    cpu = torch.device("cpu")
    count = len(plan.system.wavelengths_m)
    pupils = tuple(tuple(pupil(plan, r, i, torch.complex128, cpu) for i in range(count)) for r in (0, 1))
    return Slots(opd, pupils)


def _as_tensor(drive: NDArray[np.floating]) -> torch.Tensor:
    values = np.asarray(drive)
    if values.dtype.kind not in "fiub":
        raise UserError("drive", f"values of type {values.dtype}", expected="real numbers, 0 to 1 of the stroke")
    return torch.from_numpy(np.array(values, order="C"))


def check_drive(plan: Plan, drive: torch.Tensor) -> None:
    """UserError unless the drive has the system's shape and lies in 0…1."""
    if drive.is_complex():
        raise UserError("drive", "complex numbers", expected="real numbers, 0 to 1 of the modulator's stroke")
    expected = plan.system.drive_shape
    if tuple(drive.shape) != expected:
        raise UserError(
            "drive", f"an array of shape {tuple(drive.shape)}", expected=f"(frame, modulator, y, x) = {expected}"
        )
    low, high = (float(x) for x in torch.aminmax(drive.detach()))
    if not (low >= 0.0 and high <= 1.0):
        raise UserError(
            "drive", f"values from {low:g} to {high:g}", expected="0 to 1, a fraction of the modulator's stroke"
        )
