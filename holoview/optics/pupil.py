"""The complex pupil of a relay: apodisation and Zernike aberrations. Its stops are in the plan's support.

    pupil = exp(−(s/na)²)·exp(2πi·opd/λ),  opd = Σ_j c_j·Z_j over the pupil

with the direction sine s = |λu|, the aperture `na` of the apodisation, and Zernike terms Z_j with unit r.m.s. over the
pupil in Noll's order (J. Opt. Soc. Am. 66, 207 (1976)).
"""

from __future__ import annotations

import math

import torch

from holoview.model.plan import Plan
from holoview.numerics.zernike import zernike_sum
from holoview.optics.propagate import direction_sines


def nominal_pupil(
    plan: Plan, relay: int, wavelength: int, dtype: torch.dtype, device: torch.device
) -> torch.Tensor | None:
    """The pupil (P_y, P_x) of a relay without effects, in `fftfreq` order; None without aberration and apodisation.

    It is fixed in direction sines: in frequency its radius shrinks with the wavelength. Its optical path, in metres,
    doesn't depend on the wavelength.
    """
    description = plan.relays[relay]
    if not description.aberration_m and description.apodisation_na is None:
        return None
    λ = float(plan.system.wavelengths_m[wavelength])
    sine_y, sine_x = direction_sines(plan.grid, λ, device)
    sine = torch.hypot(sine_y, sine_x)
    amplitude = torch.ones_like(sine)
    if description.apodisation_na is not None:
        amplitude = torch.exp(-((sine / description.apodisation_na) ** 2))
    radius = description.pupil_radius_sine(λ, plan.system.modulators[0].pitch_m)
    sine_y, sine_x = (s - centre for s, centre in zip((sine_y, sine_x), description.centre_na, strict=True))
    opd = zernike_sum(description.aberration_m, torch.hypot(sine_y, sine_x) / radius, torch.atan2(sine_y, sine_x))
    return torch.polar(amplitude, 2 * math.pi * torch.remainder(opd / λ, 1.0)).to(dtype)
