"""Which effects of a table are on, and what they make of a bench; nothing here needs torch."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from holoview.effects.effect import CAMERA_HOOKS, Effect, Facts, Moment
from holoview.effects.parameter import Values
from holoview.effects.registry import effect, is_own
from holoview.errors import UserError

if TYPE_CHECKING:
    from holoview.system import System

Table = Mapping[str, Mapping[str, Any]]


def called(one: Effect, hook: str, *arguments: Any) -> Any:
    """What a hook returns. Raises UserError with the effect's name where the bench can't be, or a user's file fails."""
    try:
        found = getattr(one, hook)(*arguments)
    except UserError as error:
        raise error.inside(f"effects.{one.id}: ") from error
    except Exception as error:
        if is_own(one):
            found = f"its {hook} failed: {type(error).__name__}: {error}"
            raise UserError(f"effects.{one.id}", found, remedy="mend the file that defines it") from error
        raise
    if found is None:
        raise UserError(f"effects.{one.id}", f"its {hook} returned nothing", remedy="mend the file that defines it")
    return found


class Switched:
    """The effects of a table {id: {parameter: value}} that are off their identity, in the order of their hooks."""

    def __init__(self, table: Table, extra: Iterable[Effect] = ()) -> None:
        own = {one.id: one for one in extra}
        pairs = [(own.get(name) or effect(name), values) for name, values in table.items()]
        on = [(one, v) for one, given in pairs if not (v := one.values(given)).is_identity]
        self.on: tuple[tuple[Effect, Values], ...] = tuple(sorted(on, key=lambda pair: (pair[0].order, pair[0].id)))

    def having(self, *hooks: str) -> list[tuple[Effect, Values]]:
        """Those that override one of the hooks."""
        return [(one, v) for one, v in self.on if any(one.changes(hook) for hook in hooks)]

    def key(self, *hooks: str, where: str = "") -> tuple[Any, ...]:
        """What the hooks' results depend on, of effects that change a place; equal for equal values, hashable."""
        return tuple((one.id, v.key) for one, v in self.having(*hooks) if not where or where in one.where)

    def bench(self, system: System) -> System:
        """The bench as it is. Raises UserError, naming the effect, where such a bench can't be."""
        for one, v in self.having("bench"):
            system = called(one, "bench", system, v)
        return system

    def power(self, power: Any) -> Any:
        """Relative power that was emitted when `power` was set."""
        for one, v in self.having("power"):
            power = called(one, "power", power, v)
        return power

    def moments(self) -> list[Moment]:
        """What an exposure averages over: (weight, factor of the optical paths)."""
        moments: list[Moment] = [(1.0, 1.0)]
        for one, v in self.having("moments"):
            moments = [(w0 * w, f0 * f) for w0, f0 in moments for w, f in called(one, "moments", v)]
        return moments

    def offset(self) -> float:
        """Counts beyond the camera's nominal black level."""
        return sum(called(one, "offset", v) for one, v in self.having("offset"))

    def of_camera(self) -> list[Effect]:
        """Those that change what a camera records, which nobody's eye looks through."""
        return [one for one, _ in self.having(*CAMERA_HOOKS)]

    def as_built(self, system: System) -> System:
        """The bench as it is, its lasers' powers as emitted, a frame for each moment of an exposure.

        Frame f of the nominal bench becomes the frames f·M … f·M + M − 1 of its M moments.
        """
        self._check(system)
        system = self.bench(system)
        amplitudes = self.power(system.amplitudes)
        shares = np.array([weight for weight, _ in self.moments()])
        rows = (amplitudes[:, None, :] * (shares * len(shares))[None, :, None]).reshape(-1, amplitudes.shape[1])
        return system.edit({"amplitudes": rows, "effects": {}})

    def _check(self, system: System) -> None:
        """UserError where the bench lacks what an effect changes."""
        for one, _ in self.on:
            if missing := unmet(one, system):
                raise UserError(f"effects.{one.id}", missing, remedy="switch it off, or describe what it acts on")


def unmet(one: Effect, system: System) -> str:
    """Why an effect can't be switched on for a bench, in words; empty where it can."""
    facts = Facts(
        wavelengths=len(system.wavelengths_m),
        planes=len(system.planes_m),
        powers=2,  # whatever is set later
        modulators=len(system.modulators),
        irises=(system.relay1.iris_na is not None, system.relay2.iris_na is not None),
        is_fourier=False,
    )
    return dataclasses.replace(one.needs, wavelengths=1, planes=1).missing(facts)
