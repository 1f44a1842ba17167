"""For which eyes a hologram is optimised: their pupils' places, and whether their chromatic aberration counts.

The options `--pupils` and `--chromatic` of the command line and the viewer's panel are both described by
`OptimisedEyes`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from holoview.model.focus import required_eye, with_pupil_at
from holoview.model.system import System
from holoview.optimise.drawn_pupils import StacksAt
from holoview.optimise.pupil_places import PupilChoice, PupilPlaces, parse_pupils
from holoview.util.errors import UserError

CHROMATIC = ("compensate", "ignore")
"""What an optimisation does about the chromatic aberration of an eye: count it, or leave it out."""


class SeenTarget(Protocol):
    """A target that can be seen from places of the pupil.

    is_stack: whether it is a rendered focal stack, which was seen from one place.
    """

    @property
    def is_stack(self) -> bool: ...

    def stack_for(self, system: System) -> NDArray[np.float32]:
        """The focal stack (plane, y, x, 3) that the eye of a system is to see from its own place."""

    def moving(self, radius_m: float, system: System) -> StacksAt:
        """The focal stacks from any places of the pupil within a radius. Called unless it is a stack."""


@dataclass(frozen=True)
class OptimisedEyes:
    """Places of the pupil, None for the eye's own alone; chromatic: one of CHROMATIC. Raises UserError for another."""

    pupils: PupilChoice | None = None
    chromatic: str = CHROMATIC[0]

    def __post_init__(self) -> None:
        if self.chromatic not in CHROMATIC:
            raise UserError("chromatic", f'"{self.chromatic}"', expected=" or ".join(CHROMATIC))

    @classmethod
    def from_text(cls, pupils: str | None, chromatic: str) -> OptimisedEyes:
        """As options describe them. Raises UserError for pupils of another form."""
        return cls(None if pupils is None else parse_pupils(pupils), chromatic)

    @property
    def description(self) -> str:
        """In words; "" for an eye as it is."""
        colour = "an eye without colour error" if self.chromatic == "ignore" else ""
        return ", ".join(part for part in ("" if self.pupils is None else f"pupils {self.pupils}", colour) if part)

    def places_in(self, system: System) -> PupilPlaces:
        """The places for the eye of a system. Raises UserError for places without an eye."""
        return PupilPlaces() if self.pupils is None else self.pupils.places_in(system, "--pupils")

    def aimed(self, system: System) -> System:
        """The system that is optimised for: as if its eye had no chromatic aberration, if that is ignored.

        Raises UserError if there is no eye whose aberration could be ignored.
        """
        if self.chromatic == "compensate":
            return system
        required_eye(system, "--chromatic")
        return system.edit({"eye.chromatic": False})


def target_at_places(target: SeenTarget, system: System, pupils: PupilPlaces) -> NDArray[np.float32] | StacksAt:
    """The focal stacks (place · plane, y, x, 3) as an eye at each place sees them; from its own place without any.

    For places that are drawn, a function of the places that gives them. Raises UserError for places and a target that
    is a focal stack.
    """
    if not (pupils.drawn or pupils.fixed):
        return target.stack_for(system)
    if target.is_stack:
        raise UserError(
            "--pupils", "with a focal stack", expected="a picture or a light field, which is seen from every place"
        )
    if pupils.drawn:
        return target.moving(pupils.radius_m, system)
    return np.concatenate([target.stack_for(with_pupil_at(system, place)) for place in pupils.fixed])
