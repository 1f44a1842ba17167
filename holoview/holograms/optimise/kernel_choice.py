"""Chooses between torch and compiled kernels: the faster on this machine, measured once and remembered."""

from __future__ import annotations

import json
import platform
import time
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

import torch

from holoview.holograms.optimise.forward_model import ForwardModel
from holoview.holograms.optimise.kernels import TORCH_KERNELS, CompiledKernels, Kernels
from holoview.holograms.optimise.propagation import PlanePropagation
from holoview.light.model import preset
from holoview.light.model.plan import make_plan
from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.files import cache_dir

_FORMAT = 2
"""Of the file of choices; to be increased when kernels become faster or slower."""
_FILE = "optimiser-kernels.json"
_PRESET, _SHAPE = "holochrome-8", (96, 128)
_ROUNDS = 5


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
    return CompiledKernels() if chosen == CompiledKernels.name else TORCH_KERNELS


def will_compile(device: str) -> bool:
    """Whether `choose_kernels` has yet to compile and time the kernels for a torch device, which takes seconds."""
    return torch.device(device).type == "cpu" and find_spec("numba") is not None and _remembered_name() is None


def _faster_name() -> str:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # as in a thread of the team
    try:
        rivals = (TORCH_KERNELS, CompiledKernels())
        seconds = {kernels.name: [_seconds(kernels) for _ in range(_ROUNDS)] for kernels in rivals}
    except Exception:  # any failure of a compiler on an untried machine
        return TORCH_KERNELS.name
    finally:
        torch.set_num_threads(threads)
    return min(seconds, key=lambda name: min(seconds[name][1:]))  # the first round compiles


def _seconds(kernels: Kernels) -> float:
    """Processor time of this thread for the loss of a display and its gradient, of equal pixels."""
    system = preset.load(_PRESET).with_(shape=_SHAPE, propagation="compact", planes=["10 mm", "11 mm"])
    model = ForwardModel(make_plan(system), kernels=kernels)
    opd_m = torch.zeros(1, 2, *_SHAPE)
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


def _key() -> str:
    """Everything that the times depend on."""
    versions = [version(library) for library in ("numba", "torch")]
    return json.dumps([_FORMAT, platform.node(), platform.machine(), *versions])


def _remembered_name() -> str | None:
    name = _remembered().get(_key())
    return name if name in (TORCH_KERNELS.name, CompiledKernels.name) else None


def _remembered() -> dict[str, Any]:
    try:
        entries = json.loads((cache_dir() / _FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return entries if isinstance(entries, dict) else {}


def _remember(name: str) -> None:
    path = cache_dir() / _FILE
    with suppress(OSError, UserError):  # a folder that can't be written: the next run measures again
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, json.dumps(_remembered() | {_key(): name}, indent=1, sort_keys=True), is_durable=False)
