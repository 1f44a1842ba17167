"""Hidden faults: drawn from a seed, measured, and told only to who shows a verdict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, Nuisances, make_captures
from holoview.bench.diagnose.report.diagnosis import Diagnosis
from holoview.light.model.effects.registry import listed_effects
from holoview.light.model.system import System
from tests.diagnose.effect_sampling import sample_effect

Truth = dict[str, dict[str, float]]


class Sealed:
    """Faults of `count` effects out of `among`, of sizes between those given (1: the edge of the scan)."""

    def __init__(
        self,
        seed: int,
        system: System,
        among: Sequence[str] = (),
        count: int = 1,
        sizes: tuple[float, float] = (0.2, 0.9),
        nuisances: Nuisances | None = None,
    ) -> None:
        rng = np.random.default_rng(seed)
        library = listed_effects()
        chosen = [str(n) for n in rng.choice(sorted(among), count, replace=False)] if among else []
        self.__truth = {name: sample_effect(library[name], system, rng.uniform(*sizes), rng) for name in chosen}
        session = AcquisitionSettings(captures_per_condition=6, seed=seed, nuisances=nuisances or Nuisances())
        self.captures: Captures = make_captures(system, self.__truth, session)

    def without_the_cause(self, among: Sequence[str]) -> list[str]:
        """Effects of which none is the hidden one, nor the same physics."""
        library, facts = listed_effects(), self.captures.data_properties()
        hidden = {other for name in self.__truth for other in (name, *library[name].degeneracies(facts))}
        return [name for name in among if name not in hidden and not hidden & set(library[name].degeneracies(facts))]

    def opened(self, verdict: Diagnosis) -> Truth:
        """The truth, once there is a verdict."""
        assert isinstance(verdict, Diagnosis)
        return self.__truth
