"""Torch or compiled kernels: the faster on this machine, measured once and remembered; compiled beside other work.

Compiling takes some ten seconds of a processor. `Compiler` is another process that does it, and leaves the machine code
and the choice in the user's cache folder; as a program, this module is that process.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import torch

from holoview.holograms.optimise.forward_model import ForwardModel
from holoview.holograms.optimise.parallel import torch_threads
from holoview.holograms.optimise.propagation import TORCH_KERNELS, Kernels, PlanePropagation
from holoview.light.engine.frame import spectrum_behind_modulators
from holoview.light.model import preset
from holoview.light.model.plan import make_plan
from holoview.light.optics.chain import ChainTransmissions
from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.files import cache_dir
from holoview.util.packages import import_optional
from holoview.util.processes import environment_of_python
from holoview.util.progress import TextCallback

_FORMAT = 3
"""Of the file of choices; to be increased when kernels become faster or slower."""
_FILE = "optimiser-kernels.json"
_PRESET, _SHAPE, _SMALL = "holochrome-8", (96, 128), (16, 16)
_CHAIN = "holochrome-8-static"
_ROUNDS = 5
_SOURCES = ("chain_kernels.py", "compiled_model.py", "vector_fft.py", "vector_kernels.py")
"""Of what is compiled: where one is another file than before, numba compiles anew."""


@cache
def choose_kernels(device: str) -> Kernels:
    """The faster kernels for a torch device: compiled ones only on the CPU, and where numba is installed.

    Both are timed when a machine computes its first hologram, and the choice is kept in the user's cache folder.
    """
    if torch.device(device).type != "cpu" or find_spec("numba") is None:
        return TORCH_KERNELS
    chosen = _remembered_name()
    if chosen is None:
        chosen = _faster_name()
        _remember(chosen)
    return TORCH_KERNELS if chosen == TORCH_KERNELS.name else _compiled_kernels()


def will_compile(device: str, *, chains: bool = False) -> bool:
    """Whether kernels for a torch device have yet to be compiled, which takes seconds: those of `choose_kernels`, which
    are timed, too; or, with chains, also those of chains of elements."""
    if torch.device(device).type != "cpu" or find_spec("numba") is None:
        return False
    chosen = _remembered_name()
    return chosen is None or (chains and chosen != TORCH_KERNELS.name and _chains_key() not in _remembered())


def compile_all(device: str) -> None:
    """Compiles all kernels for a torch device, chooses the faster ones, and remembers both, unless that is done."""
    kernels = choose_kernels(device)
    if will_compile(device, chains=True):
        _run_chain(kernels)
        _remember(kernels.name, _chains_key())


def load_kernels(device: str) -> None:
    """Loads what `choose_kernels` chooses, with the machine code, for the first iteration; never compiles."""
    if torch.device(device).type == "cpu" and not will_compile(device):
        _seconds(choose_kernels(device), _SMALL)


def _compiled_kernels() -> Kernels:
    """Raises UserError if numba can't be loaded."""
    import_optional("numba", "compiled kernels")
    from holoview.holograms.optimise.compiled_model import CompiledKernels

    return CompiledKernels()


def _faster_name() -> str:
    try:
        with torch_threads(1):  # as in a thread of the team
            rivals = (TORCH_KERNELS, _compiled_kernels())
            seconds = {kernels.name: [_seconds(kernels) for _ in range(_ROUNDS)] for kernels in rivals}
    except Exception:  # any failure of a compiler on an untried machine
        return TORCH_KERNELS.name
    return min(seconds, key=lambda name: min(seconds[name][1:]))  # the first round compiles


def _seconds(kernels: Kernels, shape: tuple[int, int] = _SHAPE) -> float:
    """Processor time of this thread for the loss of a display and its gradient, of equal pixels."""
    system = preset.load(_PRESET).with_(shape=shape, propagation="compact", planes=["10 mm", "11 mm"])
    model = ForwardModel(make_plan(system), kernels=kernels, threads=1)
    opd_m = torch.zeros(1, 2, *shape)
    target, weights = torch.ones(3, *model.plan.grid.shape), torch.ones(len(model.lasers), 3)

    def evaluate_rows(plane: int, rows: slice, fields: torch.Tensor) -> None:
        image = kernels.mix(fields, weights)
        kernels.replace_by_residual(image, target[:, rows], 1.0)
        kernels.replace_by_adjoint(fields, weights, image)

    def evaluate_lines(plane: int, rows: slice, lines: torch.Tensor, propagation: PlanePropagation) -> None:
        propagation.evaluate_rows(lines, rows, weights, target, 1.0, None, carry_back=True)

    started = time.thread_time()
    model.forward(opd_m)
    model.process_planes([0, 1], evaluate_rows, evaluate_lines, carry_back=True)
    model.accumulate_gradients(torch.zeros_like(opd_m))
    return time.thread_time() - started


