"""A picture that is seen from any place of the pupil agrees with one that is rendered anew from there."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import holoview as hv
from holoview.holograms.targets.moving_pupil import moving_target
from holoview.holograms.targets.picture import Picture
from holoview.holograms.targets.target import Placement, target_for
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System

Bench = Callable[..., System]

SHAPE = (40, 56)
F = 40e-3
FLOAT32 = 3e-5  # float32 transforms, layer by layer, and the division by the coverage
INSIDE = (slice(None), slice(12, -12), slice(12, -12))  # borders continue differently


def scene(path: object) -> tuple[Picture, Placement]:
    """Coloured noise of 3 × 3 samples, a near square before a far wall."""
    blocks = np.random.default_rng(2).random((*(n // 2 for n in SHAPE), 3), dtype=np.float32)
    depth = np.ones(SHAPE, dtype=np.float32)
    depth[14:28, 20:36] = 0
    np.save(f"{path}/depth.npy", depth)
    return Picture(blocks.repeat(2, axis=0).repeat(2, axis=1), "noise"), Placement(depth=f"{path}/depth.npy")


def both(
    system: System, path: object, place: tuple[float, float]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """From a place: by moving, rendered anew; and rendered from the eye's own place."""
    picture, placement = scene(path)
    assert system.eye is not None
    moving = moving_target(system, picture, placement, 0.8e-3, 0.9)([(0.0, 0.0), place])
    there = target_for(system.with_(eye=system.eye.moved_to(place)), picture, placement, 0.9).stack
    here = target_for(system, picture, placement, 0.9).stack
    assert moving[: len(here)][INSIDE] == pytest.approx(here[INSIDE], abs=_tolerance(system))
    return moving[len(here) :], there, here


def _tolerance(system: System) -> float:
    """Rounding; where wavelengths are added before they hide each other, what `test_a_human_eye…` allows."""
    assert system.eye is not None
    return 0.25 if system.eye.chromatic and system.eye.chromatic_axis == "pupil" else FLOAT32


@pytest.mark.parametrize("place", [(0.0, 0.32e-3), (-0.32e-3, 0.64e-3)])
def test_from_whole_samples_beside_the_middle_it_is_the_same_picture(
    bench: Bench, tmp_path: object, place: tuple[float, float]
) -> None:
    """0.32 mm · 1 mm/40 mm is a sample of 8 µm: the square moves against the wall by one or two of them."""
    eye = {"eyepiece": F, "pupil": 2e-3, "chromatic": False}
    system = bench(2, SHAPE).with_(planes=["9 mm", "10 mm"], eye=eye)
    assert make_plan(system).grid.pitch_m == 8e-6
    found, expected, here = both(system, tmp_path, place)
    assert np.abs(found - expected)[INSIDE].max() <= FLOAT32
    assert np.abs(here - expected)[INSIDE].max() > 0.1


def test_elsewhere_parallax_is_rounded_to_half_a_sample(bench: Bench, tmp_path: object) -> None:
    """A displacement by half a sample changes the picture at most by half of its greatest difference of neighbours."""
    eye = {"eyepiece": F, "pupil": 2e-3, "chromatic": False}
    system = bench(2, SHAPE).with_(planes=["9 mm", "10 mm"], eye=eye)
    found, expected, _ = both(system, tmp_path, (0.0, 0.47e-3))
    slope = np.abs(np.diff(expected, axis=2)).max()
    assert np.abs(found - expected)[INSIDE].max() <= 0.5 * slope + FLOAT32


def test_an_artificial_pupil_sees_each_wavelength_from_its_place(bench: Bench, tmp_path: object) -> None:
    """Three lasers 0.625 dioptres apart, which are 1 mm: each moves by whole samples, and is composited on its own."""
    refraction = float(hv.chromatic_refraction(650e-9)) - 0.625 * np.arange(3)
    lasers_m = (214.102 + 633.46 / (1.68524 - refraction)) * 1e-9
    eye = {"eyepiece": F, "pupil": 2e-3, "reference": "650 nm"}
    system = bench(1, SHAPE).with_(wavelengths=lasers_m.tolist(), amplitudes="white", planes=["9 mm", "10 mm"], eye=eye)
    found, expected, here = both(system, tmp_path, (0.0, 0.32e-3))
    assert np.abs(found - expected)[INSIDE].max() <= 3 * FLOAT32, "colours of three lasers, with both signs"
    assert np.abs(here - expected)[INSIDE].max() > 0.1


def test_a_human_eye_that_moves_as_a_whole_sees_the_same_but_for_fringes(bench: Bench, tmp_path: object) -> None:
    """The colours of what a blurred edge lets through are approximate: an eighth of the change that parallax makes."""
    eye = {"eyepiece": F, "pupil": 2e-3, "chromatic_axis": "pupil"}
    system = bench(2, SHAPE).with_(planes=["9 mm", "10 mm"], eye=eye)
    found, expected, here = both(system, tmp_path, (0.32e-3, -0.64e-3))
    errors = [float(np.square(one - expected)[INSIDE].mean()) for one in (found, here)]
    assert errors[0] < errors[1] / 8


@pytest.mark.parametrize("axis", ["eyepiece", "pupil"])
def test_an_even_picture_stays_even_from_everywhere(bench: Bench, tmp_path: object, axis: str) -> None:
    even = Picture(np.full((*SHAPE, 3), (0.4, 0.4, 0.4), dtype=np.float32), "grey")
    system = bench(2, SHAPE).with_(planes=["9 mm", "10 mm"], eye={"pupil": 2e-3, "chromatic_axis": axis})
    stack = moving_target(system, even, scene(tmp_path)[1], 0.8e-3)([(0.8e-3, 0.0), (-0.5e-3, 0.5e-3)])
    assert stack.shape == (4, *SHAPE, 3)
    assert np.abs(stack - 0.4).max() < 1e-4


def test_two_lasers_mix_what_they_can(bench: Bench, tmp_path: object) -> None:
    """Fewer than three lasers can't mix a colour; what is left is spread evenly, as in a target."""
    system = bench(1, SHAPE).with_(wavelengths=["460 nm", "620 nm"], amplitudes=[[1.0, 1.0]], eye={"pupil": 2e-3})
    picture, _ = scene(tmp_path)
    found = moving_target(system, picture, Placement(), 0.5e-3)([(0.0, 0.0)])
    assert found[INSIDE] == pytest.approx(target_for(system, picture).stack[INSIDE], abs=FLOAT32)


def test_a_pupil_needs_an_eye(bench: Bench, tmp_path: object) -> None:
    with pytest.raises(hv.UserError, match="a bench with an eye"):
        moving_target(bench(1, SHAPE), scene(tmp_path)[0], Placement(), 1e-3)
