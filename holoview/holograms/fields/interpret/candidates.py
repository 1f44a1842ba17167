"""The arrays that can be a field, alone or as parts of a field, and the choice among them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

import numpy as np

from holoview.holograms.files.readers.contents import Contents, StoredArray
from holoview.holograms.files.request import ReadRequest
from holoview.util.errors import UserError, suggest_matches
from holoview.util.memory_limit import format_size

_ROLES = (
    ("real", re.compile(r"(?:^|[^a-z])(?:re|real)(?:[^a-z]|$)|real(?![ilmnst])", re.IGNORECASE)),
    ("imaginary", re.compile(r"(?:^|[^a-z])im(?:[^a-z]|$)|imag(?!es?(?:[^a-z]|$)|ing)", re.IGNORECASE)),
    (
        "amplitude",
        re.compile(r"ampl(?!e|if|ing)|(?:^|[^a-z])(?:amp|abs|mag|modulus)(?:[^a-z]|$)|magnitude", re.IGNORECASE),
    ),
    (
        "phase",
        re.compile(
            r"phase(?![ _-]?s(?:hift|tep))|(?:^|[^a-z])(?:phs?|phi|arg|angle|theta|poh|kinoform)(?:[^a-z]|$)",
            re.IGNORECASE,
        ),
    ),
    ("intensity", re.compile(r"intens", re.IGNORECASE)),
    ("bilevel", re.compile(r"(?:^|[^a-z])hbin(?:[^a-z]|$)|bilevel", re.IGNORECASE)),
)
_COLOURS = (
    ("r", re.compile(r"(?:^|[_\-. ])(?:r|red)(?:$|[_\-. ])", re.IGNORECASE)),
    ("g", re.compile(r"(?:^|[_\-. ])(?:g|green)(?:$|[_\-. ])", re.IGNORECASE)),
    ("b", re.compile(r"(?:^|[_\-. ])(?:b|blue)(?:$|[_\-. ])", re.IGNORECASE)),
)
_NANOMETRES = re.compile(r"(?:^|[^a-zA-Z0-9])(\d{3,4}(?:[.p]\d+)?)[ _]?nm(?![a-z])", re.IGNORECASE)
_USUAL_NAMES = (
    "hol",
    "dh",
    "h",
    "data",
    "u1",
    "hbin",
    "cghf",
    "hologram",
    "field",
    "u",
    "cgh",
    "complex",
    "phase",
    "holo",
)
_UNLIKELY = re.compile(
    r"^(?:x+|y+|[xy]m?|fx|fy|kx|ky|grid.*|mask.*|coord.*|r|rho|theta|bg|background.*|dark.*|flat.*)$", re.IGNORECASE
)
PAIRS = (("real", "imaginary"), ("amplitude", "phase"))


@dataclass(frozen=True)
class Component:
    """An array with the quantity of its numbers, "" if unknown, and why."""

    role: str
    array: StoredArray
    reason: str = ""


@dataclass(frozen=True)
class Candidate:
    """Arrays that are a field together. name: of the variables, joined with commas. what: type and size, in words."""

    name: str
    what: str
    components: tuple[Component, ...]

    @staticmethod
    def of(*components: Component) -> Candidate:
        """The candidate with its description."""
        first = components[0].array
        shape = " × ".join(map(str, first.shape))
        roles = " and ".join(c.role for c in components if c.role)
        kind = "complex" if first.dtype.kind == "c" else roles or "real"
        size = format_size(sum(c.array.nbytes for c in components))
        return Candidate(",".join(c.array.name for c in components), f"{kind}, {shape}, {size}", components)


def name_role(name: str) -> str:
    """The quantity that a name states, "" for none or several: "dice_ampli" is an amplitude, "sample" isn't."""
    stated = [role for role, pattern in _ROLES if pattern.search(name)]
    if len(stated) > 1 and stated[-1] == "bilevel":  # says how many levels the other has
        stated.pop()
    return stated[0] if len(stated) == 1 else ""


def name_colour(name: str) -> str:
    """The colour that a name states as a word, "" for none: "doll_R" is red."""
    return next((colour for colour, pattern in _COLOURS if pattern.search(name)), "")


def name_wavelength(name: str) -> str:
    """The wavelength in nm that a name states, "" for none: "phase_638nm" has 638."""
    found = _NANOMETRES.search(name)
    return found[1].replace("p", ".") if found else ""


_PARTNERS = (
    ("ampli", "phase"),
    ("amp", "phase"),
    ("amplitude", "phase"),
    ("real", "imag"),
    ("re", "im"),
    ("_R", "_G"),
)


def partner_of(path: Path) -> Path | None:
    """A file beside this one whose name says that it is another part of the same field; None if there is none."""
    for pair in _PARTNERS:
        for this, other in (pair, pair[::-1]):
            name = re.sub(rf"(?<![a-zA-Z]){this}(?![a-zA-Z])", other, path.name)
            if name != path.name and (partner := path.with_name(name)).is_file():
                return partner
    return None


