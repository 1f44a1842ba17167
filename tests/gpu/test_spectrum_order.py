"""Which frequencies of a line are stored: a band and as little else as possible, each at one position."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.light.gpu.device import Device
from holoview.light.gpu.fft_codegen import radices
from holoview.light.gpu.recorder import CommandRecorder, Dispatch
from holoview.light.gpu.shader import GeneratedWgsl, link
from holoview.light.gpu.spectrum_order import Range, SpectrumOrder, covered_digits
from holoview.light.numerics.sampling import frequency_indices

BANDS: list[tuple[int, Range | None]] = [
    (1, None),
    (15, None),
    (15, (-2, 2)),
    (96, (-23, 23)),
    (96, (5, 40)),
    (96, (-48, 47)),
    (1000, (-499, -300)),
    (1280, (-1, 639)),
    (3125, (-7, 1500)),
    (8192, (0, 0)),
]
"""Whole spectra, bands around zero, beside it, up to the highest frequency, wider than half the grid, and of one."""


def _orders(n: int, band: Range | None) -> list[SpectrumOrder]:
    natural = [SpectrumOrder.natural(n, lanes, band) for lanes in (2, 4, 8, 32) if n % lanes == 0]
    return [SpectrumOrder.reversed_order(radices(n), band), *natural]


@pytest.mark.parametrize(("n", "band"), BANDS)
def test_the_stored_frequencies_are_the_band_and_no_digit_besides(n: int, band: Range | None) -> None:
    wanted = frequency_indices(n) if band is None else np.arange(band[0], band[1] + 1)
    for order in _orders(n, band):
        found = order.frequencies()
        assert len(found) == order.count == len(set(found.tolist()))
        assert set(wanted.tolist()) <= set(found.tolist())
        share = n // (order.radices[-1] if order.radices else 1)
        assert order.count <= min(n, share * ((len(wanted) - 1) // share + 2))


def test_a_band_that_fills_whole_digits_stores_nothing_else() -> None:
    assert SpectrumOrder.natural(1024, 8, (-255, 255)).count == 512
    assert SpectrumOrder.reversed_order((32, 24), (-191, 191)).count == 384
    assert covered_digits(1024, 8, (-255, 255)) == (0, 1, 6, 7)
    assert covered_digits(1024, 8, (-600, 600)) == tuple(range(8))


@pytest.mark.gpu
@pytest.mark.parametrize(("n", "band"), BANDS[1:9])
def test_shaders_know_the_frequency_at_each_position_and_its_position(
    device: Device, n: int, band: Range | None
) -> None:
    for order in _orders(n, band)[:2]:
        text = (
            order.frequency_wgsl("frequency")
            + order.position_wgsl("position")
            + "@group(1) @binding(0) var<storage, read_write> found: array<vec3i>;\n"
            "@compute @workgroup_size(1)\n"
            "fn main(@builtin(workgroup_id) id: vec3u) {\n"
            "    let k = frequency(id.x);\n"
            f"    found[id.x] = vec3i(k, i32(position(k)), i32(position(k - {3 * n})));\n"
            "}\n"
        )
        found = device.buffer(16 * order.count, "found")
        pipeline = device.pipeline(link(GeneratedWgsl("frequency", text)))
        recorder = CommandRecorder(device)
        recorder.add(Dispatch.bind(device, pipeline, [[], [found]], (order.count, 1, 1)))
        recorder.submit()
        frequency, position, shifted = device.download(found, np.int32, (order.count, 4))[:, :3].T
        assert np.array_equal(frequency, order.frequencies())
        assert np.array_equal(position, np.arange(order.count))
        assert np.array_equal(shifted, position)
