"""Places of the pupil: what a text describes, where they lie, draws that are made anew and resumed, refusals."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.holograms.optimise.checkpoint import load_checkpoint
from holoview.holograms.optimise.eyes import (
    OptimisedEyes,
    Places,
    PupilPlaces,
    drawn_places,
    held_out_places,
    parse_pupils,
    places_between,
)
from holoview.holograms.optimise.problem import EvaluationRequest, Problem
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.solve import iterate
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System

SYSTEM = hv.load("holochrome-8").with_(eye={"pupil_x": "1 mm"})


def parse_places(text: str | None, system: System) -> PupilPlaces:
    return OptimisedEyes.from_text(text, "compensate").places_in(system)


def test_a_grid_lies_around_the_pupil() -> None:
    places = parse_places("1x3:0.5mm", SYSTEM).fixed
    assert np.array(places) == pytest.approx(np.array([[0, 0.5e-3], [0, 1e-3], [0, 1.5e-3]]))
    assert np.array(places_between(places)) == pytest.approx(np.array([[0, 0.75e-3], [0, 1.25e-3]]))
    assert len(parse_places("3x3:0.5mm", SYSTEM).held_out) == 4
    assert parse_places(None, SYSTEM) == PupilPlaces() and parse_places("1x1:1mm", SYSTEM).held_out == ()


@pytest.mark.parametrize(
    "text", ["3", "3x3", "0x3:1mm", "99x99:1mm", "3x3:", "3x3:0mm", "3x3:-1mm", "3x3:1 kg", "axb:1mm"]
)
def test_what_is_no_grid_of_places_is_refused(text: str) -> None:
    with pytest.raises(hv.UserError, match="--pupils"):
        parse_places(text, SYSTEM)


def test_places_need_an_eye() -> None:
    with pytest.raises(hv.UserError, match="--pupils: without an eye"):
        parse_places("3x3:1mm", SYSTEM.with_(eye=None))


def test_places_may_be_drawn_within_a_radius() -> None:
    pupils = parse_places("random:4:0.8mm", SYSTEM)
    assert (pupils.fixed, pupils.drawn, pupils.radius_m) == ((), 4, 0.8e-3)
    held_out = np.array(pupils.held_out) - [0, 1e-3]
    assert len(held_out) == 4 and np.abs(held_out) == pytest.approx(np.full((4, 2), 0.4e-3))
    assert SYSTEM.eye is not None and pupils.reach_m(SYSTEM.eye) == pytest.approx(0.8e-3)
    assert parse_places("1x3:0.5mm", SYSTEM).reach_m(SYSTEM.eye) == pytest.approx(0.5e-3)


@pytest.mark.parametrize(
    "text", ["random", "random:4", "random:0:1mm", "random:4:0mm", "random:4:1 kg", "random:99:1mm"]
)
def test_what_is_no_draw_is_refused(text: str) -> None:
    with pytest.raises(hv.UserError, match="--pupils"):
        parse_places(text, SYSTEM)


def test_a_draw_that_the_eyepiece_cant_show_is_refused() -> None:
    with pytest.raises(hv.UserError, match="eyepiece: 40 mm with a pupil that reaches"):
        parse_places("random:4:60mm", SYSTEM)


@pytest.mark.parametrize("text", ["3x3:0.8mm", "1x9:0.05mm", "random:4:0.8mm", "random:81:1.25mm"])
def test_places_are_written_as_they_are_read(text: str) -> None:
    assert str(parse_pupils(text)) == text


def test_colour_error_is_ignored_only_by_an_eye() -> None:
    eyes = OptimisedEyes.from_text("random:4:0.8mm", "ignore")
    seen = eyes.aimed(SYSTEM).eye
    assert seen is not None and SYSTEM.eye is not None and not seen.chromatic and SYSTEM.eye.chromatic
    assert (
        eyes.description == "pupils random:4:0.8mm, an eye without colour error" and OptimisedEyes().description == ""
    )
    with pytest.raises(hv.UserError, match="--chromatic: without an eye"):
        eyes.aimed(SYSTEM.with_(eye=None))
    with pytest.raises(hv.UserError, match='chromatic: "maybe"'):
        OptimisedEyes(chromatic="maybe")


# Pupils that are drawn anew in each iteration: where, what is kept between draws, and that a run can be resumed.


Bench = Callable[..., hv.System]

EYE: dict[str, Any] = {"eyepiece": "5 mm", "pupil": "0.5 mm", "accommodation": ["0 D", "4 D"]}
DRAWN = Settings(iterations=6, amplitudes_every=4, drawn_pupils=3, drawn_radius_m=0.2e-3)


def _stacks_at(system: hv.System) -> Callable[[Places], np.ndarray]:
    """A picture that depends on the place, (place · plane, y, x, 3)."""
    shape = (len(hv.make_plan(system).planes_m), *make_plan(system).grid.shape, 3)

    def stacks_at(places: Places) -> np.ndarray:
        x = np.linspace(0, 6, shape[2])[:, None]
        one = [np.broadcast_to(0.4 + 0.3 * np.sin(x + 1e4 * place[1] + 3e4 * place[0]), shape) for place in places]
        return np.concatenate(one).astype(np.float32)

    return stacks_at


def test_places_are_uniform_in_the_disc_and_depend_on_seed_and_iteration(bench: Bench) -> None:
    """Of a uniform disc the squared distance is uniform: its mean is R²/2, known to R²/√(12·n)."""
    system = bench(eye=EYE | {"pupil_x": "0.1 mm"})
    many = Settings(drawn_pupils=500, drawn_radius_m=0.3e-3)
    places = np.array(drawn_places(system, many, 2)) - [0.0, 0.1e-3]
    squares = (places**2).sum(axis=1) / 0.3e-3**2
    assert squares.max() <= 1 and squares.mean() == pytest.approx(0.5, abs=5 / np.sqrt(12 * 500))
    assert places.mean(axis=0) / 0.3e-3 == pytest.approx([0, 0], abs=5 * 0.5 / np.sqrt(500))
    assert drawn_places(system, many, 2) == drawn_places(system, many, 2)
    seeds = [Settings(seed=seed, drawn_pupils=2, drawn_radius_m=1e-4) for seed in (0, 1)]
    assert len({drawn_places(system, settings, i) for settings in seeds for i in (0, 1)}) == 4


def test_places_that_are_held_out_lie_in_the_disc(bench: Bench) -> None:
    places = np.array(held_out_places(bench(eye=EYE | {"pupil_y": "0.1 mm"}), 0.2e-3)) - [0.1e-3, 0.0]
    assert len(places) == 4 and np.hypot(*places.T) == pytest.approx(np.full(4, 0.2e-3 / np.sqrt(2)))


@pytest.mark.long
@pytest.mark.parametrize(
    "more", [{}, {"chromatic_axis": "pupil"}, {"stiles_crawford": True}], ids=["stop", "moving", "pupil function"]
)
def test_a_problem_that_moves_its_pupils_is_one_that_was_made_for_them(
    bench: Bench, noise: Callable[..., torch.Tensor], double_problem: Callable[..., Problem], more: dict[str, Any]
) -> None:
    """The stored free space times the stops, in another order of roundings: 1e-12 in double precision."""
    system = bench(eye=EYE | more)
    stacks_at, path_m = _stacks_at(system), noise(3, *system.drive_shape) * 800e-9
    request, found = EvaluationRequest(path_gradient=True, optimal_amplitudes=True), []
    first = drawn_places(system, DRAWN, 0)
    moved = double_problem(system, stacks_at(first), DRAWN, places_m=first)
    for iteration in (1, 2):
        places = drawn_places(system, DRAWN, iteration)
        moved.see_from(places, stacks_at(places))
        made = double_problem(system, stacks_at(places), DRAWN, places_m=places)
        one, other = (problem.evaluate(path_m, system.amplitudes, request) for problem in (moved, made))
        assert one.loss == pytest.approx(other.loss, rel=1e-12)
        assert one.path_gradient is not None and other.path_gradient is not None
        difference = torch.linalg.vector_norm(one.path_gradient - other.path_gradient)
        assert difference <= 1e-12 * torch.linalg.vector_norm(other.path_gradient)
        found.append(one.loss)
    assert found[0] != found[1]


@pytest.mark.parametrize("stopped", [1, 4])
def test_it_goes_on_from_a_checkpoint_bit_for_bit(bench: Bench, tmp_path: Path, stopped: int) -> None:
    system = bench(eye=EYE)
    whole = list(iterate(system, _stacks_at(system), DRAWN))
    states = iterate(system, _stacks_at(system), DRAWN)
    for _ in range(stopped):
        state = next(states)
    state.checkpoint().save(tmp_path / "c.safetensors")
    known = load_checkpoint(tmp_path / "c.safetensors")
    rest = list(iterate(system, _stacks_at(system), DRAWN, resume=known))
    assert [one.loss for one in rest] == [one.loss for one in whole[stopped:]]
    assert np.array_equal(rest[-1].best.drive, whole[-1].best.drive)
    assert rest[-1].best.system == whole[-1].best.system


def test_another_draw_is_another_optimisation(bench: Bench) -> None:
    system = bench(eye=EYE)
    known = next(iterate(system, _stacks_at(system), DRAWN)).checkpoint()
    other = Settings(iterations=6, amplitudes_every=4, drawn_pupils=3, drawn_radius_m=0.3e-3)
    with pytest.raises(hv.UserError, match="drawn_radius_m, the target differ"):
        iterate(system, _stacks_at(system), other, resume=known)


def test_the_latest_hologram_is_the_result(bench: Bench) -> None:
    """Losses of different draws can't be compared: that of a lucky one isn't the best."""
    system = bench(eye=EYE)
    drives = []
    for state in iterate(system, _stacks_at(system), DRAWN):
        drives.append(state.best.drive)
    assert all(not np.array_equal(one, other) for one, other in pairwise(drives))


def test_what_doesnt_fit_is_refused(bench: Bench) -> None:
    system = bench(eye=EYE)
    stack = _stacks_at(system)(((0.0, 0.0),))
    with pytest.raises(hv.UserError, match="target: a stack; expected a function of the places with 3 drawn pupils"):
        iterate(system, stack, DRAWN)
    with pytest.raises(hv.UserError, match="target: a function; expected a stack with 0 drawn pupils"):
        iterate(system, _stacks_at(system), Settings())
    with pytest.raises(hv.UserError, match="pupil places: without an eye"):
        iterate(bench(), _stacks_at(bench()), DRAWN)
    for wrong, words in (
        ({"drawn_pupils": -1}, "0 or more"),
        ({"drawn_pupils": 2}, "a radius above 0"),
        ({"drawn_pupils": 2, "drawn_radius_m": 1e-3, "pupil_places_m": ((0.0, 0.0),)}, "with fixed places"),
        ({"drawn_pupils": 2, "drawn_radius_m": 1e-3, "free": ("wavelengths",)}, "wavelengths with several places"),
    ):
        with pytest.raises(hv.UserError, match=words):
            Settings(**wrong)  # type: ignore[arg-type]
