"""Which maps captures can determine, and where on a relay's pupil they lie."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch

from holoview.bench.calibrate.train import map_layout_for
from holoview.light.model.bench_parts import Relay
from holoview.light.model.effects.hook_contexts import RelayContext
from holoview.light.model.effects.learned_maps import LearnedMaps
from tests.captures.conftest import pictures

LONGEST, PITCH = 600e-9, 8e-6  # of the pictures, which have samples of half a pixel


@pytest.mark.parametrize(
    ("relay", "radius"),
    [
        (Relay(iris_na=0.03), 0.03),
        (Relay(square=0.02), math.sqrt(2) * 0.02),
        (Relay(square="first order"), math.sqrt(2) * LONGEST / (2 * PITCH)),
        (Relay(square="first order at 500 nm"), math.sqrt(2) * 500e-9 / (2 * PITCH)),
        (Relay(iris_na=0.03, square="first order", centre_na=(0.0, 0.01)), 0.03),
        (Relay(dc_block_na=0.001), math.sqrt(2) * LONGEST / PITCH),
        (Relay(), math.sqrt(2) * LONGEST / PITCH),
    ],
    ids=lambda value: "" if isinstance(value, float) else None,
)
def test_maps_of_a_relay_end_where_light_of_every_wavelength_ends(relay: Relay, radius: float) -> None:
    captures = dataclasses.replace(pictures(), relay1=relay)
    layout = map_layout_for(captures, captures.wavelength_m.argsort())
    assert (layout.sine1, layout.sine2) == (pytest.approx(radius), 0.03)


@pytest.mark.long
def test_maps_are_centred_where_the_stops_are() -> None:
    layout = map_layout_for(pictures(), pictures().wavelength_m.argsort())
    generator = torch.Generator().manual_seed(0)
    learned = LearnedMaps(
        layout,
        {
            name: 1e-2 * torch.randn(shape, generator=generator, dtype=torch.float64)
            for name, shape in layout.shapes().items()
        },
    )
    sine = torch.linspace(-0.029, 0.029, 25, dtype=torch.float64)
    centre = (0.004, -0.01)
    middle = RelayContext(1, 500e-9, sine[:, None], sine[None], 0.03)
    moved = RelayContext(1, 500e-9, sine[:, None] + centre[0], sine[None] + centre[1], 0.03, centre)
    for quantity in (learned.relay_opd, learned.relay_amplitude):
        torch.testing.assert_close(quantity(moved), quantity(middle))
        assert float(quantity(middle).std()) > 0
