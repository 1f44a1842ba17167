"""How much of the light is in the picture: the power in the window of a plane, in that behind the last element.

    share(plane, λ) = Σ I(plane, λ) / Σ w·Σ_k |W_k·P_k|²/P

I is the intensity of a plane, summed over the samples of its window; W the spectrum behind the last modulator, or of a
field, of a frame and a direction of the source with the weight w of its laser; P_k what the stops of relay 2, with an
eye its pupil too, pass of a frequency, and P the number of samples of the padded grid (Parseval). Without stops it is
the power of the samples behind the modulator, for which no transform is needed. What the band limit leaves out walked
off the grid, and counts as light that isn't in the picture. With propagation "periodic" nothing leaves it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.model.field_band import edge_power
from holoview.light.model.plan import Plan
from holoview.light.model.validity import LEAST_IN_PICTURE, LightFigures

_STEEPEST = 0.99  # direction sine of light whose way is bounded


@dataclass(frozen=True, eq=False)
class LightShares:
    """The light that is in the pictures of a plan. Made by `light_shares`.

    in_planes: (plane, wavelength) power in the window of each plane. plain_behind: (wavelength,) power behind the last
    element where it follows without a transform, else None. derive_behind: computes it, by the transforms of one frame,
    unless `is_derived`: then it is known.
    """

    in_planes: NDArray[np.float64]
    plain_behind: NDArray[np.float64] | None
    derive_behind: Callable[[], NDArray[np.float64]]
    is_derived: bool = False

    @cached_property
    def behind(self) -> NDArray[np.float64]:
        """(wavelength,): power behind the last modulator or field and its stops."""
        return self.derive_behind() if self.plain_behind is None else self.plain_behind

    @cached_property
    def by_wavelength(self) -> NDArray[np.float64]:
        """(plane, wavelength): shares from 0 to 1; NaN at wavelengths without light."""
        return _ratio(self.in_planes, self.behind[None, :])

    @cached_property
    def by_plane(self) -> NDArray[np.float64]:
        """(plane,): shares of the light of all wavelengths together; NaN without light."""
        return _ratio(self.in_planes.sum(axis=1), self.behind.sum())

    def at(self, planes: list[int]) -> LightShares:
        """Of some of the planes, by their indices."""
        return replace(self, in_planes=self.in_planes[planes])


def light_shares(
    plan: Plan, drive: Any, intensity: NDArray[np.floating], behind: NDArray[np.float64] | None = None
) -> LightShares:
    """The shares of a plan's light.

    drive: as of `simulate`. intensity: (plane, wavelength, y, x) of the plan's planes. behind: (wavelength,) the power
    behind the last element, where an executor has measured it.
    """
    in_planes = intensity.sum(axis=3).sum(axis=2, dtype=np.float64)  # numpy sums a row in pairs: as exact, and faster
    if behind is not None:
        return LightShares(in_planes, None, lambda: behind, is_derived=True)
    return LightShares(in_planes, _plain_power(plan, drive), partial(_derived_power, plan, drive))


def needs_transforms(plan: Plan) -> bool:
    """Whether the power behind the last element is told of a plan, and known by its spectrum only."""
    return not _is_plain(plan) and may_leave(plan)


def luminance_share(plan: Plan, drive: Any, xyz: NDArray[np.floating]) -> float | None:
    """The share of the luminance that is in a picture XYZ (y, x, 3) of a plane; None where it takes transforms, or of
    no light."""
    behind = _plain_power(plan, drive)
    whole = 0.0 if behind is None else float(behind @ plan.colour_weights[:, 1])
    return min(float(xyz[..., 1].sum(dtype=np.float64)) / whole, 1.0) if whole > 0 else None


def _derived_power(plan: Plan, drive: Any) -> NDArray[np.float64]:
    from holoview.light.engine.light_behind import power_behind  # slow start: importing torch takes a second

    return power_behind(plan, drive)


def figures_of(plan: Plan, drive: Any, shares: LightShares, focus_m: NDArray[np.float64]) -> LightFigures:
    """The figures of the light that the limits of the model are measured of.

    focus_m: (plane,) the distances that are told. Where the power behind the last element takes transforms, the share
    is known only if more than a tenth of light that is spread evenly goes past the edges.
    """
    at_edge = edge_power(drive) if plan.nominal.is_field and plan.distances_m.any() else None  # at 0 nothing propagates
    is_known = shares.is_derived or shares.plain_behind is not None
    if not (is_known or may_leave(plan)) or not np.isfinite(shares.by_plane).all():
        return LightFigures(at_edge=at_edge)
    least = int(np.argmin(shares.by_plane))
    return LightFigures(float(shares.by_plane[least]), float(focus_m[least]), at_edge)


def may_leave(plan: Plan) -> bool:
    """Whether more than a tenth of light that fills a modulator and the directions that pass goes past the edges.

    Light of a direction loses the share d/N of each side N, by which it moves sideways; over all directions that pass
    this is half of that of the steepest.
    """
    system, last, ways_m = plan.system, plan.way.last, []
    for index, distance_m in enumerate(np.abs(plan.distances_m).max(axis=0).tolist()):
        λ = float(system.wavelengths_m[index])
        sine = min(λ / (2 * plan.grid.pitch_m), plan.relays[last].axis_sine(λ, plan.order_m(last)), _STEEPEST)
        ways_m += [distance_m * sine / math.sqrt(1 - sine * sine)] if plan.lit(index) else []
    return (
        sum(float(np.mean(ways_m or [0.0])) / 2 / (n * plan.grid.pitch_m) for n in plan.grid.shape)
        > 1 - LEAST_IN_PICTURE
    )


def _plain_power(plan: Plan, drive: Any) -> NDArray[np.float64] | None:
    """(wavelength,): power of the samples behind the last element; None where stops, a gap or effects change it."""
    if not _is_plain(plan):
        return None
    weights = plan.weights * len(plan.slopes)
    if not plan.nominal.is_field:
        even: NDArray[np.float64] = weights.sum(axis=0) * math.prod(plan.grid.shape)
        return even
    powers = [[_power(drive[frame, index]) for index in range(weights.shape[1])] for frame in range(weights.shape[0])]
    total: NDArray[np.float64] = (weights * np.array(powers)).sum(axis=0)
    return total


def _is_plain(plan: Plan) -> bool:
    """Whether neither stops, a gap nor effects change the power of the samples behind the last element."""
    relay = plan.relays[plan.way.last]
    is_open = not (relay.has_aperture or relay.dc_block_na is not None or relay.apodisation_na is not None)
    return (
        is_open
        and plan.nominal.eye is None
        and not plan.nominal.effects
        and len(plan.way.steps) == 1
        and not plan.way.is_chain
    )


def _power(values: Any) -> float:
    """Σ|u|² of an array or a tensor (y, x), its rows summed in double precision."""
    host = values.detach().cpu().numpy() if hasattr(values, "detach") else np.asarray(values)
    return float(sum(np.einsum("yx,yx->y", part, part).sum(dtype=np.float64) for part in (host.real, host.imag)))


def _ratio(part: NDArray[np.float64], whole: Any) -> NDArray[np.float64]:
    """part / whole, at most 1, which rounding exceeds; NaN for no light."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.minimum(part / np.where(whole > 0, whole, np.nan), 1.0)
