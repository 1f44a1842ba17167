"""Sets of lasers at a spacing, as changes of a bench: a row about 550 nm, or three groups about primaries."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

ROW_MIDDLE_NM = 550.0
PRIMARIES_NM = (460.0, 532.0, 638.0)
GROUP_SIZE = 3


def row_of_lasers(count: int, spacing_nm: float) -> dict[str, Any]:
    """Lasers spaced evenly about the middle wavelength, and a monochrome camera, for which all count alike."""
    return {**_lasers(ROW_MIDDLE_NM + _about_zero(count, spacing_nm)), "observer": "mono"}


def groups_of_lasers(spacing_nm: float) -> dict[str, Any]:
    """Three lasers spaced evenly about each primary, which show any colour that the primaries show."""
    return _lasers(np.concatenate([primary + _about_zero(GROUP_SIZE, spacing_nm) for primary in PRIMARIES_NM]))


def _lasers(wavelengths_nm: NDArray[np.float64]) -> dict[str, Any]:
    return {"wavelengths": (wavelengths_nm * 1e-9).tolist(), "amplitudes": [[1.0] * len(wavelengths_nm)]}


def _about_zero(count: int, spacing_nm: float) -> NDArray[np.float64]:
    return np.asarray(spacing_nm * (np.arange(count) - (count - 1) / 2), dtype=np.float64)
