"""The complex pupil of a relay: apodisation × exp(2πi·OPD/λ), beside the stops that the plan's support holds.

OPD is a sum of Zernike terms, r.m.s.-normalised over the iris, in Noll's order (J. Opt. Soc. Am. 66, 207 (1976)).
"""

from __future__ import annotations

import math

import torch

from holoview.model.plan import Plan
from holoview.numerics.fft_grid import frequency_indices
from holoview.numerics.zernike import zernike


def nominal_pupil(
    plan: Plan, relay: int, wavelength: int, dtype: torch.dtype, device: torch.device
) -> torch.Tensor | None:
    """(P_y, P_x) complex pupil in `fftfreq` order, or None for a relay with neither aberration nor apodisation.

    The pupil lies at direction sines λu: its radius in frequency shrinks with the wavelength, its OPD is that of the
    glass and doesn't.
    """
    description = plan.relays[relay]
    if not description.aberration_m and description.apodisation_na is None:
        return None
    λ = float(plan.system.wavelengths_m[wavelength])
    sine_y, sine_x = (
        torch.from_numpy(frequency_indices(p)).to(device).double() * (λ * step)
        for p, step in zip(plan.grid.padded, plan.grid.frequency_step, strict=True)
    )
    sine = torch.hypot(sine_y[:, None], sine_x[None, :])
    amplitude = torch.ones_like(sine)
    if description.apodisation_na is not None:
        amplitude = torch.exp(-((sine / description.apodisation_na) ** 2))
    opd = torch.zeros_like(sine)
    angle = torch.atan2(sine_y[:, None], sine_x[None, :])
    for noll, rms_m in description.aberration_m:
        opd = opd + rms_m * zernike(noll, sine / float(description.iris_na or 1.0), angle)
    return torch.polar(amplitude, 2 * math.pi * torch.remainder(opd / λ, 1.0)).to(dtype)
