"""All effects by id, of `holoview.light.effects` and of users' files, and the field of a System with the active ones.

`ActiveEffects` applies the effects of a table to a System, to laser powers and to exposures; nothing here needs torch.
"""

from __future__ import annotations

import copy
import dataclasses
import inspect
import os
import pkgutil
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from holoview.light.model.effects.definition import check_definition
from holoview.light.model.effects.effect import (
    CAMERA_HOOKS,
    MODULATOR_HOOKS,
    DataProperties,
    Effect,
    ExposureSample,
    Needs,
    Parameter,
    Values,
)
from holoview.light.model.effects.on_element import AT, OnElement, split_id
from holoview.util.errors import UserError
from holoview.util.packages import run_python_file
from holoview.util.tables import check_keys, read_table

if TYPE_CHECKING:
    from holoview.light.model.system import System


_LIBRARY = "holoview.light.effects"
_OF_FILES = "holoview.holograms.fields.source_field"  # its effect reads holograms' files, of which light knows nothing
_REMEDY = "switch it off, or describe what it acts on"
_USER_MODULES = "holoview_user_effects"
_user_effects: dict[str, Effect] = {}


def listed_effects() -> Mapping[str, Effect]:
    """The effects that are offered as causes and in the viewer, by id, sorted, with the effects of users' files.

    Those that act on an element alone are among `element_effects`.
    """
    return MappingProxyType({name: e for name, e in _all_effects().items() if e.listed and e.acts_on})


def element_effects() -> Mapping[str, Effect]:
    """The effects that may act on an element that is stated, by the id that they have there, sorted."""
    last_first = reversed(list(_all_effects().items()))  # so that of twins the first stays
    found = {effect.element_id or name: effect for name, effect in last_first if effect.element_kinds}
    return MappingProxyType(dict(sorted(found.items())))


def get_effect(name: str) -> Effect:
    """The effect of an id, listed or not; "ID@ELEMENT" is one on an element (`OnElement`).

    Raises UserError, which suggests similar ids, when there is none, and for an element that it doesn't act on.
    """
    plain, element = split_id(name)
    effect = effect_or_twin(plain)
    if not element:
        if plain == effect.element_id:
            raise UserError(f"effects.{plain}", "no element", expected='the element that it acts on, element = "…"')
        return effect
    if not effect.element_kinds:
        acts_on = effect.instead or f"no element: it acts on the {' and '.join(effect.acts_on)}"
        raise UserError(f"effects.{plain}.element", f'"{element}"', expected=acts_on)
    return _on_element(effect, element)


def effects_of(bench: DataProperties) -> list[Effect]:
    """The effects that are offered as causes on a bench: of a chain those that act on it as a whole, and on elements.

    Those that do another effect's work there are left out.
    """
    if not bench.elements:
        return list(listed_effects().values())
    whole = [effect for effect in listed_effects().values() if not effect.element_kinds]
    return [
        *(effect for effect in whole if effect.on_chain or set(effect.acts_on) <= {"source", "camera"}),
        *(
            _on_element(effect, name)
            for effect in element_effects().values()
            for name, kind in bench.elements
            if kind in effect.element_kinds
        ),
    ]


def effects_for(system: System) -> list[Effect]:
    """The effects that a bench is offered as switches: as `effects_of`, and those on elements that it has besides.

    >>> import holoview as hv
    >>> [effect.id for effect in effects_for(hv.load("high-contrast")) if effect.acts_on == ("coarse",)][:2]
    ['amplitude_gamma@coarse', 'leakage@coarse']
    """
    offered = effects_of(bench_properties(system))
    known = {effect.id for effect in offered}
    return [*offered, *(get_effect(name) for name in system.effect_values if AT in name and name not in known)]


def effect_or_twin(name: str) -> Effect:
    """The effect of an id, or of the id that several have where they act on an element: the first of these.

    Raises UserError as `get_effect` does.
    """
    known = _by_name(tuple(_user_effects.values()))
    check_keys([name], known, "effects.", noun="effect")
    return known[name]


@lru_cache(maxsize=512)
def _on_element(effect: Effect, element: str) -> OnElement:
    return OnElement(effect, element)


def load_user_effects(path: str | os.PathLike[str]) -> list[Effect]:
    """Runs a Python file and registers the effects that it defines. All code in the file is run.

    Raises UserError for a file that is missing or fails, defines no effect, or one with a mistake in its class
    (`definition`), or uses an id that an effect of the library or of another file has.
    """
    effects, module = read_user_effects(path)
    for effect in effects:
        check_definition(effect, str(path), ids_beside(effects))
    _user_effects.update({effect.id: effect for effect in effects})
    sys.modules[module.__name__] = module
    return effects


