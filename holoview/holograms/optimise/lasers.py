"""The lasers of a plan that are on, (frame, wavelength) pairs; plans with only some of them; effects that split
them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.optimise.settings import Settings
from holoview.light.model.effects.registry import ActiveEffects, EffectValues
from holoview.light.model.plan import Plan
from holoview.light.model.system import System
from holoview.util.errors import UserError

Laser = tuple[int, int]
"""Indices of a frame and of a wavelength that is on in this frame."""


def lit_lasers(plan: Plan) -> list[Laser]:
    """The lasers whose power isn't zero, frame by frame."""
    return [(int(frame), int(wavelength)) for frame, wavelength in np.argwhere(plan.weights > 0)]


def with_only_lasers(plan: Plan, lasers: Sequence[Laser]) -> Plan:
    """The plan with all other lasers switched off."""
    weights = np.zeros_like(plan.weights)
    for laser in lasers:
        weights[laser] = plan.weights[laser]
    return replace(plan, weights=weights)


def check_effects(plan: Plan, settings: Settings) -> None:
    """Raises UserError for effects that split a laser into several, or change its frames or power."""
    if not plan.nominal.effects:
        return
    table = plan.nominal.effect_values
    if names := [name for name, values in table.items() if changes_lasers(plan.nominal, {name: values})]:
        raise UserError(
            f"effects.{' and '.join(names)}",
            "splits lasers, or changes their frames or powers, which the optimiser can't take into account",
            expected="effects that leave the lasers as they are",
            remedy="switch it off for the optimisation; rendering shows what it does",
        )
    if "wavelengths" in settings.free:
        raise UserError("free", "wavelengths on a bench with effects", remedy="free patterns and amplitudes only")


_LEAST_AMPLITUDE = 1e-6  # of the brightest laser: a laser that the last picture didn't need may be needed now


def next_amplitudes(last: NDArray[np.float64], are_on: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Amplitudes (frame, wavelength) to begin a hologram with, from those of the hologram of the picture before.

    are_on: the lasers that are on in the system, and so stay on.
    """
    return np.where(are_on, np.maximum(last, _LEAST_AMPLITUDE * np.max(last)), 0.0)


def changes_lasers(nominal: System, effects: EffectValues) -> bool:
    """Whether effects split a laser of a system into several, or change its frames or powers."""
    shown = ActiveEffects(effects).as_built(nominal)
    same_count = (len(shown.wavelengths_m), shown.frames) == (len(nominal.wavelengths_m), nominal.frames)
    return not same_count or bool(np.any(shown.amplitudes != nominal.amplitudes))
