"""Effects that change a length of the bench, beside a program that shares no code with the product."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from holoview.bench.captures.predictor import Predictor
from tests.diagnose.independent import Faults, Laboratory, intensity
from tests.effects.conftest import PITCH, SHAPE, session

BENCH = Laboratory(shape=SHAPE, pitch_m=PITCH, opd_m=780e-9, gap_m=1e-3, distance_m=3e-3, fine=2)
PROGRAMS_DIFFER = 0.04
"""Relative, r.m.s.: by band limits and the cut of stops. Seen: 2.2 to 2.6 % on five benches."""


def _deviation(found: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """Relative, r.m.s., up to a factor."""
    factor = (found * expected).sum() / np.square(expected).sum()
    return float(np.linalg.norm(found - factor * expected) / np.linalg.norm(found))


@pytest.mark.parametrize(
    ("effect", "values", "faults", "longer_m"),
    [
        ("gap", {"gap_error": 3e-4}, Faults(gap_m=3e-4), 0.0),
        ("distance", {"distance_error": 3e-4}, Faults(distance_m=3e-4), 0.0),
        ("wavelength_offset", {"offset": 15e-9}, Faults(), 15e-9),
    ],
)
def test_a_length_that_is_wrong_is_that_length_for_another_program(
    effect: str, values: dict[str, float], faults: Faults, longer_m: float
) -> None:
    captures = session()
    predictor = Predictor(captures, double_precision=True, padding=3)
    laboratory = dataclasses.replace(BENCH, faults=faults)
    wavelength_m = float(captures.wavelength_m[0]) + longer_m
    expected = np.stack([intensity(laboratory, levels.astype(float), wavelength_m) for levels in captures.levels])
    wrong, nominal = (predictor(range(len(captures)), on).signal.numpy() for on in ({effect: values}, {}))
    assert _deviation(wrong, expected) < PROGRAMS_DIFFER < _deviation(nominal, expected) / 3
