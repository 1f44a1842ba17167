"""Tries an effect on a tiny bench: whether its hooks are called, it vanishes at its identity, and derivatives exist.

`holoview effects check` prints these for the author of an effect, before any real bench is at stake.
"""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial, wraps
from typing import Any

import numpy as np
import torch

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, blank_captures
from holoview.light.model.bench_parts import Modulator, Relay
from holoview.light.model.effects.definition import mistakes_in_definition
from holoview.light.model.effects.effect import ELEMENT_HOOKS, MODULATOR_HOOKS, Effect, ListParameter, Parameter
from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.optics.torch_effects import TorchEffects, modulator_context
from holoview.util.errors import UserError

Values = Mapping[str, Any]

_FOCAL_LENGTH_M = 0.1
_TRIED = 0.5  # priors from the identity
_NEAR = 1e-6  # priors; a change that is smooth at the identity is then a millionth of that at one prior
_LEFT = 1e-2  # of the change at `_TRIED`, that may be left at `_NEAR`; a square root leaves 1.4e-3
_STEP = 1e-4  # priors, of central differences
_AGREEMENT = 1e-2  # of two central differences, of which one has twice the step
_SLOPE_STEP = 1e-5  # of the stroke; in double precision the error of a central difference is about 1e-9
_SLOPE_AGREEMENT = 1e-5
_EXAMPLES = 3  # starting points that are predicted


@dataclass(frozen=True)
class TrialResult:
    """What one check found. is_passed: None where it doesn't apply."""

    check: str
    is_passed: bool | None
    found: str


def trial_bench(*, is_fourier: bool = False) -> Captures:
    """Two captures at each of two wavelengths and two planes of a bench of 12 × 16 pixels, without pictures."""
    modulator, stops = Modulator(8e-6, (12, 16), 800e-9), Relay(iris_na=0.02)
    lasers: dict[str, Any] = {
        "wavelengths_m": np.array([460e-9, 620e-9]),
        "amplitudes": np.ones((1, 2)),
        "observer": "mono",
    }
    far = System(modulators=(modulator,), planes_m=np.array([3e-3]), **lasers)
    near = System(
        modulators=(modulator, modulator),
        gap_m=1e-3,
        planes_m=np.array([3e-3, 5e-3]),
        relay1=stops,
        relay2=stops,
        **lasers,
    )
    settings = AcquisitionSettings(
        2, focal_length_m=_FOCAL_LENGTH_M if is_fourier else None, planes_m=(0.0, 1e-3) if is_fourier else None
    )
    return blank_captures(far if is_fourier else near, settings, np.random.default_rng(1))


def try_effect(effect: Effect, where: str, ids: frozenset[str]) -> list[TrialResult]:
    """The checks of an effect, in order; those of the class alone where it has mistakes.

    where: its file. ids: of all known effects.
    """
    mistakes = [TrialResult("definition", False, str(error)) for error in mistakes_in_definition(effect, where, ids)]
    if mistakes:
        return mistakes
    facts = f"{', '.join(effect.hooks)} on {', '.join(effect.acts_on)}"
    return [TrialResult("definition", True, facts), *_Trial(effect).results()]


