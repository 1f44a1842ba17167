"""The records of captures that can be wrong, and their corrections.

A correction names one wrong record and puts the captures right:

    SlmExchange, SlmInversion            patterns of the other modulator; inverted levels
    SlmOrientation, CameraOrientation    patterns or pictures that are mirrored or turned
    PatternOffset                        patterns out of step with their pictures
    ValueOrder, ColumnReversal           wavelengths or distances of other captures
    WrongUnit                            wavelengths or distances in a wrong unit
    `power_order.PowerOrder`             powers of other captures

Corrections are applied together in the order of `ORDER`: the exchange of the modulators' patterns is undone first, so
that "modulator 1" means modulator 1 of the bench in every other correction. `single_corrections` and `pairs` list the
corrections that are tried for given captures.
"""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.dataset import ORIENTATIONS, SHAPE_KEEPING, Captures, Floats, undone
from holoview.bench.captures.validation import check_captures, check_lengths
from holoview.util.errors import UserError

ORDER = (
    "slm_exchange",
    "slm1_orientation",
    "slm2_orientation",
    "camera_orientation",
    "slm1_inverted",
    "slm2_inverted",
    "inverted",
    "capture_order",
    "wavelength_order",
    "distance_order",
    "power_order",
)
"""The ids of all kinds of wrong records; of an element of a chain its name follows, as in "inverted@coarse"."""


class Words(NamedTuple):
    """The name of a wrong record: see the properties of `Correction`."""

    effect: str
    choice: str
    sentence: str


@dataclass(frozen=True)
class Correction(ABC):
    """A wrong record that can be put right. Instances are small and comparable."""

    @abstractmethod
    def words(self) -> Words:
        """The name of the wrong record."""

    @abstractmethod
    def apply(self, captures: Captures) -> Captures:
        """The captures with this record put right."""

    @property
    def effect(self) -> str:
        """The id of the wrong record."""
        return self.words().effect

    @property
    def kind(self) -> str:
        """The same without the element that it names, one of `ORDER`."""
        return self.effect.partition("@")[0]

    @property
    def choice(self) -> str:
        """The mistake in the records, as a short text; empty where the id says it all."""
        return self.words().choice

    @property
    def sentence(self) -> str:
        """The finding in words."""
        return self.words().sentence

    @property
    def doubt(self) -> str:
        """What is in doubt where captures can't show this mistake: the finding in words, without its size."""
        return self.sentence

    @property
    def label(self) -> str:
        """Id and choice."""
        return f"{self.effect} {self.choice}".strip()


Hypothesis = tuple[Correction, ...]
"""Corrections to be applied together; () leaves the captures as they are recorded."""


def hypothesis(corrections: Iterable[Correction]) -> Hypothesis:
    """The corrections in the order in which they are applied."""
    return tuple(sorted(corrections, key=lambda c: (ORDER.index(c.kind), c.effect)))


def apply_corrections(captures: Captures, corrections: Hypothesis) -> Captures:
    """The captures as they should have been recorded; they don't name the corrections."""
    for correction in corrections:
        captures = correction.apply(captures)
    return captures


def with_levels(captures: Captures, slm: int, levels: NDArray[np.unsignedinteger]) -> Captures:
    """The captures with other patterns (capture, y, x) of modulator `slm`, which counts from 0."""
    changed = captures.levels.copy()
    changed[:, slm] = levels
    return dataclasses.replace(captures, levels=changed)


Images = NDArray[Any]

ORIENTATION_WORDS = {
    "flip_x": "mirrored left to right",
    "flip_y": "upside down (mirrored top to bottom)",
    "rotate_180": "turned by 180°",
    "transpose": "with rows and columns exchanged",
    "rotate_90": "turned by 90° anticlockwise",
    "rotate_270": "turned by 90° clockwise",
    "anti_transpose": "mirrored at the other diagonal",
}
"""Each orientation in words."""


@dataclass(frozen=True)
class SlmOrientation(Correction):
    """The patterns of one modulator are recorded mirrored or turned. slm: 0 or 1."""

    slm: int
    orientation: str

    def words(self) -> Words:
        sentence = f"The patterns of modulator {self.slm + 1} are recorded {ORIENTATION_WORDS[self.orientation]}."
        return Words(f"slm{self.slm + 1}_orientation", self.orientation, sentence)

    def apply(self, captures: Captures) -> Captures:
        return with_levels(captures, self.slm, undone(captures.levels[:, self.slm], self.orientation))


