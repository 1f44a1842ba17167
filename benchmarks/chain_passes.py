"""An iteration of the optimiser of chains of elements by torch's own derivatives and by compiled passes.

Processor seconds of both in turn in one process, and the peak memory of each in a process of its own, above what is
resident once libraries, machine code and target are loaded. A bench of the short form is also computed as a chain of
the same light. The target is noise, since times don't depend on it.

    OMP_NUM_THREADS=1 python -m benchmarks.chain_passes
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np
import torch

import holoview as hv
from benchmarks.common import count_of, markdown_table
from benchmarks.optimiser_memory import highest_mb, reset_peak
from holoview.holograms.optimise.chain_loop import ChainPatterns, ChainProblem
from holoview.holograms.optimise.checkpoint import IterationState
from holoview.holograms.optimise.compiled_model import CompiledKernels
from holoview.holograms.optimise.kernel_choice import load_kernels
from holoview.holograms.optimise.propagation import TORCH_KERNELS
from holoview.light.model import preset
from holoview.light.model.system import System

_KERNELS = {"torch": TORCH_KERNELS, "compiled": CompiledKernels()}
_SETTINGS = hv.Settings(iterations=10_000, free=("patterns",), drawn_planes=0)
_AS_CHAIN, _SHAPE = ("holochrome-8", "holochrome-8-1slm"), (192, 256)


def main() -> None:
    """Prints a row for each bench."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    chains = [name for name in preset.names() if preset.load(name).is_chain]
    parser.add_argument("--presets", nargs="+", default=[*_AS_CHAIN, *chains])
    parser.add_argument("--rounds", type=count_of, default=7)
    parser.add_argument("--peak", choices=_KERNELS, help="print the peak memory of the first preset, and nothing else")
    args = parser.parse_args()
    torch.set_num_threads(1)
    if args.peak:
        print(_peak_mb(args.presets[0], args.peak))
        return
    print(
        markdown_table(["bench", "torch", "compiled", "short form", "torch MB", "compiled MB"], _rows(args)), flush=True
    )


def _rows(args: argparse.Namespace) -> list[list[str]]:
    rows = []
    for name in args.presets:
        steps = {kernels: _steps(_chain(name), kernels) for kernels in _KERNELS}
        if not preset.load(name).is_chain:
            steps["short form"] = _short_form(preset.load(name).with_(shape=_SHAPE))
        seconds = _in_turn(steps, args.rounds)
        cells = [f"{seconds[way]:.3f}" if way in seconds else "" for way in (*_KERNELS, "short form")]
        rows.append([name, *cells, *(f"{_in_process(name, kernels):.0f}" for kernels in _KERNELS)])
    return rows


def _chain(name: str) -> System:
    """A preset as a chain: one of the short form is computed as such where an element states its step."""
    system = preset.load(name)
    if system.is_chain:
        return system
    return system.with_(shape=_SHAPE).edit({f"elements.{system.element_names[0]}.step": 0.1})


def _stack(system: System) -> np.ndarray:
    shape = (len(system.planes_m), *system.way.shape, 3)
    return np.random.default_rng(0).random(shape, dtype=np.float32)


def _steps(system: System, kernels: str) -> Callable[[], None]:
    """What takes one iteration."""
    problem = ChainProblem(system, _stack(system), _SETTINGS, kernels=_KERNELS[kernels])
    patterns, amplitudes = ChainPatterns(system, _SETTINGS, None), np.array(system.amplitudes)

    def step() -> None:
        found = problem.evaluate(patterns.shown(), amplitudes)
        loss, image = problem.loss(found, amplitudes)
        problem.objective.psnr_db(image)
        problem.light(found.intensity, amplitudes)
        problem.eyebox_variation(found, amplitudes)
        patterns.step(torch.autograd.grad(loss, patterns.variables), 1.0)

    return step


def _short_form(system: System) -> Callable[[], None]:
    states: Iterator[IterationState] = iter(hv.iterate(system, _stack(system), _SETTINGS))
    return lambda: (next(states), None)[1]


def _in_turn(steps: dict[str, Callable[[], None]], rounds: int) -> dict[str, float]:
    """Median processor seconds of each, after a round that isn't timed."""
    seconds: dict[str, list[float]] = {name: [] for name in steps}
    for _ in range(rounds + 1):
        for name, step in steps.items():
            started = time.process_time()
            step()
            seconds[name].append(time.process_time() - started)
    return {name: statistics.median(times[1:]) for name, times in seconds.items()}


def _peak_mb(name: str, kernels: str) -> float:
    system = _chain(name)
    _stack(system)
    load_kernels("cpu")
    before, step = reset_peak(), _steps(system, kernels)
    for _ in range(3):
        step()
    return highest_mb() - before


def _in_process(name: str, kernels: str) -> float:
    command = [sys.executable, "-m", "benchmarks.chain_passes", "--presets", name, "--peak", kernels]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


if __name__ == "__main__":
    main()
