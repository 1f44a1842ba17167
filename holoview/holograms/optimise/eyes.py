"""The eyes for which a hologram is optimised: the places of their pupils, and whether chromatic aberration counts.

The options `--pupils` and `--chromatic` of the command line and the viewer's panel are both described by
`OptimisedEyes`. Places form a grid, "3x3:0.8mm", or are drawn anew in each iteration, "random:4:0.8mm". A draw depends
on the seed and on the iteration alone, so that a resumed optimisation draws the same places. Shi et al., Pupil-aware
holography, ACM Trans. Graph. 41, 6 (2022), train on pupils that are sampled in this way.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.optimise.settings import Settings
from holoview.light.model.eye import Eye
from holoview.light.model.fields import Word, described_field, validate
from holoview.light.model.focus import required_eye, with_pupil_at
from holoview.light.model.system import System
from holoview.light.numerics.sampling import positions
from holoview.util import units
from holoview.util.errors import UserError

Places = tuple[tuple[float, float], ...]
"""Places (y, x) of the pupil in the eyebox, m."""
StacksAt = Callable[[Places], NDArray[np.floating]]
"""The focal stacks (place · plane, y, x, 3) in linear sRGB that the eye of a system is to see from places."""

CHROMATIC = ("compensate", "ignore")
"""How an optimisation treats the chromatic aberration of an eye: it counts, or it is left out."""


class SeenTarget(Protocol):
    """A target that can be seen from places of the pupil.

    is_stack: whether it is a rendered focal stack, which was seen from one place.
    """

    @property
    def is_stack(self) -> bool: ...

    def stack_for(self, system: System) -> NDArray[np.float32]:
        """The focal stack (plane, y, x, 3) that the eye of a system is to see from its own place."""

    def moving(self, radius_m: float, system: System) -> StacksAt:
        """The focal stacks from any places of the pupil within a radius. Not called for a rendered stack."""


@dataclass(frozen=True)
class PupilsField:
    """Field type of places of the pupil, given as they are or as text; "" and None are none."""

    def parse(self, value: Any, where: str) -> PupilChoice | None:
        if value is None or value == "":
            return None
        return value if isinstance(value, PupilGrid | PupilDraw) else parse_pupils(str(value))

    def to_toml(self, value: PupilChoice | None) -> str | None:
        return None if value is None else str(value)


@dataclass(frozen=True)
class OptimisedEyes:
    """Places of the pupil, None for the eye's own alone; chromatic: one of CHROMATIC. Raises UserError for another."""

    pupils: PupilChoice | None = described_field(
        PupilsField(),
        "Places of the eye's pupil from each of which the target counts, about where it is, e.g. 3x3:0.8mm; "
        "random:4:0.8mm: four places within this radius, drawn anew in each iteration.",
        default=None,
    )
    chromatic: str = described_field(
        Word(CHROMATIC),
        "ignore: optimise as if the eye had no chromatic aberration; picture and score are always what the eye sees.",
        default=CHROMATIC[0],
    )

    def __post_init__(self) -> None:
        validate(self)

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
        """The system that is optimised for: with an eye without chromatic aberration, if that is ignored.

        Raises UserError if it is to be ignored and there is no eye.
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


# Places of the eye's pupil for an optimisation: a grid, "3x3:0.8mm", or drawn anew each time, "random:4:0.8mm".


MOST_ALONG_AXIS, MOST_DRAWN = 9, 81
"""Number of places along each axis of a grid, and of places that are drawn, at most."""

_HELD_OUT = 2  # places along each axis for which nothing is optimised
_GRID = re.compile(r"(?P<rows>\d{1,2})x(?P<columns>\d{1,2}):(?P<spacing>.+)")
_DRAW = re.compile(r"random:(?P<count>\d{1,2}):(?P<radius>.+)")
_EXPECTED = (
    f"rows x columns:spacing up to {MOST_ALONG_AXIS}x{MOST_ALONG_AXIS}, e.g. 3x3:0.8mm, or random:count:radius up to "
    f"{MOST_DRAWN}, e.g. random:4:0.8mm"
)


@dataclass(frozen=True)
class PupilPlaces:
    """The places of the pupil for which a hologram is optimised, and the places where it is judged.

    fixed: places (y, x), row by row, m. drawn: number of places that are drawn anew in each iteration, within radius_m
    of the eye's own place. Neither: its own place alone. held_out: places for which nothing is optimised.
    """

    fixed: Places = ()
    drawn: int = 0
    radius_m: float = 0.0
    held_out: Places = ()

    def reach_m(self, eye: Eye) -> float:
        """The largest distance along an axis of a place from the eye's own place."""
        middle = np.array([eye.pupil_y_m, eye.pupil_x_m])
        moved = [np.abs(np.array(place) - middle).max() for place in (*self.fixed, *self.held_out)]
        return float(max([self.radius_m, *moved]))

    def in_settings(self, settings: Settings) -> Settings:
        """The settings of an optimisation for these places."""
        return replace(settings, pupil_places_m=self.fixed, drawn_pupils=self.drawn, drawn_radius_m=self.radius_m)


@dataclass(frozen=True)
class PupilGrid:
    """A grid of places about the pupil of an eye: rows x columns, spacing_m apart."""

    rows: int
    columns: int
    spacing_m: float

    def __str__(self) -> str:
        return f"{self.rows}x{self.columns}:{_format_length(self.spacing_m)}"

    def places_in(self, system: System, where: str) -> PupilPlaces:
        """The places for the eye of a system. Raises UserError, at `where`, without an eye."""
        eye = required_eye(system, where)
        y, x = (
            centre + positions(count, self.spacing_m)
            for count, centre in ((self.rows, eye.pupil_y_m), (self.columns, eye.pupil_x_m))
        )
        places = tuple((float(a), float(b)) for a in y for b in x)
        return PupilPlaces(places, held_out=places_between(places))


