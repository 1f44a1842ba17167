"""The digest of the captures in a checkpoint: it belongs to the file format, and tells every bench from every other."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from holoview.bench.calibrate.train import captures_digest
from holoview.bench.captures.dataset import Camera, Captures, SlmSpec
from holoview.light.model.bench_parts import Relay


@pytest.mark.parametrize(
    ("modulators", "digest"),
    [
        (1, "21d1ed42dabc514ba3e0548109ae1f69ae1feede24462aa0b690b9b645ec2b7d"),
        (2, "8b08b70faf5d06e05a2ce47fd48d4d31a67f924bb307f30e3f40c24526d7aaf7"),
    ],
)
def test_the_digest_of_captures_belongs_to_the_file_format(modulators: int, digest: str) -> None:
    assert captures_digest(_captures(modulators)) == digest


def test_every_stop_counts() -> None:
    relays = [
        Relay(),
        Relay(iris_na=0.03),
        Relay(square=0.03),
        Relay(square="first order"),
        Relay(square="first order at 550 nm"),
        Relay(square="first order", centre_na=(0.0, 0.001)),
        Relay(square="first order", centre_na=(0.001, 0.0)),
        Relay(dc_block_na=0.03),
    ]
    both = [{"relay1": first, "relay2": second} for first in relays for second in relays]
    assert len({captures_digest(dataclasses.replace(_captures(2), **changes)) for changes in both}) == len(relays) ** 2


def _captures(modulators: int) -> Captures:
    return Captures(
        levels=np.arange(4 * modulators, dtype=np.uint8).reshape(1, modulators, 2, 2),
        images=np.array([[[100, 200, 300], [400, 500, 600]]], dtype=np.uint16),
        wavelength_m=np.array([5.2e-7]),
        distance_m=np.array([0.01]),
        power=np.array([0.5]),
        exposure_s=np.array([1e-3]),
        slms=(SlmSpec(pitch_m=8e-6, num_levels=256, opd_range_m=6.6e-7),) * modulators,
        camera=Camera(pitch_m=4e-6, bit_depth=12, electrons_per_count=2.5, read_noise=3.0, black_level=64.0),
        gap_m=None if modulators == 1 else 2e-3,
        relay1=Relay(iris_na=None if modulators == 1 else 0.03),
        relay2=Relay(iris_na=0.02),
    )