@dataclass(frozen=True)
class CameraOrientation(Correction):
    """The camera's pictures are recorded mirrored or turned."""

    orientation: str

    def words(self) -> Words:
        sentence = f"The camera's pictures are recorded {ORIENTATION_WORDS[self.orientation]}."
        return Words("camera_orientation", self.orientation, sentence)

    def apply(self, captures: Captures) -> Captures:
        return captures.with_pictures(self.undone)

    def undone(self, images: Images) -> Images:
        """Images (…, y, x) the right way up."""
        return undone(images, self.orientation)


def orientation_candidates(captures: Captures) -> list[Correction]:
    """All orientations that the shapes allow.

    A modulator's patterns can be turned by 90° if they are square. The pictures can be turned if they or the modulators
    are square, and on a Fourier bench, where the camera's shape is independent of the modulator's.
    """
    rows, columns = captures.levels.shape[2:]
    of_slms = ORIENTATIONS[1:] if rows == columns else SHAPE_KEEPING[1:]
    square_camera = captures.shape[0] == captures.shape[1]
    of_camera = ORIENTATIONS[1:] if rows == columns or square_camera or captures.is_fourier else SHAPE_KEEPING[1:]
    modulators = range(len(captures.slms) if captures.chain is None else 0)  # a chain's patterns differ in shape
    slms = [SlmOrientation(slm, orientation) for slm in modulators for orientation in of_slms]
    return [*slms, *(CameraOrientation(orientation) for orientation in of_camera)]


@dataclass(frozen=True)
class SlmExchange(Correction):
    """The patterns of the two modulators are exchanged."""

    def words(self) -> Words:
        return Words("slm_exchange", "", "The patterns of the two modulators are exchanged in the records.")

    def apply(self, captures: Captures) -> Captures:
        return dataclasses.replace(captures, levels=captures.levels[:, ::-1])

    def fits(self, captures: Captures) -> bool:
        """False where a modulator lacks the pixels, or the levels, of the other's patterns."""
        if captures.chain is not None and len(set(captures.chain.drive_shapes.values())) > 1:
            return False
        highest = captures.levels.max(axis=(0, 2, 3))[::-1]
        levels = [slm.num_levels for slm in captures.slms]
        return len(levels) == 2 and all(h < n for h, n in zip(highest, levels, strict=True))


@dataclass(frozen=True)
class SlmInversion(Correction):
    """The levels of one modulator are inverted: the highest stands for 0. slm: from 0. element: its name in a chain."""

    slm: int
    element: str = ""

    def words(self) -> Words:
        who = self.element or f"modulator {self.slm + 1}"
        sentence = f"The levels of {who} are recorded inverted: the highest level stands for 0."
        return Words(f"inverted@{self.element}" if self.element else f"slm{self.slm + 1}_inverted", "", sentence)

    def apply(self, captures: Captures) -> Captures:
        levels = captures.levels[:, self.slm]
        return with_levels(captures, self.slm, (captures.slms[self.slm].num_levels - 1 - levels).astype(levels.dtype))


def level_candidates(captures: Captures) -> list[Correction]:
    """The exchange of the patterns, if there are two modulators, and each modulator's inversion."""
    names = [""] * len(captures.slms) if captures.chain is None else list(captures.chain.drive_shapes)
    inversions = [SlmInversion(slm, name) for slm, name in enumerate(names)]
    return [*([SlmExchange()] if SlmExchange().fits(captures) else []), *inversions]


_SETTINGS = ("wavelength_m", "distance_m", "power", "exposure_s")


