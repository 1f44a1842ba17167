"""Effects of one's own are tried once before a search, which would take a hook that fails for a bench that can't be."""

from __future__ import annotations

from collections.abc import Iterable

import torch

from holoview.captures.dataset import Captures
from holoview.captures.predictor import Predictor
from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter
from holoview.util.errors import UserError

_REMEDY = "mend the file that defines it"
_PROBE_STEP = 0.5  # of the prior


def check_user_effects(captures: Captures, effects: Iterable[Effect]) -> None:
    """UserError, naming the effect, where its hooks fail on the first capture or its words can't be said."""
    predictor, system = Predictor(captures, cache_mb=1), captures.nominal_system()
    for one in effects:
        if one.needs.unmet_by(captures.data_properties()):
            continue
        _check_prediction(predictor, one, captures.shape)
        try:
            list(one.starting_points(system))
            one.format_finding(system, _displaced_values(one, _PROBE_STEP))
        except Exception as error:
            found = f"its starts or words failed: {type(error).__name__}: {error}"
            raise UserError(f"effects.{one.id}", found, remedy=_REMEDY) from error


def _check_prediction(predictor: Predictor, one: Effect, shape: tuple[int, int]) -> None:
    """Steps either way from the identity; one of them must leave a picture: the other may be a bench that can't be."""
    refused, tried = (
        [],
        [
            v
            for step in (_PROBE_STEP, -_PROBE_STEP)
            if not one.parameter_values(v := _displaced_values(one, step)).is_identity
        ],
    )
    for values in tried:
        try:
            signal = predictor([0], {one.id: values}).signal[0]
        except UserError as error:
            refused.append(error)
            continue
        if tuple(signal.shape) != shape:
            found = f"leaves a picture of {tuple(signal.shape)} pixels"
            raise UserError(f"effects.{one.id}", found, expected=f"{shape}", remedy=_REMEDY)
        if not bool(torch.isfinite(signal).all()):
            raise UserError(f"effects.{one.id}", "leaves a picture that isn't finite", remedy=_REMEDY)
    if refused and len(refused) == len(tried):
        raise refused[0]


def _displaced_values(one: Effect, step: float) -> dict[str, float]:
    return {p.name: _clamped(p, p.identity + step * p.prior) for p in one.parameters}


def _clamped(p: Parameter, value: float) -> float:
    return min(max(value, p.low), p.high)
