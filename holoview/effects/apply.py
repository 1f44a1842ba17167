"""A bench with its effects: which are on, and their hooks in order."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import torch

from holoview.effects.effect import Effect, Moment
from holoview.effects.parameter import Values
from holoview.effects.places import Aperture, Pose, Sensor, Surface
from holoview.effects.registry import effect
from holoview.errors import UserError
from holoview.optics.slm import phasor
from holoview.system import System

Tensor = torch.Tensor
Table = Mapping[str, Mapping[str, Any]]


class Applied:
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
            try:
                system = one.bench(system, v)
            except UserError as error:
                raise error.inside(f"effects.{one.id}: ") from error
        return system

    def power(self, power: Any) -> Any:
        """Relative power that was emitted when `power` was set."""
        for one, v in self.having("power"):
            power = one.power(power, v)
        return power

    def moments(self) -> list[Moment]:
        """What an exposure averages over: (weight, factor of the optical paths)."""
        moments: list[Moment] = [(1.0, 1.0)]
        for one, v in self.having("moments"):
            moments = [(w0 * w, f0 * f) for w0, f0 in moments for w, f in one.moments(v)]
        return moments

    def light(self, share: Tensor, at: Surface, dtype: torch.dtype, factor: float = 1.0) -> Tensor:
        """Complex transmission of a modulator that was sent `share` (rows, columns) of its stroke.

        Of pixels (rows, columns), or of samples where an effect needs them.
        """
        for one, v in self._on_modulator("response", at.number):
            share = one.response(share, at, v)
        path = share * at.stroke_m
        for one, v in self._on_modulator("path", at.number):
            path = one.path(path, at, v)
        if factor != 1.0:
            path = path * factor
        light = phasor(path, at.wavelength_m, dtype)
        for one, v in self._on_modulator("transmission", at.number):
            light = one.transmission(light, at, v)
        seat = self.seat() if at.number == 1 else Pose()
        return light if seat.is_identity else at.warped(light, seat)

    def _on_modulator(self, hook: str, number: int) -> list[tuple[Effect, Values]]:
        """Those with the hook that change this modulator, or what falls onto the first one."""
        places = {f"modulator {number + 1}", "source" if number == 0 else ""}
        return [pair for pair in self.having(hook) if places & set(pair[0].where)]

    def seat(self) -> Pose:
        """How the second modulator lies."""
        pose = Pose()
        for one, v in self.having("seat"):
            pose = one.seat(pose, v)
        return pose

    def pupil(self, at: Aperture, dtype: torch.dtype) -> Tensor | None:
        """Complex pupil that effects add to a relay, (rows, columns); None where none does."""
        on = [pair for pair in self.having("pupil") if f"relay {at.relay + 1}" in pair[0].where]
        if not on:
            return None
        pupil = torch.ones(len(at.sine_y), at.sine_x.shape[1], dtype=dtype, device=at.sine_y.device)
        for one, v in on:
            pupil = one.pupil(pupil, at, v)
        return pupil

    def aim(self) -> Pose:
        """How the camera lies."""
        pose = Pose()
        for one, v in self.having("aim"):
            pose = one.aim(pose, v)
        return pose

    def image(self, image: Tensor, at: Sensor) -> Tensor:
        """What the camera collects of an intensity (y, x)."""
        for one, v in self.having("image"):
            image = one.image(image, at, v)
        return image

    def offset(self) -> float:
        """Counts beyond the camera's nominal black level."""
        return sum(one.offset(v) for one, v in self.having("offset"))
