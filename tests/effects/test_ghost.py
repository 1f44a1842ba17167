"""A point gets a weak companion, between pixels too."""

from __future__ import annotations

import pytest
import torch

from holoview.light.model.effects.hook_contexts import CameraContext
from holoview.light.model.effects.registry import get_effect


def test_a_copy_lies_beside_the_picture() -> None:
    image = torch.zeros(20, 20).double()
    image[10, 10] = 100.0
    effect = get_effect("ghost")
    found = effect.image(
        image,
        CameraContext(4e-6, (20, 20)),
        effect.parameter_values({"strength": 0.1, "shift_y": 3.0, "shift_x": -2.5}),
    )
    assert float(found[10, 10]) == 100.0
    assert found[13, 7:9].tolist() == pytest.approx([5.0, 5.0])
    assert float(found.sum()) == pytest.approx(110.0)