def read_user_effects(path: str | os.PathLike[str]) -> tuple[list[Effect], ModuleType]:
    """Runs a Python file and returns its effects, which aren't registered or checked yet, with its module."""
    file, expected = Path(path), "a Python file that defines an Effect"
    name = f"{_USER_MODULES}.{file.stem}"
    module, effects = run_python_file(file, name, lambda module: (module, list(_effects_of(module))), expected=expected)
    classes = [member for member in vars(module).values() if _is_effect_of(member, module)]
    for own in classes:
        if not hasattr(own, "id") and not any(other is not own and issubclass(other, own) for other in classes):
            raise UserError(f"{file}: {own.__name__}", "has no `id`", expected="every field that Effect lists")
    if not effects:
        raise UserError(
            str(file), "defines no effect", expected="a class that derives from holoview.light.effects.Effect"
        )
    for number, effect in enumerate(effects):
        if effect.id in _library() or effect.id in [other.id for other in effects[:number]]:
            raise UserError(str(file), f'the id "{effect.id}" is in use', expected="an id of its own")
    for other in _user_effects.values():
        theirs = Path(inspect.getfile(type(other)))
        if theirs.resolve() == file.resolve() or not theirs.exists():  # read again, or moved
            continue
        if other.id in [effect.id for effect in effects]:
            raise UserError(str(file), f'the id "{other.id}" is in use by {theirs}', expected="an id of its own")
        if type(other).__module__ == name:
            raise UserError(str(file), f"{theirs} has the same name", expected="files of effects with different names")
    return effects, module


def ids_beside(effects: Iterable[Effect]) -> frozenset[str]:
    """The ids of all known effects, and of these."""
    return frozenset((*_all_effects(), *(effect.id for effect in effects)))


@contextmanager
def without_user_effects() -> Iterator[None]:
    """Context manager without users' effects at first; afterwards the former ones are registered again."""
    before = dict(_user_effects)
    _user_effects.clear()
    try:
        yield
    finally:
        _user_effects.clear()
        _user_effects.update(before)


def is_user_effect(effect: Effect) -> bool:
    """Whether an effect comes from a user's file."""
    own = effect.effect if isinstance(effect, OnElement) else effect
    return type(own).__module__.startswith(_USER_MODULES)


def _all_effects() -> Mapping[str, Effect]:
    return _sorted(tuple(_user_effects.values()))


@lru_cache(maxsize=1)
def _sorted(users: tuple[Effect, ...]) -> Mapping[str, Effect]:
    """The effects of the library and of users by their ids, sorted."""
    return MappingProxyType(dict(sorted({**_library(), **{effect.id: effect for effect in users}}.items())))


@lru_cache(maxsize=1)
def _by_name(users: tuple[Effect, ...]) -> Mapping[str, Effect]:
    """The same, and the first of those that have one id where they act on an element, by that id."""
    known = _sorted(users)
    twins = {effect.element_id: effect for effect in reversed(list(known.values())) if effect.element_id}
    return MappingProxyType({**known, **twins})


@cache
def _library() -> Mapping[str, Effect]:
    """The effects of `holoview.light.effects`; its subpackages hold what effects use."""
    files = [info for info in pkgutil.iter_modules(import_module(_LIBRARY).__path__) if not info.ispkg]
    modules = [import_module(name) for name in (*(f"{_LIBRARY}.{info.name}" for info in files), _OF_FILES)]
    return {effect.id: effect for module in modules for effect in _effects_of(module)}


def _effects_of(module: ModuleType) -> Iterator[Effect]:
    """The effects that a module defines; base classes have no id."""
    for _, member in inspect.getmembers(module, lambda member: _is_effect_of(member, module)):
        if hasattr(member, "id"):
            yield member()


def _is_effect_of(member: Any, module: ModuleType) -> bool:
    return inspect.isclass(member) and issubclass(member, Effect) and member.__module__ == module.__name__


# --- the table of active effects --------------------------------------------------------------------------------------


EffectPairs = tuple[tuple[str, tuple[tuple[str, Any], ...]], ...]


