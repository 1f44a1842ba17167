"""How much of the light of a distance the band limit of a grid leaves, and the refusal of what leaves nothing."""

from __future__ import annotations

from holoview.model.passband import RowsColumns, band_limit
from holoview.util import units
from holoview.util.errors import UserError


def frequencies_left(padded: RowsColumns, pitch_m: float, wavelength_m: float, distance_m: float) -> float:
    """How many frequencies beside zero the band limit leaves on each side of an axis, the larger of the two axes.

    padded, pitch_m: samples (y, x) of the grid and their distance. Below 1, only light that goes straight on is left,
    and the picture is uniform. Where 2z is large beside the side P·dx of the grid it is (P·dx)²/(2λz).
    """
    return max(n * pitch_m * band_limit(n, pitch_m, wavelength_m, distance_m) for n in padded)


def nothing_left(padded: RowsColumns, pitch_m: float, distance_m: float) -> str:
    """That a grid holds nothing of the light at a distance, in words that follow what lies there."""
    return (
        f"at {units.format_rounded(distance_m, 'mm')}, of which the grid of {padded[1]} x {padded[0]} samples of "
        f"{units.format_rounded(pitch_m, 'um')} holds nothing but light that goes straight on"
    )


def check_eye_sampled(padded: RowsColumns, pitch_m: float, wavelength_m: float, distance_m: float) -> None:
    """Raises UserError if an eye is focused so far away that the band limit leaves only light that goes straight on.

    wavelength_m: the longest one. distance_m: the largest one of all wavelengths.
    """
    if frequencies_left(padded, pitch_m, wavelength_m, distance_m) >= 1.0:
        return
    raise UserError(
        "eye",
        f"it sees a plane {nothing_left(padded, pitch_m, distance_m)}",
        expected="a plane within the band limit",
        remedy="change eye.accommodation, eye.infinity or eye.eyepiece, or raise padding",
    )
