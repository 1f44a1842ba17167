"""Intensities are spread over buffers that the device can hold; those beyond the budget share one region."""

from __future__ import annotations

import pytest

from holoview.light.engine.compositor import Compositor
from holoview.light.engine.fused import IntensityMemory
from holoview.light.gpu.device import Device

pytestmark = pytest.mark.gpu

SHAPE = (16, 16)
INTENSITY_BYTES = 16 * 16 * 4
KEYS = [(frame, wavelength) for frame in range(2) for wavelength in range(4)]


def _compositor(device: Device, buffer_bytes: int) -> Compositor:
    limits = {"max-storage-buffer-binding-size": buffer_bytes, "max-buffer-size": buffer_bytes}
    return Compositor(Device(device.raw, device.info, {**device.limits, **limits}), SHAPE)


def test_intensities_that_exceed_one_buffer_are_spread_over_several(device: Device) -> None:
    cache = IntensityMemory(_compositor(device, 5 * INTENSITY_BYTES), KEYS, max_wavelengths=2, budget_bytes=2**20)
    assert [buffer.nbytes for buffer in cache.buffers] == [4 * INTENSITY_BYTES] * 2
    regions = {(id(cache.region(key).buffer), cache.region(key).first) for key in KEYS}
    assert len(regions) == len(KEYS) and all(cache.is_resident(key) for key in KEYS)
    first, next_one = cache.region((1, 2)), cache.region((1, 3))
    assert first.buffer is next_one.buffer and next_one.first == first.first + 1  # one dispatch may compute both


def test_intensities_beyond_the_budget_share_one_region(device: Device) -> None:
    cache = IntensityMemory(_compositor(device, 2**20), KEYS, max_wavelengths=1, budget_bytes=3 * INTENSITY_BYTES + 1)
    assert [cache.is_resident(key) for key in KEYS] == [True] * 3 + [False] * 5
    assert len({cache.region(key).buffer for key in KEYS[3:]}) == 1
    assert cache.memory_bytes == 3 * INTENSITY_BYTES