@dataclass(frozen=True)
class PupilDraw:
    """Places that are drawn anew in each iteration, `count` of them within radius_m of the eye's own place."""

    count: int
    radius_m: float

    def __str__(self) -> str:
        return f"random:{self.count}:{_format_length(self.radius_m)}"

    def places_in(self, system: System, where: str) -> PupilPlaces:
        """The draw for the eye of a system.

        Raises UserError, at `where`, without an eye; and for a radius that the eyepiece can't show.
        """
        eye = required_eye(system, where)
        for sign in (1, -1):  # an eye that sees nothing from the rim is refused before time is spent
            eye.moved_to((eye.pupil_y_m, eye.pupil_x_m + sign * self.radius_m))
            eye.moved_to((eye.pupil_y_m + sign * self.radius_m, eye.pupil_x_m))
        return PupilPlaces((), self.count, self.radius_m, held_out_places(system, self.radius_m))


PupilChoice = PupilGrid | PupilDraw


def parse_pupils(text: str, where: str = "--pupils") -> PupilChoice:
    """The grid or the draw that a text describes. Raises UserError, at `where`, for text of another form.

    >>> from holoview.holograms.optimise.eyes import parse_pupils
    >>> parse_pupils("3x3:0.8mm")
    PupilGrid(rows=3, columns=3, spacing_m=0.0008)
    >>> str(parse_pupils("random:4:800um"))
    'random:4:0.8mm'
    """
    grid, draw = _GRID.fullmatch(text), _DRAW.fullmatch(text)
    if grid is not None and all(1 <= int(grid[key]) <= MOST_ALONG_AXIS for key in ("rows", "columns")):
        spacing_m = _positive_length(grid["spacing"], "a spacing", where)
        return PupilGrid(int(grid["rows"]), int(grid["columns"]), spacing_m)
    if draw is not None and 1 <= int(draw["count"]) <= MOST_DRAWN:
        return PupilDraw(int(draw["count"]), _positive_length(draw["radius"], "a radius", where))
    raise UserError(where, f'"{text}"', expected=_EXPECTED)


def places_between(places: Places) -> Places:
    """The middles of the cells of a grid of places, for which nothing was optimised; empty for fewer than two."""
    y, x = (np.unique(axis) for axis in np.array(places).reshape(-1, 2).T)
    if len(places) < 2:
        return ()
    middle = [(axis[1:] + axis[:-1]) / 2 if len(axis) > 1 else axis for axis in (y, x)]
    return tuple((float(a), float(b)) for a in middle[0] for b in middle[1])


def _positive_length(text: str, what: str, where: str) -> float:
    length_m = units.parse(text, where)
    if not 0 < length_m < math.inf:
        raise UserError(where, text, expected=f"{what} above 0")
    return length_m


def _format_length(length_m: float) -> str:
    return units.format_exact(length_m, "mm").replace(" ", "")


# --- places that are drawn -------------------------------------------------------------------------------------------


def drawn_places(system: System, settings: Settings, iteration: int) -> Places:
    """The places of an iteration: `settings.drawn_pupils`, uniform in a disc about the pupil of the system's eye.

    Raises UserError without an eye.
    """
    eye = required_eye(system, "pupil places")
    random = np.random.default_rng([settings.seed, iteration])
    radius_m = settings.drawn_radius_m * np.sqrt(random.random(settings.drawn_pupils))
    angle = 2 * math.pi * random.random(settings.drawn_pupils)
    y, x = eye.pupil_y_m + radius_m * np.sin(angle), eye.pupil_x_m + radius_m * np.cos(angle)
    return tuple(zip(y.tolist(), x.tolist(), strict=True))


def held_out_places(system: System, radius_m: float) -> Places:
    """A grid of 2 x 2 places, a radius apart, about the pupil of the system's eye: where to judge a result.

    Raises UserError without an eye.
    """
    eye, steps = required_eye(system, "pupil places"), positions(_HELD_OUT, radius_m).tolist()
    return tuple((eye.pupil_y_m + y, eye.pupil_x_m + x) for y in steps for x in steps)


class DrawnPupils:
    """The places of each iteration, and the stacks that are to be seen from them. Arguments as those of `iterate`."""

    def __init__(self, system: System, settings: Settings, stacks_at: StacksAt) -> None:
        self._system, self._settings, self._stacks_at = system, settings, stacks_at

    def __call__(self, iteration: int) -> tuple[Places, NDArray[np.floating]]:
        """The places of an iteration, and the stacks (place · plane, y, x, 3)."""
        places = drawn_places(self._system, self._settings, iteration)
        return places, self._stacks_at(places)


def drawn_pupils(system: System, settings: Settings, stack: object) -> DrawnPupils | None:
    """The places that settings want drawn, and their stacks; None where none are drawn. stack: target of `iterate`.

    Raises UserError for a function of places without drawn ones, and for anything else with them.
    """
    if callable(stack) != (settings.drawn_pupils > 0):
        found, expected = ("a function", "a stack") if callable(stack) else ("a stack", "a function of the places")
        raise UserError("target", found, expected=f"{expected} with {settings.drawn_pupils} drawn pupils")
    return DrawnPupils(system, settings, stack) if callable(stack) else None
