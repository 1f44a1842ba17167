"""Chains of elements in compiled passes, against torch's own derivatives of the same stages."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.holograms.optimise.chain_executor import dark_inputs
from holoview.holograms.optimise.chain_loop import ChainProblem
from holoview.holograms.optimise.lasers import changes_lasers
from holoview.holograms.optimise.propagation import TORCH_KERNELS, Kernels
from holoview.holograms.view import random_drive
from holoview.light.engine.torch_executor import TorchField
from holoview.light.model import preset
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from tests.optimise.test_chain_effects import CASES, bench_with_effect
from tests.optimise.test_chain_effects import CHAINS as EVERY_KIND

pytest.importorskip("numba")

from holoview.holograms.optimise.compiled_chain import CompiledChain
from holoview.holograms.optimise.compiled_model import CompiledKernels

UM, MM, NM = 1e-6, 1e-3, 1e-9


def _pixels(kind: str, **keys: Any) -> dict[str, Any]:
    return {"kind": kind, "pitch": 8 * UM, "shape": (12, 16)} | keys


_WAY = {"kind": "space", "distance": 1 * MM, "iris_na": 0.04, "aberration": {"4": "50 nm"}}
CHAINS: dict[str, list[dict[str, Any]]] = {
    **EVERY_KIND,
    "pixels of other pitch beside the axis, and levels": [
        _pixels("phase", stroke=800 * NM, levels=8),
        _WAY,
        _pixels("amplitude", pitch=24 * UM, shape=(3, 4), offset=(4 * UM, -12 * UM), range=[0.1, 0.9]),
        _WAY,
        _pixels("complex", pitch=16 * UM, shape=(5, 6), stroke=600 * NM),
    ],
    "a finer mask": [
        _pixels("phase", stroke=800 * NM, shared=True),
        _pixels("mask", pitch=4 * UM, shape=(24, 32), pattern="random", stroke=500 * NM),
        _pixels("amplitude"),
    ],
    "arms of equal and of other pixels": [
        _pixels("phase", name="one", stroke=800 * NM),
        _pixels("amplitude", name="two", beside="one"),
        _WAY,
        _pixels("phase", name="three", stroke=700 * NM),
        _pixels("amplitude", name="four", beside="three", pitch=16 * UM, shape=(6, 8)),
        _pixels("mask", name="five", beside="three", pattern="random", stroke=300 * NM),
    ],
    "the field before an element that is held": [
        _pixels("phase", stroke=800 * NM),
        _WAY,
        _pixels("phase", name="held", stroke=800 * NM, held=True),
    ],
}


def _system(name: str) -> System:
    lasers = [[1.0, 0.5], [0.5, 1.0]]
    return System([532 * NM, 580 * NM], lasers, elements=CHAINS[name], planes_m=[3 * MM, 4 * MM])


def _found(
    system: System, kernels: Kernels, settings: hv.Settings, *, double: bool
) -> tuple[float, torch.Tensor, list[torch.Tensor]]:
    """The loss, the intensities and the gradients by each pattern."""
    rng = np.random.default_rng(1)
    stack = rng.random((len(make_plan(system).planes), *system.way.shape, 3)).astype(np.float32)
    problem = ChainProblem(system, stack, settings, double=double, kernels=kernels)
    assert isinstance(problem._executor, CompiledChain) == (kernels is not TORCH_KERNELS)
    drives = {}
    for name, drive in random_drive(system, seed=2).items():
        wide = np.complex128 if np.iscomplexobj(drive) else np.float64
        drives[name] = torch.from_numpy(0.8 * drive.astype(wide if double else drive.dtype)).requires_grad_()
    light = problem.evaluate(drives, system.amplitudes)
    loss, _ = problem.loss(light, system.amplitudes)
    gradients = torch.autograd.grad(loss, list(drives.values()))
    return float(loss.detach()), light.intensity.detach(), list(gradients)


def _assert_equal(system: System, settings: hv.Settings, near: float, *, double: bool) -> None:
    found = _found(system, CompiledKernels(), settings, double=double)
    expected = _found(system, TORCH_KERNELS, settings, double=double)
    assert found[0] == pytest.approx(expected[0], rel=near)
    for own, other in zip([found[1], *found[2]], [expected[1], *expected[2]], strict=True):
        assert float((own - other).norm()) <= near * float(other.norm())


_SETTINGS = hv.Settings(eyebox=0.02)


@pytest.mark.parametrize("name", CHAINS)
def test_loss_intensities_and_gradients_are_those_of_torch(name: str) -> None:
    _assert_equal(_system(name), _SETTINGS, 1e-12, double=True)  # sums of some thousand terms in another order


@pytest.mark.parametrize(
    "keys",
    [
        {"source": {"directions": [[0, 0], [0.01, -0.02], [-0.03, 0.005]]}},
        {"propagation": "periodic"},
        {"upsample": 3},
        {"eye": {"pupil": "2 mm"}},
    ],
    ids=str,
)
def test_so_they_are_of_other_benches(keys: dict[str, Any]) -> None:
    _assert_equal(_system("one after the other").edit(keys), _SETTINGS, 1e-12, double=True)


@pytest.mark.explores
@pytest.mark.parametrize(("chain", "name", "element"), CASES)
def test_so_they_are_with_each_effect_on_each_element(chain: str, name: str, element: str) -> None:
    system = bench_with_effect(chain, name, element)
    if not changes_lasers(system, system.effect_values):
        _assert_equal(system, _SETTINGS, 1e-12, double=True)


@pytest.mark.parametrize(
    ("name", "element"), [("slm_stuck", "slm"), ("misplaced", "mask"), ("leakage", "coarse"), ("aberration", "second")]
)
def test_so_they_are_with_effects(name: str, element: str) -> None:
    _assert_equal(bench_with_effect("one after the other", name, element), _SETTINGS, 1e-12, double=True)


_PRESETS = [name for name in preset.names() if preset.load(name).is_chain]


@pytest.mark.long
@pytest.mark.parametrize("name", _PRESETS)
def test_so_they_are_of_each_preset(name: str) -> None:
    system = preset.load(name)
    system = system.with_(planes=list(system.planes_m[:1]))
    # of float32: a transform adds 2⁻²⁴·log₂(length) of the norm, and each element its rounding; there and back, in both
    transforms, length = 2 * (len(system.way.relays) + 1), max(make_plan(system).grid.padded)
    _assert_equal(system, hv.Settings(), 4 * transforms * math.log2(length) * 2.0**-24, double=False)


def _executor(name: str) -> CompiledChain:
    plan = make_plan(_system(name))
    return CompiledChain(plan, dark_inputs(plan), double=True)


def _noise(*shape: int, seed: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, dtype=torch.complex128, generator=generator)


@pytest.mark.parametrize("name", CHAINS)
def test_the_adjoint_of_every_relay_is_its_adjoint(name: str) -> None:
    """⟨A·w, g⟩ = ⟨w, A⁺·g⟩ for drawn w and g; and A is that of torch."""
    executor = _executor(name)
    plain = TORCH_KERNELS.chain_executor(executor.plan, double=True, device="cpu")
    for relay in range(len(executor.plan.relays)):
        field = _noise(*executor.plan.grid.shape, seed=relay).requires_grad_()
        if relay == executor.plan.way.last:
            out = executor.spectrum(TorchField(field), len(executor.plan.way.transmissions) - 1).values
            expected = plain.transforms[relay].forward(field.detach())
        else:
            shown = executor.transmit(executor.spectrum(TorchField(field), _before(executor, relay)), relay, 0)
            out = executor.field(shown, relay).values
            expected = plain.transforms[relay].inverse(
                plain.transforms[relay].forward(field.detach()) * plain.transfer(relay, 0)
            )
        assert float((out.detach() - expected).norm()) <= 1e-13 * float(expected.norm())  # 2⁻⁵³·log₂(length), twice
        slopes, way = _noise(*out.shape, seed=7), _noise(*field.shape, seed=8)
        (back,) = torch.autograd.grad(out, field, slopes)
        moved = (
            plain.transforms[relay].forward(way)
            if relay == executor.plan.way.last
            else plain.transforms[relay].inverse(plain.transforms[relay].forward(way) * plain.transfer(relay, 0))
        )
        there, here = complex((slopes.conj() * moved).sum()), complex((back.conj() * way).sum())
        assert abs(there - here) <= 1e-12 * float(slopes.norm() * moved.norm())


def _before(executor: CompiledChain, relay: int) -> int:
    """The number of the last element before a relay."""
    return executor.plan.way.places[relay][-1]


def test_what_the_passes_do_not_fit_is_torchs() -> None:
    """Fields of fewer samples than a vector has lanes."""
    elements = [_pixels("phase", shape=(4, 20), stroke=800 * NM)]
    system = System([532 * NM], [[1.0]], elements=[*elements, _pixels("amplitude", shape=(4, 20))], planes_m=[1 * MM])
    stack = np.full((1, *system.way.shape, 3), 0.3, np.float32)
    problem = ChainProblem(system, stack, hv.Settings(), kernels=CompiledKernels())
    assert not isinstance(problem._executor, CompiledChain)


def test_several_threads_give_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each computes rows and columns of its own."""
    system = _system("one after the other")
    alone, threads = _found(system, CompiledKernels(), _SETTINGS, double=True), torch.get_num_threads()
    monkeypatch.setenv("OMP_NUM_THREADS", "3")  # also for small fields
    torch.set_num_threads(3)
    try:
        together = _found(system, CompiledKernels(), hv.Settings(), double=True)
    finally:
        torch.set_num_threads(threads)
    assert torch.equal(alone[1], together[1])


@pytest.mark.parametrize("free", [("patterns", "amplitudes"), ("patterns", "amplitudes", "wavelengths")])
def test_an_optimisation_is_that_of_torch(free: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """Up to the rounding of float32, which Adam enlarges where a gradient is nearly 0."""
    system, losses = _system("one after the other"), []
    settings = hv.Settings(iterations=6, free=free, wavelength_range_m=(500 * NM, 600 * NM))
    stack = np.random.default_rng(3).uniform(0.1, 0.6, (2, *system.way.shape, 3)).astype(np.float32)
    for kernels in (TORCH_KERNELS, CompiledKernels()):
        monkeypatch.setattr(
            "holoview.holograms.optimise.chain_loop.choose_kernels", lambda device, kernels=kernels: kernels
        )
        losses.append([state.loss for state in hv.iterate(system, stack, settings)])
    assert losses[1] == pytest.approx(losses[0], rel=1e-4)
