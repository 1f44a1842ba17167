"""An effect on one element of a bench, which its table states, in place of the twins of a first and second modulator.

    [effects.lut]
    element = "coarse"
    gamma = 1.2

Its id is then "lut@coarse". Its parameters are those of the effect on modulator 1, without the number.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

from holoview.light.model.effects.effect import HOOKS, DataProperties, Effect, Parameter, Values

if TYPE_CHECKING:
    from holoview.light.model.system import System

AT = "@"
"""Between the id of an effect and the name of its element."""


def split_id(name: str) -> tuple[str, str]:
    """The id of an effect, and the name of its element, "" without one."""
    plain, _, element = name.partition(AT)
    return plain, element


class OnElement(Effect):
    """An effect on one element.

    effect: that of modulator 1 or relay 1, or of both modulators. element: the element's name, of a short form its
    place.
    """

    def __init__(self, effect: Effect, element: str) -> None:
        self.effect, self.element = effect, element
        own = [p for p in effect.parameters if p.acts_on in ("", "modulator 1")]
        self._names = {_without_number(p): p.name for p in own}
        new = {old: name for name, old in self._names.items()}
        self.id = f"{effect.element_id or effect.id}{AT}{element}"  # type: ignore[misc]  # these are the instance's
        self.cause = _of_one(effect.cause, element)  # type: ignore[misc]
        self.parameters = tuple(  # type: ignore[misc]
            dataclasses.replace(
                p,
                name=name,
                doc=_of_one(p.doc, element),
                acts_on="",
                modifies=tuple(new[other] for other in p.modifies if other in new),
            )
            for name, p in zip(self._names, own, strict=True)
        )
        self.acts_on = (element,)  # type: ignore[misc]
        self.needs = dataclasses.replace(effect.needs, modulators=1, irises=())  # type: ignore[misc]
        for name in ("order", "varies_over_field", "start_kinds", "has_rival_parameters", "element_kinds"):
            setattr(self, name, getattr(effect, name))
        for hook in HOOKS:
            setattr(self, hook, partial(self._call, hook))

    @property
    def kinds_in_words(self) -> str:
        """The kinds of elements that it acts on."""
        return f"elements of kind {' or '.join(self.element_kinds)}"

    def overrides(self, hook: str) -> bool:
        """Whether the effect overrides a hook, or for `actual_system` what it does to an element."""
        if hook == "actual_element":
            return False
        return self.effect.overrides("actual_element" if hook == "actual_system" else hook)

    def _call(self, hook: str, *arguments: Any) -> Any:
        """A hook of the effect, told of modulator 1."""
        *others, v = arguments
        own = self._values(v)
        if hook == "actual_system":
            return self.effect.actual_element(others[0], self.element, own)
        told = [dataclasses.replace(x, number=0) if hasattr(x, "first_shown") else x for x in others]
        return getattr(self.effect, hook)(*told, own)

    def _values(self, v: Mapping[str, Any]) -> Values:
        return self.effect.parameter_values({old: v[name] for name, old in self._names.items() if name in v})

    def contradiction(self, v: Values) -> str:
        return self.effect.contradiction(self._values(v))

    def sample_phase(self, system: System, v: Values) -> float:
        return 0.0

    def cache_values(self, v: Values, laser: int) -> tuple[Any, ...]:
        return self.effect.cache_values(self._values(v), laser)

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """Those of each parameter's scan, and of the effect where they don't depend on the bench."""
        return self.effect.element_starts(self.parameters)

    def degeneracies(self, properties: DataProperties) -> tuple[str, ...]:
        return ()

    def format_finding(self, system: System, values: Mapping[str, Any]) -> str:
        v = self.parameter_values(values)
        if self.effect.element_finding:
            texts = {p.name: p.format(v[p.name]) for p in self.parameters}
            own = self.effect.finding_fields(system, self._values(v))
            fields = {name: _of_one(text, self.element) for name, text in own.items()}
            return self.effect.element_finding.format(**{**texts, **fields, "element": self.element})
        told = ", ".join(f"{p.name} {p.format(v[p.name])}" for p in self.parameters if not v.is_off(p.name))
        return f"{self.element}: {self.cause.rstrip('.')} ({told or 'by nothing'})."


def _without_number(p: Parameter) -> str:
    """The name of a parameter of modulator 1 without its number: "gamma1", "z4_1" and "level1_05" as "gamma", "z4" …"""
    if not p.acts_on:
        return p.name
    return p.name.removesuffix("_1") if p.name.endswith("_1") else re.sub(r"1(?=(_\d+)?$)", "", p.name, count=1)


def _of_one(text: str, element: str) -> str:
    """A sentence on modulator 1, relay 1 or the modulators as one on an element."""
    text = re.sub(r"(modulator|relay) 1\b", element, text)
    return text.replace("The modulators'", f"{element}'s").replace("the modulators'", f"{element}'s")
