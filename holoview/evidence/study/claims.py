"""Claims on numbers, such as "C < 0.4", and whether a measurement bears them out."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from holoview.util.errors import UserError

QUANTITIES = {
    "C": "speckle contrast of the luminance",
    "C_red": "speckle contrast of the red lasers",
    "C_green": "speckle contrast of the green lasers",
    "C_blue": "speckle contrast of the blue lasers",
    "N_eff": "independent patterns, from the correlation between lasers",
    "colour_area": "area of the 95 % ellipse of u'v'",
    "PSNR": "PSNR to the target, dB",
    "CR": "white over the black beside it",
    "CR_sequential": "white picture over black picture",
    "CR_checkerboard": "white fields over black fields",
    "MTF50": "frequency at which the MTF against the target is a half, cycles a sample",
    "uniformity": "uniformity of the eyebox, darkest over mean",
    "picture_light": "share of the light in the picture",
}
"""What can be claimed, with words for it."""

NEEDS = {
    "C_red": "there are no red lasers",
    "C_green": "there are no green lasers",
    "C_blue": "there are no blue lasers",
    "PSNR": "needs a target",
    "CR": "needs a target with bright and dark parts",
    "CR_sequential": "needs --contrast-ratio",
    "CR_checkerboard": "needs --contrast-ratio",
    "MTF50": "needs a target with detail that is shown",
    "uniformity": "needs modulators",
}
"""Why a quantity isn't measured."""

OF_SPECKLE = frozenset({"C", "C_red", "C_green", "C_blue", "N_eff", "colour_area"})
"""Quantities that aren't measured where the contrast is withheld."""

_OPERATORS: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    "≤": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "≥": operator.ge,
}
_CLAIM = re.compile(r"\s*([A-Za-z_]+[0-9]*)\s*(<=|>=|<|>|≤|≥)\s*([0-9.]+(?:[eE][+-]?[0-9]+)?)\s*(%|dB)?\s*")
_LONGEST = 60
SIGMAS = 2.0
"""Standard errors within which a claim is undecided."""


@dataclass(frozen=True)
class NumberClaim:
    """A claim: a quantity of `QUANTITIES`, an operator and a limit. text: as it was given."""

    text: str
    quantity: str
    comparison: str
    limit: float


@dataclass(frozen=True)
class JudgedClaim:
    """A claim beside a measurement. value: None where it couldn't be measured. error: standard error, if one is known.

    verdict: "holds", "doesn't hold", "not measured", or "undecided": within two standard errors, or by a raw value.
    """

    claim: NumberClaim
    value: float | None
    error: float | None
    verdict: str


def parse_claim(text: str) -> NumberClaim:
    """The claim of a text. Raises UserError for one that isn't QUANTITY < NUMBER, and an unknown quantity."""
    match = _CLAIM.fullmatch(text) if len(text) <= _LONGEST else None
    expected = f'such as "C < 0.4", with {", ".join(QUANTITIES)}'
    if match is None or match[1] not in QUANTITIES:
        raise UserError("--claim", f'"{text[:_LONGEST]}"', expected=expected)
    try:
        limit = float(match[3])
    except ValueError:
        limit = math.nan
    if not math.isfinite(limit):
        raise UserError("--claim", f'"{text}"', expected=expected)
    return NumberClaim(text.strip(), match[1], match[2], limit / 100 if match[4] == "%" else limit)


def judge_claim(
    claim: NumberClaim,
    values: Mapping[str, tuple[float, float | None]],
    is_raw: bool = False,
    is_rough: bool = False,
) -> JudgedClaim:
    """A claim beside measured values and their standard errors, by quantity.

    is_raw: whether the structure of a picture counts in the values of speckle. It adds to the contrasts and to the area
    of the colours, and makes lasers more alike: such a value is a bound, which can bear out a claim from one side only.
    Others are undecided. is_rough: whether too few grains were measured for the values of speckle to decide anything.
    """
    if claim.quantity not in values:
        return JudgedClaim(claim, None, None, "not measured")
    value, error = values[claim.quantity]
    is_of_speckle = claim.quantity in OF_SPECKLE
    if (is_rough and is_of_speckle) or (error is not None and abs(value - claim.limit) <= SIGMAS * error):
        return JudgedClaim(claim, value, error, "undecided")
    holds = _OPERATORS[claim.comparison](value, claim.limit)
    is_bound_on_the_other_side = ("<" in claim.comparison or claim.comparison == "≤") == (claim.quantity == "N_eff")
    if is_raw and is_of_speckle and (not holds or is_bound_on_the_other_side):
        return JudgedClaim(claim, value, error, "undecided")
    return JudgedClaim(claim, value, error, "holds" if holds else "doesn't hold")
