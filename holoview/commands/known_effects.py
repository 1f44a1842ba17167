"""`--known` of a diagnosis: effects that the bench is known to have, and the placement that `rig align` has found."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from holoview.commands.arguments import parse_effects
from holoview.diagnose.likelihood import Values
from holoview.diagnose.report.diagnosis import Diagnosis
from holoview.experiment.known_alignment import refinement_note, within_alignment
from holoview.rig.registration import Registration, read_registration


@dataclass(frozen=True)
class KnownEffects:
    """What was stated: effects by name, and placements."""

    effects: Values
    placements: Sequence[Registration]

    def added_to(self, known: Values) -> dict[str, dict[str, float]]:
        """Known effects with the stated ones; these count where both have a parameter."""
        result = {name: dict(values) for name, values in known.items()}
        for table in (*(registration.known_effects() for registration in self.placements), self.effects):
            for name, values in table.items():
                result[name] = result.get(name, {}) | dict(values)
        return result

    @property
    def uncertain(self) -> dict[str, dict[str, float]]:
        """Standard deviations of what placements know."""
        return {name: own for one in self.placements for name, own in one.uncertain_effects().items()}

    def with_notes(self, found: Diagnosis) -> Diagnosis:
        """The diagnosis, with a note on causes that lie within what a placement has left open."""
        within = [name for registration in self.placements for name in within_alignment(registration, found.values)]
        notes = (*found.notes, refinement_note(within)) if within else found.notes
        return dataclasses.replace(found, notes=notes)


def read_known(texts: Sequence[str]) -> KnownEffects:
    """Reads NAME.KEY=VALUE and files of placements. Raises UserError that names what is wrong."""
    files = [text for text in texts if text.endswith(".toml") and "=" not in text]
    effects: Mapping[str, Mapping[str, float]] = parse_effects([text for text in texts if text not in files])
    return KnownEffects(effects, [read_registration(Path(file)) for file in files])
