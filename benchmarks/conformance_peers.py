"""Runs other libraries, and holoview, on the conformance set: the table in docs/conformance.md.

    python -m benchmarks.conformance_peers

A library that isn't installed is left out; benchmarks/README.md says how to install odak and torchoptics beside
holoview, and diffractsim likewise: pip install --no-deps diffractsim==2.2.13 progressbar. chromatix 0.5 isn't published
as a package: it is installed from its repository, with Python 3.12. Each is called as its
documentation shows, on the case's samples, with complex128 numbers. Each method of a library has a row, and every case
counts, those too for which its authors wouldn't have chosen it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
import torch

from holoview.commands.conformance import propagated
from holoview.evidence.conformance.cases import Case, all_cases
from holoview.evidence.conformance.score import error_of
from holoview.holograms.fields.field_bench import bench_of_field
from holoview.holograms.fields.wavefield import Wavefield
from holoview.light.engine.wgpu_executor import WgpuExecutor
from holoview.light.gpu.device import open_device
from holoview.light.model.plan import make_plan
from holoview.light.optics.frame_inputs import FrameInputs

Adapter = Callable[[Case], np.ndarray]


def shaders() -> Adapter:
    """A frame of the field in WGSL shaders, on a grid of twice the field's side as every frame has."""
    device = open_device()

    def propagate(case: Case) -> np.ndarray:
        values = case.field[None, None].astype(np.complex64)
        field = Wavefield(values, (case.pitch_m, case.pitch_m), np.array([case.wavelength_m]))
        plan = make_plan(bench_of_field(field), [case.distance_m])
        executor = WgpuExecutor(plan, FrameInputs(plan, values), device)
        behind = executor.modulate(executor.illuminate(0, 0), 0, 0, 0)
        spectrum = executor.transmit(executor.spectrum(behind, 0), 1, 0)
        return executor.download_field(executor.field(spectrum, 1))

    return propagate


def odak(method: str) -> Adapter:
    """`propagate_beam` with its own padding to twice the size."""
    from odak.learn.wave import propagate_beam

    def propagate(case: Case) -> np.ndarray:
        field, λ = torch.from_numpy(case.field), case.wavelength_m
        options: dict[str, Any] = {"propagation_type": method, "zero_padding": [True, False, True]}
        return propagate_beam(field, 2 * math.pi / λ, case.distance_m, case.pitch_m, λ, **options).numpy()

    return propagate


def torchoptics(method: str) -> Adapter:
    """`Field.propagate_to_z`; its padding is its own."""
    from torchoptics import Field

    def propagate(case: Case) -> np.ndarray:
        field = Field(torch.from_numpy(case.field), wavelength=case.wavelength_m, z=0, spacing=case.pitch_m)
        return field.propagate_to_z(case.distance_m, propagation_method=method).data.numpy()

    return propagate


def diffractsim(method: str) -> Adapter:
    """`MonochromaticField.propagate`, which doesn't pad."""
    from diffractsim import MonochromaticField

    def propagate(case: Case) -> np.ndarray:
        n = len(case.field)
        field = MonochromaticField(case.wavelength_m, n * case.pitch_m, n * case.pitch_m, n, n)
        field.E = case.field.copy()
        field.propagate(case.distance_m)
        return np.asarray(field.E)

    return propagate


def chromatix(method: str) -> Adapter:
    """A function of `chromatix.functional` with the padding that `compute_padding_exact` asks for, up to 2048 samples a
    side; with JAX's switch x64, or without, and with an option of the function perhaps."""
    import jax
    from chromatix import Field, functional

    name, *options = method.split(", ")
    switched_on = {option: True for option in options if option != "x64"}

    def propagate(case: Case) -> np.ndarray:
        n, z, λ, pitch_m = len(case.field), case.distance_m, case.wavelength_m, case.pitch_m
        asked = int(functional.compute_padding_exact(n, λ, pitch_m, abs(z))) if z else 0
        pad_width = min(asked, (2048 - n) // 2)
        with jax.enable_x64("x64" in options):
            field = Field.build(jax.numpy.asarray(case.field), pitch_m, λ)
            found = getattr(functional, name)(field, z, 1.0, pad_width=pad_width, mode="same", **switched_on)
            return np.asarray(found.u)

    return propagate


PEERS: dict[str, tuple[Callable[[str], Adapter], tuple[str, ...]]] = {
    "odak": (odak, ("Bandlimited Angular Spectrum", "Angular Spectrum", "Transfer Function Fresnel")),
    "torchoptics": (torchoptics, ("AUTO", "ASM", "DIM")),
    "diffractsim": (diffractsim, ("propagate",)),
    "chromatix": (
        chromatix,
        ("asm_propagate", "asm_propagate, x64", "asm_propagate, x64, remove_evanescent", "transfer_propagate, x64"),
    ),
}


def row(name: str, adapter: Adapter, cases: list[Case], families: list[str]) -> str:
    """Cases that passed of each family, and of all; an exception counts as failed."""
    passed = dict.fromkeys(families, 0)
    errors = []
    for case in cases:
        try:
            error = error_of(adapter(case), case.answer, case.indices)
        except Exception as problem:  # of somebody else's library, whatever it is
            print(f"{name}, {case.name}: {type(problem).__name__}: {problem}")
            error = math.inf
        passed[case.family] += error <= case.tolerance
        errors.append(error)
    cells = [f"{passed[family]}" for family in families]
    within = sum(error <= 1e-2 for error in errors)
    return f"| {name} | {' | '.join(cells)} | {sum(passed.values())} | {within} | {np.median(errors):.1e} |"


def main() -> None:
    """Prints the table."""
    cases = all_cases()
    families = list(dict.fromkeys(case.family for case in cases))
    counts = [f"{family} ({sum(case.family == family for case in cases)})" for family in families]
    print(f"| program | {' | '.join(counts)} | all ({len(cases)}) | error below 1 % | median error |")
    print("| --- " * (len(families) + 4) + "|")
    print(row("holoview, complex64", propagated, cases, families), flush=True)
    print(row("holoview, a frame in shaders", shaders(), cases, families), flush=True)
    for library, (make, methods) in PEERS.items():
        try:
            installed = version(library)
        except PackageNotFoundError:
            print(f"{library} isn't installed")
            continue
        for method in methods:
            print(row(f"{library} {installed}, {method}", make(method), cases, families), flush=True)


if __name__ == "__main__":
    main()
