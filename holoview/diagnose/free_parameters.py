"""The free parameters of a set of effects as one vector, in units of their priors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter
from holoview.numerics.least_squares import SearchDomain, Vector

FittedValues = dict[str, dict[str, float]]

_STEP = 0.02  # of the prior: small enough for a slope, large enough for float32 pictures
_EVEN_STEP = 0.1  # of the prior's square: pictures are nearly linear in it, smaller steps drown in irises' jumps
_SHARP_STEP = 0.4  # of the prior: far enough that a hard edge passes over many samples


@dataclass(frozen=True)
class FreeParameters:
    """What a fit varies: (effect id, parameter) pairs. Vectors hold `to_fit(value)` over its prior."""

    entries: tuple[tuple[str, Parameter], ...]

    def __len__(self) -> int:
        return len(self.entries)

    def pack(self, values: Mapping[str, Mapping[str, float]]) -> Vector:
        """The vector of values; what isn't given is at its identity."""
        return np.array([p.to_fit(values.get(e, {}).get(p.name, p.identity)) / _scale(p) for e, p in self.entries])

    def unpack(self, x: Vector, base: Mapping[str, Mapping[str, float]] | None = None) -> FittedValues:
        """Values by effect and parameter; `base` gives those that aren't varied."""
        found: FittedValues = {effect: dict(values) for effect, values in (base or {}).items()}
        for (effect, p), number in zip(self.entries, x, strict=True):
            found.setdefault(effect, {})[p.name] = float(p.from_fit(float(number) * _scale(p)))
        return found

    def bounds(self) -> SearchDomain:
        """The bounds of the vector, and steps for its slopes."""
        lower = [(0.0 if p.even else p.to_fit(p.low)) / _scale(p) for _, p in self.entries]
        upper = [p.to_fit(p.high) / _scale(p) for _, p in self.entries]
        steps = [_SHARP_STEP if p.sharp else _EVEN_STEP if p.even else _STEP for _, p in self.entries]
        return SearchDomain(
            np.array(lower), np.array(upper), np.array(steps), np.array([p.even for _, p in self.entries])
        )

    def value_derivatives(self, x: Vector) -> Vector:
        """∂value/∂x at x: turns the vector's uncertainty into the values'."""
        slopes = []
        for (_, p), number in zip(self.entries, x, strict=True):
            if p.even:
                slopes.append(0.5 * p.prior / max(float(number), 1e-6) ** 0.5)
            else:
                slopes.append(p.prior)
        return np.array(slopes)


def free_parameters_of(effects: Sequence[Effect], *, include_fine: bool = False) -> FreeParameters:
    """The parameters of effects, without the `fine` ones unless asked for."""
    return FreeParameters(tuple((e.id, p) for e in effects for p in e.parameters if include_fine or not p.fine))


def _scale(parameter: Parameter) -> float:
    return parameter.prior**2 if parameter.even else parameter.prior
