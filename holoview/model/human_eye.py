"""Published formulas of the human eye: its chromatic aberration, and the size of its pupil."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SLOPE, _POLE_NM = 633.46, 214.102  # dioptres · nm, nm


def chromatic_refraction(wavelength_m: Any) -> Floats:
    """Refraction Rx of the chromatic eye in dioptres, zero near 590 nm: use differences only.

    wavelength_m: a number or an array.

    >>> import holoview as hv
    >>> round(float(hv.chromatic_refraction(400e-9) - hv.chromatic_refraction(589e-9)), 2)
    -1.72
    """
    return np.asarray(1.68524 - _SLOPE / (np.asarray(wavelength_m, dtype=np.float64) * 1e9 - _POLE_NM))


def refraction_slope(wavelength_m: float) -> float:
    """Derivative of `chromatic_refraction` with respect to the wavelength, dioptres a metre."""
    return _SLOPE * 1e9 / (wavelength_m * 1e9 - _POLE_NM) ** 2


def natural_pupil_diameter(luminance: float, area_deg2: float, age: float = 30.0) -> float:
    """Diameter (m) of the pupils of a viewer who adapts to a uniform field with both eyes.

    luminance: cd/m². area_deg2: of the field, square degrees. age: years, 20 to 83.

    Watson & Yellott, J. Vis. 12(10), 12 (2012), eq. 21: the unified formula, from that of Stanley & Davies.

    >>> import holoview as hv
    >>> [round(hv.natural_pupil_diameter(L, 3600.0, 28.58) * 1e3, 2) for L in (0.01, 1.0, 100.0)]
    [7.06, 5.02, 2.82]
    """
    flux = (luminance * area_deg2 / 846) ** 0.41
    young_mm = 7.75 - 5.75 * flux / (flux + 2)
    return 1e-3 * float(young_mm + (age - 28.58) * (0.02132 - 0.009562 * young_mm))
