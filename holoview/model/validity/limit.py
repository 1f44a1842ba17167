"""A limit of the model: what is measured of a plan, against which threshold, and why."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from holoview.model.plan import Plan


@dataclass(frozen=True)
class Measured:
    """What was measured of a plan.

    value: in the unit of the limit. found: what it means beyond the threshold, a sentence without a full stop.
    where: the key of the bench that it depends on most. remedy: what to change.
    """

    value: float
    found: str
    where: str
    remedy: str


@dataclass(frozen=True)
class Limit:
    """A limit of the model.

    name: a few words. quantity: what is measured, with its unit. reason: where the threshold comes from.
    measure: what is measured of a plan; None where the limit doesn't apply.
    at_least, at_most: the threshold; one of them is given.
    refuses: whether nothing is left to see beyond the threshold, so that the plan isn't rendered.
    """

    name: str
    quantity: str
    reason: str
    measure: Callable[[Plan], Measured | None]
    at_least: float | None = None
    at_most: float | None = None
    refuses: bool = False

    @property
    def threshold(self) -> str:
        """The threshold in words."""
        return f"at most {self.at_most:.3g}" if self.at_least is None else f"at least {self.at_least:.3g}"

    def is_kept_by(self, value: float) -> bool:
        """Whether a value is on the right side of the threshold."""
        if self.at_least is not None:
            return value >= self.at_least
        assert self.at_most is not None
        return value <= self.at_most


@dataclass(frozen=True)
class Reading:
    """What a limit says of a plan."""

    limit: Limit
    measured: Measured

    @property
    def is_exceeded(self) -> bool:
        """Whether the model isn't true of the plan in this respect."""
        return not self.limit.is_kept_by(self.measured.value)

    @property
    def text(self) -> str:
        """The limit's name and what was found, in a sentence."""
        return f"{self.limit.name}: {self.measured.found}; {self.measured.remedy}"
