"""What a user has chosen for the next optimisation; saved with the session, but not a step of its history."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from holoview.model.system import System
from holoview.optimise.eyes import CHROMATIC, OptimisedEyes
from holoview.optimise.settings import LOSS_SPACES
from holoview.util.errors import UserError

SCHEMES = (
    *("simultaneous", "time-sequential", "multiplexed-3", "holochrome-8", "holochrome-8x3", "holochrome-16"),
    "holochrome-8+multisource-3x3",
)
START_PATTERNS = ("now", "random", "smooth")
MOST_ITERATIONS = 100_000


@dataclass(frozen=True)
class OptimisationChoices:
    """Choices for an optimisation.

    scheme: one of SCHEMES, "" for the bench as it is. loss: one of LOSS_SPACES, "" for that of the observer.
    start_patterns: "now" for the present ones, "random", or "smooth". iterations: number of them. eyebox: weight of an
    evenly lit one. pupils: places of the eye's pupil, as `--pupils` has them; "" for its own. chromatic: whether its
    chromatic aberration is compensated or ignored.

    Raises UserError for what isn't one of these.
    """

    scheme: str = ""
    loss: str = ""
    start_patterns: str = START_PATTERNS[1]
    iterations: int = 60
    eyebox: float = 0.0
    pupils: str = ""
    chromatic: str = CHROMATIC[0]

    def __post_init__(self) -> None:
        options_of = {"scheme": ("", *SCHEMES), "loss": ("", *LOSS_SPACES), "start_patterns": START_PATTERNS}
        for key, options in options_of.items():
            if getattr(self, key) not in options:
                expected = ", ".join(option or "nothing" for option in options)
                raise UserError(key, f'"{getattr(self, key)}"', expected=expected)
        if not 1 <= self.iterations <= MOST_ITERATIONS:
            raise UserError("iterations", str(self.iterations), expected=f"1 to {MOST_ITERATIONS}")
        if not 0 <= self.eyebox < math.inf:
            raise UserError("eyebox", f"{self.eyebox:g}", expected="a weight of 0 or more")
        OptimisedEyes.from_text(self.pupils or None, self.chromatic)

    def eyes_for(self, system: System) -> OptimisedEyes:
        """For which eyes a system is optimised; without an eye, none of them is moved and nothing is ignored."""
        return OptimisedEyes() if system.eye is None else OptimisedEyes.from_text(self.pupils or None, self.chromatic)


def choices_from_table(table: Mapping[str, Any]) -> OptimisationChoices:
    """Choices from their JSON, in which any may be missing. Raises UserError for a value of another kind."""
    given = asdict(OptimisationChoices())
    for key, usual in given.items():
        value, kind = table.get(key, usual), type(usual)
        if isinstance(value, bool) or not isinstance(value, (int, float) if kind is float else kind):
            raise UserError(key, f"{value!r}", expected=f"a {kind.__name__}")
        given[key] = kind(value)
    return OptimisationChoices(**given)
