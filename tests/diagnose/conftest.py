"""Captures for tests of the parts (pictures of noise, no optics) and benches for those of the whole."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from holoview.captures.dataset import Camera, Captures, SlmSpec
from holoview.captures.patterns import pattern_roughness
from holoview.captures.prepared_captures import prepare_captures
from holoview.captures.virtual_measurement import AcquisitionSettings
from holoview.captures.virtual_measurement import make_captures as measure
from holoview.diagnose.capture_split import split_captures
from holoview.diagnose.extended_model import PredictorWithKnownEffects
from holoview.diagnose.search_context import PerThreadPredictor, SearchContext, equivalent_effects
from holoview.diagnose.worker_pool import WorkerPool
from holoview.model.effects.registry import listed_effects
from holoview.model.system import Modulator, Relay, System

MakeBench = Callable[..., SearchContext]

SHAPE = (32, 40)


def small_system(modulators: int = 2, **changes: Any) -> System:
    """Modulators of 32 × 40 pixels and 16 levels, two wavelengths, one plane."""
    panel = Modulator(pitch_m=8e-6, shape=SHAPE, stroke_m=825e-9, levels=16)
    two = modulators == 2
    plain = System(
        wavelengths_m=np.array([450e-9, 600e-9]),
        amplitudes=np.ones((1, 2)),
        modulators=(panel,) * modulators,
        gap_m=1e-3 if two else None,
        planes_m=np.array([4e-3]),
        relay1=Relay(iris_na=0.03 if two else None),
        relay2=Relay(iris_na=0.03),
        observer="mono",
    )
    return plain.edit(changes) if changes else plain


def pictures(count: int = 4, seed: int = 0, **changes: Any) -> Captures:
    """Captures whose pictures are independent random numbers; wavelengths take turns."""
    rng = np.random.default_rng(seed)
    plain = Captures(
        levels=rng.integers(0, 16, (count, 2, *SHAPE), dtype=np.uint8),
        images=rng.integers(200, 1500, (count, 2 * SHAPE[0], 2 * SHAPE[1])).astype(np.uint16),
        wavelength_m=np.resize([450e-9, 600e-9], count),
        distance_m=np.full(count, 4e-3),
        power=np.ones(count),
        exposure_s=np.ones(count),
        slms=(SlmSpec(8e-6, 16, 825e-9),) * 2,
        camera=Camera(4e-6, 12, 4.0, 3.0, 64.0),
        gap_m=1e-3,
        iris1_na=0.03,
        iris2_na=0.03,
    )
    return dataclasses.replace(plain, **changes)


@pytest.fixture
def make_captures() -> Callable[..., Captures]:
    """Pictures of random numbers."""
    return pictures


@pytest.fixture(scope="session")
def nominal() -> Captures:
    """A small session of a bench without faults."""
    return measure(small_system(), {}, AcquisitionSettings(captures_per_condition=6, seed=5))


@pytest.fixture(scope="session")
def bench(nominal: Captures) -> SearchContext:
    """What a search would work with on these captures."""
    return _bench(nominal)


@pytest.fixture
def make_bench() -> MakeBench:
    """What a search would work with on captures of a small session with faults {effect: {parameter: value}}."""
    return lambda faults=None: _bench(
        measure(small_system(), faults or {}, AcquisitionSettings(captures_per_condition=6, seed=5))
    )


def _bench(captures: Captures) -> SearchContext:
    effects, facts = dict(listed_effects()), captures.data_properties()
    return SearchContext(
        data=prepare_captures(captures),
        system=captures.nominal_system(),
        effects=effects,
        split=split_captures(captures, pattern_roughness(captures)),
        predictor=PerThreadPredictor(partial(PredictorWithKnownEffects, captures, {})),
        workers=WorkerPool(1),
        equivalents=equivalent_effects(effects, facts),
    )
