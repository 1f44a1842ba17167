"""Chooses the torch device for an optimisation."""

from __future__ import annotations

import torch

from holoview.util.errors import UserError


def resolve_torch_device(name: str = "auto") -> str:
    """A torch device that works: "cpu", "cuda", "cuda:1" or "mps"; "auto" is CUDA, else MPS, else the CPU.

    Raises UserError that lists the available devices when this one isn't available or has no complex FFT.
    """
    available = _available_devices()
    if name == "auto":
        return available[0]
    if name.split(":")[0] not in available:
        raise UserError("device", f'"{name}" isn\'t available', expected=f"one of {', '.join(available)}")
    try:
        torch.fft.fft2(torch.ones(4, 4, dtype=torch.complex64, device=name))
    except (RuntimeError, AssertionError) as error:
        text = str(error).splitlines()[0]
        raise UserError(
            "device", f'"{name}" doesn\'t work: {text}', expected=f"one of {', '.join(available)}"
        ) from error
    return name


def _available_devices() -> list[str]:
    cuda = ["cuda"] if torch.cuda.is_available() else []
    mps = ["mps"] if torch.backends.mps.is_available() else []
    return [*cuda, *mps, "cpu"]