@dataclass(frozen=True)
class EffectTable:
    """Field type of active effects: a table {id: {parameter: value}}.

    Its value is hashable: sorted pairs (id, ((parameter, SI value), …)).
    """

    def parse(self, value: Any, where: str) -> EffectPairs:
        table = dict(value) if isinstance(value, tuple) else value
        if not isinstance(table, Mapping):
            raise UserError(where, f"{value!r}", expected='tables such as [effects.gap] gap_error = "0.1 mm"')
        found: dict[str, tuple[tuple[str, Any], ...]] = {}
        for name, given in table.items():
            for own in given if isinstance(given, list) else [given]:
                key, values = _of_element(name, own, f"{where}.{name}")
                if key in found:
                    raise UserError(f"{where}.{name}", f"twice for {split_id(key)[1]}", expected="each element once")
                found[key] = self._parse_values(key, values, f"{where}.{name}")
        return tuple(sorted(found.items()))

    def to_toml(self, value: EffectPairs) -> dict[str, Any]:
        tables = {name: {key: self._parameters(name)[key].to_toml(x) for key, x in pairs} for name, pairs in value}
        ids = [split_id(name)[0] for name in tables]
        alone = {name: split_id(name) for name in tables if AT in name and ids.count(split_id(name)[0]) == 1}
        return {
            (alone[name][0] if name in alone else name): {"element": alone[name][1], **own} if name in alone else own
            for name, own in tables.items()
        }

    def with_changes(self, value: EffectPairs, changes: Mapping[str, Any], where: str) -> EffectPairs:
        """With some values changed: {"gap.gap_error": "0.1 mm"} or {"gap": {…}}.

        A parameter of an effect that acts on one element alone needs no element beside it.
        """
        table: dict[str, Any] = {name: dict(pairs) for name, pairs in value}
        for key, change in changes.items():
            name, _, parameter = key.partition(".")
            if not parameter:
                name, change = _of_element(name, change, f"{where}.{name}")
            elif name not in table and parameter != "element":
                on_elements = [other for other in table if split_id(other)[0] == name]
                name = on_elements[0] if len(on_elements) == 1 else name
            table[name] = {**table.get(name, {}), parameter: change} if parameter else change
        return self.parse(table, where)

    def _parse_values(self, name: str, given: Any, where: str) -> tuple[tuple[str, Any], ...]:
        """The values of one effect's parameters."""
        values = dict(given) if isinstance(given, tuple) else given
        if not isinstance(values, Mapping):
            raise UserError(where, f"{given!r}", expected="a table of its parameters")
        read = read_table(values, self._parameters(name), f"{where}.", noun="parameter")
        return tuple(sorted(read.items()))

    @staticmethod
    def _parameters(name: str) -> dict[str, Parameter]:
        return {parameter.name: parameter for parameter in get_effect(name).parameters}


# --- the active effects of a table ------------------------------------------------------------------------------------


def _of_element(name: str, given: Any, where: str) -> tuple[str, Any]:
    """The id of an effect and its values, of a table that may state its `element`."""
    if AT in name or not isinstance(given, Mapping) or "element" not in given:
        return name, given
    element, effect = given["element"], effect_or_twin(name)
    if not isinstance(element, str) or not element or AT in element:
        raise UserError(f"{where}.element", f"{element!r}"[:60], expected="the name of an element")
    values = {key: value for key, value in given.items() if key != "element"}
    return f"{effect.element_id or name}{AT}{element}", values


