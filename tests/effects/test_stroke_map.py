"""The path is the nominal one times 1 plus Zernike terms over the circle around the modulator."""

from __future__ import annotations

import pytest
import torch

from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.light.model.effects.registry import get_effect

SHAPE = (30, 40)
CORNER_PX = 25.0  # half the diagonal of 30 × 40 pixels


def _path(number: int = 0, **values: float) -> torch.Tensor:
    effect = get_effect("stroke_map")
    at = ModulatorContext(number, 520e-9, 780e-9, 8e-6, SHAPE, 2)
    return effect.optical_path(torch.full(SHAPE, 400e-9, dtype=torch.float64), at, effect.parameter_values(values))


def test_a_wedge_raises_the_stroke_along_x() -> None:
    x = torch.arange(40).double() - 19.5
    expected = 400e-9 * (1 + 0.05 * 2 * x / CORNER_PX)
    torch.testing.assert_close(_path(z2_1=0.05), expected.expand(SHAPE), rtol=1e-12, atol=0)


def test_a_bow_raises_it_towards_the_corners() -> None:
    y, x = torch.arange(30).double()[:, None] - 14.5, torch.arange(40).double() - 19.5
    expected = 400e-9 * (1 + 0.05 * 3**0.5 * (2 * (y**2 + x**2) / CORNER_PX**2 - 1))
    torch.testing.assert_close(_path(z4_1=0.05), expected, rtol=1e-12, atol=0)


def test_what_has_no_path_gets_none() -> None:
    """Which tells it from a wavefront, `slm_flatness`."""
    effect, at = get_effect("stroke_map"), ModulatorContext(0, 520e-9, 780e-9, 8e-6, SHAPE, 2)
    assert not effect.optical_path(torch.zeros(SHAPE), at, effect.parameter_values({"z3_1": 0.2})).any()


@pytest.mark.parametrize("noll", range(1, 7))
def test_each_modulator_has_its_own_map(noll: int) -> None:
    values = {f"z{noll}_2": 0.05}
    assert torch.equal(_path(0, **values), torch.full(SHAPE, 400e-9, dtype=torch.float64))
    assert bool((_path(1, **values) != 400e-9).any())
