"""The starting values that captures suggest on top of a base, by the kinds that effects declare."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from functools import cached_property, partial

from holoview.diagnose.fit import FittedValues
from holoview.diagnose.likelihood import Comparison, GainFit
from holoview.diagnose.search_context import SearchContext
from holoview.diagnose.starts.fringes import FringeStarts, ModulatorFringeStarts
from holoview.diagnose.starts.picture import (
    DisplacementStarts,
    GhostStarts,
    PlaneStarts,
    SmearStarts,
    StartingValues,
    StartProvider,
)
from holoview.diagnose.starts.stuck import StuckStarts
from holoview.model.effects.effect import Effect, StartKind

ALL_KINDS = frozenset(StartKind)
LIST_KINDS = frozenset({StartKind.PLANES, StartKind.STUCK_PIXELS})
"""Those of effects with lists. Where there are any, much less error is left."""


class SuggestedStarts:
    """The starting values of all kinds; each kind is looked for once, and only where an effect declares it."""

    def __init__(self, context: SearchContext, base: FittedValues, comparison: Comparison) -> None:
        self._context, self._base, self._comparison = context, base, comparison
        self._found: dict[StartKind, StartProvider] = {}

    def of(self, effects: Iterable[Effect], kinds: Collection[StartKind] = ALL_KINDS) -> StartProvider:
        """Those of some kinds for some effects; what they need in common is computed here, not in each job."""
        for kind in {kind for effect in effects for kind in effect.start_kinds if kind in kinds} - self._found.keys():
            self._found[kind] = self._makers[kind]()
        return partial(_starts_of, {kind: found for kind, found in self._found.items() if kind in kinds})

    @cached_property
    def _fitted(self) -> GainFit:
        return self._comparison.fit_gains(self._base)

    @property
    def _makers(self) -> dict[StartKind, Callable[[], StartProvider]]:
        context, base, comparison = self._context, self._base, self._comparison
        return {
            StartKind.DISPLACEMENT: lambda: DisplacementStarts(base, comparison),
            StartKind.GHOST: lambda: GhostStarts(self._fitted, comparison),
            StartKind.SMEAR: lambda: SmearStarts(self._fitted, comparison),
            StartKind.CAMERA_FRINGES: lambda: FringeStarts(self._fitted, comparison),
            StartKind.MODULATOR_FRINGES: lambda: ModulatorFringeStarts(context, base, comparison),
            StartKind.PLANES: lambda: PlaneStarts(context, base),
            StartKind.STUCK_PIXELS: lambda: StuckStarts(context, base, comparison),
        }


def _starts_of(providers: Mapping[StartKind, StartProvider], effect: Effect) -> StartingValues:
    return [start for kind in effect.start_kinds if kind in providers for start in providers[kind](effect)]
