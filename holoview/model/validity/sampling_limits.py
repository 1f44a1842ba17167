"""What the grid of a plan can't hold: the band limit, wrap-around, orders beyond the samples, stops, oblique light.

Symbols: p pixel pitch, u samples along each side of a pixel, dx = p/u, P padded samples, s = λf direction sine.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from holoview.model.bench_parts import Relay
from holoview.model.passband import band_limit
from holoview.model.plan import Plan, walk_off
from holoview.model.sampled_distance import frequencies_left, nothing_left
from holoview.model.validity.limit import Limit, Measured
from holoview.util import units

Path = tuple[str, int, float]
"""Key of the bench, number of the relay, and distance in metres of a way that light goes."""

_ENVELOPE_EXCESS = 0.25
_PHASE_ERROR = 1e-2
_ROUNDINGS, _UNIT_ROUNDOFF = 3, 2.0**-24  # of float32 in a phase's remainder, measured: docs/physics.md


def lit_wavelengths(plan: Plan) -> NDArray[np.float64]:
    """The wavelengths that shine in some frame."""
    lit: NDArray[np.float64] = plan.system.wavelengths_m[np.any(plan.weights > 0, axis=0)]
    return lit


def paths(plan: Plan) -> list[Path]:
    """The ways that light goes: the gap, and to the farthest plane at any wavelength."""
    ways = [("planes" if plan.nominal.eye is None else "eye", 1, float(plan.distances_m.max()))]
    return ways if plan.system.gap_m is None else [("gap", 0, plan.system.gap_m), *ways]


def first_order_sine(plan: Plan, relay: Relay, wavelength_m: float) -> float:
    """The largest direction sine along an axis that a relay passes of the first order, λ/(2p) or less."""
    pitch_m = plan.system.modulators[0].pitch_m
    return min(relay.axis_sine(wavelength_m, pitch_m), wavelength_m / (2 * pitch_m))


# --- band limit -----------------------------------------------------------------------------------------------------


def _is_band_limited(plan: Plan) -> bool:
    return plan.system.sampling.propagation != "periodic"


def _frequencies_left(plan: Plan) -> Measured | None:
    if not _is_band_limited(plan):
        return None
    grid, λ = plan.grid, float(lit_wavelengths(plan).max())
    left, (key, _, distance_m) = min(
        (frequencies_left(grid.padded, grid.pitch_m, λ, path[2]), path) for path in paths(plan)
    )
    return Measured(
        left,
        f"light goes on to what lies {nothing_left(grid.padded, grid.pitch_m, distance_m)}",
        key,
        "raise shape, pitch or padding, or shorten the distance",
    )


BAND_LEFT = Limit(
    name="band left",
    quantity="frequencies beside zero that the band limit leaves on each side of the longer axis",
    reason="below 1 only the zero order is computed, and every pattern gives the same uniform picture",
    measure=_frequencies_left,
    at_least=1.0,
    refuses=True,
)


def _first_order_left(plan: Plan) -> Measured | None:
    if not _is_band_limited(plan):
        return None
    grid, worst, worst_key, worst_m = plan.grid, math.inf, "", 0.0
    for key, relay, distance_m in paths(plan):
        for λ in lit_wavelengths(plan).tolist():
            limit = min(band_limit(n, grid.pitch_m, λ, distance_m) for n in grid.padded)
            share = λ * limit / min(first_order_sine(plan, plan.relays[relay], λ), 1.0)
            if share < worst:
                worst, worst_key, worst_m = share, key, distance_m
    return Measured(
        worst,
        f"of the first order's angles the grid holds {worst:.0%} at {units.format_rounded(worst_m, 'mm')}: the rest "
        "walks off by more than half the grid and is left out",
        worst_key,
        "raise padding or shape, or shorten the distance",
    )


BAND_LIMIT = Limit(
    name="band limit",
    quantity="band limit in half widths of the first order, or of what the stops pass of it",
    reason="below 1 light of the first order is left out: measured errors of the intensity of 17 % and more",
    measure=_first_order_left,
    at_least=1.0,
)


# --- wrap-around ----------------------------------------------------------------------------------------------------


def wrap_around(plan: Plan) -> tuple[float, str, float]:
    """Share of a side of the field that light reaches which walked off over the edges of the padded grid.

    The FFT makes the grid periodic: light that walks off by more than the padding re-enters on the other side. The
    share is max(0, n + walk-off − padded)/n, with n the samples of the unpadded side, before the band limit cuts it.

    Returns the share, "gap" or "planes", and the walk-off in samples; (0, "", 0) where there is none.
    """
    worst = (0.0, "", 0.0)
    for key, relay, distance_m in paths(plan):
        reach = walk_off(plan.system, plan.relays[relay], distance_m)
        for n, padded in zip(plan.grid.shape, plan.grid.padded, strict=True):
            share = min(1.0, max(0.0, n + reach - padded) / n)
            if share > worst[0]:
                worst = (share, "planes" if key == "eye" else key, reach)
    return worst


def _wrapped_share(plan: Plan) -> Measured | None:
    if _is_band_limited(plan):
        return None
    share, key, reach = wrap_around(plan)
    return Measured(
        share,
        f"light that leaves the grid re-enters on the other side: up to {share:.0%} of a side, {reach:.0f} samples "
        f"over the {key}",
        "sampling.propagation",
        "set propagation to linear or compact",
    )


WRAP_AROUND = Limit(
    name="wrap-around",
    quantity="share of a side that light reaches which wrapped around",
    reason="a modulator has edges; geometric walk-off of the steepest ray",
    measure=_wrapped_share,
    at_most=0.0,
)


# --- samples a pixel ------------------------------------------------------------------------------------------------


def envelope_excess(upsample: int, cycles: float) -> float:
    """Power that u samples a pixel send into a frequency over that of a square pixel, minus 1.

    cycles: the frequency in cycles a pixel. The sampled pixel sends sin²(πf)/(u·sin(πf/u))², the square one sinc²(f).
    """
    return float(1 / np.sinc(cycles / upsample) ** 2 - 1)


def _envelope(plan: Plan) -> Measured:
    pitch_m, upsample = plan.system.modulators[0].pitch_m, plan.grid.upsample
    relays = [plan.relays[number] for _, number, _ in paths(plan)]
    cycles = max(
        pitch_m / λ * first_order_sine(plan, relay, λ) for relay in relays for λ in lit_wavelengths(plan).tolist()
    )
    excess = envelope_excess(upsample, cycles)
    return Measured(
        excess,
        f"with {upsample} sample{'s' * (upsample > 1)} a pixel, light at the edge of the first order is {excess:.0%} "
        "too strong, as higher orders are aliased into it",
        "sampling.upsample",
        "raise upsample to 2 or more",
    )


SAMPLES_A_PIXEL = Limit(
    name="samples a pixel",
    quantity="excess of power at the edge of what passes of the first order",
    reason="1/sinc²(f/u) − 1 at f ≤ 1/2 cycle a pixel: 147 % for u = 1, 23 % for 2, 5 % for 4",
    measure=_envelope,
    at_most=_ENVELOPE_EXCESS,
)


# --- stops and oblique light ----------------------------------------------------------------------------------------


def _stops(plan: Plan) -> Measured | None:
    pitch_m, dx = plan.system.modulators[0].pitch_m, plan.grid.pitch_m
    stopped = [(number, plan.relays[number]) for _, number, _ in paths(plan) if plan.relays[number].has_aperture]
    if not stopped:
        return None
    worst, number = max(
        (relay.axis_sine(λ, pitch_m) / min(λ / (2 * dx), 1.0), number)
        for number, relay in stopped
        for λ in lit_wavelengths(plan).tolist()
    )
    return Measured(
        worst,
        f"the stops of relay {number + 1} reach {worst:.3g} times as far as the samples hold light, and nothing is "
        "computed beyond",
        f"relay{number + 1}",
        "raise upsample or narrow the stop",
    )


STOPS = Limit(
    name="stops beyond the samples",
    quantity="farthest direction that the stops pass along an axis, in that of the samples, λ/(2·dx)",
    reason="light between the two would pass the bench and isn't computed (Nyquist)",
    measure=_stops,
    at_most=1.0,
)


def _obliqueness(plan: Plan) -> Measured:
    turns = float(np.abs(plan.slopes).max())
    return Measured(
        turns,
        f"the light arrives with {turns:.3g} turns a sample, and is computed as if it came from another direction",
        "source",
        "raise upsample or reduce the angle",
    )


OBLIQUE_LIGHT = Limit(
    name="oblique light",
    quantity="phase slope of the illumination, turns a sample",
    reason="a wave of more than half a turn a sample is aliased to another direction (Nyquist)",
    measure=_obliqueness,
    at_most=0.5,
)


# --- single precision -----------------------------------------------------------------------------------------------


def remainder_turns(waves: float, squared_sine: float) -> float:
    """What the paraxial phase leaves of the phase of propagation, turns: (z/λ)·[A/(1 + √(1 − A)) − A/2]."""
    a = min(squared_sine, 1.0)
    return waves * (a / (1 + math.sqrt(1 - a)) - a / 2)


def _phase_error(plan: Plan) -> Measured:
    grid, worst, worst_key = plan.grid, 0.0, ""
    for key, number, distance_m in paths(plan):
        for λ in lit_wavelengths(plan).tolist():
            limits = [1 / (2 * grid.pitch_m)] * 2
            if _is_band_limited(plan):
                limits = [min(limits[0], band_limit(n, grid.pitch_m, λ, distance_m)) for n in grid.padded]
            stop = plan.relays[number].steepest_sine(λ, plan.system.modulators[0].pitch_m)
            turns = remainder_turns(distance_m / λ, min(stop**2, (λ * math.hypot(*limits)) ** 2))
            error = 2 * math.pi * _ROUNDINGS * _UNIT_ROUNDOFF * turns
            if error >= worst:
                worst, worst_key = error, key
    return Measured(
        worst,
        f"phases of the steepest light are off by up to {worst:.2g} rad in single precision",
        worst_key,
        "compute it with --backend torch64",
    )


SINGLE_PRECISION = Limit(
    name="single precision",
    quantity="rounding of the steepest light's phase on a GPU, rad",
    reason="three roundings of the phase beyond the paraxial one; 0.01 rad change an interference by 1 %",
    measure=_phase_error,
    at_most=_PHASE_ERROR,
)
