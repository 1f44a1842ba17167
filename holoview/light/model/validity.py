"""When the model stops being true: limits of a bench's plan, each with what is measured, its threshold and its reason.

`Limit` states the measure and its threshold, `LimitReading` the figure of a plan. `LIMITS` are all of them:
limits of sampling (band limit, wrap-around, samples a pixel, stops and oblique light, single precision), of scalar
diffraction, of broad lines and extended sources, of the eye's pupil, and of the light itself: how much of it is in the
picture and, of a field, at the edge of its samples' band. docs/physics.md has the table of thresholds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.light.colour import observer_table, observer_weights
from holoview.light.model.chain import Travel
from holoview.light.model.effects.registry import ActiveEffects, bench_properties, idle_parameters
from holoview.light.model.eye import Eye
from holoview.light.model.passband import Integers, band_limit, frequencies_left, nothing_left
from holoview.light.model.plan import Plan, walk_off
from holoview.util import units
from holoview.util.errors import UserError

Measure = Callable[..., "Measured | None"]
"""(plan) or, of the light, (plan, light): the figure, or None where it doesn't apply."""


@dataclass(frozen=True)
class Measured:
    """The figure of a plan.

    value: in the unit of the limit. found: the consequence beyond the threshold, a sentence without a full stop.
    where: the key of the bench that it depends on most. remedy: the change that helps.
    """

    value: float
    found: str
    where: str
    remedy: str


@dataclass(frozen=True)
class LightFigures:
    """Figures of the light that a plan shows, which its drive decides; None where they aren't known.

    in_picture: the share of the light that is in the picture of a plane, of the plane that has least.
    plane_m: the distance of this plane. at_edge: of a complex field, the share of its power in the outer tenth of the
    samples' band, along the axis that has more.
    """

    in_picture: float | None = None
    plane_m: float = 0.0
    at_edge: float | None = None


@dataclass(frozen=True)
class Limit:
    """A limit of the model.

    name: a few words. quantity: the measured quantity with its unit. reason: where the threshold comes from.
    measure: its figure for a plan and its light; None where the limit doesn't apply.
    at_least, at_most: the threshold; one of them is given.
    refuses: whether nothing is left to see beyond the threshold, so that the plan isn't rendered.
    is_of_light: whether it is measured of a plan and its `LightFigures`.
    """

    name: str
    quantity: str
    reason: str
    measure: Measure
    at_least: float | None = None
    at_most: float | None = None
    refuses: bool = False
    is_of_light: bool = False

    @property
    def threshold(self) -> str:
        """The threshold in words."""
        return f"at most {self.at_most:.3g}" if self.at_least is None else f"at least {self.at_least:.3g}"

    def is_kept_by(self, value: float) -> bool:
        """Whether a value is on the right side of the threshold."""
        if self.at_least is not None:
            return value >= self.at_least
        assert self.at_most is not None
        return value <= self.at_most


LIMITS: dict[str, Limit] = {}
"""All limits by their names, in the order in which they are told."""


def _limit(
    name: str,
    *,
    quantity: str,
    reason: str,
    at_least: float | None = None,
    at_most: float | None = None,
    refuses: bool = False,
    is_of_light: bool = False,
) -> Callable[[Measure], Measure]:
    """Makes a limit of the function that measures it, and adds it to `LIMITS`; the arguments are those of `Limit`."""

    def add(measure: Measure) -> Measure:
        LIMITS[name] = Limit(name, quantity, reason, measure, at_least, at_most, refuses, is_of_light)
        return measure

    return add


@dataclass(frozen=True)
class LimitReading:
    """The verdict of a limit on a plan."""

    limit: Limit
    measured: Measured

    @property
    def is_exceeded(self) -> bool:
        """Whether the model isn't true of the plan in this respect."""
        return not self.limit.is_kept_by(self.measured.value)

    @property
    def text(self) -> str:
        """The limit's name and its verdict, in a sentence."""
        return f"{self.limit.name}: {self.measured.found}; {self.measured.remedy}"


# Limits of the grid of a plan.
#
# Symbols: p pixel pitch, u samples along each side of a pixel, dx = p/u, P padded samples, s = λf direction sine.


Path = tuple[str, int, float]
"""Key of the bench, number of the relay, and distance in metres of a way that light goes."""

