"""Depth and phase of interference fringes at each wavelength, and their wedge, which several effects share.

To tell the phase of the fringes at one wavelength from that at another, one would have to know the glass: its thickness
to a hundredth of a wave, and its dispersion. Coatings and the width of the laser's line decide the depth. So both are
free at each wavelength, as the cosine and the sine of one oscillation.
"""

from __future__ import annotations

import math

from holoview.effects.starting_grids import half_circle
from holoview.model.effects.parameter import Parameter, Values
from holoview.util.errors import UserError

_ORDINALS = ("shortest", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth")
LASERS = len(_ORDINALS)
"""The largest number of wavelengths in a session or on a bench."""


def depth_parameters(centre: str) -> tuple[Parameter, ...]:
    """The parameters cos1, sin1 … cos8, sin8 of fringes whose phase is stated at a place, such as "the centre"."""
    return tuple(
        Parameter(
            f"{part}{number}",
            f"Depth of the fringes times the {name} of their phase in {centre}, at the {word} wavelength.",
            low=-0.5,
            high=0.5,
            prior=0.02,
        )
        for number, word in enumerate(_ORDINALS, start=1)
        for part, name in (("cos", "cosine"), ("sin", "sine"))
    )


def fringe_depths(effect: str, laser: int, v: Values) -> tuple[float, float]:
    """Cosine and sine at a laser, 0 for the shortest wavelength. Raises UserError, with the effect's id, beyond 8."""
    if laser >= LASERS:
        raise UserError(
            f"effects.{effect}", f"there are more than {LASERS} wavelengths", expected=f"at most {LASERS} in a session"
        )
    return v[f"cos{laser + 1}"], v[f"sin{laser + 1}"]


def wedge_starts() -> list[dict[str, float]]:
    """Points {parameter: value} of a few wedges, path_y and path_x, with weak fringes at every wavelength."""
    depths = {f"cos{number}": 0.02 for number in range(1, LASERS + 1)}
    return [{**wedge, **depths} for wedge in half_circle("path_y", "path_x", 5e-6, 8)]


def describe_fringes(v: Values) -> dict[str, str]:
    """The fields depth, fringes_y and fringes_x of a finding; the numbers of fringes are those at 550 nm."""
    fringes = {f"fringes_{axis}": f"{abs(v[f'path_{axis}']) / 550e-9:.3g}" for axis in ("y", "x")}
    return {"depth": _format_depths(v), **fringes}


def _format_depths(v: Values) -> str:
    """The smallest and the largest depth as text, of the wavelengths that have fringes."""
    depths = [math.hypot(v[f"cos{n}"], v[f"sin{n}"]) for n in range(1, LASERS + 1)]
    present = [depth for depth in depths if depth] or [0.0]
    low, high = (f"{depth:.2g}" for depth in (min(present), max(present)))
    return low if low == high else f"{low} … {high}"
