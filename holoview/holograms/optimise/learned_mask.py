"""A static element that is trained for a whole set of pictures at once, and then held.

A mask can't change with the picture, so that a pattern sought for one picture tells nothing about the next. Here each
picture has patterns and laser amplitudes of its own, and all share one pattern: the loss is the mean of the pictures'.

    L = 1/N · Σ_i L_i(own patterns of picture i, the shared pattern)

The gradient of the shared pattern sums over the pictures, one after the other, so that memory doesn't grow with their
number. The method is that of learned masks for étendue expansion (Tseng et al., Nature Communications 15, 2907, 2024).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.holograms.optimise.adam import sqrt_decay
from holoview.holograms.optimise.chain_loop import ChainPatterns, ChainProblem, check_whole_picture
from holoview.holograms.optimise.objective import Objective, make_objective
from holoview.holograms.optimise.settings import Settings
from holoview.light.model.elements import PhaseModulator
from holoview.light.model.system import System
from holoview.util.errors import UserError, suggest_matches

ENOUGH_PICTURES = 24
"""A mask of fewer is learned by heart: it loses on other pictures what it gains on these."""


@dataclass(frozen=True)
class MaskState:
    """Training after an iteration. psnr_db (picture,): of linear sRGB, mean over planes. mask (y, x): 0…1.

    The mask has the smallest loss so far; the PSNR is that of the iteration.
    """

    iteration: int
    iterations: int
    loss: float
    psnr_db: NDArray[np.float64]
    mask: NDArray[np.float32]


@dataclass
class _LearnedPicture:
    """A picture's target, its own patterns, and the amplitudes (frame, wavelength) that suit them."""

    objective: Objective
    patterns: ChainPatterns
    amplitudes: NDArray[np.float64]


def check_learnable(system: System, name: str) -> None:
    """Raises UserError unless the element of this name is a phase modulator that all frames share, beside another."""
    named = dict(zip(system.element_names, system.elements, strict=True)) if system.is_chain else {}
    element = named.get(name)
    if not isinstance(element, PhaseModulator) or not element.shared or element.held:
        found, remedy = "a bench without elements", "write the bench as elements, and the mask as one of them"
        if named:
            found = "no element" if element is None else f"of kind {element.kind}"
            remedy = suggest_matches(name, named) if element is None else "set shared = true"
        if isinstance(element, PhaseModulator):
            found += ", with held = true" if element.shared else ", with shared = false"
            remedy = "set shared = true and held = false"
        expected = "the name of an element of kind phase with shared = true"
        raise UserError(f'mask "{name}"', found, expected=expected, remedy=remedy)
    if list(system.drive_shapes) == [name]:
        raise UserError(f'mask "{name}"', "is the only pattern", expected="a modulator that shows the pictures")


def learn_mask(
    system: System, stacks: Sequence[NDArray[np.float32]], settings: Settings, name: str, *, device: str = "cpu"
) -> Iterator[MaskState]:
    """Trains a static mask for many pictures at once: the states of the training.

    system: a chain whose element `name` is of kind phase with shared = true. stacks: a focal stack (plane, y, x, 3) in
    linear sRGB for each picture, as `target_for` makes it. settings: as of `iterate`; patterns and laser amplitudes may
    be free. device: of torch, "cpu", "cuda", "cuda:1" or "mps". A pattern of its own belongs to each picture; that of
    the element is common to all.

    Raises UserError for an element that can't be trained, without pictures, for settings that chains don't have, and as
    `iterate` does.

    >>> import holoview as hv, numpy as np
    >>> pixels = {"kind": "phase", "pitch": "8 um", "shape": [16, 16], "stroke": "825 nm"}
    >>> elements = [pixels, {"kind": "space", "distance": "2 mm"}, pixels | {"name": "mask", "shared": True}]
    >>> bench = hv.System(["532 nm"], [[1.0]], elements=elements, planes_m=["10 mm"])
    >>> stacks = [np.full((1, 32, 32, 3), grey, dtype=np.float32) for grey in (0.1, 0.3)]
    >>> *_, last = hv.learn_mask(bench, stacks, hv.Settings(iterations=2), "mask")
    >>> last.mask.shape, last.psnr_db.shape
    ((16, 16), (2,))
    """
    check_learnable(system, name)
    if not stacks:
        raise UserError("pictures", "none", expected="one at least")
    if "wavelengths" in settings.free:
        raise UserError("free", "wavelengths, of a mask that many pictures share", expected="patterns and amplitudes")
    check_whole_picture(settings, stacks[0])
    problem = ChainProblem(system, stacks[0], settings, device)
    own = [other for other in system.drive_shapes if other != name]
    mask = ChainPatterns(system, settings, None, [name])
    scenes = [
        _LearnedPicture(
            make_objective(problem.plan, stack, settings, device=device, double=False),
            ChainPatterns(system, settings, None, own),
            np.array(system.amplitudes),
        )
        for stack in stacks
    ]
    best_loss, best = np.inf, mask.variables[0].detach()
    for iteration in range(settings.iterations + 1):
        is_last = iteration == settings.iterations
        solves = "amplitudes" in settings.free and (iteration % settings.amplitudes_every == 0 or is_last)
        decay = None if is_last else sqrt_decay(iteration, settings.iterations)
        before = mask.variables[0].detach().clone()
        parts = [_learned_from(scene, problem, mask, solves, decay) for scene in scenes]
        losses, psnr_db = (np.array(values) for values in zip(*((loss, db) for loss, db, _ in parts), strict=True))
        if losses.mean() < best_loss:
            best_loss, best = losses.mean(), before
        if decay is not None:
            mask.step([torch.stack([pull for _, _, pull in parts]).mean(dim=0)], decay)
        values = best[0].cpu().numpy().astype(np.float32)
        yield MaskState(iteration, settings.iterations, float(losses.mean()), psnr_db, values)


def _learned_from(
    scene: _LearnedPicture, problem: ChainProblem, mask: ChainPatterns, solves: bool, decay: float | None
) -> tuple[float, float, torch.Tensor]:
    """Loss and PSNR of a picture, and its pull on the mask; then its own patterns have moved, but for decay None."""
    problem.objective = scene.objective
    found = problem.evaluate(scene.patterns.shown() | mask.shown(), scene.amplitudes)
    if solves:
        scene.amplitudes = problem.solved_amplitudes(found.intensity)
    loss, image = problem.loss(found, scene.amplitudes)
    value, psnr_db = float(loss.detach()), problem.objective.psnr_db(image)
    if decay is None:
        return value, psnr_db, torch.zeros_like(mask.variables[0])
    *gradients, pull = torch.autograd.grad(loss, [*scene.patterns.variables, *mask.variables])
    scene.patterns.step(gradients, decay)
    return value, psnr_db, pull