_ENVELOPE_EXCESS = 0.25
_PHASE_ERROR = 1e-2
_ROUNDINGS, _UNIT_ROUNDOFF = 3, 2.0**-24  # of float32 in a phase's remainder, measured: docs/physics-evidence.md


def lit_wavelengths(plan: Plan) -> NDArray[np.float64]:
    """The wavelengths that shine in some frame."""
    lit: NDArray[np.float64] = plan.system.wavelengths_m[np.any(plan.weights > 0, axis=0)]
    return lit


def paths(plan: Plan) -> list[Path]:
    """The ways that light goes: the gap, and to the farthest plane at any wavelength, which may lie before a field."""
    distances = plan.distances_m.ravel()
    farthest_m = float(distances[np.argmax(np.abs(distances))])
    way, to_planes = plan.way, ("planes" if plan.nominal.eye is None else "eye", plan.way.last, farthest_m)
    between = [step.relay for step in way.steps if isinstance(step, Travel) and way.kernel(step.relay) is None]
    return [("elements" if way.is_chain else "gap", relay, way.distances_m[relay]) for relay in between] + [to_planes]


def _key(plan: Plan, relay: int) -> str:
    """The key of the bench that states the stops of a relay."""
    return "elements" if plan.way.is_chain else f"relay{relay + 1}"


def first_order_sine(plan: Plan, relay: int, wavelength_m: float) -> float:
    """The largest direction sine along an axis that a relay passes of the first order, λ/(2p) or less."""
    pitch_m = plan.order_m(relay)
    return min(plan.relays[relay].axis_sine(wavelength_m, pitch_m), wavelength_m / (2 * pitch_m))


# --- band limit -----------------------------------------------------------------------------------------------------


def _is_band_limited(plan: Plan) -> bool:
    return plan.system.sampling.propagation != "periodic"


@_limit(
    "band left",
    quantity="frequencies beside zero that the band limit leaves on each side of the longer axis",
    reason="below 1 only the zero order is computed, and every pattern gives the same uniform picture",
    at_least=1.0,
    refuses=True,
)
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


@_limit(
    "light left",
    quantity="frequencies that the stops of a relay pass, at the wavelength that passes best",
    reason="without a frequency there is no light",
    at_least=1.0,
    refuses=True,
)
def _light_left(plan: Plan) -> Measured:
    """The frequencies that pass a relay at the wavelength that passes best, of the relay that passes fewer."""
    lit = [i for i in range(len(plan.system.wavelengths_m)) if plan.lit(i)]
    fewest, relay = min(
        (max(_count_passing(plan.stop_rows(relay, i)) for i in lit), relay) for _, relay, _ in paths(plan)
    )
    return Measured(
        float(fewest),
        "no light passes its stops" if fewest == 0 else "a single frequency of the samples passes its stops",
        _key(plan, relay),
        "widen them, move them to light that the samples hold, or raise padding or upsample",
    )


def _count_passing(support: Integers) -> int:
    """How many frequencies a support passes (`Transfer.support`)."""
    smallest, low, high = support.astype(np.int64).T
    blocked = np.minimum(high, smallest - 1) - np.maximum(low, 1 - smallest) + 1
    return int((high - low + 1 - np.maximum(blocked, 0)).sum())  # an empty row has the bounds (1, 0)