def list_candidates(contents: Contents) -> list[Candidate]:
    """Every array or pair of arrays that can be a field, the likeliest first."""
    complex_ones = [Candidate.of(Component("complex", a)) for a in contents.arrays if a.dtype.kind == "c"]
    real = [a for a in contents.arrays if a.dtype.kind in "biuf"]
    pairs = [*_named_pairs(real), *(pair for a in real for pair in _pair_along_an_axis(a))]
    singles = [Candidate.of(Component(a.role or name_role(a.name), a)) for a in real]
    return [*sorted(complex_ones, key=_rank), *sorted(pairs, key=_rank), *sorted(singles, key=_rank)]


def _rank(candidate: Candidate) -> tuple[bool, int, bool, str]:
    """Sorts by likelihood: arrays of coordinates last, then by size, usual names first among equals."""
    array = candidate.components[0].array
    last = array.name.rpartition(".")[2].lower()
    return bool(_UNLIKELY.match(last)), -int(np.prod(array.shape, dtype=object)), last not in _USUAL_NAMES, array.name


def _named_pairs(arrays: Sequence[StoredArray]) -> list[Candidate]:
    """Pairs of one shape in which one name states the first part and the other one the second."""
    found = []
    for first_role, second_role in PAIRS:
        firsts = [a for a in arrays if (a.role or name_role(a.name)) == first_role]
        seconds = [a for a in arrays if (a.role or name_role(a.name)) == second_role]
        for first in firsts:
            alike = [a for a in seconds if a.shape == first.shape]
            partner = max(alike, key=lambda a: _equal_letters(a.name, first.name), default=None)
            if partner is not None:
                reason = f'the names "{first.name}" and "{partner.name}"'
                found.append(
                    Candidate.of(Component(first_role, first, reason), Component(second_role, partner, reason))
                )
    return found


def _equal_letters(one: str, other: str) -> int:
    """How many letters two names have in common from their start."""
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(one, other, strict=False)))


def _pair_along_an_axis(array: StoredArray) -> list[Candidate]:
    """Real and imaginary part of an array of floats that has two of them along its last or first axis."""
    shape = array.shape
    if array.dtype.kind != "f" or len(shape) < 3 or array.role:
        return []
    for axis in (len(shape) - 1, 0):
        if shape[axis] == 2 and min(shape[a] for a in range(len(shape)) if a != axis and shape[a] > 1) > 2:
            reason = f"axis {axis} has the size 2, as for real and imaginary part"
            parts = [array.at(axis, index) for index in (0, 1)]
            return [Candidate.of(Component("real", parts[0], reason), Component("imaginary", parts[1], reason))]
    return []


def choose(path: Path, contents: Contents, request: ReadRequest) -> tuple[Candidate, list[Candidate]]:
    """The candidate that is taken, and all candidates.

    Raises UserError where there is none, and for a variable that isn't there.
    """
    candidates = list_candidates(contents)
    if not candidates:
        numbers = ", ".join(list(contents.numbers)[:8])
        found = f"holds no array that could be a hologram{f' (only {numbers})' if numbers else ''}"
        raise UserError(str(path), found, expected="an array with rows and columns")
    if request.variable is None:
        wanted = None if request.quantity in (None, "complex") else request.quantity
        fitting = [c for c in candidates if wanted and [part.role for part in c.components] == [wanted]]
        fitting += [c for c in candidates if wanted and len(c.components) == 1 and c.components[0].role != "complex"]
        return (fitting or candidates)[0], candidates
    return _named(path, candidates, request), candidates


def _named(path: Path, candidates: list[Candidate], request: ReadRequest) -> Candidate:
    """The candidate that the request names; several names with commas are its parts."""
    assert request.variable is not None
    singles = {c.name: c.components[0].array for c in reversed(candidates) if len(c.components) == 1}
    names = [name.strip() for name in request.variable.split(",")]
    arrays = [_find(path, name, singles) for name in names]
    if len(arrays) == 1:
        matching = [c for c in candidates if c.components[0].array.name == arrays[0].name]
        return next((c for c in matching if len(c.components) > 1 and c.name == request.variable), matching[0])
    roles: tuple[str, ...] = request.parts or tuple(name_role(name) for name in names)
    if len(roles) != len(arrays):
        found = f"{len(roles)} parts for {len(arrays)} variables"
        raise UserError("parts", found, expected="one part for each variable, such as real,imaginary")
    return Candidate.of(*(Component(role, array, "as given") for role, array in zip(roles, arrays, strict=True)))


def _find(path: Path, name: str, arrays: dict[str, StoredArray]) -> StoredArray:
    exact = arrays.get(name)
    if exact is not None:
        return exact
    alike = [a for key, a in arrays.items() if key.lower() == name.lower() or key.rpartition(".")[2] == name]
    if len(alike) == 1:
        return alike[0]
    raise UserError(str(path), f'has no variable "{name}"', remedy=suggest_matches(name, arrays))
