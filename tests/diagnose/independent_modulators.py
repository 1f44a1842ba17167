"""What may be wrong with the modulators and the lasers of the virtual bench in `independent`; by plain numpy alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SHORT_M, _LONG_M = 450e-9, 650e-9  # where exponents of a table are stated


@dataclass(frozen=True)
class ModulatorFaults:
    """Pairs are those of modulators 1 and 2 unless stated otherwise. Everything as it stands here: no fault.

    exponents: the table's exponent at 450 nm and at 650 nm of each modulator, in proportion to the wavelength between.
    wedge: by how much the stroke of each grows from its left to its right edge, as a share. bow: by how much it is
    larger in the corners than in the centre, as a share.
    """

    exponents: tuple[tuple[float, float], tuple[float, float]] = ((1.0, 1.0), (1.0, 1.0))
    wedge: tuple[float, float] = (0.0, 0.0)
    bow: tuple[float, float] = (0.0, 0.0)

    def path(self, number: int, share: Floats, opd_m: float, wavelength_m: float) -> Floats:
        """The optical path of pixels (y, x) of modulator 0 or 1 that are sent `share` of the full drive."""
        rows, columns = share.shape
        y, x = np.mgrid[:rows, :columns] - np.array([rows - 1, columns - 1]).reshape(2, 1, 1) / 2
        short, long = self.exponents[number]
        exponent = short + (long - short) * (wavelength_m - _SHORT_M) / (_LONG_M - _SHORT_M)
        corner = (rows / 2) ** 2 + (columns / 2) ** 2
        stroke = 1 + self.wedge[number] * x / columns + self.bow[number] * (x**2 + y**2) / corner
        return opd_m * stroke * share**exponent


@dataclass(frozen=True)
class LightFaults:
    """second_mode: power relative to that of the first, and how much longer its wavelength is (m). turned_deg: angle
    between the plane in which light is polarised and that in which liquid crystals act.
    """

    second_mode: tuple[float, float] = (0.0, 0.0)
    turned_deg: float = 0.0

    def components(self, wavelength_m: float) -> list[tuple[float, float, bool]]:
        """What adds in intensity: (power, wavelength, whether the modulators act on it)."""
        relative, longer = self.second_mode
        across = np.sin(np.radians(self.turned_deg)) ** 2
        found = []
        for power, line in ((1.0, wavelength_m), (relative, wavelength_m + longer)):
            found += [(power * (1 - across), line, True), (power * across, line, False)]
        return [component for component in found if component[0] > 0]