@_limit(
    "band limit",
    quantity="band limit in half widths of the first order, or of what the stops pass of it",
    reason="below 1 light of the first order is left out: measured errors of the intensity of 17 % and more",
    at_least=1.0,
)
def _first_order_left(plan: Plan) -> Measured | None:
    if not _is_band_limited(plan):
        return None
    grid, worst, worst_key, worst_m = plan.grid, math.inf, "", 0.0
    for key, relay, distance_m in paths(plan):
        for λ in lit_wavelengths(plan).tolist():
            limit = min(band_limit(n, grid.pitch_m, λ, distance_m) for n in grid.padded)
            share = λ * limit / min(first_order_sine(plan, relay, λ), 1.0)
            if share < worst:
                worst, worst_key, worst_m = share, key, distance_m
    return Measured(
        worst,
        f"of the first order's angles the grid holds {worst:.0%} at {units.format_rounded(worst_m, 'mm')}: the rest "
        "walks off by more than half the grid and is left out",
        worst_key,
        "raise padding or shape, or shorten the distance",
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
        reach = walk_off(plan.system, relay, distance_m)
        for n, padded in zip(plan.grid.shape, plan.grid.padded, strict=True):
            share = min(1.0, max(0.0, n + reach - padded) / n)
            if share > worst[0]:
                worst = (share, "planes" if key == "eye" else key, reach)
    return worst


@_limit(
    "wrap-around",
    quantity="share of a side that light reaches which wrapped around",
    reason="a modulator has edges; geometric walk-off of the steepest ray",
    at_most=0.0,
)
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


# --- samples a pixel ------------------------------------------------------------------------------------------------


def envelope_excess(upsample: int, cycles: float) -> float:
    """Power that u samples a pixel send into a frequency over that of a square pixel, minus 1.

    cycles: the frequency in cycles a pixel. The sampled pixel sends sin²(πf)/(u·sin(πf/u))², the square one sinc²(f).
    """
    return float(1 / np.sinc(cycles / upsample) ** 2 - 1)


@_limit(
    "samples a pixel",
    quantity="excess of power at the edge of what passes of the first order",
    reason="1/sinc²(f/u) − 1 at f ≤ 1/2 cycle a pixel: 147 % for u = 1, 23 % for 2, 5 % for 4",
    at_most=_ENVELOPE_EXCESS,
)
def _envelope(plan: Plan) -> Measured | None:
    if plan.system.is_field:  # a field is known at points and has no pixels
        return None
    pitch_m = plan.way.finest_m
    upsample = round(pitch_m / plan.grid.pitch_m)
    relays = [number for _, number, _ in paths(plan)]
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


_limit(
    "stops on the grid",
    quantity="frequencies that the stops of a relay pass, at the wavelength that passes best",
    reason="a single one is a uniform picture whatever the patterns, and its brightness depends on the grid",
    at_least=2.0,
)(_light_left)


# --- stops and oblique light ----------------------------------------------------------------------------------------


@_limit(
    "stops beyond the samples",
    quantity="farthest direction that the stops pass along an axis, in that of the samples, λ/(2·dx)",
    reason="light between the two would pass the bench and isn't computed (Nyquist)",
    at_most=1.0,
)
def _stops(plan: Plan) -> Measured | None:
    dx = plan.grid.pitch_m
    stopped = [(number, plan.relays[number]) for _, number, _ in paths(plan) if plan.relays[number].has_aperture]
    if not stopped:
        return None
    worst, number = max(
        (relay.axis_sine(λ, plan.order_m(number)) / min(λ / (2 * dx), 1.0), number)
        for number, relay in stopped
        for λ in lit_wavelengths(plan).tolist()
    )
    return Measured(
        worst,
        f"the stops of {plan.way.relay_words(number)} reach {worst:.3g} times as far as the samples hold light, and "
        "nothing is computed beyond",
        _key(plan, number),
        "raise upsample or narrow the stop",
    )


@_limit(
    "oblique light",
    quantity="phase slope of the illumination, turns a sample",
    reason="a wave of more than half a turn a sample is aliased to another direction (Nyquist)",
    at_most=0.5,
)
def _obliqueness(plan: Plan) -> Measured:
    turns = float(np.abs(plan.slopes).max())
    return Measured(
        turns,
        f"the light arrives with {turns:.3g} turns a sample, and is computed as if it came from another direction",
        "source",
        "raise upsample or reduce the angle",
    )


# --- single precision -----------------------------------------------------------------------------------------------


def remainder_turns(waves: float, squared_sine: float) -> float:
    """The phase of propagation minus the paraxial phase, turns: (z/λ)·[A/(1 + √(1 − A)) − A/2]."""
    a = min(squared_sine, 1.0)
    return waves * (a / (1 + math.sqrt(1 - a)) - a / 2)


@_limit(
    "single precision",
    quantity="rounding of the steepest light's phase on a GPU, rad",
    reason="three roundings of the phase beyond the paraxial one; 0.01 rad change an interference by 1 %",
    at_most=_PHASE_ERROR,
)
def _phase_error(plan: Plan) -> Measured:
    grid, worst, worst_key = plan.grid, 0.0, ""
    for key, number, distance_m in paths(plan):
        for λ in lit_wavelengths(plan).tolist():
            limits = [1 / (2 * grid.pitch_m)] * 2
            if _is_band_limited(plan):
                limits = [min(limits[0], band_limit(n, grid.pitch_m, λ, distance_m)) for n in grid.padded]
            stop = plan.relays[number].steepest_sine(λ, plan.order_m(number))
            turns = remainder_turns(abs(distance_m) / λ, min(stop**2, (λ * math.hypot(*limits)) ** 2))
            error = 2 * math.pi * _ROUNDINGS * _UNIT_ROUNDOFF * turns
            if error >= worst:
                worst, worst_key = error, key
    return Measured(
        worst,
        f"phases of the steepest light are off by up to {worst:.2g} rad in single precision",
        worst_key,
        "compute it with --backend torch64",
    )


# --- scalar diffraction -----------------------------------------------------------------------------------------------


_COSINE = 0.95
"""Cosine of the steepest direction at which the two polarisations still have nearly equal amplitudes."""
PIXEL_WAVELENGTHS = 1 / (math.sqrt(2) * math.sqrt(1 - _COSINE**2))
"""Pixels whose first order reaches that direction in its corners, λ/(√2·p): 2.26 wavelengths."""


@_limit(
    "pixels near the wavelength",
    quantity="pixel pitch in wavelengths, at the longest one",
    reason="the field of the two polarisations differs by cos θ, 5 % in the first order's corners, sin θ = λ/(√2·p)",
    at_least=PIXEL_WAVELENGTHS,
)
def _pixel_wavelengths(plan: Plan) -> Measured:
    pitch_m, λ = plan.way.finest_m, float(lit_wavelengths(plan).max())
    return Measured(
        pitch_m / λ,
        f"pixels of {units.format_rounded(pitch_m, 'um')} are {pitch_m / λ:.2g} wavelengths at "
        f"{units.format_rounded(λ, 'nm')}: neither scalar diffraction nor square pixels of constant path describe them",
        "pitch",
        "compute such a modulator by a rigorous theory",
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


@_limit(
    "evanescent orders",
    quantity="share of the first order that doesn't propagate, at the longest wavelength",
    reason="sin θ > 1 for frequencies above 1/λ; pixels below λ/√2 have such orders",
    at_most=0.0,
)
def _evanescent(plan: Plan) -> Measured:
    λ = float(lit_wavelengths(plan).max())
    share = evanescent_share(λ / (2 * plan.way.finest_m))
    return Measured(
        share,
        f"{share:.0%} of the first order is evanescent at {units.format_rounded(λ, 'nm')}: this detail of the patterns "
        "reaches no plane",
        "pitch",
        "use larger pixels or shorter wavelengths",
    )


@_limit(
    "near field",
    quantity="shortest distance above 0 in wavelengths, at the longest one",
    reason="an evanescent wave of sin θ = √2 has fallen to exp(−2π·z/λ) of its amplitude: 0.2 % at one wavelength",
    at_least=1.0,
)
def _distance_in_waves(plan: Plan) -> Measured | None:
    distances = [(z, key) for key, _, z in paths(plan) if key in ("gap", "elements") and z > 0]
    distances += [(abs(z), "planes") for z in plan.distances_m.ravel().tolist() if z != 0]
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


# --- broad lines and extended sources ---------------------------------------------------------------------------------


_LEAST_RESPONSE = 0.5 / 255 / 12.92  # half a level of 8 bits on the linear part of sRGB's curve


@_limit(
    "observer's response",
    quantity="the largest of X, Y, Z at the wavelength that is seen worst, in that of the wavelength seen best",
    reason="half a level of 8-bit sRGB next to black, 1/(2·255·12.92): less changes no pixel even of a dark picture",
    at_least=_LEAST_RESPONSE,
)
def _response(plan: Plan) -> Measured | None:
    observer = plan.system.observer
    if observer == "mono":
        return None
    λ = lit_wavelengths(plan)
    strongest = np.abs(observer_table(observer)[1]).max(axis=0)
    responses = (np.abs(observer_weights(observer, λ)) / strongest).max(axis=1)
    dimmest = int(np.argmin(responses))
    return Measured(
        float(responses[dimmest]),
        f"{units.format_rounded(float(λ[dimmest]), 'nm')} excites the observer with {responses[dimmest]:.1e} of the "
        "strongest response: it adds nothing to the picture that is seen",
        "wavelengths",
        'choose another wavelength, or observer = "mono"',
    )


@_limit(
    "samples of lines and sources",
    quantity="phase between neighbouring samples of a broad line, an extended source or a flicker, rad",
    reason="half a fringe: a sum of samples holds a continuum's interference up to π between them (Nyquist)",
    at_most=math.pi,
)
def _sample_phase(plan: Plan) -> Measured | None:
    active = ActiveEffects(plan.nominal.effect_values)
    system = plan.nominal.with_(planes=[plane.nominal_m for plane in plan.planes])
    steps = [(effect.sample_phase(system, values), effect.id) for effect, values in active.pairs]
    if not steps or max(steps)[0] == 0.0:
        return None
    phase, name = max(steps)
    return Measured(
        phase,
        f"neighbouring samples of {name} differ by {phase:.3g} rad: they make separate speckle patterns where a "
        "continuum blurs them",
        f"effects.{name}",
        "narrow the line or the source, shorten the distances, or lower the flicker",
    )


@_limit(
    "parameters of effects",
    quantity="parameters of effects that are set and change nothing",
    reason="each of them is meant to change the picture",
    at_most=0,
)
def _idle_parameters(plan: Plan) -> Measured | None:
    active, bench = ActiveEffects(plan.nominal.effect_values), bench_properties(plan.nominal)
    found = [words for effect, v in active.pairs for words in idle_parameters(effect, v, bench)]
    if plan.nominal.frames == 1:
        of_time = [effect.id for effect, _ in active.pairs if effect.hooks == ("settled_share",)]
        found += [f"effects.{name} changes nothing of one frame, which comes after itself" for name in of_time]
    if not active.pairs:
        return None
    where = found[0].split(" ", 1)[0] if found else "effects"
    more = f", and {len(found) - 1} more" if len(found) > 1 else ""
    return Measured(len(found), f"{found[0] if found else 'each acts'}{more}", where, "leave it out")


# --- the eye ----------------------------------------------------------------------------------------------------------


_LEAST_SHARE = 0.01
_CHORDS = 200  # across the pupil: the area of their part in the square is right to 1e-3 of the pupil's


def pupil_share(eye: Eye, pupil_na: float, half_side: float) -> float:
    """Share of a pupil's area that lies in the square |s_y|, |s_x| ≤ half_side of direction sines."""
    y, x = eye.pupil_centre_na
    heights = pupil_na * ((np.arange(_CHORDS) + 0.5) / _CHORDS * 2 - 1)
    half_chords = np.sqrt(pupil_na**2 - heights**2)
    left, right = np.maximum(x - half_chords, -half_side), np.minimum(x + half_chords, half_side)
    inside = np.where(np.abs(y + heights) <= half_side, np.maximum(right - left, 0.0), 0.0)
    return float(inside.sum() / (2 * half_chords).sum())


def _worst_share(plan: Plan, orders: float) -> tuple[float, float] | None:
    """The smallest share of the pupil in a square of so many first orders, and its wavelength; None without an eye."""
    eyes = dict.fromkeys(plane.eye for plane in plan.planes if plane.eye is not None)
    if not eyes:
        return None
    pitch_m, field_m = plan.way.finest_m, plan.nominal.field_m
    return min(
        (pupil_share(eye, eye.pupil_na(field_m), orders * λ / (2 * pitch_m)), λ)
        for eye in eyes
        for λ in lit_wavelengths(plan).tolist()
    )


@_limit(
    "pupil beside the eyebox",
    quantity="share of the pupil in the eyebox of the first order, at the worst wavelength",
    reason="outside, only higher orders arrive, whose strength depends on the real pixels' shape",
    at_least=_LEAST_SHARE,
)
def _in_eyebox(plan: Plan) -> Measured | None:
    worst = _worst_share(plan, 1.0)
    if worst is None:
        return None
    share, λ = worst
    return Measured(
        share,
        f"{share:.1%} of the pupil lie in the eyebox of {units.format_rounded(λ, 'nm')}: the eye sees this light by "
        "higher orders only, and dimly",
        "eye.pupil_y, eye.pupil_x",
        "move the pupil towards the middle of the eyebox",
    )


@_limit(
    "pupil beyond the samples",
    quantity="share of the pupil in the directions that the samples hold, λ/(2·dx), at the worst wavelength",
    reason="light beyond would enter the eye and isn't computed (Nyquist)",
    at_least=1.0,
)
def _in_samples(plan: Plan) -> Measured | None:
    worst = _worst_share(plan, plan.way.finest_m / plan.grid.pitch_m)
    if worst is None:
        return None
    share, λ = worst
    return Measured(
        share,
        f"the samples hold the light of {share:.0%} of the pupil at {units.format_rounded(λ, 'nm')}; that of the rest "
        "isn't computed",
        "eye",
        "raise upsample, narrow the pupil or move it to the middle",
    )


# --- the light itself -------------------------------------------------------------------------------------------------


LEAST_IN_PICTURE = 0.9
_MOST_AT_EDGE = 0.05


@_limit(
    "light in the picture",
    quantity="power in the picture of a plane, in that behind the last modulator or field and its stops",
    reason="what walked off carries detail and brightness of the image: a tenth of the light is 0.15 stops",
    at_least=LEAST_IN_PICTURE,
    is_of_light=True,
)
def _light_in_picture(plan: Plan, light: LightFigures) -> Measured | None:
    if light.in_picture is None:
        return None
    share = f"{100 * light.in_picture:.2g}%" if light.in_picture >= 1e-3 else "less than 0.1%"
    return Measured(
        light.in_picture,
        f"{share} of the light is in the picture at "
        f"{units.format_rounded(light.plane_m, 'mm')}, the rest goes past its edges",
        "planes",
        "bring the field to its image in a window that holds its light (--propagation auto, --window-centre, "
        "--window-size), or see a nearer plane"
        if plan.system.is_field
        else "shorten the distance, narrow the stops or reduce the angle of the light",
    )


@_limit(
    "band of the field",
    quantity="power of a complex field in the outer tenth of its samples' band along an axis, in all its power",
    reason="half of an even spectrum's tenth: a spectrum that doesn't fall towards its edge was cut there or aliased",
    at_most=_MOST_AT_EDGE,
    is_of_light=True,
)
def _field_band(plan: Plan | None, light: LightFigures) -> Measured | None:
    if light.at_edge is None:
        return None
    return Measured(
        light.at_edge,
        f"{light.at_edge:.0%} of the field's power lies in the outer tenth of its samples' band, where +1/2 and -1/2 "
        "turn a sample look alike: light beyond was aliased to other directions",
        "pitch",
        "sample the field more finely, or take a tilt out of it",
    )


# --- all limits -------------------------------------------------------------------------------------------------------


def read_limits(plan: Plan, light: LightFigures | None = None) -> tuple[LimitReading, ...]:
    """The verdict of each limit that applies to a plan and its light, if that is known, in the order of `LIMITS`."""
    measured = (
        (limit, limit.measure(plan, light or LightFigures()) if limit.is_of_light else limit.measure(plan))
        for limit in LIMITS.values()
    )
    return tuple(LimitReading(limit, found) for limit, found in measured if found is not None)


def band_note(at_edge: float | None) -> str:
    """The sentence of the limit "band of the field" on a share at the edge, of any field; empty within the limit."""
    limit, found = (
        LIMITS["band of the field"],
        None if at_edge is None else _field_band(None, LightFigures(at_edge=at_edge)),
    )
    return "" if found is None or limit.is_kept_by(found.value) else LimitReading(limit, found).text


def exceeded_limits(plan: Plan, light: LightFigures | None = None) -> tuple[str, ...]:
    """The limits beyond which the model isn't true of a plan and its light, each as a sentence."""
    return tuple(reading.text for reading in read_limits(plan, light) if reading.is_exceeded)


def check_plan(plan: Plan) -> Plan:
    """The plan. Raises UserError where its sampling or its stops leave nothing of the patterns to see."""
    for limit in LIMITS.values():
        found = limit.measure(plan) if limit.refuses else None
        if found is not None and not limit.is_kept_by(found.value):
            expected = f"{limit.quantity}: {limit.threshold}"
            raise UserError(found.where, found.found, expected=expected, remedy=found.remedy)
    return plan
