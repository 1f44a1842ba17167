"""What scalar diffraction can't describe: pixels near the wavelength, evanescent orders, and the near field."""

from __future__ import annotations

import math

from holoview.model.plan import Plan
from holoview.model.validity.limit import Limit, Measured
from holoview.model.validity.sampling_limits import lit_wavelengths, paths
from holoview.util import units

_COSINE = 0.95
"""Cosine of the steepest direction at which the two polarisations still have nearly equal amplitudes."""
PIXEL_WAVELENGTHS = 1 / (math.sqrt(2) * math.sqrt(1 - _COSINE**2))
"""Pixels whose first order reaches that direction in its corners, λ/(√2·p): 2.26 wavelengths."""


def _pixel_wavelengths(plan: Plan) -> Measured:
    pitch_m, λ = plan.system.modulators[0].pitch_m, float(lit_wavelengths(plan).max())
    return Measured(
        pitch_m / λ,
        f"pixels of {units.format_rounded(pitch_m, 'um')} are {pitch_m / λ:.2g} wavelengths at "
        f"{units.format_rounded(λ, 'nm')}: neither scalar diffraction nor square pixels of constant path describe them",
        "pitch",
        "compute such a modulator by a rigorous theory",
    )


PIXELS = Limit(
    name="pixels near the wavelength",
    quantity="pixel pitch in wavelengths, at the longest one",
    reason="the field of the two polarisations differs by cos θ, 5 % in the first order's corners, sin θ = λ/(√2·p)",
    measure=_pixel_wavelengths,
    at_least=PIXEL_WAVELENGTHS,
)


def evanescent_share(half_side: float) -> float:
    """Share of a square |s_y|, |s_x| ≤ a of direction sines that lies outside the unit circle.

    half_side: a. The circle cuts nothing of a square with a ≤ 1/√2, and lies inside one with a ≥ 1.
    """
    if half_side <= math.sqrt(0.5):
        return 0.0
    if half_side >= 1.0:
        return 1 - math.pi / (4 * half_side**2)
    edge = math.sqrt(1 - half_side**2)
    inside = 4 * (half_side * edge + 0.5 * (math.asin(half_side) - math.asin(edge)))
    return 1 - inside / (4 * half_side**2)


def _evanescent(plan: Plan) -> Measured:
    λ = float(lit_wavelengths(plan).max())
    share = evanescent_share(λ / (2 * plan.system.modulators[0].pitch_m))
    return Measured(
        share,
        f"{share:.0%} of the first order is evanescent at {units.format_rounded(λ, 'nm')}: this detail of the patterns "
        "reaches no plane",
        "pitch",
        "use larger pixels or shorter wavelengths",
    )


EVANESCENT = Limit(
    name="evanescent orders",
    quantity="share of the first order that doesn't propagate, at the longest wavelength",
    reason="sin θ > 1 for frequencies above 1/λ; pixels below λ/√2 have such orders",
    measure=_evanescent,
    at_most=0.0,
)


def _distance_in_waves(plan: Plan) -> Measured | None:
    distances = [(z, "gap") for key, _, z in paths(plan) if key == "gap" and z > 0]
    distances += [(z, "planes") for z in plan.distances_m.ravel().tolist() if z > 0]
    if not distances:
        return None
    (nearest_m, key), λ = min(distances), float(lit_wavelengths(plan).max())
    return Measured(
        nearest_m / λ,
        f"{units.format_rounded(nearest_m, 'um')} are {nearest_m / λ:.2g} wavelengths, where evanescent waves, which "
        "are left out, are still there",
        key,
        "move the plane away, or to 0",
    )


NEAR_FIELD = Limit(
    name="near field",
    quantity="shortest distance above 0 in wavelengths, at the longest one",
    reason="an evanescent wave of sin θ = √2 has fallen to exp(−2π·z/λ) of its amplitude: 0.2 % at one wavelength",
    measure=_distance_in_waves,
    at_least=1.0,
)