def _run_chain(kernels: Kernels) -> None:
    """Calls all passes of a chain of elements once."""
    shapes = {f"elements.{name}.shape": _SMALL for name in ("phase", "mask")}
    system = preset.load(_CHAIN).edit({**shapes, "planes": ["10 mm"]})
    executor = kernels.chain_executor(make_plan(system), double=False, device="cpu")
    transmissions = executor.inputs.sampled_transmissions
    assert isinstance(transmissions, ChainTransmissions)
    drive = torch.zeros(1, *_SMALL, requires_grad=True)
    transmissions.show({"phase": drive})
    spectrum = spectrum_behind_modulators(executor, 0, 0, 0)
    shown = executor.intensities([([spectrum], 0)], [0]).sum() + executor.passed_power(spectrum, 0).sum()
    torch.autograd.grad(shown, drive)


def _key() -> str:
    """Everything that the times depend on."""
    versions = [version(library) for library in ("numba", "torch")]
    files = [Path(__file__).with_name(name).stat() for name in _SOURCES]
    stamps = [[file.st_mtime_ns, file.st_size] for file in files]
    return json.dumps([_FORMAT, platform.node(), platform.machine(), *versions, stamps])


def _remembered_name() -> str | None:
    name = _remembered().get(_key())
    return name if name in (TORCH_KERNELS.name, "compiled") else None


def _remembered() -> dict[str, Any]:
    try:
        entries = json.loads((cache_dir() / _FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return entries if isinstance(entries, dict) else {}


def _chains_key() -> str:
    """Of the kernels of chains, where these are compiled."""
    return f"chains of elements {_key()}"


def _remember(name: str, key: str = "") -> None:
    path = cache_dir() / _FILE
    with suppress(OSError, UserError):  # a folder that can't be written: the next run measures again
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, json.dumps(_remembered() | {key or _key(): name}, indent=1, sort_keys=True), is_durable=False)


# --- in another process -----------------------------------------------------------------------------------------------


_POLL_S = 0.2


class Compiler:
    """A process that compiles the kernels, times both, and remembers the choice. It ends with this program."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,  # closed when this program ends, however it does
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=environment_of_python(),
        )
        weakref.finalize(self, _end, self._process)

    @property
    def is_busy(self) -> bool:
        """Whether the choice may be still to come."""
        return self._process.poll() is None

    def wait(self, meanwhile: Callable[[], None] = lambda: None) -> None:
        """Waits until it has ended, and calls `meanwhile` several times a second.

        If it failed, nothing is remembered, and `choose_kernels` compiles.
        """
        while self.is_busy:
            meanwhile()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_POLL_S)


@cache
def compiler() -> Compiler:
    """The one of this program, which begins when it is first asked for."""
    return Compiler()


_WORK_BESIDE = 5e8  # samples of a field in a plane, which torch computes in 14 s of a processor, an AMD EPYC's


def iterations_beside(samples: float) -> int:
    """How many iterations of so many samples in planes torch computes in about the time in which another processor
    compiles."""
    return max(1, round(_WORK_BESIDE / samples))


def tell_of_turn(tell: TextCallback, beside: int, iterations: int) -> None:
    """Tells that kernels are compiled beside some iterations; a run that ends before has no need of them."""
    if beside <= iterations:
        tell(f"compiling for this processor, once, beside the first {beside} iterations")


class KernelTurn:
    """When an optimisation that began by torch, beside the compiler, goes on with the kernels that are chosen.

    at: the iteration; 0 where it began with them. tell: called while it waits, several times a second. chains: whether
    it is one of a chain of elements.
    """

    def __init__(self, device: str, tell: TextCallback, at: int, *, chains: bool = False) -> None:
        self._will_compile, self._tell, self.at = partial(will_compile, device, chains=chains), tell, at

    def is_due(self, iteration: int) -> bool:
        """Whether it is now; it then has waited for the compiler, which begins once the first picture is there."""
        if iteration == self.at > 0:
            if self._will_compile():
                compiler().wait(lambda: self._tell("waiting for the compiler"))
            return True
        if 0 < iteration < self.at and self._will_compile():
            compiler()
        return False


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()
    assert process.stdin is not None
    process.stdin.close()


def _end_with_parent() -> None:
    sys.stdin.read()
    os._exit(1)


if __name__ == "__main__":
    threading.Thread(target=_end_with_parent, daemon=True).start()
    compile_all("cpu")
