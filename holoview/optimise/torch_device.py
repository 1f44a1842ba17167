"""Which torch device to optimise on."""

from __future__ import annotations

import torch

from holoview.util.errors import UserError


def resolve_torch_device(name: str = "auto") -> str:
    """A torch device that works: "cpu", "cuda", "cuda:1", "mps"; "auto" is CUDA, else MPS, else the processor.

    Raises UserError, with those that there are, when it isn't available or can't transform complex numbers.
    """
    present = _present()
    if name == "auto":
        return present[0]
    if name.split(":")[0] not in {device.split(":")[0] for device in present}:
        raise UserError("device", f'"{name}" isn\'t available', expected=f"one of {', '.join(present)}")
    try:
        torch.fft.fft2(torch.ones(4, 4, dtype=torch.complex64, device=name))
    except (RuntimeError, AssertionError) as error:
        text = str(error).splitlines()[0]
        raise UserError("device", f'"{name}" doesn\'t work: {text}', expected=f"one of {', '.join(present)}") from error
    return name


def _present() -> list[str]:
    cuda = ["cuda"] if torch.cuda.is_available() else []
    mps = ["mps"] if torch.backends.mps.is_available() else []
    return [*cuda, *mps, "cpu"]
