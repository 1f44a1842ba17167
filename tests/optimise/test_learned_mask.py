"""A static mask trained for several pictures: the sum of their gradients, one pattern for all, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.holograms.optimise.chain_loop import ChainPatterns, ChainProblem
from holoview.holograms.optimise.learned_mask import check_learnable, learn_mask
from holoview.light.model.system import System

UM, MM, NM = 1e-6, 1e-3, 1e-9
SHAPE = (16, 20)


def shared_mask(**keys: Any) -> System:
    pixels = {"kind": "phase", "pitch": 8 * UM, "shape": SHAPE, "stroke": 800 * NM}
    space = {"kind": "space", "distance": 1 * MM, "square": "first order"}
    elements = (pixels | {"name": "slm"}, space, pixels | {"name": "mask", "shared": True} | keys)
    return System([532 * NM, 580 * NM], [[1.0, 0.7]], elements=elements, planes_m=[2 * MM, 3 * MM], observer="eye")


def _stacks(count: int) -> list[np.ndarray]:
    random = np.random.default_rng(3)
    return [0.3 * random.random((2, 32, 40, 3)).astype(np.float32) for _ in range(count)]


SETTINGS = hv.Settings(iterations=6, seed=4)


def test_one_picture_is_the_optimisation_of_both_patterns() -> None:
    # The same variables, begun alike, moved by the same gradients: the first PSNR is equal, later ones up to rounding.
    system, (stack,) = shared_mask(), _stacks(1)
    settings = hv.Settings(iterations=6, seed=4, free=("patterns",))
    learned = [state.psnr_db[0] for state in learn_mask(system, [stack], settings, "mask")]
    problem = ChainProblem(system, stack, settings)
    own, mask = (ChainPatterns(system, settings, None, [name]) for name in ("slm", "mask"))
    start = {name: v.detach().numpy() for p in (own, mask) for name, v in p.shown().items()}
    found = [state.psnr_db for state in hv.iterate(system, stack, settings, start=start)]
    assert problem.plan.grid.shape == (32, 40)
    np.testing.assert_allclose(learned, found, atol=1e-3)  # dB: f32 sums of 1280 samples, six steps


def test_the_masks_gradient_is_the_mean_of_the_pictures() -> None:
    system, stacks = shared_mask(), _stacks(3)
    settings = hv.Settings(iterations=1, seed=4, free=("patterns",), step_rad=0.01)
    first, last = learn_mask(system, stacks, settings, "mask")
    start = ChainPatterns(system, settings, None, ["mask"]).variables[0].detach()[0]
    np.testing.assert_array_equal(first.mask, start)
    moved = last.mask - first.mask
    pulls = []
    for stack in stacks:
        problem = ChainProblem(system, stack, settings, double=True)
        own, mask = (ChainPatterns(system, settings, None, [name]) for name in ("slm", "mask"))
        loss, _ = problem.loss(problem.evaluate(own.shown() | mask.shown(), system.amplitudes), system.amplitudes)
        pulls.append(torch.autograd.grad(loss, mask.variables)[0][0])
    mean = torch.stack(pulls).mean(dim=0).numpy()
    # Adam's first step is the sign of the gradient; near zero rounding decides it.
    large = np.abs(mean) > 1e-3 * np.abs(mean).max()
    inside = (start.numpy() > 0.02) & (start.numpy() < 0.98)
    assert np.array_equal(np.sign(moved[large & inside]), -np.sign(mean[large & inside]))


def test_training_raises_the_mean_psnr_and_keeps_the_mask_in_its_range() -> None:
    *_, last = states = list(learn_mask(shared_mask(), _stacks(2), hv.Settings(iterations=12, seed=1), "mask"))
    assert last.loss < 0.9 * states[0].loss
    assert last.mask.shape == SHAPE
    assert last.mask.min() >= 0 and last.mask.max() <= 1
    assert len(last.psnr_db) == 2


@pytest.mark.parametrize(
    ("name", "keys", "words"),
    [
        ("mask", {"shared": False}, "of kind phase, with shared = false; expected .*; set shared = true"),
        ("msk", {}, "no element; expected .*mask"),
        ("slm", {}, "of kind phase, with shared = false"),
    ],
)
def test_what_cant_be_trained_is_a_sentence(name: str, keys: dict[str, Any], words: str) -> None:
    bench = shared_mask(**keys) if keys.get("shared", True) else shared_mask(shared=False, offset=[8 * UM, 0.0])
    with pytest.raises(hv.UserError, match=words):
        check_learnable(bench, name)
    with pytest.raises(hv.UserError, match="a bench without elements"):
        check_learnable(hv.load("holochrome-8"), name)
    with pytest.raises(hv.UserError, match="pictures: none"):
        next(learn_mask(shared_mask(), [], SETTINGS, "mask"))
