"""Small optimisations by a process group and by one process, for test_parallel.

`python process_group_run.py FOLDER` writes FOLDER/RANK.npz.

In double precision, so that no rounding hides a difference; the first case in single precision too.
"""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from holoview.holograms.optimise import solve
from holoview.holograms.optimise.parallel import SINGLE_PROCESS, ProcessGroup, torchrun_group
from holoview.holograms.optimise.problem import Problem
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.solve import iterate
from holoview.light.model.plan import make_plan
from tests.optimise.conftest import small_bench

TWO_FRAMES = [[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]]
CASES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "one frame": ({}, {}),
    "two frames, some lasers off": ({"amplitudes": TWO_FRAMES}, {}),
    "sources": ({"source": {"directions": [[0, 0], [0.01, -0.02]]}}, {}),
    "one modulator": ({"modulators": [{"pitch": "8 um", "shape": [12, 16], "stroke": "825 nm"}], "gap": None}, {}),
    "even eyebox": ({}, {"eyebox": 0.1}),
    "encoded": ({}, {"loss": "srgb"}),
    "free wavelengths": ({}, {"free": ("patterns", "amplitudes", "wavelengths")}),
    "a region": ({}, {"region": (4, 4, 20, 10)}),
    "levels": ({"levels": 16}, {}),
}


PROBED = "encoded"
PROBES = 3
_ROUNDING = 64 * np.finfo(np.float64).eps


def run(case: str, group: ProcessGroup, probe: int | None = None) -> dict[str, np.ndarray]:
    """Losses of the iterations, and the best hologram; for a probe's seed, of a target with its last digits changed."""
    changes, settings = CASES[case]
    system = small_bench(**changes)
    rows, columns = make_plan(system).grid.shape
    y, x = np.mgrid[0:rows, 0:columns] / max(rows, columns)
    image = 0.3 + 0.2 * np.cos(2 * np.pi * (x + y)[..., None] + np.array([0.0, 1.0, 3.0]))
    stack = np.repeat(image[None], len(system.planes_m), axis=0)
    if probe is not None:
        stack = stack * (1 + _ROUNDING * np.random.default_rng(probe).uniform(-1, 1, stack.shape))
    states = list(iterate(system, stack, Settings(iterations=12, amplitudes_every=3, **settings), team=group))
    best = states[-1].best
    return {
        "losses": np.array([state.loss for state in states]),
        "eyebox": np.array([state.eyebox for state in states]),
        "drive": best.drive,
        "amplitudes": best.system.amplitudes,
        "wavelengths": best.system.wavelengths_m,
    }


def run_all(group: ProcessGroup, label: str) -> dict[str, np.ndarray]:
    """The results of all cases, and of the first one in single precision."""
    found: dict[str, np.ndarray] = {}
    single = next(iter(CASES))
    for name, case, double in [("single", single, False), *((case, case, True) for case in CASES)]:
        torch.set_default_dtype(torch.float64 if double else torch.float32)
        solve.Problem = partial(Problem, double=double)  # type: ignore[misc,assignment]
        found |= {f"{name}{label}/{key}": value for key, value in run(case, group).items()}
    return found


def main(folder: Path) -> None:
    torch.set_num_threads(1)
    found: dict[str, np.ndarray] = {}
    with torchrun_group("cpu") as group:
        if group.is_main:
            found |= run_all(SINGLE_PROCESS, "/alone")
            for probe in range(PROBES):
                found |= {f"probe {probe}/{key}": value for key, value in run(PROBED, SINGLE_PROCESS, probe).items()}
        torch.set_default_dtype(torch.float32)  # as the other process has it
        group.any_rank(False)  # the other process waits, and reads what numba has compiled meanwhile
        found |= run_all(group, "")
    np.savez(folder / f"{group.rank}.npz", **found)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
