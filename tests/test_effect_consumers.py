"""Every effect is the same in all parts of the program that show a bench, as `benchmarks.effect_consumers` measures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

import holoview as hv
from benchmarks.effect_consumers import Consumer, benches, consumers, deviation, measured, shown_by, values_of
from holoview.light.model.effects.registry import ActiveEffects, listed_effects
from holoview.light.model.system import System
from tests.chromium import needs_chromium
from tests.explored import explored

pytestmark = [pytest.mark.gpu, needs_chromium]

# float32 rounds each of some ten operations of a transform by 2⁻²⁴, and shaders evaluate phases to 4e-7 rad (parity);
# float64 rounds phases of up to 1e4 turns to 1e-11 of a turn where a test sums plain Fourier series.
SINGLE, DOUBLE, SERIES = 2e-6, 1e-12, 1e-10
TOLERANCES = {
    "torch": SINGLE,
    "wgpu": SINGLE,
    "field_at": SERIES,
    "point_light": DOUBLE,
    "sections": SINGLE,
    "optimiser": DOUBLE,
    "captures": DOUBLE,
    "edits": SINGLE,
    "page": SINGLE,
}
TOGETHER = ["second_line+laser_power+distance", "polarisation+wavelength_offset+gap"]

Kinds = dict[str, tuple[System, Any]]


@pytest.fixture(scope="module")
def kinds() -> Kinds:
    """The benches by name, with their patterns."""
    return benches()


@pytest.fixture(scope="module")
def opened() -> Iterator[dict[str, Consumer]]:
    """All consumers by name."""
    with consumers() as found:
        yield found


BY_DEFAULT = ("lut", "ambient", "gap")
"""Levels, light beside, lengths; runs that explore take all. Other tests compare executors for every effect."""


@pytest.mark.parametrize("effect", explored([*listed_effects(), *TOGETHER], BY_DEFAULT))
def test_an_effect_is_the_same_everywhere(effect: str, kinds: Kinds, opened: dict[str, Consumer]) -> None:
    assert opened.keys() == TOLERANCES.keys()
    wrong, changes, active = {}, [0.0], ActiveEffects({name: dict(values_of(name)) for name in effect.split("+")})
    for kind, (system, drive) in kinds.items():
        shown = shown_by(system, drive, effect)
        if shown is None:
            continue
        for name, consumer in opened.items():
            found = measured(consumer, shown)
            if found is not None and not found <= TOLERANCES[name]:
                wrong[kind, name] = found
        if shown.view is not None:
            changes.append(deviation(shown.view.xyz, hv.simulate(system, drive, backend="torch64").xyz))
    assert not wrong
    assert max(changes) > 1e-3 or active.camera_effects(), "an effect that changes nothing tests nothing"
