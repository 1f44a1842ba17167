"""What the check of the records found."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

from holoview.captures.dataset import Captures
from holoview.captures.records.corrections import Hypothesis, apply_corrections

_PREFIX = "Records: "


@dataclass(frozen=True)
class RecordFindings:
    """Which records are wrong.

    corrections: what puts them right; empty where nothing was found. rivals: other corrections that predict the same.
    correlation: of predicted and seen speckle on the captures compared, as recorded and as corrected. undecided: what
    these captures can't show, as ids with choices. captures: how many were compared. seconds: how long it took.
    """

    corrections: Hypothesis = ()
    rivals: tuple[Hypothesis, ...] = ()
    correlation: tuple[float, float] = (float("nan"), float("nan"))
    undecided: tuple[str, ...] = ()
    captures: int = 0
    seconds: float = 0.0

    def corrected(self, captures: Captures) -> Captures:
        """The captures as they should have been recorded, with a note of each correction."""
        noted = (*captures.corrections, *(f"{c.label}: {c.sentence}" for c in self.corrections))
        return dataclasses.replace(apply_corrections(captures, self.corrections), corrections=noted)

    @property
    def lines(self) -> list[str]:
        """The findings in words, one line at least."""
        wrong = [f"{c.label}: {c.sentence}" for c in self.corrections] or ["nothing found that is recorded wrongly"]
        return [*wrong, *(note.removeprefix(_PREFIX) for note in self.notes)]

    @property
    def notes(self) -> list[str]:
        """What a person should know beside the corrections, in sentences."""
        found = [
            f"{_PREFIX}{' and '.join(c.label for c in rival)} would predict the same as "
            f"{' and '.join(c.label for c in self.corrections)}; these captures can't tell which."
            for rival in self.rivals
        ]
        if self.undecided:
            found.append(f"{_PREFIX}these captures look the same with and without {', '.join(self.undecided)}.")
        return found

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        return {
            "wrong": [{"effect": c.effect, "choice": c.choice, "sentence": c.sentence} for c in self.corrections],
            "rivals": [[{"effect": c.effect, "choice": c.choice} for c in rival] for rival in self.rivals],
            "correlation": {
                name: round(value, 6) if math.isfinite(value) else None
                for name, value in zip(("as_recorded", "as_corrected"), self.correlation, strict=True)
            },
            "undecided": list(self.undecided),
            "captures": self.captures,
            "seconds": round(self.seconds, 3),
        }
