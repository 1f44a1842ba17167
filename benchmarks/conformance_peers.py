"""Runs other libraries, and holoview, on the conformance set: the table in docs/conformance.md.

    python -m benchmarks.conformance_peers

A library that isn't installed is left out; benchmarks/README.md says how to install odak and torchoptics beside
holoview, and diffractsim likewise: pip install --no-deps diffractsim==2.2.13 progressbar. Each is called as its
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
from holoview.wavefield.conformance import Case, all_cases
from holoview.wavefield.conformance_score import error_of

Adapter = Callable[[Case], np.ndarray]


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
    """`asm_propagate` or `transfer_propagate` with the padding that `compute_padding_exact` asks for, up to a grid of
    2048 samples; x64 as JAX's switch says."""
    import jax
    from chromatix import Field
    from chromatix.functional import asm_propagate, compute_padding_exact, transfer_propagate

    function = transfer_propagate if method.startswith("transfer") else asm_propagate

    def propagate(case: Case) -> np.ndarray:
        n, z, λ, pitch_m = len(case.field), case.distance_m, case.wavelength_m, case.pitch_m
        asked = int(compute_padding_exact(n, λ, pitch_m, abs(z))) if z else 0
        with jax.enable_x64("x64" in method):
            field = Field.build(jax.numpy.asarray(case.field), pitch_m, λ)
            return np.asarray(function(field, z, 1.0, pad_width=min(asked, (2048 - n) // 2), mode="same").u)

    return propagate


PEERS: dict[str, tuple[Callable[[str], Adapter], tuple[str, ...]]] = {
    "odak": (odak, ("Bandlimited Angular Spectrum", "Angular Spectrum", "Transfer Function Fresnel")),
    "torchoptics": (torchoptics, ("AUTO", "ASM", "DIM")),
    "diffractsim": (diffractsim, ("propagate",)),
    "chromatix": (chromatix, ("asm_propagate, x64", "asm_propagate", "transfer_propagate, x64")),
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
