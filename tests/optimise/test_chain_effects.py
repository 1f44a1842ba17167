"""Chains with each effect of the library on each of their elements are optimised for what `hv.simulate` shows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import holoview as hv
from holoview.holograms.optimise.chain_loop import ChainProblem
from holoview.holograms.optimise.lasers import changes_lasers
from holoview.light.model.system import System
from tests.effects.test_on_element import ELEMENTS, NO_DISTANCE, UNKNOWN, effect_cases, with_effect
from tests.explored import one_of_each
from tests.optimise.chain_slopes import free_drives, slope_along

UM, MM, NM = 1e-6, 1e-3, 1e-9


def _pixels(name: str, kind: str, **keys: Any) -> dict[str, Any]:
    return {"name": name, "kind": kind, "pitch": 8 * UM, "shape": (12, 16)} | keys


CHAINS: dict[str, list[dict[str, Any]]] = {
    "one after the other": ELEMENTS,
    "arms, and a Fourier plane": [
        _pixels("one", "phase", stroke=800 * NM),
        _pixels("two", "complex", beside="one"),
        {"name": "way", "kind": "space", "distance": 1 * MM, "iris_na": 0.03},
        {"name": "lens", "kind": "lens", "focal_length": 20 * MM, "abbe": 40.0},
        {"name": "fourier", "kind": "fourier", "focal_length": 1.25 * MM},
        _pixels("static", "phase", stroke=700 * NM, shared=True),
        _pixels("cells", "amplitude"),
        {"name": "last", "kind": "space", "iris_na": 0.04},
    ],
}
CASES = [
    (chain, *case)
    for chain, elements in CHAINS.items()
    for case in effect_cases(elements)
    if case[0] not in UNKNOWN and case != NO_DISTANCE
]


def bench_with_effect(chain: str, name: str, element: str) -> System:
    """A chain with an effect."""
    plain = System([532 * NM, 580 * NM], [[1.0, 0.5], [0.5, 1.0]], elements=CHAINS[chain], planes_m=[3 * MM, 4 * MM])
    system = with_effect(plain, name, element)
    if name == "misplaced" and chain != "one after the other":  # no space is beside these elements
        return system.edit({f"effects.misplaced@{element}.shift_z": 0.0})
    return system


def _patterns(system: System, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """In float32 and complex64. No two phases or amplitudes of a pattern are equal, and none is a multiple of 1/15:
    there `fringing` and `lut` have kinks."""
    patterns = {}
    for name, drive in hv.random_drive(system, seed=2).items():
        own, n = drive * np.float32(0.8), drive[0].size
        if not np.iscomplexobj(drive):
            values = 0.8 * (np.arange(n) + 0.5) / n
            own = np.stack([rng.permutation(values) for _ in drive]).reshape(drive.shape).astype(np.float32)
        patterns[name] = own
    return patterns


@pytest.mark.parametrize(("chain", "name", "element"), one_of_each(CASES, 1))
def test_a_chain_is_optimised_for_its_effects(chain: str, name: str, element: str) -> None:
    system, rng = bench_with_effect(chain, name, element), np.random.default_rng(1)
    stack = rng.random((2, *system.way.shape, 3)).astype(np.float32)
    if changes_lasers(system, system.effect_values):
        with pytest.raises(hv.UserError, match=rf"effects\.{name}: splits lasers"):
            next(iter(hv.iterate(system, stack, hv.Settings(iterations=1))))
        return
    problem = ChainProblem(system, stack, hv.Settings(eyebox=0.01), double=True)
    patterns = _patterns(system, rng)
    drives, ways = free_drives(patterns, rng)
    found, seen = (
        problem.evaluate(drives, system.amplitudes),
        hv.simulate(system, patterns, backend="torch64").intensity,
    )
    own = np.zeros_like(seen)
    for (frame, laser), intensity in zip(problem.lasers, found.intensity.detach().numpy(), strict=True):
        own[:, laser] += system.amplitudes[frame, laser] * intensity
    np.testing.assert_allclose(own, seen, atol=1e-12 * seen.max())  # sums of 1e4 numbers in float64

    along, loss = slope_along(problem, system, drives, ways)
    h = 1e-6  # the loss, about 0.1, is true to 1e-15; phases change by 1e-5, the error is the square of this
    measured = float((loss(h) - loss(-h)).detach()) / (2 * h)
    assert along == pytest.approx(measured, rel=1e-6, abs=1e-9)

    *_, last = hv.iterate(system, stack, hv.Settings(iterations=1), start=patterns)
    error = (np.clip(hv.simulate(last.best, backend="torch64").rgb, 0, 1) - stack) ** 2
    assert last.best_psnr_db == pytest.approx(float(np.mean(-10 * np.log10(error.mean(axis=(1, 2, 3))))), abs=1e-3)
