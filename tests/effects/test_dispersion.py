"""The path grows by `slope` for each 100 nm below 550 nm."""

from __future__ import annotations

import pytest
import torch

from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.light.model.effects.registry import get_effect


@pytest.mark.parametrize(("wavelength_m", "factor"), [(550e-9, 1.0), (450e-9, 1.1 + 0.02), (650e-9, 0.9 + 0.02)])
def test_the_path_depends_on_the_wavelength(wavelength_m: float, factor: float) -> None:
    effect, at = get_effect("dispersion"), ModulatorContext(1, wavelength_m, 780e-9, 8e-6, (1, 1), 2)
    found = effect.optical_path(
        torch.tensor([[500e-9]]).double(), at, effect.parameter_values({"slope": 0.1, "curvature": 0.02})
    )
    assert float(found) == pytest.approx(500e-9 * factor)
