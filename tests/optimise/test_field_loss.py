"""A complex target: the loss by its definition, its gradient, and holograms that show a field with its phase."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from PIL import Image

import holoview as hv
from holoview.commands.cli import main
from holoview.holograms.fields.field_target import FieldTarget
from holoview.holograms.optimise.chain_loop import ChainProblem
from holoview.holograms.optimise.field_loss import ComplexTarget
from holoview.holograms.optimise.problem import EvaluationRequest, Problem
from holoview.holograms.optimise.settings import Settings
from holoview.light.model import preset
from holoview.light.model.elements import Space
from holoview.light.model.system import System
from holoview.util.errors import UserError
from tests.optimise.chain_slopes import free_drives, slope_along

PLANES = ["4 mm", "6 mm"]
REGION = (6, 4, 40, 30)


def _system(**changes: Any) -> System:
    lasers = {"wavelengths": ["460 nm", "620 nm"], "amplitudes": [[1.0, 0.7]]}
    return hv.load("holochrome-8").edit({"shape": [20, 28], "planes": PLANES, **lasers, **changes})


def _scene(system: System, seed: int = 5) -> FieldTarget:
    """The field that the bench itself sends with some patterns."""
    one = hv.Hologram(hv.random_drive(system, seed), system)
    return hv.as_field(one).scene()


def _fidelity(system: System, drive: NDArray[Any], target: ComplexTarget, region: tuple[int, int, int, int]) -> float:
    """The mean of |⟨T, E⟩|²/(‖T‖²‖E‖²) over planes and lasers, from the fields of the reference executor."""
    x, y, width, height = region
    cut = (slice(y, y + height), slice(x, x + width))
    found = []
    for plane, z in enumerate(system.planes_m):
        for laser in range(len(system.wavelengths_m)):
            light = hv.field_at(system, drive, stage="plane", plane=float(z), laser=laser).values[cut]
            wanted = target.fields[plane, 0, laser][cut]
            found.append(abs(np.vdot(wanted, light)) ** 2 / (np.linalg.norm(wanted) * np.linalg.norm(light)) ** 2)
    return float(np.mean(found))


def test_the_loss_is_what_the_fields_overlap_by() -> None:
    system = _system()
    target, drive = ComplexTarget.of(_scene(system), system), hv.random_drive(system)
    problem = Problem(system, target, Settings(region=REGION), double=True)
    path = torch.from_numpy(drive.astype(np.float64)) * system.modulators[0].stroke_m
    loss = problem.evaluate(path, system.amplitudes, EvaluationRequest()).loss
    assert loss == pytest.approx(1 - _fidelity(system, drive, target, REGION), abs=1e-6)  # the target is complex64


def test_a_constant_phase_and_the_power_do_not_count() -> None:
    system = _system()
    target, drive = ComplexTarget.of(_scene(system), system), hv.random_drive(system)
    turned = ComplexTarget(target.stack, (3 * np.exp(0.7j) * target.fields).astype(np.complex64))
    path = torch.from_numpy(drive.astype(np.float64)) * system.modulators[0].stroke_m
    losses = [
        Problem(system, of, Settings(), double=True).evaluate(path, amplitudes, EvaluationRequest()).loss
        for of, amplitudes in ((target, system.amplitudes), (turned, 5 * system.amplitudes))
    ]
    assert losses[0] == pytest.approx(losses[1], abs=1e-6)


@pytest.mark.parametrize("directions", [[1, 1], [1, 2]])
def test_its_gradient_is_what_central_differences_approach(directions: list[int]) -> None:
    system = _system(source={"grid": directions, "spacing": "2 mrad"}) if directions != [1, 1] else _system()
    target = ComplexTarget.of(_scene(_system()), system)
    settings = Settings(region=REGION, plane_weights=(1.0, 2.0))
    problem = Problem(system, target, settings, double=True)
    rng, λ = np.random.default_rng(0), float(system.wavelengths_m[0])
    path = torch.from_numpy(rng.random(system.drive_shape)) * λ
    step = torch.from_numpy(rng.normal(size=system.drive_shape)) * λ
    found = problem.evaluate(path, system.amplitudes, EvaluationRequest(path_gradient=True)).path_gradient
    assert found is not None
    size = 1e-5  # rounding 1e-16/1e-5
    ahead, behind = (
        problem.evaluate(path + sign * size * step, system.amplitudes, EvaluationRequest()).loss for sign in (1, -1)
    )
    # Phases turn by 2π of a step: the cubic term is (2π)³·size²/6 of the loss, 4e-9; with 60 draws 7e-10 r.m.s., beside
    # slopes of 0.08.
    assert float((found * step).sum()) == pytest.approx((ahead - behind) / (2 * size), rel=1e-6, abs=1e-8)


def test_a_hologram_shows_a_field_with_its_phase() -> None:
    """Two modulators show a smooth beam that converges: from 2 % of the power, as random, to most of it."""
    system = _system(planes=["4 mm"])
    y, x = (np.arange(n) * 8e-6 - (n - 1) * 4e-6 for n in (20, 28))
    squared = y[:, None] ** 2 + x**2
    beam = np.exp(-squared / (60e-6) ** 2)[None] * np.exp(
        -1j * np.pi * squared[None] / (system.wavelengths_m[:, None, None] * 30e-3)
    )
    scene = hv.load_field(beam.astype(np.complex64), pitch="8 um", wavelengths=list(system.wavelengths_m)).scene("4 mm")
    target = ComplexTarget.of(scene, system)
    states = list(hv.iterate(system, target, Settings(iterations=40)))
    best = states[-1].best
    whole = (0, 0, 56, 40)
    found = _fidelity(best.system, best.drive, target, whole)
    assert found == pytest.approx(1 - states[-1].loss, abs=1e-4)  # f32
    assert _fidelity(system, hv.random_drive(system), target, whole) < 0.1 and found > 0.5


def test_the_command_takes_a_field_and_refuses_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    system = _system()
    hv.as_field(hv.Hologram(hv.random_drive(system), system)).save(tmp_path / "field.safetensors")
    (tmp_path / "bench.toml").write_text(preset.dumps(system))
    out = tmp_path / "found.safetensors"
    arguments = ["optimise", str(tmp_path / "bench.toml"), str(tmp_path / "field.safetensors"), "--device", "cpu"]
    assert main([*arguments, "--loss", "field", "--iterations", "3", "-o", str(out)]) == 0
    assert hv.load_hologram(out).system.wavelengths_m.tolist() == system.wavelengths_m.tolist()
    Image.new("RGB", (8, 8), "orange").save(tmp_path / "orange.png")
    arguments[2] = str(tmp_path / "orange.png")
    assert main([*arguments, "--loss", "field", "-o", str(out)]) == 2
    assert "expected a complex field as the target" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("changes", "settings", "said"),
    [
        ({"levels": 4}, {}, "levels"),
        ({}, {"free": ("patterns", "wavelengths")}, "wavelengths"),
        ({}, {"loss": "xyz"}, "its fields are compared"),
    ],
)
def test_what_it_cannot_have_is_said(changes: dict[str, Any], settings: dict[str, Any], said: str) -> None:
    system = _system(**changes)
    target = ComplexTarget.of(_scene(_system()), system)
    with pytest.raises(UserError, match=said):
        Problem(system, target, Settings(**settings))


PIXELS = {"kind": "phase", "pitch": "8 um", "shape": [20, 28], "stroke": "825 nm"}
SPACE = {"kind": "space", "distance": "1 mm", "square": "first order"}
CHAINS: dict[str, tuple[dict[str, Any], ...]] = {
    "phase and coarse amplitude": (PIXELS, SPACE, {"kind": "amplitude", "pitch": "16 um", "shape": [10, 14]}),
    "complex": ({"kind": "complex", "pitch": "8 um", "shape": [20, 28]},),
    "two arms": (PIXELS | {"name": "one"}, PIXELS | {"beside": "one", "name": "other"}, SPACE, PIXELS),
}


def _chain(name: str) -> System:
    lasers = {"wavelengths_m": ["460 nm", "620 nm"], "amplitudes": [[1.0, 0.7]]}
    return System(**lasers, elements=CHAINS[name], planes_m=PLANES)


@pytest.mark.parametrize("name", CHAINS)
def test_the_loss_of_a_chain_is_what_the_fields_overlap_by(name: str) -> None:
    system = _chain(name)
    target, drive = ComplexTarget.of(_scene(system), system), hv.random_drive(system)
    problem = ChainProblem(system, target, Settings(region=REGION), double=True)
    shown = {own: torch.from_numpy(patterns) for own, patterns in drive.items()}
    losses = [
        problem.loss(problem.evaluate(shown, system.amplitudes, planes), system.amplitudes)[0]
        for planes in (None, (0,), (1,))
    ]
    assert float(losses[0]) == pytest.approx(1 - _fidelity(system, drive, target, REGION), abs=1e-6)
    assert float(losses[0]) == pytest.approx(float(losses[1] + losses[2]) / 2, rel=1e-9)


@pytest.mark.parametrize("name", CHAINS)
def test_the_derivative_of_a_chain_is_what_central_differences_approach(name: str) -> None:
    system, rng = _chain(name), np.random.default_rng(0)
    target = ComplexTarget.of(_scene(system), system)
    problem = ChainProblem(system, target, Settings(region=REGION, plane_weights=(1.0, 2.0)), double=True)
    drives, ways = free_drives(hv.random_drive(system), rng)
    slope, loss = slope_along(problem, system, drives, ways)
    size = 1e-6  # as above; rounding 1e-16/1e-6
    assert slope == pytest.approx(float((loss(size) - loss(-size)).detach()) / (2 * size), rel=1e-6, abs=1e-8)


def test_a_chain_in_place_of_a_short_form_has_its_loss_of_fields(tmp_path: Path) -> None:
    """A mask without any path changes nothing, and makes a chain."""
    np.save(tmp_path / "flat.npy", np.zeros((20, 28)))
    system = _system(gap=None, modulators=[{"pitch": "8 um", "shape": [20, 28], "stroke": "825 nm"}])
    mask = {"kind": "mask", "pitch": "8 um", "file": str(tmp_path / "flat.npy")}
    chain = System(
        system.wavelengths_m,
        system.amplitudes,
        elements=[PIXELS, mask, Space.over(None, system.relay2)],
        planes_m=PLANES,
        sampling=system.sampling,
        observer=system.observer,
    )
    target, drive = ComplexTarget.of(_scene(system), system), hv.random_drive(system)
    path = torch.from_numpy(drive.astype(np.float64)) * system.modulators[0].stroke_m
    expected = Problem(system, target, Settings(), double=True).evaluate(path, system.amplitudes, EvaluationRequest())
    problem = ChainProblem(chain, target, Settings(), double=True)
    found = problem.evaluate({"phase": torch.from_numpy(drive[:, 0])}, chain.amplitudes)
    assert float(problem.loss(found, chain.amplitudes)[0]) == pytest.approx(expected.loss, rel=1e-9)


@pytest.mark.parametrize("name", CHAINS)
def test_a_chain_shows_a_field_with_its_phase(name: str) -> None:
    """That of other patterns of the same bench: more of it than random patterns show."""
    system = _chain(name)
    target = ComplexTarget.of(_scene(system), system)
    states = list(hv.iterate(system, target, Settings(iterations=40)))
    best = states[-1].best
    found, before = (
        _fidelity(system, drive, target, (0, 0, 56, 40)) for drive in (best.drive, hv.random_drive(system))
    )
    # the bench's own lasers: fidelities don't depend on powers; f32
    assert found == pytest.approx(1 - min(state.loss for state in states), abs=1e-4)
    assert found > before + 0.05 and np.isfinite(states[-1].psnr_db)


@pytest.mark.parametrize(
    ("levels", "settings", "said"),
    [
        (2, {}, "levels"),
        (None, {"free": ("patterns", "wavelengths")}, "wavelengths"),
        (None, {"loss": "xyz"}, "its fields are compared"),
    ],
)
def test_what_the_loss_of_a_chain_cannot_have_is_said(levels: int | None, settings: dict[str, Any], said: str) -> None:
    system = _chain("phase and coarse amplitude")
    target = ComplexTarget.of(_scene(system), system)
    system = system if levels is None else system.edit({"elements.amplitude.levels": levels})
    with pytest.raises(UserError, match=said):
        next(iter(hv.iterate(system, target, Settings(**settings))))


def test_a_laser_that_the_field_lacks_is_said() -> None:
    system = _system()
    with pytest.raises(UserError, match="a laser of the system"):
        ComplexTarget.of(_scene(system), system.with_(wavelengths=["460 nm", "640 nm"]))
