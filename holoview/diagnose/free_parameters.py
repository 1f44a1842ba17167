"""The free parameters of a set of effects as one vector, in units of their priors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from holoview.diagnose.config import StepConfig
from holoview.model.effects.effect import Effect
from holoview.model.effects.list_parameter import ListParameter
from holoview.model.effects.parameter import Parameter
from holoview.numerics.least_squares import SearchDomain, Vector

FittedValues = dict[str, dict[str, Any]]
"""{effect id: {parameter: value}}; the value of a list of numbers is a tuple."""


@dataclass(frozen=True)
class FreeParameters:
    """What a fit varies: (effect id, parameter) pairs, in which entries of a list are parameters of their own.

    A component of the vector is the value over its prior, or the value's square over the prior's where images depend on
    the square.
    """

    entries: tuple[tuple[str, Parameter], ...]

    def __len__(self) -> int:
        return len(self.entries)

    @property
    def identity(self) -> Vector:
        """The vector at which no effect changes anything."""
        return np.array([p.to_fit(p.identity) / _scale(p) for _, p in self.entries])

    def pack(self, values: Mapping[str, Mapping[str, Any]]) -> Vector:
        """The vector of values; parameters that aren't given are at their identity."""
        return np.array([p.to_fit(p.read(values.get(e, {}))) / _scale(p) for e, p in self.entries])

    def unpack(self, x: Vector, base: Mapping[str, Mapping[str, Any]] | None = None) -> FittedValues:
        """Values by effect and parameter; `base` gives those that aren't varied."""
        result: FittedValues = {effect: dict(values) for effect, values in (base or {}).items()}
        for (effect, p), number in zip(self.entries, x, strict=True):
            result[effect] = p.written(result.get(effect, {}), float(p.from_fit(float(number) * _scale(p))))
        return result

    def bounds(self, steps: StepConfig) -> SearchDomain:
        """The bounds of the vector, and steps of its forward differences."""
        lower = [(0.0 if p.even_symmetric else p.to_fit(p.low)) / _scale(p) for _, p in self.entries]
        upper = [p.to_fit(p.high) / _scale(p) for _, p in self.entries]
        lengths = [
            steps.hard_edge if p.non_smooth else steps.even if p.even_symmetric else steps.regular
            for _, p in self.entries
        ]
        return SearchDomain(
            np.array(lower), np.array(upper), np.array(lengths), np.array([p.even_symmetric for _, p in self.entries])
        )

    def value_derivatives(self, x: Vector) -> Vector:
        """∂value/∂x at x, which turns the vector's uncertainty into the values'."""
        derivatives = []
        for (_, p), number in zip(self.entries, x, strict=True):
            if p.even_symmetric:
                derivatives.append(0.5 * p.prior / max(float(number), 1e-6) ** 0.5)
            else:
                derivatives.append(p.prior)
        return np.array(derivatives)


def free_parameters_of(
    effects: Sequence[Effect],
    values: Mapping[str, Mapping[str, Any]] | None = None,
    *,
    include_fine: bool = False,
) -> FreeParameters:
    """The parameters of effects, and the entries of their lists at `values`; without `fine` ones unless asked for."""
    listed = [(e.id, p) for e in effects for p in e.parameters if include_fine or not p.secondary]
    given = values or {}
    return FreeParameters(tuple((e, free) for e, p in listed for free in p.free_entries(p.read(given.get(e, {})))))


def has_list(effect: Effect) -> bool:
    """Whether an effect states lists of numbers."""
    return any(isinstance(p, ListParameter) for p in effect.parameters)


def number_count(effect: Effect) -> float:
    """How many numbers an effect states; infinitely many with a list, which has any number of them."""
    return math.inf if has_list(effect) else len(free_parameters_of([effect]))


def identity_values(effect: Effect) -> dict[str, Any]:
    """The values at which an effect changes nothing."""
    return {p.name: p.identity for p in effect.parameters}


def _scale(parameter: Parameter) -> float:
    return parameter.prior**2 if parameter.even_symmetric else parameter.prior