class _Trial:
    """An effect on its bench, with the calls of its hooks counted."""

    def __init__(self, effect: Effect) -> None:
        self._captures = trial_bench(is_fourier=not effect.needs.near_field)
        self._calls: Counter[str] = Counter()
        self._effect = _counting(effect, self._calls)
        self._predict = Predictor(self._captures, (self._effect,), double_precision=True, cache_mb=0)
        self._tried = {p.name: p.nudged(_TRIED) for p in effect.parameters}
        self._plain = np.zeros(0)

    def results(self) -> Iterator[TrialResult]:
        self._plain = self._pictures({})
        checks: tuple[tuple[str, Callable[[], tuple[bool | None, str]]], ...] = (
            ("hooks are called", self._hooks_are_called),
            ("identity changes no bit", self._identity),
            ("vanishes at its identity", self._vanishes),
            ("derivative by each parameter", self._derivatives),
            ("gradient by the patterns", self._gradient),
            ("finding and starting points", self._sentences),
        )
        for name, check in checks:
            try:
                yield TrialResult(name, *check())
            except UserError as error:
                yield TrialResult(name, False, str(error))
                return
            except Exception as error:  # of the user's own methods that aren't hooks
                yield TrialResult(name, False, f"{type(error).__name__}: {error}")

    def _hooks_are_called(self) -> tuple[bool | None, str]:
        changed = self._pictures(self._tried)
        silent = [hook for hook in self._effect.hooks if not (self._calls[hook] or hook in ELEMENT_HOOKS)]
        if silent:
            return False, f"never called: {', '.join(silent)}"
        if not np.isfinite(changed).all():
            return False, "a picture isn't finite"
        change = _size(changed - self._plain) / _size(self._plain)
        if change == 0:
            values = ", ".join(f"{k} {v}" for k, v in self._effect.parameter_values(self._tried).items())
            has_list = any(isinstance(p, ListParameter) for p in self._effect.parameters)  # of places that aren't here
            return None if has_list else False, f"the pictures don't change at {values}"
        counts = ", ".join(f"{hook} {self._calls[hook]} times" for hook in self._effect.hooks)
        return True, f"{counts}; half a prior of each parameter changes the pictures by {change:.2g} of their r.m.s."

    def _identity(self) -> tuple[bool, str]:
        self._calls.clear()
        off = self._pictures({p.name: p.identity for p in self._effect.parameters})
        is_same = np.array_equal(off, self._plain) and not self._calls
        return is_same, "all pictures equal those without it" if is_same else "pictures differ with it at its identity"

    def _vanishes(self) -> tuple[bool | None, str]:
        smooth = [p for p in self._effect.parameters if not (p.non_smooth or isinstance(p, ListParameter))]
        if not smooth:
            return None, "no parameter in which it is smooth"
        whole = _size(self._pictures({p.name: p.nudged(_TRIED) for p in smooth}) - self._plain)
        if whole == 0:
            return None, "its lists alone change the pictures"
        near = _size(self._pictures({p.name: p.nudged(_NEAR) for p in smooth}) - self._plain)
        words = f"{near / whole:.2g} of the change is left at a millionth of a prior"
        return near <= _LEFT * whole, words if near <= _LEFT * whole else f"{words}: a jump; is `identity` right?"

    def _derivatives(self) -> tuple[bool | None, str]:
        found, is_passed = [], True
        for p in self._effect.parameters:
            if isinstance(p, ListParameter) or p.non_smooth or p.passes_edges:
                continue
            once, twice = (self._slope(p, step * p.prior) for step in (_STEP, 2 * _STEP))
            size, off = _size(once), _size(once - twice)
            is_smooth = bool(np.isfinite(size)) and off <= _AGREEMENT * size
            is_passed &= is_smooth
            per_prior = size * p.prior / _size(self._plain)
            found.append(f"{p.name} {per_prior:.2g} of the pictures in a prior" + ("" if is_smooth else ", not smooth"))
        return (is_passed, "; ".join(found)) if found else (None, "no parameter that a fit varies smoothly")

    def _slope(self, p: Parameter, step: float) -> np.ndarray[Any, Any]:
        """Central difference of all pictures, at half a prior from the identity."""
        middle = min(max(self._tried[p.name], p.low + step), p.high - step)
        low, high = (self._pictures({**self._tried, p.name: middle + sign * step}) for sign in (-1, 1))
        return np.asarray((high - low) / (2 * step))

    def _gradient(self) -> tuple[bool | None, str]:
        """The gradient that an optimiser uses, beside a central difference along a random direction."""
        if not any(hook in MODULATOR_HOOKS for hook in self._effect.hooks):
            return None, "it doesn't act on modulators"
        plan = make_plan(self._captures.nominal_system())
        active, worst = TorchEffects({self._effect.id: self._tried}, (self._effect,)), 0.0
        for number in range(len(plan.system.modulators)):
            context, draw = modulator_context(plan, number, 0, 0), np.random.default_rng(number)
            share, before, direction = (torch.from_numpy(draw.uniform(0.1, 0.9, context.shape)) for _ in range(3))
            light = partial(_weighted_light, active, context, before)
            free = share.clone().requires_grad_()
            with torch.enable_grad():
                value = light(free)
            if not value.requires_grad:
                return False, f"the light of modulator {number + 1} doesn't depend on its pattern by torch"
            (slope,) = torch.autograd.grad(value, free)
            along, step = float((slope * direction).sum()), _SLOPE_STEP * direction
            expected = float(light(share + step) - light(share - step)) / (2 * _SLOPE_STEP)
            scale = float(slope.norm() * direction.norm()) + abs(expected)
            worst = max(worst, abs(along - expected) / scale if scale else 0.0)
        return worst <= _SLOPE_AGREEMENT, f"differs by {worst:.1g} from a central difference"

    def _sentences(self) -> tuple[bool, str]:
        system, effect = self._captures.nominal_system(), self._effect
        starts = list(effect.starting_points(system))
        for values in starts:
            for p in effect.parameters:
                if p.name in values and not isinstance(p, ListParameter) and not p.low <= values[p.name] <= p.high:
                    return False, f"the starting point {p.name} = {values[p.name]:g} is out of range"
        for values in starts[:: max(len(starts) // _EXAMPLES, 1)]:
            self._pictures(values)
        sentence = effect.format_finding(system, self._tried)
        return "{" not in sentence, f'{len(starts)} starting points; "{sentence}"'

    def _pictures(self, values: Values) -> np.ndarray[Any, Any]:
        """Expected counts (capture, y, x) at unit gain, beyond the nominal black level."""
        prediction = self._predict(range(len(self._captures)), {self._effect.id: values} if values else {})
        without_lasers = prediction.counts_without_lasers(self._captures.camera.black_level)
        return np.asarray(prediction.signal.numpy() + without_lasers)


def _weighted_light(
    active: TorchEffects, context: ModulatorContext, before: torch.Tensor, share: torch.Tensor
) -> torch.Tensor:
    """A number that depends on all the light behind a modulator."""
    light = active.modulator_transmission(share, context, torch.complex128, before=before, first=before)
    weights = torch.linspace(-1, 1, light.numel(), dtype=torch.float64).reshape(light.shape)
    return (light.real * weights + light.imag * weights.flip(0)).sum()


def _counting(effect: Effect, calls: Counter[str]) -> Effect:
    """A copy of an effect whose hooks count their calls."""
    counted = copy.copy(effect)
    for hook in effect.hooks:
        setattr(counted, hook, _counted(getattr(effect, hook), hook, calls))
    return counted


def _counted(method: Callable[..., Any], hook: str, calls: Counter[str]) -> Callable[..., Any]:
    @wraps(method)
    def call(*arguments: Any) -> Any:
        calls[hook] += 1
        return method(*arguments)

    return call


def _size(values: np.ndarray[Any, Any]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
