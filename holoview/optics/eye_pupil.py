"""What the pupil of an eye does beyond stopping light: its cylinder, its Zernike terms, the Stiles–Crawford effect.

    pupil = 10^(−ρ·r²/2)·exp(2πi·opd/λ),  r = f·|s − s₀|

with the focal length f of the eyepiece, the direction sine s and that of the pupil's centre s₀. The effect weights
intensity by 10^(−ρ·r²), ρ = 0.05/mm² (Applegate & Lakshminarayanan, J. Opt. Soc. Am. A 10, 1611 (1993)), so that the
amplitude has half the exponent. For coherent light the integrated effect is disputed (Vohnsen & Rativa 2011;
Westheimer 2013).
"""

from __future__ import annotations

import math

import torch

from holoview.model.eye import Eye
from holoview.model.plan import Plan
from holoview.numerics.zernike import zernike_sum
from holoview.optics.propagate import direction_sines

_STILES_CRAWFORD = 0.05e6  # 1/m²


def eye_pupil(plan: Plan, wavelength: int, eye: Eye | None) -> torch.Tensor | None:
    """The pupil function (P_y, P_x) complex128 of an eye, on the grid of a plan, in `fftfreq` order.

    Without the stop itself, which is in the plan's support; None where it only stops light.
    """
    if eye is None or not eye.has_pupil_function:
        return None
    λ = float(plan.system.wavelengths_m[wavelength])
    sine_y, sine_x = (
        sines - centre for sines, centre in zip(direction_sines(plan.grid, λ), eye.pupil_centre_na, strict=True)
    )
    sine, angle = torch.hypot(sine_y, sine_x), torch.atan2(sine_y, sine_x)
    amplitude = torch.ones_like(sine)
    if eye.stiles_crawford:
        amplitude = 10.0 ** (-0.5 * _STILES_CRAWFORD * (eye.eyepiece_m * sine) ** 2)
    terms = eye.prescription.aberration_m
    opd = _cylinder_path(eye, sine, angle) + zernike_sum(terms, sine / eye.pupil_na(plan.nominal.field_m), angle)
    return torch.polar(amplitude, 2 * math.pi * torch.remainder(opd / λ, 1.0))


def _cylinder_path(eye: Eye, sine: torch.Tensor, angle: torch.Tensor) -> torch.Tensor:
    """Optical path of a cylinder without its mean sphere, which is in the distance, m.

    The eye is focused by C·(sin²(θ − α) − ½) dioptres further away in the meridian θ, that is −f²·C·(…) of z nearer to
    the modulator, so that the path of free space, −z·s²/2, lacks ½·f²·C·(…)·s². The angle θ runs from x to y, which
    points downwards: clockwise in the picture.
    """
    p = eye.prescription
    turned = torch.cos(2 * (angle - math.radians(p.axis_deg)))
    return -0.25 * p.cylinder_dpt * (eye.eyepiece_m * sine) ** 2 * turned
