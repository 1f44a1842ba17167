"""What may be wrong with the modulators and the lasers of the virtual bench in `independent`; by plain numpy alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]

_SHORT_M, _LONG_M = 450e-9, 650e-9  # where exponents of a table are stated


@dataclass(frozen=True)
class CoverGlass:
    """The plate before a modulator, a wedge whose surfaces reflect.

    reflectance: of its surfaces, at the shortest wavelength of visible light (400 nm) and at the longest (700 nm), in
    proportion between. thickness_m: in the modulator's centre. period_px: modulator pixels from one fringe to the next
    at 550 nm. towards_deg: direction across the fringes in which the glass grows thicker, from +x (columns) towards +y
    (rows).
    """

    reflectance: tuple[float, float]
    period_px: float
    towards_deg: float
    thickness_m: float = 0.7e-3

    def transmission(self, shape: tuple[int, int], wavelength_m: float) -> Complex:
        """(y, x) of the pixels: the beam that passes, and the one that is reflected twice before it does."""
        rows, columns = shape
        y, x = np.mgrid[:rows, :columns] - np.array([rows - 1, columns - 1]).reshape(2, 1, 1) / 2
        angle = np.radians(self.towards_deg)
        index = 1.5046 + 4200e-18 / wavelength_m**2  # Cauchy's formula, crown glass
        round_trip = 2 * index * self.thickness_m + (x * np.cos(angle) + y * np.sin(angle)) / self.period_px * 550e-9
        weak = np.interp(wavelength_m, (400e-9, 700e-9), self.reflectance)
        return np.asarray(1 + weak * np.exp(2j * np.pi * round_trip / wavelength_m))


@dataclass(frozen=True)
class Dead:
    """Pixels that a driver no longer reaches: so many rows and columns from the first ones, None: all to the end.

    level: what they show, in levels of the table, between two of them too. None: what they were sent last before the
    driver failed, the first patterns of the session. is_late: instead, what was sent for the capture before. flickers:
    instead, levels at random, others in each capture.
    """

    first_row: int = 0
    rows: int | None = None
    first_column: int = 0
    columns: int | None = None
    level: float | None = 0.0
    is_late: bool = False
    flickers: bool = False

    def shown(self, levels: Floats, before_failure: Floats, before: Floats) -> Floats:
        """The levels (y, x) with those of the dead pixels."""
        changed = levels.astype(float)
        y, x = (
            slice(first, None if count is None else first + count)
            for first, count in ((self.first_row, self.rows), (self.first_column, self.columns))
        )
        changed[y, x] = before_failure[y, x] if self.level is None else self.level
        changed[y, x] = before[y, x] if self.is_late else changed[y, x]
        if self.flickers:
            rng = np.random.default_rng(int(np.square(levels.cumsum()).sum()) % 2**32)
            changed[y, x] = rng.uniform(0.0, levels.max(), changed[y, x].shape)
        return changed


@dataclass(frozen=True)
class ModulatorFaults:
    """Pairs are those of modulators 1 and 2 unless stated otherwise. Everything as it stands here: no fault.

    exponents: the table's exponent at 450 nm and at 650 nm of each modulator, in proportion to the wavelength between.
    wedge: by how much the stroke of each grows from its left to its right edge, as a share. bow: by how much it is
    larger in the corners than in the centre, as a share. glass: before each, None where nothing is reflected. dead:
    what of each no longer follows.
    """

    exponents: tuple[tuple[float, float], tuple[float, float]] = ((1.0, 1.0), (1.0, 1.0))
    wedge: tuple[float, float] = (0.0, 0.0)
    bow: tuple[float, float] = (0.0, 0.0)
    glass: tuple[CoverGlass | None, CoverGlass | None] = (None, None)
    dead: tuple[tuple[Dead, ...], tuple[Dead, ...]] = ((), ())

    def shown(self, levels: Floats, before_failure: Floats, before: Floats) -> Floats:
        """What both show of what they are sent, (modulator, y, x), in levels."""
        for number, parts in enumerate(self.dead):
            for part in parts:
                levels = levels.astype(float)
                levels[number] = part.shown(levels[number], before_failure[number], before[number])
        return levels

    def path(self, number: int, share: Floats, opd_m: float, wavelength_m: float) -> Floats:
        """The optical path of pixels (y, x) of modulator 0 or 1 that are sent `share` of the full drive."""
        rows, columns = share.shape
        y, x = np.mgrid[:rows, :columns] - np.array([rows - 1, columns - 1]).reshape(2, 1, 1) / 2
        short, long = self.exponents[number]
        exponent = short + (long - short) * (wavelength_m - _SHORT_M) / (_LONG_M - _SHORT_M)
        corner = (rows / 2) ** 2 + (columns / 2) ** 2
        stroke = 1 + self.wedge[number] * x / columns + self.bow[number] * (x**2 + y**2) / corner
        return opd_m * stroke * share**exponent


_SOURCE_POINTS = 37


@dataclass(frozen=True)
class LightFaults:
    """second_mode: power relative to that of the first, and how much longer its wavelength is (m). turned_deg: angle
    between the plane in which light is polarised and that in which liquid crystals act. source_rad: angular radius of a
    disc of mutually incoherent light.
    """

    second_mode: tuple[float, float] = (0.0, 0.0)
    turned_deg: float = 0.0
    source_rad: float = 0.0

    def directions(self) -> list[tuple[float, float]]:
        """Tilts (y, x) of waves that add in intensity, all of the same power: a sunflower's seeds."""
        count = _SOURCE_POINTS if self.source_rad else 1
        n = np.arange(count) + 0.5
        radius, angle = self.source_rad * np.sqrt(n / count), math.pi * (3 - math.sqrt(5)) * n
        return list(zip((radius * np.sin(angle)).tolist(), (radius * np.cos(angle)).tolist(), strict=True))

    def components(self, wavelength_m: float) -> list[tuple[float, float, bool]]:
        """What adds in intensity: (power, wavelength, whether the modulators act on it)."""
        relative, longer = self.second_mode
        across = np.sin(np.radians(self.turned_deg)) ** 2
        found = []
        for power, line in ((1.0, wavelength_m), (relative, wavelength_m + longer)):
            found += [(power * (1 - across), line, True), (power * across, line, False)]
        return [component for component in found if component[0] > 0]
