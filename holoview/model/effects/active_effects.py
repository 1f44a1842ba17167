"""Which effects of a table are on, and what they make of a bench; nothing here needs torch."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from holoview.model.effects.effect import CAMERA_HOOKS, DataProperties, Effect, ExposureSample
from holoview.model.effects.parameter import Values
from holoview.model.effects.registry import get_effect, is_user_effect
from holoview.util.errors import UserError

if TYPE_CHECKING:
    from holoview.model.system import System

EffectValues = Mapping[str, Mapping[str, Any]]


def call_hook(effect: Effect, hook: str, *arguments: Any) -> Any:
    """What a hook returns. Raises UserError with the effect's name where the bench can't be, or a user's file fails."""
    try:
        found = getattr(effect, hook)(*arguments)
    except UserError as error:
        raise error.inside(f"effects.{effect.id}: ") from error
    except Exception as error:
        if is_user_effect(effect):
            found = f"its {hook} failed: {type(error).__name__}: {error}"
            raise UserError(f"effects.{effect.id}", found, remedy="mend the file that defines it") from error
        raise
    if found is None:
        raise UserError(f"effects.{effect.id}", f"its {hook} returned nothing", remedy="mend the file that defines it")
    return found


class ActiveEffects:
    """The effects of a table {id: {parameter: value}} that are off their identity, in the order of their hooks."""

    def __init__(self, table: EffectValues, extra: Iterable[Effect] = ()) -> None:
        own = {one.id: one for one in extra}
        pairs = [(own.get(name) or get_effect(name), values) for name, values in table.items()]
        on = [(one, v) for one, given in pairs if not (v := one.parameter_values(given)).is_identity]
        self.pairs: tuple[tuple[Effect, Values], ...] = tuple(sorted(on, key=lambda pair: (pair[0].order, pair[0].id)))

    def with_hooks(self, *hooks: str) -> list[tuple[Effect, Values]]:
        """Those that override one of the hooks."""
        return [(one, v) for one, v in self.pairs if any(one.overrides(hook) for hook in hooks)]

    def cache_key(self, *hooks: str, acts_on: str = "") -> tuple[Any, ...]:
        """What the hooks' results depend on, of effects that change a place; equal for equal values, hashable."""
        return tuple(
            (one.id, v.cache_key) for one, v in self.with_hooks(*hooks) if not acts_on or acts_on in one.acts_on
        )

    def bench(self, system: System) -> System:
        """The bench as it is. Raises UserError, naming the effect, where such a bench can't be."""
        for one, v in self.with_hooks("bench"):
            system = call_hook(one, "bench", system, v)
        return system

    def laser_power(self, power: Any) -> Any:
        """Relative power that was emitted when `power` was set."""
        for one, v in self.with_hooks("laser_power"):
            power = call_hook(one, "laser_power", power, v)
        return power

    def exposure_samples(self) -> list[ExposureSample]:
        """What an exposure averages over: (weight, factor of the optical paths)."""
        moments: list[ExposureSample] = [(1.0, 1.0)]
        for one, v in self.with_hooks("exposure_samples"):
            moments = [(w0 * w, f0 * f) for w0, f0 in moments for w, f in call_hook(one, "exposure_samples", v)]
        return moments

    def black_level_offset(self) -> float:
        """Counts beyond the camera's nominal black level."""
        return sum(call_hook(one, "black_level_offset", v) for one, v in self.with_hooks("black_level_offset"))

    def camera_effects(self) -> list[Effect]:
        """Those that change what a camera records, which nobody's eye looks through."""
        return [one for one, _ in self.with_hooks(*CAMERA_HOOKS)]

    def as_built(self, system: System) -> System:
        """The bench as it is, its lasers' powers as emitted, a frame for each moment of an exposure.

        Frame f of the nominal bench becomes the frames f·M … f·M + M − 1 of its M moments.
        """
        self._check(system)
        system = self.bench(system)
        amplitudes = self.laser_power(system.amplitudes)
        shares = np.array([weight for weight, _ in self.exposure_samples()])
        rows = (amplitudes[:, None, :] * (shares * len(shares))[None, :, None]).reshape(-1, amplitudes.shape[1])
        return system.edit({"amplitudes": rows, "effects": {}})

    def _check(self, system: System) -> None:
        """UserError where the bench lacks what an effect changes."""
        for one, _ in self.pairs:
            if missing := unmet_requirement(one, system):
                raise UserError(f"effects.{one.id}", missing, remedy="switch it off, or describe what it acts on")


def unmet_requirement(one: Effect, system: System) -> str:
    """Why an effect can't be switched on for a bench, in words; empty where it can."""
    facts = DataProperties(
        wavelengths=len(system.wavelengths_m),
        planes=len(system.planes_m),
        powers=2,  # whatever is set later
        modulators=len(system.modulators),
        irises=(system.relay1.iris_na is not None, system.relay2.iris_na is not None),
        is_fourier=False,
    )
    return dataclasses.replace(one.needs, wavelengths=1, planes=1).unmet_by(facts)
