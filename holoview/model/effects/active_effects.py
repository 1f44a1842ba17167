"""Applies the active effects of a table to a System, to laser powers and to exposures; nothing here needs torch."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from holoview.model.effects.effect import CAMERA_HOOKS, MODULATOR_HOOKS, DataProperties, Effect, ExposureSample
from holoview.model.effects.parameter import Values
from holoview.model.effects.registry import get_effect, is_user_effect
from holoview.util.errors import UserError

if TYPE_CHECKING:  # a System holds the values of its effects: its module imports this package
    from holoview.model.system import System

EffectValues = Mapping[str, Mapping[str, Any]]
"""{effect id: {parameter: SI value}}."""

ActivePair = tuple[Effect, Values]


def call_hook(effect: Effect, hook: str, *arguments: Any) -> Any:
    """The result of an effect's hook.

    Raises UserError that names the effect when the hook raises one, and when a user's effect fails or returns None.
    """
    try:
        result = getattr(effect, hook)(*arguments)
    except UserError as error:
        raise error.inside(f"effects.{effect.id}: ") from error
    except Exception as error:
        if is_user_effect(effect):
            found = f"its {hook} failed: {type(error).__name__}: {error}"
            raise UserError(f"effects.{effect.id}", found, remedy="mend the file that defines it") from error
        raise
    if result is None:
        raise UserError(f"effects.{effect.id}", f"its {hook} returned nothing", remedy="mend the file that defines it")
    return result


class ActiveEffects:
    """The effects of a table that aren't at their identity, in the order in which their hooks are called.

    table: {effect id: {parameter: SI value}}.
    extra: effects that are used instead of the registered ones of the same id.

    pairs: (effect, its parameter values), sorted by `Effect.order` and id.
    """

    def __init__(self, table: EffectValues, extra: Iterable[Effect] = ()) -> None:
        extra_by_id = {effect.id: effect for effect in extra}
        pairs = [(extra_by_id.get(name) or get_effect(name), given) for name, given in table.items()]
        active = [(effect, v) for effect, given in pairs if not (v := effect.parameter_values(given)).is_identity]
        self.pairs: tuple[ActivePair, ...] = tuple(sorted(active, key=lambda pair: (pair[0].order, pair[0].id)))

    def with_hooks(self, *hooks: str) -> list[ActivePair]:
        """The pairs whose effect overrides one of the hooks."""
        return [(effect, v) for effect, v in self.pairs if any(effect.overrides(hook) for hook in hooks)]

    def on_modulator(self, number: int, *hooks: str) -> list[ActivePair]:
        """The pairs with one of the hooks that act on modulator 0 or 1; the source acts on modulator 0."""
        parts = {f"modulator {number + 1}", "source" if number == 0 else ""}
        return [pair for pair in self.with_hooks(*hooks) if parts & set(pair[0].acts_on)]

    def cache_key(self, *hooks: str, acts_on: str = "", laser: int | None = None) -> tuple[Any, ...]:
        """A hashable key of all that the hooks' results depend on: equal for equal effects and values.

        acts_on: restricts it to effects of one part, such as "modulator 1". laser: restricts it to what matters while
        this laser is on, 0 for the shortest wavelength.
        """
        pairs = [pair for pair in self.with_hooks(*hooks) if not acts_on or acts_on in pair[0].acts_on]
        keys = [(effect.id, v.cache_key if laser is None else effect.cache_values(v, laser)) for effect, v in pairs]
        return tuple(key for key in keys if key[1])

    def applied(self, hook: str, value: Any, *context: Any, pairs: Iterable[ActivePair] | None = None) -> Any:
        """`value` passed through one hook of every pair that has it, or of the given pairs, one after another."""
        for effect, v in self.with_hooks(hook) if pairs is None else pairs:
            value = call_hook(effect, hook, value, *context, v)
        return value

    def actual_system(self, system: System) -> System:
        """The system with the hooks `actual_system`. Raises UserError, with an effect's id, if none can be."""
        changed: System = self.applied("actual_system", system)
        return changed

    def camera_distance(self, distance_m: float) -> float:
        """How far the camera really is from the last modulator, or from the focal plane, m."""
        return float(self.applied("camera_distance", distance_m))

    def laser_power(self, power: Any) -> Any:
        """The relative power that is emitted when `power` was set, a number or an array."""
        return self.applied("laser_power", power)

    def exposure_samples(self) -> list[ExposureSample]:
        """The samples that an exposure averages: pairs (weight, factor of the optical paths)."""
        samples: list[ExposureSample] = [(1.0, 1.0)]
        for effect, v in self.with_hooks("exposure_samples"):
            samples = [(w0 * w, f0 * f) for w0, f0 in samples for w, f in call_hook(effect, "exposure_samples", v)]
        return samples

    def black_level_offset(self) -> float:
        """Counts that are added to the camera's nominal black level."""
        hook = "black_level_offset"
        return sum(call_hook(effect, hook, v) for effect, v in self.with_hooks(hook))

    def camera_effects(self) -> list[Effect]:
        """The effects that change only what a camera records; an observer doesn't see them."""
        return [effect for effect, _ in self.with_hooks(*CAMERA_HOOKS)]

    def as_built(self, system: System) -> System:
        """The system with effects on distances, angles, wavelengths, apertures and laser powers, as it is simulated.

        An exposure with M samples becomes M frames: frame f of `system` becomes the frames f·M … f·M + M − 1. Raises
        UserError when the system lacks what an effect changes.
        """
        self._check_requirements(system)
        system = self.actual_system(system)
        amplitudes = self.laser_power(system.amplitudes)
        weights = np.array([weight for weight, _ in self.exposure_samples()])
        rows = (amplitudes[:, None, :] * (weights * len(weights))[None, :, None]).reshape(-1, amplitudes.shape[1])
        return system.edit({"amplitudes": rows, "effects": {}})

    def _check_requirements(self, system: System) -> None:
        for effect, _ in self.pairs:
            if missing := unmet_requirement(effect, system):
                raise UserError(f"effects.{effect.id}", missing, remedy="switch it off, or describe what it acts on")


def unmet_requirement(effect: Effect, system: System) -> str:
    """Why an effect can't be active in a system, in words; empty when it can."""
    if system.is_field and any(effect.overrides(hook) for hook in (*MODULATOR_HOOKS, "exposure_samples")):
        return "acts on a modulator, and a field has none"
    properties = DataProperties(
        wavelengths=len(system.wavelengths_m),
        planes=len(system.planes_m),
        powers=1,
        modulators=len(system.modulators),
        irises=(system.relay1.has_aperture, system.relay2.has_aperture),
        is_fourier=False,
    )
    return unmet_by_bench(effect, properties)


def unmet_by_bench(effect: Effect, properties: DataProperties) -> str:
    """Why an effect can't be active on a bench, in words; how many captures of what were taken there doesn't matter."""
    needs = dataclasses.replace(effect.needs, wavelengths=1, planes=1)
    return needs.unmet_by(dataclasses.replace(properties, powers=2))
