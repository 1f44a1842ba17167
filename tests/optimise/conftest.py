"""What the optimiser's tests share: small benches, and a plain model differentiated by autograd."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pytest
import torch

from holoview.holograms.optimise.forward_model import ForwardModel, PlainBeam
from holoview.holograms.optimise.problem import Problem
from holoview.holograms.optimise.propagation import TORCH_KERNELS
from holoview.holograms.optimise.settings import Settings
from holoview.light.model.bench_parts import Modulator
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System

STROKE_M = 825e-9

CASES: dict[str, dict[str, Any]] = {
    "two modulators": {},
    "one modulator": {"modulators": [{"pitch": "8 um", "shape": [6, 7], "stroke": "825 nm"}], "gap": None},
    "sources": {"source": {"directions": [[0, 0], [0.01, -0.02], [-0.03, 0.005]]}},
    "tilts": {"source": {"directions": [[0, 0], [0.01, -0.02]], "tilts": [[0.004, 0], [-0.002, 0.003]]}},
    "stops": {"relay1.iris_na": 0.04, "relay2.iris_na": 0.03, "relay2.dc_block_na": 0.004},
    "glass": {"relay2": {"iris_na": 0.04, "apodisation_na": 0.03, "aberration": {"Z4": "70 nm", "Z8": "40 nm"}}},
    "glass in the gap": {"relay1": {"iris_na": 0.05, "apodisation_na": 0.04, "aberration": {"Z5": "60 nm"}}},
    "periodic": {"propagation": "periodic"},
    "first orders": {"relay1.square": "first order", "relay2.square": "first order"},
    "off centre": {"relay1.iris_na": 0.03, "relay2.iris_na": 0.02, "relay2.centre_na": [0.01, -0.02]},
    "order off centre": {"relay1.square": "first order", "relay1.centre_na": [0, 0.03], "upsample": 3},
    "half a stop": {"relay2.iris_na": 0.02, "propagation": "periodic"},
    "a stop in the gap": {"relay1.iris_na": 0.02, "relay1.dc_block_na": 0.004},
    "a block alone": {"relay2.dc_block_na": 0.01},
    "stops and sources": {
        "relay1.iris_na": 0.04,
        "relay2.square": "first order",
        "source": {"directions": [[0, 0], [0.01, -0.02], [-0.03, 0.005]]},
    },
    "upsampled thrice": {"upsample": 3},
    "upsampled seven times": {"upsample": 7},
    "not upsampled": {"upsample": 1},
    "an eye": {"eye": {"eyepiece": "5 mm", "pupil": "0.5 mm", "pupil_x": "0.1 mm", "accommodation": ["3 D", "9 D"]}},
    "an eye that moves as a whole": {
        "eye": {
            "eyepiece": "8 mm",
            "pupil": "0.6 mm",
            "pupil_y": "-0.1 mm",
            "chromatic_axis": "pupil",
            "stiles_crawford": True,
            "prescription": {"cylinder": "5 D", "axis": 20.0, "aberration": {"Z8": "60 nm"}},
        }
    },
}


def small_bench(**changes: Any) -> System:
    """A bench of two modulators of 12 × 16 pixels, three lasers and two planes, with some of its keys changed."""
    modulator = Modulator(pitch_m=8e-6, shape=(12, 16), stroke_m=STROKE_M)
    base = System(
        wavelengths_m=[460e-9, 532e-9, 638e-9],
        amplitudes=[[1.0, 1.0, 1.0]],
        modulators=(modulator, modulator),
        gap_m=0.4e-3,
        planes_m=[0.4e-3, 0.5e-3],
    )
    return base.edit(changes)


def _plan_of(case: str) -> Plan:
    """A plan of two frames, two lasers and three planes; both modulators 6 × 7 pixels."""
    modulator = Modulator(pitch_m=8e-6, shape=(6, 7), stroke_m=STROKE_M)
    base = System(
        wavelengths_m=[460.3e-9, 638.2e-9],
        amplitudes=[[1.0, 2.0], [3.0, 1.0]],
        modulators=(modulator, modulator),
        gap_m=0.5e-3,
        planes_m=[0.8e-3, 1e-3, 1.3e-3],
    )
    return make_plan(base.edit(CASES[case]))


@dataclass(frozen=True)
class Plain:
    """A bench's light by the plain pair: every field padded, every sample for itself; torch differentiates it."""

    plan: Plan

    def spectrum(self, opd_m: torch.Tensor, frame: int, laser: int, source: int) -> torch.Tensor:
        """W: the spectrum behind the last modulator, (P_y, P_x) complex128."""
        beam = PlainBeam(self.plan, laser, source)
        return beam.spectrum(beam.forward(opd_m[frame])[1][-1])

    def intensity(self, opd_m: torch.Tensor, frame: int, laser: int) -> torch.Tensor:
        """Mean intensity over sources at unit amplitude, (plane, y, x)."""
        beams = [PlainBeam(self.plan, laser, source) for source in range(len(self.plan.slopes))]
        return torch.stack([beam.forward(opd_m[frame])[0].abs().square() for beam in beams]).mean(dim=0)


