"""A preset as the nominal bench of captures, and a bench with the causes that were found switched on."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from holoview.bench.captures.dataset import Captures, SlmSpec
from holoview.bench.captures.predictor import Prediction, Predictor
from holoview.bench.diagnose.fit import FittedValues
from holoview.bench.diagnose.likelihood import Values
from holoview.light.model.effects.registry import get_effect
from holoview.light.model.system import System
from holoview.util.errors import UserError

_PITCH_TOLERANCE = 1e-6  # relative; the rounding of a value written to a file


def with_preset_geometry(captures: Captures, system: System, name: str) -> tuple[Captures, FittedValues, System]:
    """The captures with the geometry of a preset, the effects that it has on, and the preset itself.

    Raises UserError when the preset's modulators aren't those of the captures.
    """
    if captures.chain is not None:
        if system.drive_shapes != captures.chain.drive_shapes:
            found = ", ".join(f"{own} {shape[1:]}" for own, shape in system.drive_shapes.items())
            known = ", ".join(f"{own} {shape[1:]}" for own, shape in captures.chain.drive_shapes.items())
            raise UserError(f"--preset {name}", found, expected=f"{known}, as in the captures")
        return dataclasses.replace(captures, chain=system.edit({"effects": {}})), system.effect_values, system
    system.require_short_form(f"--preset {name}")
    if len(system.modulators) != len(captures.slms):
        raise UserError(
            f"--preset {name}",
            f"{len(system.modulators)} modulators",
            expected=f"{len(captures.slms)} as in the captures",
        )
    shape = captures.levels.shape[2:]
    if system.modulators[0].shape != shape:
        found = "{} x {} pixels".format(*system.modulators[0].shape)
        raise UserError(f"--preset {name}", found, expected="{} x {} as in the captures".format(*shape))
    for slm, modulator in zip(captures.slms, system.modulators, strict=True):
        if abs(slm.pitch_m / modulator.pitch_m - 1) > _PITCH_TOLERANCE:
            raise UserError(
                f"--preset {name}",
                f"a pitch of {modulator.pitch_m:.4g} m",
                expected=f"{slm.pitch_m:.4g} m as in the captures",
            )
    changed = dataclasses.replace(
        captures,
        slms=tuple(
            SlmSpec(p.pitch_m, p.num_levels, m.stroke_m) for p, m in zip(captures.slms, system.modulators, strict=True)
        ),
        gap_m=system.gap_m,
        relay1=system.relay1,
        relay2=captures.relay2 if captures.is_fourier else system.relay2,
    )
    return changed, system.effect_values, system


def add_effect_values(known: Values, found: Values) -> dict[str, dict[str, Any]]:
    """The sum of known and found values, each counted from its identity (known + found − identity), within bounds."""
    result: dict[str, dict[str, Any]] = {name: dict(values) for name, values in known.items()}
    for name, values in found.items():
        own = result.setdefault(name, {})
        for p in get_effect(name).parameters:
            if p.name not in values:
                continue
            if p.name in own:
                own[p.name] = p.added(own[p.name], values[p.name])
            else:
                own[p.name] = values[p.name]
    return result


class PredictorWithKnownEffects:
    """A predictor with known effects always on. options: keywords of `Predictor`."""

    def __init__(self, captures: Captures, known_values: Values, **options: Any) -> None:
        self._predict, self._known = Predictor(captures, **options), known_values
        self._extra = {effect.id for effect in options.get("extra_effects", ())}  # never among the known effects

    @property
    def fields_requested(self) -> int:
        """How many fields calls have asked for."""
        return self._predict.fields_requested

    def __call__(self, indices: Any, values: Values, *, grad: bool = False) -> Prediction:
        """As `Predictor`; `values` add to what is known."""
        if self._known:
            extra = {name: own for name, own in values.items() if name in self._extra}
            listed = {name: own for name, own in values.items() if name not in extra}
            values = {**add_effect_values(self._known, listed), **extra}
        return self._predict(indices, values, grad=grad)


def extended_system(system: System, found: Mapping[str, Mapping[str, float]]) -> System:
    """A bench with the effects that were found switched on, beside those that it has."""
    values = add_effect_values(system.effect_values, found)
    changes = {f"effects.{name}.{key}": value for name, own in values.items() for key, value in own.items()}
    return system.edit(changes) if changes else system