@dataclass(frozen=True)
class PatternOffset(Correction):
    """Patterns are recorded `offset` captures after their pictures (before them if negative).

    slms: the modulators concerned, from 0. element: the name of the only one in a chain. with_settings: wavelength,
    distance, power and exposure are out of step with the pictures too. wraps: the captures at one end belong to the
    pictures at the other; otherwise these pictures have no pattern in the file, and are left out.
    """

    offset: int
    slms: tuple[int, ...]
    modulators: int
    with_settings: bool = False
    wraps: bool = True
    element: str = ""

    @property
    def is_plain(self) -> bool:
        """Whether it concerns the patterns of all modulators, and nothing else."""
        return not self.with_settings and len(self.slms) == self.modulators

    def words(self) -> Words:
        choice = f"offset:{self.offset:+d}{self._which}{' with settings' * self.with_settings}"
        where = f"capture{'s' * (abs(self.offset) > 1)} {'later' if self.offset > 0 else 'earlier'}"
        ends = "" if self.wraps else " Captures whose pattern isn't in the file are left out."
        sentence = f"{self._who} stand {abs(self.offset)} {where} in the file than their pictures.{ends}"
        return Words("capture_order", choice, sentence)

    @property
    def doubt(self) -> str:
        return f"{self._who} stand some captures earlier or later in the file than their pictures."

    @property
    def _which(self) -> str:
        return f" of {self.element or f'modulator {self.slms[0] + 1}'}" if len(self.slms) < self.modulators else ""

    @property
    def _who(self) -> str:
        settings = ", with their wavelengths, distances, powers and exposures," * self.with_settings
        return f"The patterns{self._which}{settings}"

    def apply(self, captures: Captures) -> Captures:
        levels = captures.levels.copy()
        for slm in self.slms:
            levels[:, slm] = np.roll(levels[:, slm], -self.offset, axis=0)
        changed: dict[str, NDArray[np.generic]] = {"levels": levels}
        if self.with_settings:
            changed |= {name: np.roll(getattr(captures, name), -self.offset) for name in _SETTINGS}
        moved = dataclasses.replace(captures, **changed)  # type: ignore[arg-type]
        return moved if self.wraps else moved.subset(np.flatnonzero(~self.wrapped(len(captures))))

    def wrapped(self, count: int) -> NDArray[np.bool_]:
        """Which of `count` pictures would get a pattern from the other end of the file."""
        source = np.arange(count) + self.offset
        return (source < 0) | (source >= count)

    def without_ends(self) -> PatternOffset:
        """The same offset, but with no pattern for the pictures at the end."""
        return dataclasses.replace(self, wraps=False)