EffectValues = Mapping[str, Mapping[str, Any]]
"""{effect id: {parameter: SI value}}."""
NO_EFFECTS: EffectValues = MappingProxyType({})

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

    pairs: (effect, its parameter values), sorted by `Effect.order` and id. Raises UserError for values of an effect
    that contradict each other.
    """

    def __init__(self, table: EffectValues, extra: Iterable[Effect] = ()) -> None:
        extra_by_id = {effect.id: effect for effect in extra}
        pairs = [(extra_by_id.get(name) or get_effect(name), given) for name, given in table.items()]
        active = [(effect, v) for effect, given in pairs if not (v := effect.parameter_values(given)).is_identity]
        self.pairs: tuple[ActivePair, ...] = tuple(sorted(active, key=lambda pair: (pair[0].order, pair[0].id)))
        self._pairs_with: dict[tuple[str, ...], tuple[ActivePair, ...]] = {}
        for effect, v in self.pairs:
            if contradiction := effect.contradiction(v):
                raise UserError(f"effects.{effect.id}", contradiction)

    def with_hooks(self, *hooks: str) -> tuple[ActivePair, ...]:
        """The pairs whose effect overrides one of the hooks."""
        if hooks not in self._pairs_with:
            pairs = [pair for pair in self.pairs if any(pair[0].overrides(hook) for hook in hooks)]
            self._pairs_with[hooks] = tuple(pairs)
        return self._pairs_with[hooks]

    def on_modulator(self, number: int, *hooks: str) -> list[ActivePair]:
        """The pairs with one of the hooks that act on modulator 0 or 1; the source acts on modulator 0."""
        return self.on_parts({f"modulator {number + 1}", "source" if number == 0 else ""}, *hooks)

    def on_parts(self, parts: Iterable[str], *hooks: str) -> list[ActivePair]:
        """The pairs with one of the hooks that act on one of some parts: places, or elements of a chain."""
        wanted = set(parts)
        return [(e, v) for e, v in self.with_hooks(*hooks) if e.on_all_elements or wanted & set(e.acts_on)]

    def cache_key(self, *hooks: str, acts_on: str = "", laser: int | None = None) -> tuple[Any, ...]:
        """A hashable key of all that the hooks' results depend on: equal for equal effects and values.

        acts_on: restricts it to effects of one part, such as "modulator 1". laser: restricts it to what matters while
        this laser is on, 0 for the shortest wavelength.
        """
        pairs = self.on_parts((acts_on,), *hooks) if acts_on else self.with_hooks(*hooks)
        keys = [
            (effect.id, v.cache_key if laser is None else call_hook(effect, "cache_values", v, laser))
            for effect, v in pairs
        ]
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
        self.require_possible(bench_properties(system))
        system = self.actual_system(system.edit({"amplitudes": self.laser_power(system.amplitudes)}))
        amplitudes = system.amplitudes
        weights = np.array([weight for weight, _ in self.exposure_samples()])
        rows = (amplitudes[:, None, :] * (weights * len(weights))[None, :, None]).reshape(-1, amplitudes.shape[1])
        return system.edit({"amplitudes": rows, "effects": {}})

    def require_possible(self, bench: DataProperties) -> None:
        """Raises UserError, with an effect's id, unless a bench can have all these effects.

        bench: `bench_properties` of a system, or the properties of captures that were taken there.
        """
        _require_possible(self.pairs, bench)


def require_possible_effects(system: System) -> None:
    """Raises UserError, with an effect's id, unless a system can have all of its own effects that are on."""
    pairs = [(get_effect(name), own) for name, own in system.effect_values.items()]
    active = [(effect, v) for effect, own in pairs if not (v := effect.parameter_values(own)).is_identity]
    if active:
        _require_possible(active, bench_properties(system))


def _require_possible(pairs: Iterable[ActivePair], bench: DataProperties) -> None:
    for effect, v in pairs:
        if missing := unmet_by_bench(effect, bench):
            raise UserError(f"effects.{effect.id}", missing, remedy=_REMEDY)
        for p in effect.parameters:
            if not v.is_off(p.name) and (missing := parameter_unmet_by_bench(p, bench)):
                raise UserError(f"effects.{effect.id}.{p.name}", missing, remedy=_REMEDY)


def bench_properties(system: System) -> DataProperties:
    """The properties of a system on which it depends whether it can have an effect; one power stands for any."""
    return DataProperties(
        wavelengths=len(system.wavelengths_m),
        planes=len(system.planes_m),
        powers=1,
        modulators=len(system.drive_shapes) if system.is_chain else len(system.modulators),
        irises=(system.relay1.has_aperture, system.relay2.has_aperture),
        is_fourier=False,
        is_field=system.is_field,
        lasers=len(system.wavelengths_m),
        elements=chain_parts(system),
    )


def chain_parts(system: System) -> tuple[tuple[str, str], ...]:
    """The name and kind of each element of a chain; nothing of a short form."""
    if not system.is_chain:
        return ()
    return tuple((name, e.kind) for name, e in zip(system.element_names, system.elements, strict=True))


def unmet_requirement(effect: Effect, system: System) -> str:
    """Why an effect can't be active in a system, in words; empty when it can."""
    return unmet_by_bench(effect, bench_properties(system))


