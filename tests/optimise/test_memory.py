"""The estimate of the memory that an optimisation needs, and the error when there is less."""

from __future__ import annotations

import re
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
import psutil
import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from holoview.holograms.optimise.memory import memory_guard, peak_bytes, with_compact_grid
from holoview.holograms.optimise.problem import Problem
from holoview.holograms.optimise.propagation import TORCH_KERNELS
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.solve import iterate
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.util.errors import UserError

Bench = Callable[..., System]

BENCHES: dict[str, dict[str, Any]] = {
    "two modulators": {},
    "one modulator": {"modulators": [{"pitch": "8 um", "shape": [40, 50], "stroke": "825 nm"}], "gap": None},
    "frames and planes": {"amplitudes": np.eye(3), "planes": ["0.1 mm", "0.2 mm", "0.3 mm", "0.4 mm"]},
    "sources": {"source": {"directions": [[0, 0], [0.01, 0], [0, 0.01], [0.01, 0.01]]}},
    "first order": {"relay1.square": "first order", "relay2.square": "first order"},
    "last order of sources": {"relay2.square": "first order", "source": {"directions": [[0, 0], [0.01, 0]]}},
    "eight lasers": {"wavelengths": [f"{λ} nm" for λ in range(460, 620, 20)], "amplitudes": "white"},
    "some lasers off": {"amplitudes": [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]},
}


@pytest.fixture(autouse=True)
def _by_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    """Torch computes all: compiled passes, whose buffers `_Peak` doesn't see, keep fewer fields."""
    monkeypatch.setattr("holoview.holograms.optimise.problem.choose_kernels", lambda device: TORCH_KERNELS)


def _system(bench: Bench, name: str = "two modulators") -> System:
    return bench(**({"shape": [40, 50], "gap": "0.1 mm", "planes": ["0.1 mm", "0.2 mm"]} | BENCHES[name]))


class _Peak(TorchDispatchMode):
    """Counts the bytes of every tensor that torch makes inside the block while it lives, and their highest sum."""

    def __init__(self) -> None:
        super().__init__()
        self.now = self.highest = 0
        self._sizes: dict[int, int] = {}

    def __torch_dispatch__(
        self, function: Any, types: Any, args: tuple[Any, ...] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        made = function(*args, **(kwargs or {}))
        for tensor in tree_leaves(made):
            if isinstance(tensor, torch.Tensor):
                self._count(tensor.untyped_storage())
        return made

    def _count(self, storage: torch.UntypedStorage) -> None:
        key = storage._cdata
        if key in self._sizes:  # a view, or the result of an operation in place
            return
        self._sizes[key] = storage.nbytes()
        self.now += storage.nbytes()
        self.highest = max(self.highest, self.now)
        weakref.finalize(storage, self._forget, key)

    def _forget(self, key: int) -> None:
        self.now -= self._sizes.pop(key)


def _peak_of(system: System, iterations: int = 1, **settings: Any) -> int:
    plan = make_plan(system)
    stack = np.full((len(plan.planes_m), *plan.grid.shape, 3), 0.5, dtype=np.float32)
    with _Peak() as peak:
        for _ in iterate(system, stack, Settings(iterations=iterations, amplitudes_every=1, **settings)):
            pass
    return peak.highest


def test_the_peak_counts_what_lives_at_a_time() -> None:
    with _Peak() as peak:
        kept = torch.ones(1000, dtype=torch.complex64)
        (kept * 2).add_(1)
        kept.view(10, 100)[:5].mul_(2)
        torch.fft.fft2(kept.view(10, 100))
    assert peak.now == 8000
    assert peak.highest == 16000


@pytest.mark.parametrize("name", BENCHES)
def test_the_estimate_is_within_a_tenth_of_what_an_optimisation_holds_at_its_peak(name: str, bench: Bench) -> None:
    system = with_compact_grid(_system(bench, name))
    assert peak_bytes(system) == pytest.approx(_peak_of(system), rel=0.1)


@pytest.mark.parametrize(
    "settings",
    [
        {"loss": "srgb"},
        {"loss": "xyz", "eyebox": 0.1},
        {"free": ("patterns", "amplitudes", "wavelengths")},
    ],
    ids=["encoded", "eyebox", "wavelengths"],
)
def test_the_estimate_holds_for_other_settings(settings: dict[str, Any], bench: Bench) -> None:
    system = with_compact_grid(_system(bench, "eight lasers"))
    needed = peak_bytes(system, free_wavelengths="wavelengths" in settings.get("free", ()))
    assert needed == pytest.approx(_peak_of(system, 4, **settings), rel=0.1)


@pytest.mark.long
@pytest.mark.parametrize("name", ["two modulators", "eight lasers", "sources"])
def test_a_loss_by_structure_takes_a_whole_plane_at_once(name: str, bench: Bench) -> None:
    system = with_compact_grid(_system(bench, name))
    larger = system.edit({"shape": [100, 125]})
    for one in (system, larger):
        needed = peak_bytes(one, whole_planes=True)
        assert needed == pytest.approx(_peak_of(one, 2, loss="ms-ssim"), rel=0.1)


def test_a_bench_on_twice_the_grid_is_estimated_on_the_compact_one(bench: Bench) -> None:
    system = _system(bench)
    assert system.sampling.propagation == "linear"
    assert peak_bytes(system) == peak_bytes(with_compact_grid(system))
    assert with_compact_grid(system).sampling.propagation == "compact"
    periodic = system.edit({"propagation": "periodic"})
    assert with_compact_grid(periodic) is periodic


@pytest.mark.parametrize(
    ("raised", "found"),
    [
        (MemoryError(), "and ran out"),
        (RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory: you tried …"), "on cpu and ran out"),
        (RuntimeError("CUDA out of memory. Tried to allocate 2.00 GiB"), "on cpu and ran out"),
        (torch.cuda.OutOfMemoryError("Out of memory"), "on cpu and ran out"),
    ],
    ids=["python", "torch", "cuda", "cuda's own"],
)
def test_running_out_of_memory_is_said_with_what_is_needed_and_what_to_lower(
    raised: Exception, found: str, bench: Bench
) -> None:
    plan = make_plan(with_compact_grid(_system(bench)))
    needed = f"{peak_bytes(plan.system) / 2**30:.3g} GiB"
    message = f"optimisation: needs about {needed} of memory {found}"
    pattern = f"^{re.escape(message)}.*lower shape, upsample, frames, sources"
    with pytest.raises(UserError, match=pattern), memory_guard(plan, "cpu"):
        raise raised


@pytest.mark.parametrize(
    "raised", [RuntimeError("shape mismatch"), ValueError("memory"), UserError("x", "y")], ids=repr
)
def test_other_errors_pass(raised: Exception, bench: Bench) -> None:
    with pytest.raises(type(raised)) as caught, memory_guard(make_plan(_system(bench)), "cpu"):
        raise raised
    assert caught.value is raised


def test_a_machine_that_is_too_small_is_told_before_anything_is_made(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    system = _system(bench)
    plan, entered = make_plan(system), []
    tiny = psutil.virtual_memory()._replace(total=1 << 20)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: tiny)
    with pytest.raises(UserError, match=r"GiB of memory of 0\.000977 GiB"), memory_guard(plan, "cpu"):
        entered.append("cpu")
    with memory_guard(plan, "cuda"):  # its memory is another
        entered.append("cuda")
    assert entered == ["cuda"]
    with pytest.raises(UserError, match="lower shape"):
        Problem(system, np.full((2, *plan.grid.shape, 3), 0.5), Settings())
