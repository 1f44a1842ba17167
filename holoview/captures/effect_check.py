"""Checks effects before a search: known ones, and users' own, which are run once.

A search treats a parameter value at which a hook raises UserError as an impossible bench and goes on, so a mistake in
an effect's file would stay unnoticed. Here it is reported.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import torch

from holoview.captures.dataset import Captures
from holoview.captures.predictor import Predictor
from holoview.model.effects.active_effects import unmet_by_bench
from holoview.model.effects.effect import Effect
from holoview.model.effects.effect_table import EffectTable
from holoview.model.effects.registry import get_effect
from holoview.util.errors import UserError

_REMEDY = "mend the file that defines it"
_PROBE_STEP = 0.5  # of the prior of each parameter


def check_known_effects(captures: Captures, known: Mapping[str, Mapping[str, Any]]) -> None:
    """Raises UserError for known effects {id: {parameter: value}} that the bench can't have, or values out of range."""
    EffectTable().parse(known, "effects")
    for name in known:
        if missing := unmet_by_bench(get_effect(name), captures.data_properties()):
            raise UserError(f"effects.{name}", missing, expected="known effects of the bench that took these captures")


def check_user_effects(captures: Captures, effects: Iterable[Effect]) -> None:
    """Raises UserError that names the effect whose hooks fail on the first capture, or whose finding can't be written.

    Effects that need other data than these captures are skipped.
    """
    predictor, system = Predictor(captures, cache_mb=1), captures.nominal_system()
    for effect in effects:
        if effect.needs.unmet_by(captures.data_properties()):
            continue
        _check_prediction(predictor, effect, captures.shape)
        try:
            list(effect.starting_points(system))
            effect.format_finding(system, _probe_values(effect, _PROBE_STEP))
        except Exception as error:
            found = f"its starting points or finding failed: {type(error).__name__}: {error}"
            raise UserError(f"effects.{effect.id}", found, remedy=_REMEDY) from error


def _check_prediction(predictor: Predictor, effect: Effect, shape: tuple[int, int]) -> None:
    """Predicts the first capture with all parameters raised, and with all lowered.

    UserError if an image has the wrong shape or isn't finite, or if both predictions fail: one may, where it
    describes an impossible bench.
    """
    probes = [_probe_values(effect, step) for step in (_PROBE_STEP, -_PROBE_STEP)]
    probes = [values for values in probes if not effect.parameter_values(values).is_identity]
    errors = []
    for values in probes:
        try:
            signal = predictor([0], {effect.id: values}).signal[0]
        except UserError as error:
            errors.append(error)
            continue
        if tuple(signal.shape) != shape:
            found = f"leaves a picture of {tuple(signal.shape)} pixels"
            raise UserError(f"effects.{effect.id}", found, expected=f"{shape}", remedy=_REMEDY)
        if not bool(torch.isfinite(signal).all()):
            raise UserError(f"effects.{effect.id}", "leaves a picture that isn't finite", remedy=_REMEDY)
    if errors and len(errors) == len(probes):
        raise errors[0]


def _probe_values(effect: Effect, step: float) -> dict[str, float]:
    """Every parameter at its identity plus `step` priors, within its bounds."""
    return {p.name: p.nudged(step) for p in effect.parameters}
