"""Effects of the bench that the pictures of a loop show, added to its model, so that its gradients get better."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from holoview.captures.dataset import Captures, join_captures
from holoview.diagnose.extended_model import extended_system
from holoview.diagnose.pipeline import diagnose
from holoview.model.effects.registry import get_effect, listed_effects
from holoview.model.system import System
from holoview.optimise.lasers import changes_lasers


@dataclass(frozen=True)
class ModelUpdates:
    """Every so many iterations the bench is diagnosed anew.

    every: iterations between two updates. effects: ids of those that may be the cause; all where empty. time_s: of one
    diagnosis; None for as long as `holoview diagnose` takes by default.
    """

    every: int
    effects: tuple[str, ...] = ()
    time_s: float | None = None

    def is_due(self, iteration: int) -> bool:
        """Whether the model is updated before this iteration."""
        return iteration > 0 and iteration % self.every == 0


@dataclass(frozen=True)
class UpdatedModel:
    """A bench with what was found, and what that was, in words."""

    system: System
    note: str


def update_model(
    system: System, captures: Sequence[Captures], updates: ModelUpdates, is_asked_to_end: Callable[[], bool]
) -> UpdatedModel:
    """The system with the effects that captures, each a session of one, show beside those that it has.

    Effects that change the lasers themselves aren't taken over, since patterns can't be optimised for them.
    Raises UserError for an effect that is unknown.
    """
    joined = join_captures(captures)
    joined = dataclasses.replace(joined, levels_before=joined.levels)  # each settled before its picture was taken
    candidates = [get_effect(name) for name in updates.effects] or list(listed_effects().values())
    found = diagnose(
        joined,
        candidates,
        known=system.effect_values,
        free_maps=False,
        time_s=updates.time_s,
        is_asked_to_end=is_asked_to_end,
    )
    values = {name: own for name, own in found.values.items() if not changes_lasers(system, {name: own})}
    left_out = [name for name in found.values if name not in values]
    sentences = [cause.sentence for cause in found.causes if cause.effect in values]
    note = " ".join(sentences) or "nothing beside what the model has"
    if left_out:
        note += f" ({', '.join(left_out)} can't be optimised for)"
    return UpdatedModel(extended_system(system, values), note)
