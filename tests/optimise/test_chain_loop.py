"""The optimiser of chains: derivatives of every kind of element, and what it tells beside the PSNR."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.holograms.optimise.chain_loop import ChainProblem
from holoview.holograms.optimise.checkpoint import load_checkpoint
from holoview.holograms.optimise.lasers import next_amplitudes
from holoview.holograms.optimise.objective import make_objective
from holoview.holograms.optimise.problem import EvaluationRequest, Problem
from holoview.holograms.optimise.settings import LOSS_SPACES, next_settings
from holoview.holograms.optimise.solve import follow
from holoview.holograms.view import random_drive
from holoview.light.model.focus import with_pupil_at
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from tests.optimise.chain_slopes import free_drives, slope_along

UM, MM, NM = 1e-6, 1e-3, 1e-9
SHAPE = (16, 20)


def _pixels(kind: str, **keys: Any) -> dict[str, Any]:
    return {"kind": kind, "pitch": 8 * UM, "shape": SHAPE} | keys


def _chain(*elements: dict[str, Any], frames: int = 1) -> System:
    lasers = [[1.0, 0.7]] * frames
    return System([532 * NM, 580 * NM], lasers, elements=elements, planes_m=[2 * MM, 3 * MM], observer="eye")


_STACK = np.random.default_rng(5).random((2, 32, 40, 3)).astype(np.float32)
_SPACE = {"kind": "space", "distance": 1 * MM, "square": "first order"}
_CHAINS = {
    "phase and amplitude": (
        _pixels("phase", stroke=800 * NM),
        _SPACE,
        _pixels("amplitude", pitch=16 * UM, shape=(8, 10), range=[0.1, 0.9]),
    ),
    "complex, and a phase that all frames share": (
        _pixels("complex", stroke=600 * NM),
        _SPACE,
        _pixels("phase", stroke=700 * NM, shared=True),
    ),
    "side by side": (
        _pixels("phase", stroke=800 * NM, name="one"),
        _pixels("phase", stroke=700 * NM, name="other", beside="one"),
        _pixels("complex", name="third", beside="one"),
        _SPACE,
        _pixels("amplitude"),
    ),
    "behind a lens": (
        {"kind": "lens", "focal_length": 20 * MM},
        _pixels("amplitude"),
        {"kind": "mask", "pitch": 8 * UM, "shape": SHAPE, "pattern": "random", "stroke": 500 * NM},
        _pixels("complex"),
    ),
    "in a Fourier plane": (
        _pixels("phase", stroke=800 * NM),
        {"kind": "fourier", "focal_length": 1.5 * MM},
        _pixels("amplitude"),
    ),
}


# encoded sRGB has a kink at its knee, where differences tell no derivative: the next test has those losses
_SMOOTH = [name for name, space in LOSS_SPACES.items() if not space.is_encoded]


@pytest.mark.parametrize(
    ("name", "loss_name"), [(name, None) for name in _CHAINS] + [("phase and amplitude", name) for name in _SMOOTH]
)
def test_the_derivative_is_that_of_the_loss(name: str, loss_name: str | None) -> None:
    system = _chain(*_CHAINS[name], frames=2)
    problem = ChainProblem(system, _STACK, hv.Settings(eyebox=0.01, loss=loss_name), double=True)
    patterns = {
        key: 0.8 * drive.astype(complex if np.iscomplexobj(drive) else float)
        for key, drive in random_drive(system, seed=2).items()
    }
    drives, ways = free_drives(patterns, np.random.default_rng(1))
    along, loss = slope_along(problem, system, drives, ways)
    h = 1e-4  # of order four: its error is that of h⁴ times the fifth derivative, its rounding 1e-16/h
    measured = (8 * (loss(h) - loss(-h)) - (loss(2 * h) - loss(-2 * h))).detach() / (12 * h)
    assert along == pytest.approx(float(measured), rel=1e-7)


# --- wavelengths ------------------------------------------------------------------------------------------------------

_EVERYTHING = ("patterns", "amplitudes", "wavelengths")


def _own_drives(system: System) -> dict[str, torch.Tensor]:
    """Patterns in float64, away from the edges of their ranges."""
    return {
        name: torch.from_numpy(0.8 * drive.astype(complex if np.iscomplexobj(drive) else float))
        for name, drive in random_drive(system, seed=2).items()
    }


def _wavelength_gradient(system: System, settings: hv.Settings) -> np.ndarray:
    problem, drives = ChainProblem(system, _STACK, settings, double=True), _own_drives(system)
    return problem.wavelength_gradient(drives, problem.evaluate(drives, system.amplitudes), system.amplitudes)


@pytest.mark.parametrize("name", [*_CHAINS, "a lens of glass"])
def test_the_derivative_by_wavelength_is_that_of_the_loss(name: str) -> None:
    glass = ({"kind": "lens", "focal_length": 20 * MM, "abbe": 30.0}, *_CHAINS["phase and amplitude"])
    system = _chain(*(_CHAINS | {"a lens of glass": glass})[name], frames=2)
    system = system.edit({"wavelengths": [532.3 * NM, 580.4 * NM]})  # between the entries of the observer's table
    settings = hv.Settings(eyebox=0.01, free=_EVERYTHING, wavelength_range_m=(520 * NM, 590 * NM))
    found = _wavelength_gradient(system, settings)
    problem, drives = ChainProblem(system, _STACK, settings, double=True), _own_drives(system)

    def loss(steps: np.ndarray) -> float:
        problem.set_wavelengths(system.wavelengths_m * (1 + steps))
        return float(problem.loss(problem.evaluate(drives, system.amplitudes), system.amplitudes)[0])

    h = 1e-5  # of order four: phases of some 10³ rad change by 1e-2, so that it is true to 1e-9; 1e-16/h of rounding
    for number, λ in enumerate(system.wavelengths_m):
        step = h * (np.arange(2) == number)
        measured = (8 * (loss(step) - loss(-step)) - (loss(2 * step) - loss(-2 * step))) / (12 * h * λ)
        # the difference of order two, of a step of 1e-6: (1e-3)²/6
        assert found[number] == pytest.approx(measured, rel=1e-6, abs=1e-6 * np.abs(found).max())


@pytest.mark.long
def test_the_derivative_by_wavelength_is_that_by_hand_of_the_short_form() -> None:
    """Two modulators that all frames share are a chain; of one frame they are those of the short form."""
    gap = {"kind": "space", "distance": 1 * MM, "square": "first order", "aberration": {"4": "50 nm"}}
    last = {"kind": "space", "iris_na": 0.03, "apodisation_na": 0.05}

    def bench(is_shared: bool) -> System:
        first, second = (_pixels("phase", stroke=800 * NM, name=name, shared=is_shared) for name in "ab")
        return _chain(first, gap, second, last)

    settings, short = hv.Settings(eyebox=0.02, free=_EVERYTHING), bench(False)
    assert bench(True).is_chain and not short.is_chain
    drives = _own_drives(bench(True))
    paths_m = 800 * NM * torch.stack([drives["a"], drives["b"]], dim=1)
    request = EvaluationRequest(path_gradient=True, wavelength_gradient=True, eyebox_variation=True)
    by_hand = Problem(short, _STACK, settings, double=True).evaluate(paths_m, short.amplitudes, request)
    found = _wavelength_gradient(bench(True), settings)
    # a difference of a step δ of 1e-6: phases of 10² rad, (1e-4)²/6 = 2e-9; rounding of the loss 1e-16/1e-6
    np.testing.assert_allclose(found, by_hand.wavelength_gradient, rtol=2e-9)


def test_wavelengths_move_inside_their_range_and_the_best_has_its_own() -> None:
    system = _chain(*_CHAINS["phase and amplitude"])
    low, high = 500 * NM, 584 * NM
    settings = hv.Settings(iterations=12, free=_EVERYTHING, wavelength_range_m=(low, high))
    *_, last = hv.iterate(system, _STACK, settings)
    λ = last.best.system.wavelengths_m
    assert low <= λ.min() and λ.max() <= high and (np.abs(λ - system.wavelengths_m) > 0.1 * NM).all()
    view = hv.simulate(last.best, backend="torch64")
    error = (np.clip(view.rgb, 0, 1) - np.clip(_STACK, 0, 1)) ** 2
    assert last.best_psnr_db == pytest.approx(float(np.mean(-10 * np.log10(error.mean(axis=(1, 2, 3))))), abs=1e-3)


def test_wavelengths_that_a_fourier_plane_cannot_hold_are_refused() -> None:
    system = _chain(*_CHAINS["in a Fourier plane"])
    settings = hv.Settings(free=_EVERYTHING, wavelength_range_m=(400 * NM, 800 * NM))
    with pytest.raises(hv.UserError, match=r"wavelength range: .*focal_length"):
        next(iter(hv.iterate(system, _STACK, settings)))


def test_what_it_finds_is_what_a_simulation_shows() -> None:
    system = _chain(*_CHAINS["phase and amplitude"])
    states = list(hv.iterate(system, _STACK, hv.Settings(iterations=15)))
    view = hv.simulate(states[-1].best, backend="torch64")
    error = (np.clip(view.rgb, 0, 1) - np.clip(_STACK, 0, 1)) ** 2
    assert states[-1].best_psnr_db == pytest.approx(
        float(np.mean(-10 * np.log10(error.mean(axis=(1, 2, 3))))), abs=1e-3
    )
    assert states[-1].psnr_db > states[0].psnr_db


@pytest.mark.parametrize("loss_name", LOSS_SPACES)
def test_every_loss_is_that_of_the_derivative_by_hand(loss_name: str) -> None:
    region, weights, random = (3, 2, 30, 25), (1.0, 3.0), np.random.default_rng(7)
    settings = hv.Settings(loss=loss_name, region=region, plane_weights=weights)
    plan = make_plan(_chain(*_CHAINS["phase and amplitude"]))
    objective = make_objective(plan, _STACK, settings, double=True)
    image = torch.from_numpy(random.random(objective.target.shape)).requires_grad_()
    loss = objective.loss_of(image)
    slopes = image.detach().clone()
    sums = [objective.evaluate_rows(k, slice(0, 32), slopes[k]) for k in range(2)]
    norms = torch.stack([one.norms for one in sums])[:, None]
    planes = objective.plane_losses(range(2), norms)
    # both in float64: the structure of an image sums some thousand numbers of size 1
    assert float(loss.detach()) == pytest.approx(sum(one.loss for one in planes), rel=1e-12)
    assert objective.psnr_db(image.detach()) == pytest.approx(np.mean([one.psnr_db for one in planes]), rel=1e-12)
    assert torch.allclose(torch.autograd.grad(loss, image)[0], slopes, rtol=1e-9, atol=1e-15)


def test_the_light_that_passes_is_told() -> None:
    dark = _pixels("amplitude", levels=[0.0, 1.0])
    system = _chain(_pixels("amplitude", name="first"), dark | {"name": "second"})
    half = np.zeros((1, *SHAPE), np.float32)
    half[:, :8] = 1.0
    start = {"first": np.full((1, *SHAPE), 0.5, np.float32), "second": half}
    periodic = system.with_(propagation="periodic")
    first = next(iter(hv.iterate(periodic, _STACK, hv.Settings(iterations=1, free=("amplitudes",)), start=start)))
    assert first.light == pytest.approx(0.5**2 / 2, rel=1e-5)  # a quarter of the light of half the field


def test_masks_that_frames_share_have_one_pattern() -> None:
    system = _chain(*_CHAINS["complex, and a phase that all frames share"], frames=3)
    *_, last = hv.iterate(system, _STACK, hv.Settings(iterations=2))
    assert {name: drive.shape[0] for name, drive in last.best.drive.items()} == {"complex": 3, "phase": 1}


def test_amplitudes_stay_in_their_range_and_levels_are_shown() -> None:
    system = _chain(_pixels("amplitude", levels=2, name="binary"), _pixels("complex"))
    *_, last = hv.iterate(system, _STACK, hv.Settings(iterations=5, step_rad=3.0))
    drive = last.best.drive
    assert drive["binary"].min() >= 0 and drive["binary"].max() <= 1
    assert np.abs(drive["complex"]).max() <= 1 + 1e-6


@pytest.mark.parametrize("name", _CHAINS)
def test_a_stack_that_follows_is_a_run_from_the_hologram_before(name: str) -> None:
    """To the bit; a laser that the picture before didn't need stays on."""
    system, settings = _chain(*_CHAINS[name], frames=2), hv.Settings(iterations=3, amplitudes_every=2)
    red = _STACK * np.float32([1.0, 0.0, 0.0])
    states = list(follow(system, [red, _STACK], settings, next_iterations=2))
    assert [state.iteration for state in states] == [0, 1, 2, 3, 0, 1, 2]
    *_, first = hv.iterate(system, red, settings)
    best = first.best
    begun = system.edit({"amplitudes": next_amplitudes(best.system.amplitudes, system.amplitudes > 0)})
    expected = list(hv.iterate(begun, _STACK, next_settings(settings, 2), start=best.drive))
    assert [state.loss for state in states[4:]] == [state.loss for state in expected]
    assert all(np.array_equal(states[-1].best.drive[key], drive) for key, drive in expected[-1].best.drive.items())


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"pupil_places_m": ((0.0, 0.0),)}, "pupil places: without an eye"),
        ({"drawn_pupils": 2, "drawn_radius_m": 1e-4}, "a function of the places with 2 drawn pupils"),
    ],
)
def test_what_is_not_known_of_chains_is_refused(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(hv.UserError, match=words):
        next(iter(hv.iterate(_chain(_pixels("amplitude")), _STACK, hv.Settings(**settings))))


def _edited(name: str, **keys: Any) -> System:
    """The chain with keys of its last element that shows patterns."""
    system = _chain(*_CHAINS[name], frames=2)
    last = list(system.drive_shapes)[-1]
    return system.edit({f"elements.{last}.{key}": value for key, value in keys.items()})


@pytest.mark.parametrize("name", _CHAINS)
def test_an_element_that_is_held_keeps_its_patterns(name: str) -> None:
    """Those of the start, or patterns that let the light through; the others move as if it were a static one."""
    system, settings = _edited(name, held=True), hv.Settings(iterations=6, amplitudes_every=3)
    *others, last = system.drive_shapes
    for start in (None, random_drive(system, 3)):
        states = list(hv.iterate(system, _STACK, settings, start=start))
        best = states[-1].best.drive
        expected = 0.0 if system.elements[system.part(last)].kind == "phase" else 1.0
        assert np.array_equal(best[last], np.full_like(best[last], expected) if start is None else start[last])
        if others:
            assert states[-1].loss < states[0].loss
            before = states[0].best.drive
            assert any(not np.array_equal(best[own], before[own]) for own in others)


@pytest.mark.parametrize("name", _CHAINS)
def test_the_step_of_an_element_is_that_which_it_states(name: str) -> None:
    """Adam's first step has the size of the step where the gradient isn't nearly 0; inside the range."""
    system = _edited(name, step=0.003)
    last = list(system.drive_shapes)[-1]
    start = {own: 0.5 * np.ones_like(drive) for own, drive in random_drive(system).items()}
    start = {own: drive + 0.01 * random_drive(system)[own] for own, drive in start.items()}
    *_, state = hv.iterate(system, _STACK, hv.Settings(iterations=1, free=("patterns",)), start=start)
    moved = state.checkpoint().tensors[f"drive/{last}"]
    given = start[last]
    parts = np.stack([given.real, given.imag], axis=-1) if np.iscomplexobj(given) else given
    sizes = np.abs(moved - parts)
    assert sizes.max() <= 0.003 * (1 + 1e-4)
    assert np.median(sizes) == pytest.approx(0.003, rel=0.05)


def test_a_chain_whose_every_element_is_held_has_amplitudes_alone_to_find() -> None:
    system = _chain(_pixels("amplitude", held=True))
    with pytest.raises(hv.UserError, match="every element is held"):
        next(iter(hv.iterate(system, _STACK, hv.Settings())))
    *_, last = hv.iterate(system, _STACK, hv.Settings(iterations=2, free=("amplitudes",)))
    assert (last.best.drive["amplitude"] == 1).all() and (last.best.system.amplitudes > 0).any()


def test_a_held_element_goes_on_from_a_checkpoint(tmp_path: Path) -> None:
    elements = [dict(element) for element in _CHAINS["phase and amplitude"]]
    elements[0]["held"] = True
    system, settings, whole = _chain(*elements), hv.Settings(iterations=8), []
    start = random_drive(system, 2)
    for state in hv.iterate(system, _STACK, settings, start=start):
        whole.append(state)
        if state.iteration == 3:
            state.checkpoint().save(tmp_path / "checkpoint.safetensors")
    found = list(hv.iterate(system, _STACK, settings, resume=load_checkpoint(tmp_path / "checkpoint.safetensors")))
    assert [s.loss for s in found] == [s.loss for s in whole[4:]]
    assert np.array_equal(found[-1].best.drive["phase"], start["phase"])


def test_a_bench_of_one_modulator_that_is_held_is_a_chain_of_the_same_light() -> None:
    short, held = (_chain(_pixels("phase", stroke=800 * NM, **keys)) for keys in ({}, {"held": True}))
    assert not short.is_chain and held.is_chain
    drive = random_drive(short)
    seen = [
        hv.simulate(system, own, backend="torch64").intensity
        for system, own in ((short, drive), (held, {"phase": drive[:, 0]}))
    ]
    np.testing.assert_allclose(seen[1], seen[0], atol=1e-9 * seen[0].max())


def _with_five_planes(name: str) -> tuple[System, Any]:
    system = _chain(*_CHAINS[name], frames=2).with_(planes=["2 mm", "2.5 mm", "3 mm", "3.5 mm", "4 mm"])
    return system, np.random.default_rng(6).random((5, *_STACK.shape[1:])).astype(np.float32)


@pytest.mark.parametrize("name", _CHAINS)
def test_the_gradient_of_some_planes_is_on_average_that_of_all(name: str) -> None:
    system, stack = _with_five_planes(name)
    problem = ChainProblem(system, stack, hv.Settings(plane_weights=(1, 2, 1, 1, 3), eyebox=0.02), double=True)
    drives, _ = free_drives(random_drive(system), np.random.default_rng(1))

    def slopes(planes: tuple[int, ...] | None) -> list[torch.Tensor]:
        loss, _ = problem.loss(problem.evaluate(drives, system.amplitudes, planes), system.amplitudes)
        return list(torch.autograd.grad(loss, list(drives.values())))

    each, whole = [slopes((plane,)) for plane in range(5)], slopes(None)
    for number, expected in enumerate(whole):
        mean = torch.stack([own[number] for own in each]).mean(dim=0)
        torch.testing.assert_close(mean, expected, rtol=1e-9, atol=1e-12 * float(expected.abs().max()))


def test_with_drawn_planes_the_best_hologram_is_one_of_all_planes(monkeypatch: pytest.MonkeyPatch) -> None:
    system, stack = _with_five_planes("phase and amplitude")
    settings, taken = hv.Settings(iterations=45, drawn_planes=2, amplitudes_every=7), list[Any]()
    evaluate = ChainProblem.evaluate

    def watched(self: ChainProblem, drives: Any, amplitudes: Any, planes: Any = None) -> Any:
        taken.append(planes)
        return evaluate(self, drives, amplitudes, planes)

    monkeypatch.setattr(ChainProblem, "evaluate", watched)
    states = list(hv.iterate(system, stack, settings))
    few = [number for number, planes in enumerate(taken) if planes is not None]
    assert few and max(few) < 0.7 * 45 and not any(number % 7 == 0 or number % 10 == 0 for number in few)
    turns = [{*taken[n], *taken[n + 1]} for n in few if n % 2 == 0 and n + 1 in few]
    assert turns and all(len(turn) == 4 for turn in turns)  # two of five in an iteration, others in the next
    whole = min((states[n] for n, planes in enumerate(taken) if planes is None), key=lambda state: state.loss)
    assert states[-1].best_psnr_db == whole.psnr_db
    assert states[-1].best_psnr_db > states[0].psnr_db
    problem = ChainProblem(system, stack, settings)
    best = {name: torch.from_numpy(drive) for name, drive in states[-1].best.drive.items()}
    amplitudes = states[-1].best.system.amplitudes
    loss = problem.loss(evaluate(problem, best, amplitudes), amplitudes)[0]
    assert float(loss) == pytest.approx(whole.loss, rel=1e-5)  # f32


def test_a_run_with_drawn_planes_goes_on_from_its_checkpoint(tmp_path: Path) -> None:
    system, stack = _with_five_planes("phase and amplitude")
    settings, whole = hv.Settings(iterations=20, drawn_planes=1), []
    for state in hv.iterate(system, stack, settings):
        whole.append(state)
        if state.iteration == 2:
            state.checkpoint().save(tmp_path / "checkpoint.safetensors")
    found = list(hv.iterate(system, stack, settings, resume=load_checkpoint(tmp_path / "checkpoint.safetensors")))
    assert [s.loss for s in found] == [s.loss for s in whole[3:]]
    assert found[0].picture().shape == stack.shape[1:]


@pytest.mark.parametrize(
    ("name", "free"),
    [
        ("phase and amplitude", ("patterns", "amplitudes")),
        ("complex, and a phase that all frames share", ("patterns", "amplitudes")),
        ("phase and amplitude", ("patterns", "amplitudes", "wavelengths")),
    ],
)
def test_a_chain_goes_on_from_a_checkpoint_bit_for_bit(name: str, free: tuple[str, ...], tmp_path: Path) -> None:
    system, settings = _chain(*_CHAINS[name], frames=2), hv.Settings(iterations=9, free=free)
    whole = []
    for state in hv.iterate(system, _STACK, settings):
        whole.append(state)
        if state.iteration == 2:
            state.checkpoint().save(tmp_path / "checkpoint.safetensors")
    found = list(hv.iterate(system, _STACK, settings, resume=load_checkpoint(tmp_path / "checkpoint.safetensors")))
    assert [(s.iteration, s.loss, s.best_psnr_db) for s in found] == [
        (s.iteration, s.loss, s.best_psnr_db) for s in whole[3:]
    ]
    assert all(np.array_equal(found[-1].best.drive[key], drive) for key, drive in whole[-1].best.drive.items())
    assert np.array_equal(found[-1].best.system.wavelengths_m, whole[-1].best.system.wavelengths_m)
    assert np.array_equal(found[-1].best.system.wavelengths_m, system.wavelengths_m) == ("wavelengths" not in free)


def test_a_checkpoint_of_another_chain_is_refused_with_the_difference(tmp_path: Path) -> None:
    system, settings = _chain(*_CHAINS["phase and amplitude"]), hv.Settings(iterations=3)
    next(iter(hv.iterate(system, _STACK, settings))).checkpoint().save(tmp_path / "checkpoint.safetensors")
    stored, other = load_checkpoint(tmp_path / "checkpoint.safetensors"), system.with_(planes=["2 mm", "4 mm"])
    with pytest.raises(hv.UserError, match="planes"):
        next(iter(hv.iterate(other, _STACK, settings, resume=stored)))


def test_the_best_of_a_checkpoint_stays_the_best(tmp_path: Path) -> None:
    """Of a step so large that the first patterns are the best."""
    system = _chain(_pixels("complex"))
    settings = hv.Settings(iterations=6, step_rad=3.0)
    whole = list(hv.iterate(system, _STACK, settings))
    for state in hv.iterate(system, _STACK, settings):
        if state.iteration == 4:
            state.checkpoint().save(tmp_path / "checkpoint.safetensors")
            break
    *_, last = hv.iterate(system, _STACK, settings, resume=load_checkpoint(tmp_path / "checkpoint.safetensors"))
    assert np.array_equal(last.best.drive["complex"], whole[-1].best.drive["complex"])
    assert np.array_equal(last.best.system.amplitudes, whole[-1].best.system.amplitudes)


# --- places of the pupil ----------------------------------------------------------------------------------------------

_EYE = {"eyepiece": "5 mm", "pupil": "0.5 mm", "accommodation": ["0 D", "4 D"]}
_EYES = {
    "a stop": {},
    "an eye that moves as a whole": {"chromatic_axis": "pupil", "prescription": {"aberration": {"Z8": "60 nm"}}},
    "a pupil function": {"stiles_crawford": True},
}
_PLACES = ((0.0, 0.0), (0.1e-3, -0.2e-3), (0.0, 0.3e-3))


def _seen_chain(name: str, eye: str) -> System:
    return _chain(*_CHAINS[name], frames=2).with_(eye=_EYE | _EYES[eye])


def _stacks_at(places: Any) -> np.ndarray:
    """Pictures that depend on the place, (place · plane, y, x, 3)."""
    x = np.linspace(0, 6, 40)[:, None]
    one = [np.broadcast_to(0.4 + 0.3 * np.sin(x + 1e4 * px + 3e4 * py), (2, 32, 40, 3)) for py, px in places]
    return np.concatenate(one).astype(np.float32)


@pytest.mark.parametrize(
    ("name", "eye"),
    [*((name, "a pupil function") for name in _CHAINS), *(("phase and amplitude", eye) for eye in list(_EYES)[:2])],
)
def test_each_place_sees_what_a_simulation_of_its_eye_shows(name: str, eye: str) -> None:
    """Of a problem that was made for the places, and of one that moved there from others."""
    system = _seen_chain(name, eye)
    drives, stack = _own_drives(system), _stacks_at(_PLACES)
    made = ChainProblem(system, stack, hv.Settings(pupil_places_m=_PLACES), double=True)
    first = ((1e-4, 0.0), (0.0, 0.0), (0.2e-3, 0.1e-3))
    moved = ChainProblem(system, _stacks_at(first), hv.Settings(), double=True, places_m=first)
    moved.evaluate(drives, system.amplitudes)
    moved.see_from(_PLACES, stack)
    shown = {key: drive.numpy() for key, drive in drives.items()}
    views = [hv.simulate(with_pupil_at(system, place), shown, backend="torch64") for place in _PLACES]
    expected = np.concatenate([view.intensity for view in views])
    for problem in (made, moved):
        light = problem.evaluate(drives, system.amplitudes).intensity
        seen = np.zeros(expected.shape)
        for (frame, wavelength), one in zip(problem.lasers, light.numpy(), strict=True):
            seen[:, wavelength] += system.amplitudes[frame, wavelength] * one
        # both in float64, in the same stages
        np.testing.assert_allclose(seen, expected, rtol=0, atol=1e-12 * expected.max())
    assert np.abs(views[1].intensity - views[0].intensity).max() > 1e-2 * expected.max()
    losses = [p.loss(p.evaluate(drives, system.amplitudes), system.amplitudes)[0] for p in (made, moved)]
    assert float(losses[0]) == pytest.approx(float(losses[1]), rel=1e-12)


def test_the_derivative_for_many_places_is_that_of_the_loss() -> None:
    system = _seen_chain("side by side", "a pupil function")
    problem = ChainProblem(system, _stacks_at(_PLACES), hv.Settings(pupil_places_m=_PLACES), double=True)
    patterns = {key: drive.numpy() for key, drive in _own_drives(system).items()}
    drives, ways = free_drives(patterns, np.random.default_rng(1))
    along, loss = slope_along(problem, system, drives, ways)
    h = 1e-4  # as of the other losses
    measured = (8 * (loss(h) - loss(-h)) - (loss(2 * h) - loss(-2 * h))).detach() / (12 * h)
    assert along == pytest.approx(float(measured), rel=1e-7)


@pytest.mark.parametrize("stopped", [1, 4])
def test_places_that_are_drawn_are_drawn_again_from_a_checkpoint(stopped: int, tmp_path: Path) -> None:
    """To the bit; the latest hologram is the result, since losses of different draws can't be compared."""
    system = _seen_chain("phase and amplitude", "a stop")
    settings = hv.Settings(iterations=6, amplitudes_every=4, drawn_pupils=3, drawn_radius_m=0.2e-3)
    whole, file = [], tmp_path / "checkpoint.safetensors"
    for state in hv.iterate(system, _stacks_at, settings):
        whole.append(state)
        if len(whole) == stopped:
            state.checkpoint().save(file)
    found = list(hv.iterate(system, _stacks_at, settings, resume=load_checkpoint(file)))
    assert [state.loss for state in found] == [state.loss for state in whole[stopped:]]
    bests = [state.best.drive["phase"] for state in whole]
    assert all(not np.array_equal(one, other) for one, other in pairwise(bests))
    assert np.array_equal(found[-1].best.drive["phase"], bests[-1])