def intensity_at(model: ForwardModel, plane: int) -> torch.Tensor:
    """The intensity of every laser at a plane, mean over sources, unit amplitude: (laser, y, x)."""

    def squares(plane: int, rows: slice, fields: torch.Tensor) -> torch.Tensor:
        return fields.abs().square().mean(dim=1)

    return torch.cat(model.process_planes([plane], squares, carry_back=False)[0], dim=1)


def carry_back(model: ForwardModel, plane: int, slopes: torch.Tensor) -> None:
    """Adds a plane's part to c_W, for slopes of the loss with respect to the intensities (laser, y, x)."""

    def conjugate_gradients(plane: int, rows: slice, fields: torch.Tensor) -> None:
        fields.copy_(fields.conj() * slopes[:, None, rows] * (2 / fields.shape[1]))

    model.process_planes([plane], conjugate_gradients, carry_back=True)


def _noise(seed: int, *shape: int) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest) -> str:
    """Each kind of bench that the model treats differently."""
    return str(request.param)


@pytest.fixture(scope="session")
def plan_of() -> Callable[[str], Plan]:
    """The plan of a case."""
    return _plan_of


@pytest.fixture(scope="session")
def plain() -> type[Plain]:
    """`plain(plan).intensity(opd_m, frame, laser)`."""
    return Plain


@pytest.fixture(scope="session")
def noise() -> Callable[..., torch.Tensor]:
    """`noise(seed, *shape)`: uniform in 0…1, float64."""
    return _noise


@pytest.fixture(scope="session")
def bench() -> Callable[..., System]:
    """`bench(upsample=3)`: see `small_bench`."""
    return small_bench


@pytest.fixture(scope="session")
def stack_for() -> Callable[..., np.ndarray]:
    """A smooth colour image in linear sRGB at every plane of a system."""

    def made(system: System, seed: int = 0) -> np.ndarray:
        plan = make_plan(system)
        rows, columns = plan.grid.shape
        y, x = np.mgrid[0:rows, 0:columns] / max(rows, columns)
        phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, 3)
        image = 0.3 + 0.2 * np.cos(2 * np.pi * (x + y)[..., None] + phases)
        return np.repeat(image[None], len(plan.planes_m), axis=0)

    return made


@pytest.fixture(scope="session")
def double_problem() -> Callable[[System, np.ndarray, Settings], Problem]:
    """A `Problem` that computes in float64, so that finite differences can check it to eight digits."""
    return partial(Problem, double=True)


@pytest.fixture
def kernels_of_a_card(monkeypatch: pytest.MonkeyPatch) -> None:
    """The processor computes with the kernels that a card has, so that both round alike."""
    monkeypatch.setattr("holoview.holograms.optimise.problem.choose_kernels", lambda device: TORCH_KERNELS)
