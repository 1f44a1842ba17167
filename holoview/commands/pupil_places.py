"""Places of the eye's pupil for an optimisation: `--pupils 3x3:0.8mm` or `--pupils random:4:0.8mm`."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from holoview.model.eye import Eye
from holoview.model.focus import required_eye
from holoview.model.system import System
from holoview.numerics.fft_grid import positions
from holoview.optimise.drawn_pupils import Places, held_out_places
from holoview.util import units
from holoview.util.errors import UserError

_GRID = re.compile(r"(?P<rows>\d{1,2})x(?P<columns>\d{1,2}):(?P<spacing>.+)")
_DRAW = re.compile(r"random:(?P<count>\d{1,2}):(?P<radius>.+)")
_MOST = 9  # along each axis
_MOST_DRAWN = 81


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


def parse_places(text: str | None, system: System) -> PupilPlaces:
    """The places that `--pupils` describes, around that of the system's eye; none for None.

    Raises UserError for text of another form, and without an eye.
    """
    if text is None:
        return PupilPlaces()
    grid, draw = _GRID.fullmatch(text), _DRAW.fullmatch(text)
    is_grid = grid is not None and all(1 <= int(grid[key]) <= _MOST for key in ("rows", "columns"))
    if not is_grid and (draw is None or not 1 <= int(draw["count"]) <= _MOST_DRAWN):
        raise UserError(
            "--pupils",
            f'"{text}"',
            expected=f"rows x columns:spacing up to {_MOST}x{_MOST}, e.g. 3x3:0.8mm, or random:count:radius up to "
            f"{_MOST_DRAWN}, e.g. random:4:0.8mm",
        )
    eye = required_eye(system, "--pupils")
    if draw is not None:
        radius_m = _positive_length(draw["radius"], "a radius")
        for sign in (1, -1):  # an eye that sees nothing from the rim is refused before time is spent
            eye.moved_to((eye.pupil_y_m, eye.pupil_x_m + sign * radius_m))
            eye.moved_to((eye.pupil_y_m + sign * radius_m, eye.pupil_x_m))
        return PupilPlaces((), int(draw["count"]), radius_m, held_out_places(system, radius_m))
    assert grid is not None
    spacing_m = _positive_length(grid["spacing"], "a spacing")
    y, x = (
        centre + positions(int(grid[key]), spacing_m)
        for key, centre in (("rows", eye.pupil_y_m), ("columns", eye.pupil_x_m))
    )
    places = tuple((float(a), float(b)) for a in y for b in x)
    return PupilPlaces(places, held_out=places_between(places))


def places_between(places: Places) -> Places:
    """The middles of the cells of a grid of places, for which nothing was optimised; empty for fewer than two."""
    y, x = (np.unique(axis) for axis in np.array(places).reshape(-1, 2).T)
    if len(places) < 2:
        return ()
    middle = [(axis[1:] + axis[:-1]) / 2 if len(axis) > 1 else axis for axis in (y, x)]
    return tuple((float(a), float(b)) for a in middle[0] for b in middle[1])


def _positive_length(text: str, what: str) -> float:
    length_m = units.parse(text, "--pupils")
    if not 0 < length_m < math.inf:
        raise UserError("--pupils", text, expected=f"{what} above 0")
    return length_m