def unmet_by_bench(effect: Effect, bench: DataProperties) -> str:
    """Why an effect can't be active on a bench, in words; how many captures of what were taken there doesn't matter."""
    if bench.elements:
        return _unmet_by_chain(effect, bench)
    parts = bench.parts
    if not effect.acts_on and effect.element_kinds:
        return "acts on one element, and none is stated"
    if isinstance(effect, OnElement) and parts & set(effect.acts_on):
        kind = "space" if effect.element.startswith("relay") else "phase"
        if kind not in effect.element_kinds:
            return f"acts on {effect.kinds_in_words}, and the {effect.element} is none"
    acts_on_modulator = any(effect.overrides(hook) for hook in (*MODULATOR_HOOKS, "exposure_samples"))
    if bench.is_field and (acts_on_modulator or any(part.startswith("modulator") for part in effect.acts_on)):
        return "acts on a modulator, and a field has none"
    if unmet := _unmet_by_content(effect.needs, bench):
        return unmet
    if effect.acts_on and not parts & set(effect.acts_on):
        return f"acts on {' and '.join(effect.acts_on)}, and this bench has {', '.join(sorted(parts))} only"
    if bench.is_fourier and effect.hooks == ("pupil",):
        return "acts on the pupil of a relay, and a Fourier bench has none"
    return ""


@lru_cache(maxsize=1024)
def _unmet_by_content(needs: Needs, bench: DataProperties) -> str:
    """What an effect needs beside several lasers, planes and powers, and of a chain several modulators and irises."""
    needs = dataclasses.replace(needs, wavelengths=1, planes=1)
    if bench.elements:
        needs = dataclasses.replace(needs, modulators=1, irises=())
    return needs.unmet_by(dataclasses.replace(bench, powers=2))


def _unmet_by_chain(effect: Effect, bench: DataProperties) -> str:
    """`unmet_by_bench` of a chain."""
    kinds = dict(bench.elements)
    if unmet := _unmet_by_content(effect.needs, bench):
        return unmet
    if isinstance(effect, OnElement):
        if effect.element not in kinds:
            return f'acts on "{effect.element}", and this chain has {", ".join(kinds)}'
        if kinds[effect.element] not in effect.element_kinds:
            return f'acts on {effect.kinds_in_words}, and "{effect.element}" is one of kind {kinds[effect.element]}'
        return ""
    if effect.on_all_elements:
        return ""
    if effect.element_kinds:
        fitting = [name for name, kind in kinds.items() if kind in effect.element_kinds]
        if not fitting:
            return f"acts on {' or '.join(effect.element_kinds)} elements, and this chain has none"
        return f'acts on one element of a chain, which it has to state, e.g. element = "{fitting[0]}"'
    if effect.on_chain:
        found = set(effect.on_chain) & set(kinds.values())
        return "" if found else f"acts on {' or '.join(effect.on_chain)} elements, and this chain has none"
    if not set(effect.acts_on) <= {"source", "camera"}:
        return f"isn't known of chains of elements{f': there is {effect.instead}' if effect.instead else ''}"
    return ""


def parameter_unmet_by_bench(parameter: Parameter, bench: DataProperties) -> str:
    """Why a parameter would change nothing on a bench that can have its effect, in words; empty when it can."""
    if parameter.acts_on and not bench.elements and parameter.acts_on not in bench.parts:
        return f"acts on {parameter.acts_on}, which this bench doesn't have"
    return ""


def idle_parameters(effect: Effect, v: Values, bench: DataProperties) -> list[str]:
    """What parameters of an effect aren't at their identity and yet change nothing on a bench, in words.

    They are not refused: some lasers of a bench may be left out, and what another parameter scales may be set first.
    """
    found = []
    for p in effect.parameters:
        if v.is_off(p.name):
            continue
        if lacks_laser(p, bench):
            found.append(f"effects.{effect.id}.{p.name} acts on laser {p.laser}, and there are {bench.lasers}")
        elif p.modifies and all(v.is_off(name) for name in p.modifies):
            found.append(f"effects.{effect.id}.{p.name} changes nothing without {' or '.join(p.modifies)}")
    return found


def lacks_laser(parameter: Parameter, bench: DataProperties) -> bool:
    """Whether a parameter is that of a laser which a bench doesn't have."""
    return bench.lasers is not None and parameter.laser > bench.lasers


def effect_on_bench(effect: Effect, bench: DataProperties) -> Effect:
    """The effect as a search varies it on a bench: parameters that would change nothing keep their identity."""
    held = [p for p in effect.parameters if parameter_unmet_by_bench(p, bench) or lacks_laser(p, bench)]
    if not held:
        return effect
    own = copy.copy(effect)
    own.parameters = tuple(  # type: ignore[misc]  # of this instance
        dataclasses.replace(p, low=p.identity, high=p.identity, scan=None) if p in held else p
        for p in effect.parameters
    )
    return own


def unmet_by_data(effect: Effect, properties: DataProperties) -> str:
    """Why an effect can't be seen in captures, in words, or can't be on their bench; empty when it can."""
    return effect.needs.unmet_by(properties) or unmet_by_bench(effect, properties)