def offset_candidates(captures: Captures, largest: int) -> list[Correction]:
    """Offsets up to ± `largest`: of all patterns, of one modulator's patterns, and of patterns with their settings."""
    modulators = len(captures.slms)
    names = [""] * modulators if captures.chain is None else list(captures.chain.drive_shapes)
    each = [(tuple(range(modulators)), ""), *(((slm,), name) for slm, name in enumerate(names) if modulators > 1)]
    most = min(largest, len(captures) // 2)
    steps = [sign * n for n in range(1, most + 1) for sign in (1, -1)]
    settings_vary = any(len(np.unique(getattr(captures, name))) > 1 for name in _SETTINGS[:2])
    found = [PatternOffset(n, slms, modulators, element=name) for slms, name in each for n in steps]
    if settings_vary:
        found += [PatternOffset(n, each[0][0], modulators, with_settings=True) for n in steps]
    return list(found)


Column = Literal["wavelength", "distance"]
_FIELDS: dict[Column, str] = {"wavelength": "wavelength_m", "distance": "distance_m"}
_SHOWN: dict[Column, tuple[float, str]] = {"wavelength": (1e9, "nm"), "distance": (1e3, "mm")}
_UNITS: dict[Column, tuple[tuple[float, str, str], ...]] = {
    "wavelength": ((1e3, "nm", "µm"), (1e-3, "µm", "nm"), (1e9, "nm", "m"), (1e6, "µm", "m")),
    "distance": ((1e3, "mm", "m"), (1e-3, "m", "mm"), (1e6, "µm", "m")),
}
"""(recorded over true value, the unit meant, the unit taken) of common mistakes."""


def column_values(captures: Captures, column: Column) -> Floats:
    """The distinct values of a column (m) in ascending order."""
    return np.unique(getattr(captures, _FIELDS[column]))


def _replaced(captures: Captures, column: Column, values: Floats) -> Captures:
    return dataclasses.replace(captures, **{_FIELDS[column]: values})  # type: ignore[arg-type]


@dataclass(frozen=True)
class ColumnCorrection(Correction):
    """A correction of one column of the records."""

    column: Column

    def words_of_column(self, choice: str, sentence: str) -> Words:
        """The words with the id of the column's order."""
        return Words(f"{self.column}_order", choice, sentence)


@dataclass(frozen=True)
class ValueOrder(ColumnCorrection):
    """The values of a column are mixed up: where the i-th smallest is recorded, the true value is the p[i]-th smallest.

    permutation: p, counted from 0. values: the distinct values (m), ascending; others stay.
    """

    permutation: tuple[int, ...]
    values: tuple[float, ...]

    def words(self) -> Words:
        is_reversed = self.permutation == tuple(reversed(range(len(self.permutation))))
        choice = "reversed" if is_reversed else f"permutation:{','.join(map(str, self.permutation))}"
        scale, unit = _SHOWN[self.column]
        moved = [
            f"{self.values[i] * scale:.6g} {unit} stands for {self.values[p] * scale:.6g} {unit}"
            for i, p in enumerate(self.permutation)
            if i != p
        ]
        return self.words_of_column(choice, f"The {self.column}s are mixed up in the records: {', '.join(moved)}.")

    def apply(self, captures: Captures) -> Captures:
        values, recorded = np.array(self.values), getattr(captures, _FIELDS[self.column])
        index = np.abs(recorded[:, None] - values[None]).argmin(axis=1)
        moved = values[np.array(self.permutation)[index]]
        return _replaced(captures, self.column, np.where(recorded == values[index], moved, recorded))


@dataclass(frozen=True)
class ColumnReversal(ColumnCorrection):
    """The column stands in the file from the last capture to the first."""

    def words(self) -> Words:
        return self.words_of_column("reversed", f"The {self.column}s are recorded from the last capture to the first.")

    def apply(self, captures: Captures) -> Captures:
        return _replaced(captures, self.column, getattr(captures, _FIELDS[self.column])[::-1].copy())


@dataclass(frozen=True)
class WrongUnit(ColumnCorrection):
    """The numbers of a column were meant in one unit and taken in another.

    factor: recorded value over true value.
    """

    factor: float
    meant: str
    taken: str

    def words(self) -> Words:
        how = f"{self.meant} taken as {self.taken}"
        sentence = (
            f"The {self.column}s are recorded in a wrong unit: numbers in {self.meant} were taken as {self.taken}."
        )
        return self.words_of_column(f"unit:{how}", sentence)

    def apply(self, captures: Captures) -> Captures:
        return _replaced(captures, self.column, getattr(captures, _FIELDS[self.column]) / self.factor)


def unit_candidates(captures: Captures, column: Column) -> list[WrongUnit]:
    """Common mistakes with the unit of a column after which lengths are plausible."""
    found = [WrongUnit(column, *each) for each in _UNITS[column]]
    return [unit for unit in found if _has_plausible_lengths(unit.apply(captures))]


def plausible_units(captures: Captures) -> tuple[WrongUnit, ...]:
    """The units that must be corrected before the captures are plausible; usually none.

    Raises UserError for captures that are impossible for another reason (`check_captures`).
    """
    units = units_of_lengths(captures)
    check_captures(apply_corrections(captures, units))
    return units


def units_of_lengths(captures: Captures) -> tuple[WrongUnit, ...]:
    """As `plausible_units`, for lengths alone. Raises UserError for lengths that no unit makes plausible."""
    units: tuple[WrongUnit, ...] = ()
    if not _has_plausible_lengths(captures):
        of_columns = [[None, *(WrongUnit(column, *each) for each in _UNITS[column])] for column in _UNITS]
        for pair in sorted(product(*of_columns), key=lambda pair: sum(unit is not None for unit in pair)):
            chosen = tuple(unit for unit in pair if unit is not None)
            if _has_plausible_lengths(apply_corrections(captures, chosen)):
                units = chosen
                break
    check_lengths(apply_corrections(captures, units))
    return units


def _has_plausible_lengths(captures: Captures) -> bool:
    try:
        check_lengths(captures)
    except UserError:
        return False
    return True


def cyclic_orders(captures: Captures, column: Column) -> list[ValueOrder]:
    """The cyclic permutations of a column's values, the identity first; together they pair each value with each."""
    values = tuple(column_values(captures, column).tolist())
    n = len(values)
    return [ValueOrder(column, tuple((i + step) % n for i in range(n)), values) for step in range(n)]


def exchanges(captures: Captures, column: Column, indices: Sequence[int]) -> list[Correction]:
    """Each value that these captures have, exchanged with each of the column's other values."""
    values = column_values(captures, column)
    own = set(value_indices(captures, column, indices))
    pairs = {(min(i, j), max(i, j)) for i in own for j in range(len(values)) if i != j}
    found: list[Correction] = []
    for i, j in sorted(pairs):
        order = list(range(len(values)))
        order[i], order[j] = j, i
        found.append(ValueOrder(column, tuple(order), tuple(values.tolist())))
    return found


def value_indices(captures: Captures, column: Column, indices: Sequence[int]) -> list[int]:
    """Which of the column's distinct values each of these captures has."""
    values = column_values(captures, column)
    return [int(np.searchsorted(values, getattr(captures, _FIELDS[column])[k])) for k in indices]


LARGEST_OFFSET = 8
"""[captures] Largest offset between patterns and pictures that is tried. Evidence: none recorded."""

PAIRED_OFFSET = 3
"""[captures] Largest offset that is tried together with another correction; an offset that moves all patterns together
is tried whatever its size. Evidence: the cost."""

COLUMNS: tuple[Column, ...] = ("wavelength", "distance")


def single_corrections(captures: Captures, screened: Sequence[int]) -> list[Correction]:
    """Every correction that these captures can need; of mixed-up columns those that the screened captures see."""
    found = [*orientation_candidates(captures), *level_candidates(captures)]
    found += offset_candidates(captures, LARGEST_OFFSET)
    for column in COLUMNS:
        if len(column_values(captures, column)) > 1:
            found += [*exchanges(captures, column, screened), ColumnReversal(column)]
    return [*found, *unit_candidates(captures, "distance")] if not captures.is_fourier else found


def pairs(singles: Sequence[Correction]) -> list[Hypothesis]:
    """Two corrections of different kinds; of the offsets only small ones, and those of all patterns together."""
    most = PAIRED_OFFSET
    few = [c for c in singles if not isinstance(c, PatternOffset) or c.is_plain or abs(c.offset) <= most]
    return [hypothesis(pair) for pair in combinations(few, 2) if pair[0].effect != pair[1].effect]


def moves_only(corrections: Hypothesis, captures: Captures) -> bool:
    """Whether the corrections of patterns and pictures undo each other, so that they change where the axis lies alone.

    Patterns turned with the pictures predict the same, and in a far field inverted levels turn it by 180°. Only a
    picture beside the axis then moves, which a displaced camera or a tilt does as well.
    """
    turns = [c for c in corrections if isinstance(c, (SlmOrientation, SlmInversion))]
    of_camera = [c for c in corrections if isinstance(c, CameraOrientation)]
    if not turns or captures.chain is not None or not (captures.is_fourier or of_camera):
        return False
    upright = np.arange(4).reshape(2, 2)
    seen = of_camera[0].undone(upright) if of_camera else upright
    for slm in range(captures.levels.shape[1]):
        turned = upright
        for turn in (one for one in turns if one.slm == slm):
            if isinstance(turn, SlmInversion) and not captures.is_fourier:
                return False
            orientation = turn.orientation if isinstance(turn, SlmOrientation) else "rotate_180"
            turned = undone(turned, orientation)
        if not np.array_equal(turned, seen):
            return False
    return True


def preference(corrections: Hypothesis) -> tuple[object, ...]:
    """Sorts explanations that predict alike: fewer corrections first, then modulators before the camera.

    The last part makes the order of equals definite.
    """
    kinds = sorted((ORDER.index(c.kind), c.effect) for c in corrections)
    involved = sum(isinstance(c, PatternOffset) and not c.is_plain for c in corrections)
    reversal = sum(isinstance(c, ColumnReversal) for c in corrections)
    return len(corrections), involved, reversal, kinds, [c.choice for c in corrections]
