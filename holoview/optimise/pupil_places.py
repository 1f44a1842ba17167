"""Places of the eye's pupil for an optimisation: a grid, "3x3:0.8mm", or drawn anew each time, "random:4:0.8mm"."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

import numpy as np

from holoview.model.eye import Eye
from holoview.model.focus import required_eye
from holoview.model.system import System
from holoview.numerics.fft_grid import positions
from holoview.optimise.drawn_pupils import Places, held_out_places
from holoview.optimise.settings import Settings
from holoview.util import units
from holoview.util.errors import UserError

MOST_ALONG_AXIS, MOST_DRAWN = 9, 81
"""Number of places along each axis of a grid, and of places that are drawn, at most."""

_GRID = re.compile(r"(?P<rows>\d{1,2})x(?P<columns>\d{1,2}):(?P<spacing>.+)")
_DRAW = re.compile(r"random:(?P<count>\d{1,2}):(?P<radius>.+)")
_EXPECTED = (
    f"rows x columns:spacing up to {MOST_ALONG_AXIS}x{MOST_ALONG_AXIS}, e.g. 3x3:0.8mm, or random:count:radius up to "
    f"{MOST_DRAWN}, e.g. random:4:0.8mm"
)


@dataclass(frozen=True)
class PupilPlaces:
    """The places of the pupil for which a hologram is optimised, and those where it is judged.

    fixed: places (y, x), row by row, m. drawn: number of places that are drawn anew in each iteration, within radius_m
    of the eye's own. Neither: its own place alone. held_out: places for which nothing is optimised.
    """

    fixed: Places = ()
    drawn: int = 0
    radius_m: float = 0.0
    held_out: Places = ()

    def reach_m(self, eye: Eye) -> float:
        """How far the pupil is moved along an axis from the eye's own place, at most."""
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
    """Places that are drawn anew in each iteration, `count` of them within radius_m of the pupil of an eye."""

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

    >>> from holoview.optimise.pupil_places import parse_pupils
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
